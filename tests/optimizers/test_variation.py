"""Variation: the paper's equations against values worked out by hand; what "history" draws."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_gait.optimizers._variation import (
    MEMORY_SIZE,
    crossed_along,
    donors,
    drawn_elite,
    drawn_scales_and_rates,
    mean_scale,
    neighbours,
    next_rates,
    principal_axes,
    rank_scale,
    remembered,
    scales,
    shrunken_size,
)


def test_the_scale_falls_with_the_rank_as_a_sigmoid_about_the_middle():
    scale = rank_scale(40)
    assert scale[19] == 0.5  # rank 20 = n/2
    assert scale[0] == pytest.approx(1.0 / (1.0 + math.exp(-4.75)), abs=1e-9)
    assert scale[39] == pytest.approx(1.0 / (1.0 + math.exp(5.0)), abs=1e-9)
    assert (np.diff(scale) < 0.0).all()


def test_the_mean_scale_falls_from_its_largest_to_its_smallest_value():
    assert mean_scale(0, 100) == 1.55
    # Half-way n = (0.2 + 5) / 2 = 2.6, and 0.5 ** 2.6 = 0.16493849.
    assert mean_scale(50, 100) == pytest.approx(0.15 + 1.4 * 0.16493849, abs=1e-8)
    assert mean_scale(100, 100) == 0.15
    assert mean_scale(250, 100) == 0.15


def test_an_individual_s_scale_is_the_mean_of_both_for_its_rank():
    order = np.array([2, 0, 4, 1, 3])
    scale = scales(order, 50, 100)
    np.testing.assert_allclose(scale[order], (rank_scale(5) + mean_scale(50, 100)) / 2.0)


@pytest.mark.parametrize(
    ("scheme", "expected"),
    [
        (0, [9.0, 18.5]),  # best + (x1 - x2) / 2
        (1, [11.5, 18.0]),  # best + (x1 - x2) / 2 + (x3 - x4) / 2
        (2, [7.5, 9.0]),  # x1 + (best - x1) / 2 + (x3 - x2) / 2
    ],
)
def test_donors_are_built_as_equation_22_says(scheme, expected):
    x = np.array([[10.0, 20.0], [1.0, 2.0], [3.0, 5.0], [7.0, 1.0], [2.0, 2.0]])
    others = np.array([[1], [2], [3], [4]])
    donor = donors(x, np.intp(0), others, np.array([scheme]), np.array([0.5]))
    np.testing.assert_array_equal(donor, [expected])


def test_a_crossover_rate_is_redrawn_one_time_in_ten_and_is_then_low_or_high():
    redraw, draw = np.random.default_rng(0).random((2, 100_000))
    rates = next_rates(np.full(100_000, 0.3), redraw, draw)
    assert set(np.unique(rates)) == {0.05, 0.3, 0.95}
    assert np.mean(rates == 0.05) == pytest.approx(0.05, abs=0.005)
    assert np.mean(rates == 0.95) == pytest.approx(0.05, abs=0.005)


@settings(max_examples=25, deadline=None)
@given(size=st.integers(5, 70), seed=st.integers(0, 2**32))
def test_donors_are_drawn_from_four_different_others(size, seed):
    others = neighbours(np.random.default_rng(seed).random(size))
    with_self = np.vstack([np.arange(size), others])
    assert all(len(set(column)) == 5 for column in with_self.T)


def test_every_other_is_drawn_equally_often():
    rng = np.random.default_rng(0)
    drawn = np.stack([neighbours(rng.random(6)) for _ in range(6_000)])
    for row in range(4):
        for individual in range(6):
            counts = np.bincount(drawn[:, row, individual], minlength=6)
            assert counts[individual] == 0
            assert np.delete(counts, individual) == pytest.approx(1_200, rel=0.15)


# --- the variant "history" -----------------------------------------------------------------------


def test_the_elite_is_the_best_ninth_and_two_at_least():
    rng = np.random.default_rng(0)
    order = np.random.default_rng(1).permutation(100)
    assert set(drawn_elite(order, rng)) <= set(order[:11])
    few = np.concatenate([drawn_elite(order[:5], rng) for _ in range(10)])
    assert set(few) == set(order[:2])


def test_scales_and_rates_are_drawn_near_what_is_remembered():
    memory = np.tile([[0.4], [0.7], [0.2]], MEMORY_SIZE)
    scale, rate, turned = drawn_scales_and_rates(memory, 10_000, np.random.default_rng(0))
    assert np.median(scale) == pytest.approx(0.4, abs=0.02)
    assert rate.mean() == pytest.approx(0.7, abs=0.01)
    assert (turned == 0.2).all()
    for drawn in (scale, rate):
        assert drawn.min() >= 0.02
        assert drawn.max() <= 1.0


def test_only_trials_that_beat_their_parents_are_remembered():
    scale, rates = np.array([0.2, 0.9, 0.6]), np.array([0.5, 0.1, 0.5])
    turned, better = np.array([True, False, False]), np.array([True, False, True])
    # (0.2^2 + 0.6^2) / (0.2 + 0.6) = 0.5
    np.testing.assert_allclose(remembered(scale, rates, turned, better), [0.5, 0.5, 0.5])
    # However they fared, some trials are turned, and some not.
    assert remembered(scale, rates, turned, ~better)[2] == 0.1
    assert remembered(scale, rates, ~turned, ~better)[2] == 0.9


def test_principal_axes_find_the_direction_of_most_spread():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    points = rng.standard_normal((500, 3)) * [10.0, 1.0, 0.1] @ turn.T
    longest = principal_axes(points + 7.0)[:, -1]
    assert abs(longest @ turn[:, 0]) == pytest.approx(1.0, abs=1e-2)


def test_a_trial_along_axes_takes_the_donor_s_value_along_those_crossed():
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    parents, donor = rng.standard_normal((2, 4, 3))
    crossed = rng.random((4, 3)) < 0.5
    width = np.array([1.0, 10.0, 100.0])
    trials = crossed_along(axes, parents, donor, crossed, width)
    turned = [points / width @ axes for points in (trials, parents, donor)]
    np.testing.assert_allclose(turned[0], np.where(crossed, turned[2], turned[1]), atol=1e-12)


def test_the_population_falls_linearly_to_five():
    sizes = [shrunken_size(105, generation, 100) for generation in (0, 25, 50, 100, 200)]
    assert sizes == [105, 80, 55, 5, 5]
