import dataclasses
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from drake_gait import recording
from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import Gait
from drake_gait.problem import Candidate
from drake_gait.recording import record
from drake_gait.simulation import simulate
from drake_gait.walk import Walk

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="module")
def candidate() -> Candidate:
    return Candidate(
        gait=Gait.from_degrees([[0, -1.5, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]])
    )


@pytest.fixture(scope="module")
def walk(candidate: Candidate) -> Walk:
    return simulate(candidate, history=True)


@pytest.fixture(scope="module")
def page(walk: Walk, candidate: Candidate, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "walk.html"
    record(walk, candidate, path, caption="Walk 7 & its <foot>")
    return path


def test_a_recording_is_one_page_of_less_than_six_megabytes(page: Path) -> None:
    assert [path.name for path in page.parent.iterdir()] == ["walk.html"]
    assert page.stat().st_size < 6e6


def test_a_recording_loads_nothing_from_elsewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    loads = re.findall(
        r"""<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=["']?([^"'\s>]+)""", text
    )
    assert all(load.startswith("data:") for load in loads)
    assert "Drake MeshCat" not in text


def test_a_caption_is_text_not_markup(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "<title>Walk 7 &amp; its &lt;foot&gt;</title>" in text
    assert "<strong>Walk 7 &amp; its &lt;foot&gt;</strong>" in text


def test_a_walk_recorded_twice_gives_the_same_page(
    walk: Walk, candidate: Candidate, page: Path, tmp_path: Path
) -> None:
    again = tmp_path / "again.html"
    record(walk, candidate, again, caption="Walk 7 & its <foot>")
    assert again.read_bytes() == page.read_bytes()


def test_a_walk_that_fell_is_recorded_up_to_its_fall(
    walk: Walk, candidate: Candidate, page: Path, tmp_path: Path
) -> None:
    assert walk.history is not None
    columns = {
        field.name: getattr(walk.history, field.name)[:60]
        for field in dataclasses.fields(walk.history)
    }
    fallen = dataclasses.replace(walk, history=dataclasses.replace(walk.history, **columns))
    path = tmp_path / "fallen.html"
    record(fallen, candidate, path)
    assert path.stat().st_size < page.stat().st_size


def test_a_walk_without_a_history_is_refused_with_the_cure(
    walk: Walk, candidate: Candidate, tmp_path: Path
) -> None:
    bare = dataclasses.replace(walk, history=None)
    with pytest.raises(SettingsError, match="history=True"):
        record(bare, candidate, tmp_path / "walk.html")
    assert not list(tmp_path.iterdir())


def test_positions_of_another_robot_are_refused(
    walk: Walk, candidate: Candidate, tmp_path: Path
) -> None:
    assert walk.history is not None
    history = dataclasses.replace(walk.history, positions=walk.history.positions[:, :20])
    with pytest.raises(SettingsError, match="20 positions"):
        record(dataclasses.replace(walk, history=history), candidate, tmp_path / "walk.html")


def test_a_file_that_cannot_be_written_is_named(
    walk: Walk, candidate: Candidate, tmp_path: Path
) -> None:
    with pytest.raises(GaitError, match=r"cannot write the recording .*nowhere"):
        record(walk, candidate, tmp_path / "nowhere" / "walk.html")


def test_no_free_port_is_one_clear_error(
    walk: Walk, candidate: Candidate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_port(_: object) -> None:
        raise RuntimeError("Meshcat failed to open a websocket port.\nand more")

    monkeypatch.setattr(recording, "Meshcat", no_port)
    with pytest.raises(GaitError, match=r"no free port from 7000 to 7999.*websocket port\.$"):
        record(walk, candidate, tmp_path / "walk.html")


def test_a_path_is_drawn_as_a_tube_of_one_radius_around_its_points() -> None:
    angle = np.linspace(0.0, 6.0, 50)
    points = np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=1)
    vertices, faces = recording._tube(points, 0.01)
    distance = np.linalg.norm(vertices.T.reshape(50, 4, 3) - points[:, None], axis=2)
    np.testing.assert_allclose(distance, 0.01)
    assert faces.shape == (3, 8 * 49)
    assert sorted(set(faces.ravel())) == list(range(200))


def test_grid_lines_are_one_spacing_apart_and_fill_the_rectangle() -> None:
    begin, end = recording._grid(np.array([0.0, -0.2]), np.array([0.1, 0.3]), 0.1, 0.0)
    across_x, across_y = (end - begin)[:2] != 0.0
    np.testing.assert_allclose(begin[0, across_y], [0.0, 0.1])
    np.testing.assert_allclose(begin[1, across_x], [-0.2, -0.1, 0.0, 0.1, 0.2, 0.3], atol=1e-12)


def screenshot(page: str, target: Path, milliseconds: int) -> tuple[np.ndarray, str]:
    """What Chromium shows of a page after some virtual time, without a network; and its log."""
    assert CHROMIUM is not None
    run = subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--disable-background-networking",
            "--disable-quic",
            "--disable-sync",
            "--no-first-run",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            "--enable-logging=stderr",
            f"--user-data-dir={target.with_suffix('.profile')}",
            f"--virtual-time-budget={milliseconds}",
            "--window-size=800,600",
            f"--screenshot={target}",
            page,
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return imread(target)[..., :3], run.stderr


# The page without Meshcat's bar at the top and the panel at the bottom, where the time is shown.
SCENE = slice(30, 480)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium on the PATH")
def test_a_recording_plays_in_a_browser_without_a_network(page: Path, tmp_path: Path) -> None:
    first, first_log = screenshot(page.as_uri(), tmp_path / "first.png", 3000)
    second, second_log = screenshot(page.as_uri(), tmp_path / "second.png", 4000)
    assert "CONSOLE" not in first_log + second_log
    assert len(np.unique(first[SCENE].reshape(-1, 3), axis=0)) > 100  # not blank
    assert (np.abs(first - second)[SCENE].max(axis=2) > 0.1).mean() > 0.01  # it moves


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium on the PATH")
def test_a_time_in_the_address_opens_the_recording_at_rest(page: Path, tmp_path: Path) -> None:
    address = f"{page.as_uri()}#t=1.5"
    first, _ = screenshot(address, tmp_path / "first.png", 3000)
    second, _ = screenshot(address, tmp_path / "second.png", 4000)
    np.testing.assert_array_equal(first, second)
