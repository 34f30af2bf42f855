"""The network: what it learns, what it admits not to know."""

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.problem import OUTPUTS
from drake_gait.surrogates.ensemble import fit, r_squared
from drake_gait.surrogates.prediction import FEWEST_SURVIVORS


def points(count, *, seed=0, dimension=16):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, dimension))


def smooth(x):
    """Four outputs about as a walk has them: slopes, a bend, an interaction; SI units."""
    return np.stack(
        [
            0.15 + 0.02 * x[:, 0] - 0.015 * (x[:, 1] - 0.7) ** 2 + 0.01 * x[:, 2],
            0.01 * x[:, 3] + 0.005 * np.sin(2.0 * x[:, 4]),
            0.1 * np.tanh(x[:, 5] + x[:, 6]),
            0.244 + 0.001 * x[:, 7] + 0.0005 * x[:, 8],
        ],
        axis=1,
    )


def everyone(x):
    return np.ones(len(x), dtype=bool)


@pytest.fixture(scope="module")
def x():
    return points(300)


@pytest.fixture(scope="module")
def network(x):
    return fit(x, smooth(x), everyone(x))


@pytest.fixture(scope="module")
def half_known():
    """A network of walks that fall where x_0 + x_1 > 0.2; their outputs are nonsense."""
    x = points(300)
    fallen = x[:, 0] + x[:, 1] > 0.2
    outputs = np.where(fallen[:, None], 1e6, smooth(x))
    return fit(x, outputs, ~fallen)


def test_the_outputs_are_the_paper_s_four():
    assert OUTPUTS == ("forward", "lateral", "yaw", "com_height")


def test_a_smooth_function_is_learnt_for_points_that_were_left_out(network):
    assert network.r2_heldout.shape == (4,)
    assert (network.r2_heldout > 0.9).all()
    assert (network.r2_train >= network.r2_heldout).all()


def test_held_out_r2_is_an_honest_forecast_of_new_points(network):
    new = points(2000, seed=1)
    achieved = r_squared(smooth(new), network.predict(new).mean)
    assert (achieved > 0.9).all()
    assert (achieved > network.r2_heldout - 0.02).all()


def test_noise_is_not_learnt(x):
    noise = np.random.default_rng(1).normal(size=(300, 4))
    network = fit(x, noise, everyone(x))
    assert (network.r2_heldout <= 0.2).all()


def test_half_of_the_deviation_s_intervals_hold_what_they_promise(network):
    new = points(2000, seed=2)
    expected = network.predict(new)
    error = np.abs(smooth(new) - expected.mean)
    # A normal error is within one deviation in 68 % of all cases; more is caution, less is bluff.
    assert ((error < expected.deviation).mean(axis=0) > 0.6).all()


def test_noise_widens_the_deviation(x, network):
    noise = 0.02 * np.random.default_rng(1).normal(size=(300, 4))
    noisy = fit(x, smooth(x) + noise, everyone(x))
    assert (noisy.predict(x).deviation.min(axis=0) > 0.01).all()
    assert (network.predict(x).deviation[:, 0] < 0.01).all()


def test_the_same_walks_and_seed_give_the_same_numbers(x, network):
    again = fit(x.copy(), smooth(x), everyone(x))
    new = points(50, seed=3)
    for name in ("mean", "deviation", "survival"):
        assert (getattr(again.predict(new), name) == getattr(network.predict(new), name)).all()
    assert (again.heldout == network.heldout).all()


def test_a_training_in_between_changes_nothing(x, network):
    np.random.default_rng(5)
    fit(points(40, seed=9), smooth(points(40, seed=9)), everyone(points(40)), seed=3)
    assert (fit(x, smooth(x), everyone(x)).heldout == network.heldout).all()


def test_another_seed_gives_another_network_that_is_as_good(x, network):
    other = fit(x, smooth(x), everyone(x), seed=1)
    assert (other.heldout != network.heldout).any()
    assert other.r2_heldout == pytest.approx(network.r2_heldout, abs=0.05)


def test_the_unit_of_an_output_does_not_matter(x, network):
    # Millimetres and degrees instead of metres and radians, and another origin.
    scale, offset = np.array([1e3, 1e3, 180.0 / np.pi, 1e3]), np.array([50.0, 0.0, -90.0, 0.0])
    converted = fit(x, smooth(x) * scale + offset, everyone(x))
    assert converted.r2_heldout == pytest.approx(network.r2_heldout, abs=1e-3)
    found, expected = converted.predict(x), network.predict(x)
    assert (found.mean - offset) / scale == pytest.approx(expected.mean, abs=1e-4)
    assert found.deviation / scale == pytest.approx(expected.deviation, rel=0.02)


def test_an_output_that_does_not_vary_is_predicted_as_it_is(x):
    outputs = smooth(x)
    outputs[:, 1] = 0.003
    network = fit(x, outputs, everyone(x))
    assert network.predict(x).mean[:, 1] == pytest.approx(0.003, abs=1e-9)
    assert (network.r2_heldout[[0, 2, 3]] > 0.9).all()


def test_one_prediction_is_that_of_many_made_together(x, network):
    together = network.predict(x)
    alone = network.predict(x[7:8])
    assert alone.mean[0] == pytest.approx(together.mean[7], rel=1e-12)
    assert alone.survival[0] == pytest.approx(together.survival[7], rel=1e-12)


def test_the_numbers_of_a_fall_are_not_learnt(half_known):
    safe = points(400, seed=4)
    safe = safe[safe[:, 0] + safe[:, 1] < -0.2]
    mean = half_known.predict(safe).mean
    assert (r_squared(smooth(safe), mean) > 0.8).all()


def test_survival_separates_a_half_space_that_is_known(half_known):
    new = points(2000, seed=5)
    fallen = new[:, 0] + new[:, 1] > 0.2
    survival = half_known.predict(new).survival
    assert ((survival > 0.5) == ~fallen).mean() > 0.9
    clear = np.abs(new[:, 0] + new[:, 1] - 0.2) > 0.6
    assert ((survival > 0.5) == ~fallen)[clear].mean() > 0.98
    assert survival[clear & fallen].mean() < 0.1
    assert survival[clear & ~fallen].mean() > 0.9
    assert (survival >= 0.0).all()
    assert (survival <= 1.0).all()


def test_without_a_fall_none_is_expected(x, network):
    assert (network.predict(x).survival == 1.0).all()


def test_too_few_survivors_are_refused_with_the_cure(x):
    survived = np.arange(300) < FEWEST_SURVIVORS - 1
    with pytest.raises(
        SettingsError,
        match=rf"{FEWEST_SURVIVORS - 1} of 300 walks survived; the network needs "
        rf"{FEWEST_SURVIVORS}: draw more samples",
    ):
        fit(x, smooth(x), survived)


def test_the_fewest_survivors_are_enough(x):
    survived = np.arange(300) < FEWEST_SURVIVORS
    network = fit(x, smooth(x), survived)
    prediction = network.predict(x)
    assert network.heldout.shape == (FEWEST_SURVIVORS, 4)
    assert np.isfinite(prediction.mean).all()
    assert (prediction.deviation > 0.0).all()


def test_r2_has_its_hand_computed_values():
    targets = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [3.0, 3.0, 3.0]])
    predicted = np.array([[1.0, 2.0, 3.0], [2.0, 2.0, 2.0], [3.0, 2.0, 1.0]])
    # All explained; the mean explains none; the reverse is worse than the mean.
    assert r_squared(targets, predicted) == pytest.approx([1.0, 0.0, -3.0])
