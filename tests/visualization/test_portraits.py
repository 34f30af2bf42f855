import dataclasses

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.problem import Candidate
from drake_gait.simulation.simulate import simulate
from drake_gait.visualization.portraits import pictures

CANDIDATE = Candidate(
    gait=Gait.from_degrees(
        [
            [0.5, 2.3, 5.8, -0.4],
            [12.7, -13.1, 9.4, -0.6],
            [22.2, -2.4, 13.0, 0.2],
            [10, 6.2, 6.4, 0.7],
        ]
    )
)


@pytest.fixture(scope="module")
def history():
    return simulate(CANDIDATE, history=True).history


def test_a_standing_robot_is_as_high_as_the_maker_says_and_stands_on_the_ground(history):
    (picture,) = pictures(history, [0], CANDIDATE)
    _, _, lower, upper = picture.extent
    rows = np.flatnonzero((picture.pixels[..., 3] > 0.5).any(axis=1))
    height = (upper - lower) / len(picture.pixels)
    assert upper - rows[0] * height == pytest.approx(0.401, abs=0.002)
    assert upper - (rows[-1] + 1) * height == pytest.approx(0.0, abs=0.002)


def test_a_picture_stays_with_the_robot_that_walks_away(history):
    first, last = pictures(history, [0, 240], CANDIDATE)
    moved = history.com[240, 0] - history.com[0, 0]
    assert last.left - first.left == pytest.approx(moved, abs=0.02)


def test_a_wider_big_toe_takes_more_of_the_picture(history):
    def yellow(width):
        candidate = dataclasses.replace(CANDIDATE, foot=FootDesign(big_toe_width=width))
        (picture,) = pictures(history, [0], candidate, towards=(1.0, 0.0, 0.2))
        red, _, blue, _ = np.moveaxis(picture.pixels, 2, 0)
        return int(((red > 0.5) & (blue < 0.4 * red)).sum())

    assert yellow(0.044) == pytest.approx(2.0 * yellow(0.022), rel=0.2)


def test_positions_of_another_robot_are_refused(history):
    other = dataclasses.replace(history, positions=history.positions[:, :20])
    with pytest.raises(SettingsError, match="20 positions"):
        pictures(other, [0], CANDIDATE)
