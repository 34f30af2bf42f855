"""Selection: what a violation is worth, which point is the better, how the epsilon falls."""

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.optimizers._selection import (
    beats,
    constraint_units,
    epsilon,
    first_epsilon,
    violations_of,
)


def test_a_constraint_is_violated_above_zero_and_wherever_it_is_no_number():
    constraints = [[-1.0, 2.0], [np.nan, -np.inf], [0.0, np.inf]]
    assert violations_of(constraints, 3, 2).tolist() == [[0.0, 2.0], [np.inf, 0.0], [0.0, np.inf]]


def test_no_constraint_and_one_constraint_need_no_second_axis():
    assert violations_of(None, 3, None).shape == (3, 0)
    assert violations_of([1.0, 2.0, -3.0], 3, None).tolist() == [[1.0], [2.0], [0.0]]


@pytest.mark.parametrize("wrong", [1.0, [1.0, 2.0], [[1.0]] * 3, np.zeros((3, 2, 1)), None])
def test_constraints_of_another_shape_are_refused(wrong):
    with pytest.raises(SettingsError, match=r"must be \(3, 2\) in shape"):
        violations_of(wrong, 3, 2)


def test_a_constraint_is_measured_by_its_largest_finite_violation():
    violations = np.array([[0.0, 0.0, 4.0], [0.0, np.inf, np.inf], [0.0, 300.0, 1.0]])
    assert constraint_units(violations).tolist() == [1.0, 300.0, 4.0]


def test_excess_decides_before_cost_and_a_tie_beats_nobody():
    better = beats(
        np.array([0.0, 1.0, 0.0, 0.0, np.inf]),
        np.array([9.0, 1.0, 1.0, 2.0, 1.0]),
        np.array([1.0, 0.0, 0.0, 0.0, np.inf]),
        np.array([1.0, 9.0, 2.0, 2.0, 2.0]),
    )
    assert better.tolist() == [True, False, True, False, True]


def test_an_epsilon_is_given_to_what_no_first_point_meets_only():
    excess = np.arange(10.0, 0.0, -1.0)
    never_met = np.ones((10, 1))
    met_once = np.vstack([np.zeros((1, 1)), np.ones((9, 1))])
    assert first_epsilon(never_met, excess) == 3.0  # a fifth of the excesses lie below
    assert first_epsilon(np.hstack([met_once, never_met]), excess) == 3.0
    assert first_epsilon(np.hstack([met_once, met_once[::-1]]), excess) == 0.0
    assert first_epsilon(np.empty((10, 0)), excess) == 0.0
    assert first_epsilon(never_met, np.full(10, np.inf)) == 0.0


def test_the_epsilon_has_fallen_to_zero_after_three_tenths_of_the_run():
    assert epsilon(2.0, 0, 100) == 2.0
    assert epsilon(2.0, 15, 100) == pytest.approx(2.0 * 0.5**5)
    assert epsilon(2.0, 30, 100) == 0.0
    assert epsilon(2.0, 90, 100) == 0.0
