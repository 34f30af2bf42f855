import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import texts
from matplotlib.image import imread
from numpy.typing import ArrayLike

from drake_gait.errors import SettingsError
from drake_gait.gait import FRAME_TIME, FRAMES, STANDING, FloatArray, Gait
from drake_gait.visualization import human
from drake_gait.visualization import style as figures
from drake_gait.visualization import walk as walk_figures
from drake_gait.visualization.rasterizer import Picture
from drake_gait.walk import History


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


def first(history: History, frames: int) -> History:
    """The first frames of a walk."""
    arrays = {name: value[:frames] for name, value in vars(history).items() if name != "schedule"}
    return dataclasses.replace(history, **arrays)


def test_every_figure_of_a_walk_is_a_png_one_column_wide(history: History, tmp_path: Path) -> None:
    walk_figures.waveforms(history, tmp_path / "waveforms.png")
    walk_figures.paths(history, tmp_path / "paths.png")
    walk_figures.ground_reaction(history, tmp_path / "ground_reaction.png")
    walk_figures.torques(history, tmp_path / "torques.png", np.full(10, 1.373))
    for path in sorted(tmp_path.iterdir()):
        picture = imread(path)[..., :3]
        assert picture.shape[1] == round(figures.COLUMN * figures.PNG_RESOLUTION)
        assert 0.5 < picture.mean() < 0.999, f"{path.name} is blank"


def test_waveforms_show_the_second_cycle_with_units(history: History, tmp_path: Path) -> None:
    path = tmp_path / "waveforms.svg"
    walk_figures.waveforms(history, path)
    shown = texts(path)
    for label in ("roll [deg]", "hip [deg]", "knee [deg]", "ankle [deg]", "time [s]"):
        assert label in shown
    assert {"1.2", "2.4"} <= set(shown)


def test_frames_of_a_cycle_begin_at_its_start_and_end_before_the_next() -> None:
    time = np.arange(FRAMES + 1) * FRAME_TIME
    frames = np.flatnonzero(walk_figures._between(time, 1.2, 2.4))
    np.testing.assert_array_equal(frames, np.arange(60, 120))


def test_paths_have_one_scale_in_both_directions_and_millimetres(
    history: History, tmp_path: Path
) -> None:
    path = tmp_path / "paths.svg"
    walk_figures.paths(history, path)
    assert {"forward [mm]", "lateral, left positive [mm]", "centre of mass"} <= set(texts(path))


@pytest.fixture(scope="module")
def seen() -> list[Picture]:
    """Five pictures of something grey, 200 mm wide and 400 mm high."""
    picture = Picture(pixels=np.full((800, 400, 4), 0.5), left=-0.1, bottom=0.0)
    return [picture] * 5


def test_postures_name_the_five_phases_of_the_gait(
    history: History, seen: list[Picture], tmp_path: Path
) -> None:
    path = tmp_path / "postures.svg"
    walk_figures.postures(history, seen, path)
    assert {"1.2 s, initial contact", "2.1 s, initial swing", "height [mm]"} <= set(texts(path))


def test_postures_name_the_angles_of_the_toes_that_are_bent_more(
    history: History, seen: list[Picture], tmp_path: Path
) -> None:
    toes = np.radians(np.tile([3.0, 2.0, 17.0, 14.0], (FRAMES + 1, 1)))
    path = tmp_path / "postures.svg"
    walk_figures.postures(dataclasses.replace(history, toes=toes), seen, path)
    assert texts(path).count("left toes 17° and 14°") == 5


@pytest.mark.slow
def test_postures_show_the_whole_robot_however_long_its_step(
    history: History, seen: list[Picture], tmp_path: Path
) -> None:
    def least(pictures: list[Picture]) -> float:
        path = tmp_path / "postures.svg"
        walk_figures.postures(history, pictures, path)
        return min(
            float(text.replace("\N{MINUS SIGN}", "-"))
            for text in texts(path)
            if re.fullmatch("\N{MINUS SIGN}?[0-9]+", text)
        )

    long = dataclasses.replace(seen[0], left=-0.3)
    assert least(seen) == -100
    assert least([*seen[:4], long]) <= -200


def test_postures_needs_a_picture_for_each_instant(
    history: History, seen: list[Picture], tmp_path: Path
) -> None:
    with pytest.raises(SettingsError, match="5 pictures, got 4"):
        walk_figures.postures(history, seen[:4], tmp_path / "postures.png")


def test_a_walk_that_fell_shows_its_last_posture_at_the_later_instants(history: History) -> None:
    fell = first(history, 80)
    assert walk_figures.posture_frames(fell) == [60, 75, 79, 79, 79]


def test_the_sway_of_a_walk_along_a_slanted_sinusoid_is_that_sinusoid() -> None:
    time = np.arange(0.3, 3.3, FRAME_TIME)
    lateral = 0.003 + 0.01 * time + 0.02 * np.sin(2.0 * np.pi * time / 1.2 + 0.7)
    fitted, amplitude = walk_figures.sway(time, lateral)
    np.testing.assert_allclose(fitted, lateral, atol=1e-12)
    assert amplitude == pytest.approx(0.02)


def test_the_largest_torque_is_a_share_of_the_joint_s_own_limit(
    history: History, tmp_path: Path
) -> None:
    limits = np.array([2.0, 1.0, 1.0, 1.0, 1.0] * 2)
    torques = np.zeros((FRAMES + 1, 10))
    torques[100, 5], torques[50, 6] = -1.0, 0.8  # left hip roll, left hip pitch
    path = tmp_path / "torques.svg"
    moved = dataclasses.replace(history, torques=torques, speeds=np.ones((FRAMES + 1, 10)))
    walk_figures.torques(moved, path, limits)
    shown = texts(path)
    assert "hip roll: at most 0 % of the stall torque driving, 50 % braking" in shown
    assert "hip pitch: at most 80 % of the stall torque driving, 0 % braking" in shown


def test_the_time_on_both_feet_is_that_of_the_forces(history: History, tmp_path: Path) -> None:
    force = np.zeros((FRAMES + 1, 2, 3))
    force[:, 0, 2], force[: FRAMES // 2, 1, 2] = 10.0, 5.0
    path = tmp_path / "forces.svg"
    walk_figures.ground_reaction(dataclasses.replace(history, ground_reaction=force), path)
    assert {"right, 100 %", "left, 50 %", "both, 50 %"} <= set(texts(path))


def test_a_robot_standing_still_can_be_drawn(history: History, tmp_path: Path) -> None:
    still = History(
        **{
            name: np.repeat(np.asarray(getattr(history, name))[:1], FRAMES + 1, axis=0)
            for name in vars(history)
            if name not in ("time", "commands", "schedule")
        },
        time=history.time,
        commands=STANDING.commands,
    )
    walk_figures.paths(still, tmp_path / "paths.png")
    walk_figures.waveforms(still, tmp_path / "waveforms.png")


def test_a_walk_that_fell_before_the_second_cycle_can_be_drawn(
    history: History, tmp_path: Path
) -> None:
    fell = first(history, 40)
    walk_figures.waveforms(fell, tmp_path / "waveforms.png")
    walk_figures.ground_reaction(fell, tmp_path / "ground_reaction.png")


def test_a_human_s_leg_is_drawn_where_there_is_an_angle_of_it(
    history: History, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []

    def angles(joint: str, phase: ArrayLike) -> tuple[FloatArray, FloatArray]:
        drawn.append(joint)
        return human.angles(joint, phase)

    monkeypatch.setattr(walk_figures, "human", SimpleNamespace(JOINTS=human.JOINTS, angles=angles))
    path = tmp_path / "waveforms.svg"
    walk_figures.waveforms(history, path)
    assert drawn == list(human.JOINTS)
    assert "human, right leg" in texts(path)
