"""What ISADE minimises on a network: improvement times feasibility, away from what is under way."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from drake_gait.problem import OUTPUTS, Constraints
from drake_gait.search.acquisition import (
    Acquisition,
    Test,
    chance_to_hold,
    expected_improvement,
)
from drake_gait.search.grounds import Grounded, together
from drake_gait.study.reading import read_study
from drake_gait.study.search_settings import Risk
from drake_gait.surrogates.prediction import Prediction

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
    chance = acquisition().chance([NEAR.predict(np.zeros((3, 16)))])
    assert chance == pytest.approx(np.full(3, inside.mean()), abs=0.004)
    assert 0.3 < inside.mean() < 0.6  # A chance of 0 or 1 would show nothing.


def test_a_limit_that_a_study_adds_lowers_the_chance_by_its_own():
    names = (*OUTPUTS, "clearance")
    network = Told([*NEAR.mean, 0.010], [*NEAR.deviation, 0.002])
    added = Constraints(clearance=0.011)
    expected = [network.predict(np.zeros((1, 16)))]
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
    chance = acquisition().chance([NEAR.predict(x)])
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


# --- two grounds ---------------------------------------------------------------------------------


def ends(lateral, deviation=0.006, *, survival=(0.9, 0.7), forward=(0.14, 0.10)):
    """Predictions of one point on two grounds that differ in drift, distance and survival."""
    return [
        Prediction(
            mean=np.array([[far, drift, 0.0, 0.2440]]),
            deviation=np.array([[0.01, deviation, 0.02, 0.0004]]),
            survival=np.array([chance]),
        )
        for far, drift, chance in zip(forward, lateral, survival, strict=True)
    ]


@given(
    drifts=st.tuples(st.floats(-0.04, 0.04), st.floats(-0.04, 0.04)),
    deviation=st.floats(0.001, 0.03),
)
def test_both_grounds_hold_no_more_often_than_either(drifts, deviation):
    both = ends(drifts, deviation)
    alone = [chance_to_hold([one], OUTPUTS, LIMITS)[0] for one in both]
    together = chance_to_hold(both, OUTPUTS, LIMITS)[0]
    assert 0.0 <= together <= min(alone) + 1e-12
    mean = chance_to_hold(both, OUTPUTS, LIMITS, Risk.MEAN)[0]
    assert mean == pytest.approx(np.mean(alone))
    assert chance_to_hold(both[::-1], OUTPUTS, LIMITS)[0] == pytest.approx(together)


def test_grounds_that_are_alike_count_as_one():
    both = ends((0.004, 0.004), survival=(0.8, 0.8), forward=(0.12, 0.12))
    for risk in Risk:
        found = chance_to_hold(both, OUTPUTS, LIMITS, risk)
        assert found == pytest.approx(chance_to_hold(both[:1], OUTPUTS, LIMITS))


def test_both_grounds_hold_as_often_as_one_error_leaves_both_within_the_limits():
    rng = np.random.default_rng(0)
    both = ends((-0.012, 0.010), survival=(1.0, 1.0))
    limits = [limit for limit in LIMITS if limit.quantity == "lateral"]
    error = rng.normal(0.0, 0.006, 400_000)
    inside = (np.abs(error - 0.012) <= limits[0].upper) & (np.abs(error + 0.010) <= limits[0].upper)
    assert chance_to_hold(both, OUTPUTS, limits) == pytest.approx([inside.mean()], abs=0.003)
    assert 0.5 < inside.mean() < 0.95


@given(spread=st.floats(0.0, 0.03), more=st.floats(0.001, 0.03))
def test_the_more_the_ground_decides_the_less_a_candidate_holds(spread, more):
    narrow, wide = (
        chance_to_hold(ends((-half, half)), OUTPUTS, LIMITS)[0] for half in (spread, spread + more)
    )
    assert wide < narrow or wide == narrow == 0.0


class OnBoth:
    """Expects the same of every point, on two grounds."""

    def predict(self, x):
        parts = ends((-0.008, 0.012))
        which = (x[:, -1] > 0).astype(int)
        return Prediction(
            mean=np.array([parts[end].mean[0] for end in which]),
            deviation=np.array([parts[end].deviation[0] for end in which]),
            survival=np.array([parts[end].survival[0] for end in which]),
        )


def test_the_risk_says_which_improvement_and_which_chance_count():
    x, both = np.zeros((1, 16)), ends((-0.008, 0.012))
    network, to_beat = Grounded(OnBoth()), 0.09
    merged = together(both)

    def improvement(one):
        return expected_improvement(one.mean[:, 0], one.deviation[:, 0], to_beat)[0]

    holds = chance_to_hold(both, OUTPUTS, LIMITS)[0]
    on_average = chance_to_hold(both, OUTPUTS, LIMITS, Risk.MEAN)[0]
    expected = {
        Risk.MEAN: improvement(merged) * on_average,
        Risk.CHANCE: improvement(merged) * holds,
        Risk.WORST: min(map(improvement, both)) * holds,
    }
    for risk, value in expected.items():
        cost = Acquisition(network, OUTPUTS, "forward", LIMITS, to_beat, [], 0.6, risk=risk)(x)
        assert cost == pytest.approx([-np.log(value)])
    assert expected[Risk.WORST] < expected[Risk.CHANCE] < expected[Risk.MEAN]


def test_points_of_a_batch_are_the_best_that_are_apart():
    x = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 16))
    one = acquisition(radius=2.0)
    chosen = one.best_apart(x, 6)
    for place in range(6):
        again = acquisition(radius=2.0, trials=list(chosen[:place]))
        assert (x[np.argmin(again(x))] == chosen[place]).all()


# --- The confirmation's first test ----------------------------------------------------------------


class Slope:
    """Expects a turn that grows with the first coefficient, and knows it well."""

    def predict(self, x):
        x = np.asarray(x)
        mean = np.tile([0.5, 0.0, 0.0, 0.25], (len(x), 1))
        mean[:, 2] = Constraints().yaw * x[:, 0]
        return Prediction(mean=mean, deviation=np.full((len(x), 4), 1e-4), survival=np.ones(len(x)))


def trusting(**settings):
    return read_study(Path("studies/steady.toml"), {("search", "risk"): "trust", **settings})


def test_only_a_search_that_weighs_trust_knows_the_test():
    assert Test.of(read_study(Path("studies/steady.toml"), {("search", "risk"): "chance"})) is None
    found = Test.of(trusting())
    assert (found.walks, found.feasible) == (8, 7)


def test_noise_counts_in_the_units_of_the_box():
    settings = trusting()
    found = Test.of(settings)
    expected = settings.confirmation.noise / settings.space.half_width.ravel()
    assert settings.space.noise(settings.confirmation.noise) == pytest.approx(expected)
    assert found.noise.mean(axis=0) == pytest.approx(np.zeros(16), abs=1e-15)
    assert 0.3 < np.median(np.abs(found.noise) / expected) < 1.5


def test_a_gait_near_the_edge_of_a_limit_holds_less_often_with_noise():
    test = Test.of(trusting())
    x = np.zeros((3, 16))
    x[:, 0] = [0.0, 0.99, 1.01]
    inner, edge, outside = test.chance_of_a_walk(Slope(), x, OUTPUTS, LIMITS)
    assert inner > 0.999
    assert 0.1 < outside <= edge < 0.9


@pytest.mark.parametrize("chance", [0.3, 0.7, 0.95])
def test_the_chance_to_pass_is_that_of_seven_of_eight_walks(chance):
    rng = np.random.default_rng(0)
    passed = (rng.random((100_000, 8)) < chance).sum(axis=1) >= 7
    found = Test.of(trusting()).chance_to_pass(np.array([chance]))
    assert found == pytest.approx([passed.mean()], abs=0.005)


def test_a_search_that_weighs_trust_prefers_the_middle_of_a_limit_to_a_little_more_distance():
    class Edge(Slope):
        def predict(self, x):
            found = super().predict(x)
            found.mean[:, 0] += 0.01 * np.asarray(x)[:, 0]
            return found

    x = np.zeros((2, 16))
    x[1, 0] = 0.9
    costs = {}
    for risk in (Risk.CHANCE, Risk.TRUST):
        settings = trusting()
        test = Test.of(settings) if risk is Risk.TRUST else None
        costs[risk] = Acquisition(
            Edge(), OUTPUTS, "forward", LIMITS, 0.4, [], 0.6, risk=risk, test=test
        )(x)
    assert costs[Risk.CHANCE][1] < costs[Risk.CHANCE][0]
    assert costs[Risk.TRUST][0] < costs[Risk.TRUST][1]
