import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from browser import FAILING_WEBGL, NO_WEBGL, PLAYS, address, in_a_browser, opened

from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import Gait
from drake_gait.problem import Candidate
from drake_gait.simulation.simulate import simulate
from drake_gait.visualization.meshcat import floor_extent
from drake_gait.visualization.recording import Exhibit, record, record_gallery
from drake_gait.walk import Walk


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
        if field.name != "schedule"
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
    with pytest.raises(GaitError, match=r"recording .*nowhere"):
        record(walk, candidate, tmp_path / "nowhere" / "walk.html")


def test_a_gallery_shares_one_page_and_names_every_walk(
    walk: Walk, candidate: Candidate, page: Path, tmp_path: Path
) -> None:
    path = tmp_path / "gallery.html"
    names = ["seed 0", "seed 1 </script>"]
    exhibits = [Exhibit(walk=walk, candidate=candidate, label=name) for name in names]
    record_gallery(exhibits, path, caption="Two of them")
    text = path.read_text(encoding="utf-8")
    assert '"seed 0"' in text
    assert "seed 1 </script>" not in text
    assert path.stat().st_size < 1.5 * page.stat().st_size


def test_a_gallery_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="at least one walk"):
        record_gallery([], tmp_path / "gallery.html")


REFUSED = ".walk-refused"


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize("lacking", [NO_WEBGL, FAILING_WEBGL])
def test_a_recording_is_one_sentence_where_nothing_draws_in_three_dimensions(
    page: Path, lacking: str
) -> None:
    with opened(address(page), lacking=lacking) as seen:
        said = seen.page.inner_text("body")
        assert "WebGL 2" in said
        assert said == seen.page.inner_text(REFUSED)
        assert said.count(".") == 1
        assert seen.complaints == []
        assert seen.requests == [address(page)]


@pytest.mark.slow
@in_a_browser
def test_a_recording_is_one_sentence_without_scripts(page: Path) -> None:
    with opened(address(page), scripts=False) as seen:
        visible = [text for text in seen.page.locator("body > *").all() if text.is_visible()]
        (said,) = (text.inner_text() for text in visible)
        assert "scripts" in said
        assert "WebGL" not in said


@pytest.mark.slow
@in_a_browser
def test_a_recording_says_when_its_drawing_is_lost_and_not_when_it_is_back(page: Path) -> None:
    lose = "viewer.renderer.getContext().getExtension('WEBGL_lose_context')"
    with opened(address(page)) as seen:
        seen.page.wait_for_function(PLAYS)
        assert not seen.page.is_visible("#walk-lost")
        seen.page.evaluate(f"window.switch = {lose}, window.switch.loseContext()")
        seen.page.wait_for_selector("#walk-lost", state="visible")
        assert "reload" in seen.page.inner_text("#walk-lost")
        seen.page.evaluate("window.switch.restoreContext()")
        seen.page.wait_for_selector("#walk-lost", state="hidden")


RESTS = "document.querySelector('#walk-panel button').textContent === 'Play'"
MIDDLE = {"x": 0, "y": 30, "width": 1000, "height": 550}  # above the panel, where time is shown


@pytest.mark.slow
@in_a_browser
def test_a_recording_plays_at_once_in_real_time_without_a_network(page: Path) -> None:
    with opened(address(page)) as seen:
        seen.page.wait_for_function(PLAYS)
        first, begun = seen.shot(**MIDDLE), seen.page.evaluate("[viewer.animator.time, Date.now()]")
        seen.page.wait_for_timeout(700)
        second, ended = (
            seen.shot(**MIDDLE),
            seen.page.evaluate("[viewer.animator.time, Date.now()]"),
        )
        duration = seen.page.evaluate("viewer.animator.duration")
        played = (ended[0] - begun[0]) % duration
        assert played == pytest.approx((ended[1] - begun[1]) / 1e3 % duration, abs=0.3)
        assert len(np.unique(first.reshape(-1, 3), axis=0)) > 100  # not blank
        assert (np.abs(first - second).max(axis=2) > 0.1).mean() > 0.01  # it moves
        assert seen.complaints == []
        assert seen.requests == [address(page)]


@pytest.mark.slow
@in_a_browser
def test_a_time_in_the_address_opens_the_recording_at_rest(page: Path) -> None:
    with opened(f"{address(page)}#t=0.5") as seen:
        seen.page.wait_for_function(f"{PLAYS} && {RESTS}")
        seen.page.wait_for_function("viewer.animator.time === 0.5")
        first = seen.shot()
        seen.page.wait_for_timeout(300)
        np.testing.assert_array_equal(seen.shot(), first)
        assert seen.page.inner_text("output") == "0.50 s"


@pytest.mark.slow
@in_a_browser
def test_the_slider_stops_the_walk_where_it_is_put(page: Path) -> None:
    with opened(address(page)) as seen:
        seen.page.wait_for_function(f"{PLAYS} && viewer.animator.time > 0")
        seen.page.fill("input[type=range]", "0.4")
        seen.page.wait_for_function(f"viewer.animator.playing === false && {RESTS}")
        assert seen.page.evaluate("viewer.animator.time") == pytest.approx(0.4)


@pytest.mark.slow
@in_a_browser
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)], ids=["desk", "phone"])
def test_the_whole_floor_is_seen_above_the_panel(
    walk: Walk, page: Path, width: int, height: int
) -> None:
    assert walk.history is not None
    lower, upper = floor_extent(walk.history)
    corners = [
        [x, z, -y] for x in (lower[0], upper[0]) for y in (lower[1], upper[1]) for z in (0.0, 0.4)
    ]
    with opened(address(page), width=width, height=height) as seen:
        seen.page.wait_for_function(f"{PLAYS} && viewer.animator.time > 0.1")
        places = seen.page.evaluate(
            """corners => corners.map(corner => {
                const seen = viewer.camera.position.clone().set(...corner).project(viewer.camera);
                return [(1 + seen.x) / 2 * innerWidth, (1 - seen.y) / 2 * innerHeight];
            })""",
            corners,
        )
        panel = seen.page.locator("#walk-panel").bounding_box()
        assert panel is not None
    across, down = np.array(places).T
    assert across.min() >= 0
    assert across.max() <= width
    assert down.min() >= 0
    assert down.max() <= panel["y"]


@pytest.mark.slow
@in_a_browser
def test_the_names_in_a_gallery_hide_neither_each_other_nor_a_robot_at_the_start(
    walk: Walk, candidate: Candidate, tmp_path: Path
) -> None:
    path = tmp_path / "gallery.html"
    names = ["seed 0, walk 97: 305.0 mm", "seed 1, walk 131: 297.4 mm", "seed 2, walk 7: 30.0 mm"]
    record_gallery([Exhibit(walk=walk, candidate=candidate, label=name) for name in names], path)
    with opened(f"{address(path)}#t=0", width=1280, height=800) as seen:
        seen.page.wait_for_function(f"{PLAYS} && {RESTS}")
        boxes, robots = seen.page.evaluate(
            """async () => {
                const frame = () => new Promise(requestAnimationFrame);
                await frame().then(frame);  // drawn with the last part, and the names put there
                const boxes = [...document.querySelectorAll(".walk-label")].map(
                    label => label.getBoundingClientRect().toJSON());
                const heads = [];
                viewer.scene.traverse(object => {
                    if (object.name !== "torso") return;
                    const [x, y, z] = object.matrixWorld.elements.slice(12, 15);
                    const seen = viewer.camera.position.clone().set(x, y, z);
                    heads.push((1 + seen.project(viewer.camera).x) / 2 * innerWidth);
                });
                return [boxes, heads];
            }"""
        )
    assert len(boxes) == len(robots) == len(names)
    for (nearer, box), robot in zip(enumerate(boxes), robots, strict=True):
        assert robot < box["x"]
        assert box["x"] + box["width"] <= 1280
        for other in boxes[:nearer]:
            assert box["y"] + box["height"] <= other["y"]
