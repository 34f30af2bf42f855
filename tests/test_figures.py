import dataclasses
import itertools
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.image import imread

from drake_gait import figures
from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import FRAME_TIME, FRAMES, STANDING, Gait
from drake_gait.walk import History

OUTPUTS = [("distance", "mm"), ("lateral", "mm"), ("yaw", "deg")]


@pytest.fixture(scope="module")
def history() -> History:
    """A made-up walk: 160 mm forward, the joints 5 degrees off the command."""
    n = FRAMES + 1
    time = np.arange(n) * FRAME_TIME
    commands = Gait.from_degrees(
        [[0, -1.5, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]]
    ).commands
    com = np.stack([0.16 * time / time[-1], 0.01 * np.sin(time), np.full(n, 0.245)], axis=1)
    weight = 7.35 * (1.0 + np.stack([np.sin(5 * time), -np.sin(5 * time)], axis=1))
    return History(
        time=time,
        positions=np.zeros((n, 21)),
        com=com,
        torso=np.zeros((n, 6)),
        ankles=com[:, None] + np.array([[0.0, -0.0457, -0.18], [0.0, 0.0457, -0.18]]),
        commands=commands,
        angles=commands - np.radians(5.0),
        speeds=np.zeros((n, 10)),
        torques=np.sin(time)[:, None] * np.linspace(0.2, 1.0, 10),
        toes=np.zeros((n, 4)),
        sole_height=np.zeros((n, 2)),
        ground_reaction=weight[:, :, None] * np.array([0.0, 0.0, 1.0]),
    )


def texts(svg: Path) -> list[str]:
    """Every piece of text in a drawing."""
    root = ElementTree.parse(svg).getroot()
    found = ("".join(node.itertext()).strip() for node in root.iter() if node.tag.endswith("text"))
    return [text for text in found if text]


def test_every_figure_of_a_walk_is_a_png_one_column_wide(history: History, tmp_path: Path) -> None:
    figures.waveforms(history, tmp_path / "waveforms.png")
    figures.paths(history, tmp_path / "paths.png")
    figures.ground_reaction(history, tmp_path / "ground_reaction.png")
    figures.torques(history, tmp_path / "torques.png", 1.373)
    for path in sorted(tmp_path.iterdir()):
        picture = imread(path)[..., :3]
        assert picture.shape[1] == round(figures.COLUMN * figures.PNG_RESOLUTION)
        assert 0.5 < picture.mean() < 0.999, f"{path.name} is blank"


def test_waveforms_show_the_second_cycle_with_units(history: History, tmp_path: Path) -> None:
    path = tmp_path / "waveforms.svg"
    figures.waveforms(history, path)
    shown = texts(path)
    for label in ("roll [deg]", "hip [deg]", "knee [deg]", "ankle [deg]", "time [s]"):
        assert label in shown
    assert {"1.2", "2.4"} <= set(shown)


def test_frames_of_a_cycle_begin_at_its_start_and_end_before_the_next() -> None:
    time = np.arange(FRAMES + 1) * FRAME_TIME
    frames = np.flatnonzero(figures._between(time, 1.2, 2.4))
    np.testing.assert_array_equal(frames, np.arange(60, 120))


def test_paths_have_one_scale_in_both_directions_and_millimetres(
    history: History, tmp_path: Path
) -> None:
    path = tmp_path / "paths.svg"
    figures.paths(history, path)
    assert {"forward [mm]", "lateral, left positive [mm]", "centre of mass"} <= set(texts(path))


def test_postures_name_the_five_phases_of_the_gait(history: History, tmp_path: Path) -> None:
    legs = np.broadcast_to([0.0, 0.05, 0.1], (FRAMES + 1, 2, 7, 3))
    path = tmp_path / "postures.svg"
    figures.postures(history, legs, path)
    assert {"1.2 s, initial contact", "2.1 s, initial swing", "height [mm]"} <= set(texts(path))


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "lean"),
    [
        (0.0, 0.0, 1.0, (0.0, 0.0)),
        (0.1, 0.0, 0.0, (0.0, -0.1)),
        (0.0, 0.1, 0.0, (0.1, 0.0)),
        (0.0, 0.1, np.pi / 2.0, (0.0, 0.1)),
    ],
    ids=["turned", "rolled to the right", "pitched forward", "pitched and turned to the left"],
)
def test_the_head_leans_as_the_torso_does(
    history: History, roll: float, pitch: float, yaw: float, lean: tuple[float, float]
) -> None:
    torso = np.array([[0.0, 0.0, 0.235, roll, pitch, yaw]])
    head = figures._head(dataclasses.replace(history, torso=torso), 0)
    np.testing.assert_allclose(head[:2], figures._HEAD_ABOVE_TORSO * np.sin(lean), atol=1e-12)


def test_the_same_data_give_the_same_file(history: History, tmp_path: Path) -> None:
    for name in ("a.png", "b.png", "a.svg", "b.svg"):
        figures.paths(history, tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_a_robot_standing_still_can_be_drawn(history: History, tmp_path: Path) -> None:
    still = History(
        **{
            name: np.repeat(np.asarray(getattr(history, name))[:1], FRAMES + 1, axis=0)
            for name in vars(history)
            if name not in ("time", "commands")
        },
        time=history.time,
        commands=STANDING.commands,
    )
    figures.paths(still, tmp_path / "paths.png")
    figures.waveforms(still, tmp_path / "waveforms.png")


def test_a_walk_that_fell_before_the_second_cycle_can_be_drawn(
    history: History, tmp_path: Path
) -> None:
    fell = History(**{name: getattr(history, name)[:40] for name in vars(history)})
    figures.waveforms(fell, tmp_path / "waveforms.png")
    figures.ground_reaction(fell, tmp_path / "ground_reaction.png")


@pytest.mark.parametrize(
    ("forward_mm", "feasible"),
    [
        ([], []),
        ([np.nan, np.nan], [False, False]),
        ([100.0, np.nan, 150.0, 120.0], [False, False, True, False]),
        ([100.0, 120.0], [True, True]),
    ],
    ids=["no walk yet", "all fell", "mixed", "all feasible"],
)
def test_convergence_is_drawn_at_any_stage_of_a_study(
    forward_mm: list[float], feasible: list[bool], tmp_path: Path
) -> None:
    path = tmp_path / "convergence.svg"
    figures.convergence(forward_mm, feasible, path, samples=1)
    assert {"walk", "distance walked [mm]"} <= set(texts(path))
    assert ("fell" in texts(path)) == bool(np.isnan(forward_mm).any())


def test_the_best_feasible_walk_never_gets_worse() -> None:
    forward = np.array([90.0, np.nan, 120.0, 100.0, 150.0])
    best = figures._best_so_far(forward, np.array([False, False, True, True, True]))
    np.testing.assert_array_equal(best, [np.nan, np.nan, 120.0, 120.0, 150.0])


def test_convergence_refuses_flags_of_another_length(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="one flag for each walk"):
        figures.convergence([1.0, 2.0], [True], tmp_path / "convergence.png", samples=1)


def test_each_output_gets_a_panel_with_its_unit_and_both_scores(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    simulated = rng.normal(size=(30, 3))
    heldout = simulated + 0.5
    heldout[:20] = np.nan  # walks that every network has seen
    path = tmp_path / "predicted.svg"
    figures.predicted_against_simulated(
        simulated, simulated, heldout, [0.97, 0.96, 0.95], [0.5, 0.25, -0.125], OUTPUTS, path
    )
    shown = texts(path)
    for name, unit in OUTPUTS:
        assert {name, f"simulated [{unit}]", f"predicted [{unit}]"} <= set(shown)
    assert {"R² training 0.97", "R² held out -0.12"} <= set(shown)


def test_predictions_of_another_shape_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="held out"):
        figures.predicted_against_simulated(
            np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((2, 3)), [0] * 3, [0] * 3, OUTPUTS,
            tmp_path / "predicted.png",
        )  # fmt: skip


def test_a_figure_that_cannot_be_written_is_named(history: History, tmp_path: Path) -> None:
    with pytest.raises(GaitError, match=r"cannot write the figure .*nowhere"):
        figures.paths(history, tmp_path / "nowhere" / "paths.png")
    with pytest.raises(SettingsError, match="docx"):
        figures.paths(history, tmp_path / "paths.docx")


def test_right_left_and_centre_of_mass_differ_in_lightness_or_hue_for_everyone() -> None:
    # Okabe and Ito (2008) chose their colours to remain apart for all common kinds of colour
    # blindness; any other colour would have to be shown to.
    okabe_ito = {"#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7"}
    used = [figures.RIGHT, figures.LEFT, figures.COM]
    assert set(used) <= okabe_ito
    assert all(a != b for a, b in itertools.combinations(used, 2))
