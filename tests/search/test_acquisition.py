"""What ISADE minimises on a network: improvement times feasibility, away from what is under way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from drake_gait.problem.problem import OUTPUTS, Constraints
from drake_gait.search.acquisition import Acquisition, expected_improvement
from drake_gait.surrogates.ensemble import Prediction

LIMITS = Constraints().limits


class Told:
    """Expects the same of every point."""

    def __init__(self, mean, deviation, survival=1.0):
        self.mean, self.deviation = np.array(mean), np.array(deviation)
        self.survival = survival

    def predict(self, x):
        n = len(x)
        return Prediction(
            mean=np.tile(self.mean, (n, 1)),
            deviation=np.tile(self.deviation, (n, 1)),
            survival=np.full(n, self.survival),
        )


NEAR = Told([0.12, 0.008, -0.05, 0.2440], [0.01, 0.012, 0.04, 0.0004], 0.7)
"""Likely, but not certain to be feasible."""


def acquisition(network=NEAR, *, to_beat=None, trials=(), radius=0.6, limits=LIMITS):
    return Acquisition(network, OUTPUTS, "forward", limits, to_beat, trials, radius)


def test_the_chance_of_a_feasible_walk_is_that_of_drawing_normal_ones():
    rng = np.random.default_rng(0)
    drawn = rng.normal(NEAR.mean, NEAR.deviation, (200_000, 4))
    limits = Constraints()
    inside = (
        (np.abs(drawn[:, 1]) <= limits.lateral)
        & (np.abs(drawn[:, 2]) <= limits.yaw)
        & (drawn[:, 3] >= limits.com_height)
        & (rng.random(200_000) < NEAR.survival)
    )
    chance = acquisition().chance(NEAR.predict(np.zeros((3, 16))))
    assert chance == pytest.approx(np.full(3, inside.mean()), abs=0.004)
    assert 0.3 < inside.mean() < 0.6  # A chance of 0 or 1 would show nothing.


def test_a_limit_that_a_study_adds_lowers_the_chance_by_its_own():
    names = (*OUTPUTS, "clearance")
    network = Told([*NEAR.mean, 0.010], [*NEAR.deviation, 0.002])
    added = Constraints(clearance=0.011)
    expected = network.predict(np.zeros((1, 16)))
    without = Acquisition(network, names, "forward", LIMITS, None, [], 0.6).chance(expected)
    found = Acquisition(network, names, "forward", added.limits, None, [], 0.6).chance(expected)
    assert found == pytest.approx(without * norm.sf(0.5))


@given(mean=st.floats(-0.2, 0.2), deviation=st.floats(0.001, 0.1), to_beat=st.floats(-0.2, 0.2))
def test_expected_improvement_is_the_integral_over_what_may_come(mean, deviation, to_beat):
    lower = max(to_beat, mean - 12 * deviation)
    upper = mean + 12 * deviation
    expected = 0.0
    if lower < upper:
        expected, _ = quad(
            lambda y: (y - to_beat) * norm.pdf(y, mean, deviation), lower, upper, epsabs=1e-13
        )
    found = expected_improvement(np.array([mean]), np.array([deviation]), to_beat)
    assert found == pytest.approx([expected], rel=1e-6, abs=1e-9)


def test_the_cost_is_the_negative_logarithm_of_improvement_times_chance():
    x = np.zeros((1, 16))
    chance = acquisition().chance(NEAR.predict(x))
    improvement = expected_improvement(NEAR.mean[:1], NEAR.deviation[:1], 0.125)
    assert acquisition(to_beat=0.125)(x) == pytest.approx(-np.log(chance * improvement))


def test_without_a_feasible_walk_the_chance_alone_counts():
    x = np.zeros((1, 16))
    far = Told([0.5, *NEAR.mean[1:]], NEAR.deviation, NEAR.survival)
    assert acquisition()(x) == acquisition(far)(x)
    assert acquisition(to_beat=0.1)(x) != acquisition(far, to_beat=0.1)(x)


def test_a_point_costs_more_the_nearer_it_is_to_a_trial_under_way():
    trial = np.full(16, 0.3)
    away = np.linspace(0.0, 3.0, 40)[:, None] * np.ones(16)
    cost = acquisition(trials=[trial])(trial + away)
    free = acquisition()(trial + away)
    assert (np.diff(cost) <= 0.0).all()
    assert cost[0] > free[0] + 100.0  # On the trial itself.
    assert cost[-1] == pytest.approx(free[-1], abs=1e-6)  # Far away it does not matter.


def test_the_neighbourhood_of_a_trial_is_a_part_of_the_trust_region():
    trial, x = np.zeros(16), np.full((1, 16), 0.1)
    excess = [
        float(acquisition(trials=[trial], radius=radius)(x)[0] - acquisition(radius=radius)(x)[0])
        for radius in (0.15, 0.6, 1.2)
    ]
    assert excess == sorted(excess)
    doubled = acquisition(trials=[trial], radius=1.2)(2 * x) - acquisition()(x)
    assert doubled == pytest.approx(excess[1])


def test_a_point_without_hope_has_a_finite_cost():
    hopeless = Told([-5.0, 9.0, 9.0, 0.0], [1e-4] * 4, 0.0)
    cost = acquisition(hopeless, to_beat=0.2, trials=[np.zeros(16)])(np.zeros((1, 16)))
    assert np.isfinite(cost).all()
