import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import free_port

from drake_gait.errors import GaitError
from drake_gait.visualization import meshcat as scene


def test_no_free_port_is_one_clear_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_port(_: object) -> None:
        raise RuntimeError("Meshcat failed to open a websocket port.\nand more")

    monkeypatch.setattr(scene, "Meshcat", no_port)
    with pytest.raises(GaitError, match=r"7000 to 7999.*\.$"):
        scene.start_meshcat()


def test_a_port_that_is_taken_is_named_with_the_cure() -> None:
    first = scene.start_meshcat()
    with pytest.raises(GaitError, match=rf"port {first.port()}.* --port"):
        scene.start_meshcat(first.port())


def test_without_a_port_the_next_free_one_is_taken() -> None:
    first, second = scene.start_meshcat(), scene.start_meshcat()
    assert first.port() != second.port()


def test_a_path_is_drawn_as_a_tube_of_one_radius_around_its_points() -> None:
    angle = np.linspace(0.0, 6.0, 50)
    points = np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=1)
    vertices, faces = scene._tube(points, 0.01)
    distance = np.linalg.norm(vertices.T.reshape(50, 4, 3) - points[:, None], axis=2)
    np.testing.assert_allclose(distance, 0.01)
    assert faces.shape == (3, 8 * 49)
    assert sorted(set(faces.ravel())) == list(range(200))


def test_grid_lines_are_one_spacing_apart_and_fill_the_rectangle() -> None:
    begin, end = scene._grid(np.array([0.0, -0.2]), np.array([0.1, 0.3]), 0.1, 0.0)
    across_x, across_y = (end - begin)[:2] != 0.0
    np.testing.assert_allclose(begin[0, across_y], [0.0, 0.1])
    np.testing.assert_allclose(begin[1, across_x], [-0.2, -0.1, 0.0, 0.1, 0.2, 0.3], atol=1e-12)


IN_THREADS = """
import asyncio, gc, logging, sys, threading
from pathlib import Path
from drake_gait.visualization import meshcat as scene
from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import STANDING
from drake_gait.visualization.live import Screen
from drake_gait.problem import Candidate
from drake_gait.visualization.recording import Exhibit, record, record_gallery
from drake_gait import simulate

folder, level = Path(sys.argv[1]), logging.getLogger("drake").level
candidate = Candidate(gait=STANDING)
walk = simulate(candidate, history=True)
port, kept = int(sys.argv[2]), []
start = scene.start_meshcat
scene.start_meshcat = lambda asked=None: start(asked or port)


def recorded(name):
    record(walk, candidate, folder / name)


def shown():
    def play(meshcat):
        screen = Screen(meshcat, "khr3hv.sdf", FootDesign())
        for frame in (0, 1):
            screen.show(0.02 * frame, walk.history.positions[frame])

    scene.with_meshcat(play)


def failed():
    try:
        record(walk, candidate, folder / "failed.html", model="khr3hv_rigid.sdf")
    except Exception as error:
        kept.append(error)

    def play(meshcat):
        screen = Screen(meshcat, "khr3hv.sdf", FootDesign())
        try:
            screen.show(0.0, walk.history.positions[0][:3])
        except Exception as error:
            raise KeyboardInterrupt from error

    try:
        scene.with_meshcat(play)
    except KeyboardInterrupt as error:
        kept.append(error)


exhibits = [Exhibit(walk=walk, candidate=candidate, label=str(n)) for n in range(2)]
works = [
    lambda: recorded("thread.html"), shown, failed,
    lambda: record_gallery(exhibits, folder / "gallery.html"),
    lambda: kept.append(start()),  # Nobody but its thread could end it.
]
for work in works:
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    gc.collect()
assert not any("is taken" in str(one) for one in kept), kept  # Each has ended, and freed it.
port = None  # Several draw at once.
kept.clear()
gc.collect()


async def together():
    names = [f"{n}.html" for n in range(3)]
    recorded("loop.html")
    await asyncio.gather(*(asyncio.to_thread(recorded, name) for name in names))


asyncio.run(together())
gc.collect()
pages = {(folder / name).read_text() for name in ("thread.html", "loop.html", "0.html", "2.html")}
assert len(pages) == 1
assert logging.getLogger("drake").level == level
print("ended")
"""


@pytest.mark.slow
def test_a_meshcat_begins_and_ends_in_whichever_thread_draws(tmp_path: Path) -> None:
    # Where one ends in another thread, Drake ends the process with SIGABRT.
    ended = subprocess.run(
        [sys.executable, "-c", IN_THREADS, str(tmp_path), str(free_port())],
        check=False,
        capture_output=True,
        text=True,
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "ended\n", "")


def test_a_port_is_free_again_after_an_error() -> None:
    def work(meshcat: object) -> None:
        raise ZeroDivisionError

    port = free_port()
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            scene.with_meshcat(work, port)
    assert scene.with_meshcat(lambda meshcat: meshcat.port(), port) == port


def test_a_meshcat_that_is_kept_lasts() -> None:
    kept = scene.with_meshcat(lambda meshcat: meshcat)
    with pytest.raises(GaitError, match=f"port {kept.port()}"):
        scene.with_meshcat(lambda meshcat: None, kept.port())
