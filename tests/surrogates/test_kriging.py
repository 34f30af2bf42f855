"""A network's errors nearby, and what they say of the walks to come."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern

from drake_gait.surrogates.ensemble import fit, r_squared
from drake_gait.surrogates.residual_gp import ErrorProcesses, KrigedNetwork


def points(count, *, seed=0, dimension=3):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, dimension))


def bumpy(x):
    """What a smooth network misses: a slope, and waves that are known only near known points."""
    return (0.1 * x[:, 0] + 0.05 * np.sin(5.0 * x[:, 1]) * np.cos(4.0 * x[:, 2]))[:, None]


def survives(x):
    return np.sin(5.0 * x[:, 0]) < 0.7


def none_since(dimension=3, outputs=1):
    return np.empty((0, dimension)), np.empty((0, outputs)), np.empty(0, dtype=bool)


@pytest.fixture(scope="module")
def network():
    """Of 200 walks in three dimensions, which lie close together; those on two crests fall."""
    x = points(200)
    return fit(x, bumpy(x), survives(x))


@pytest.fixture(scope="module")
def corrected(network):
    new = points(1000, seed=3)
    return new, network.predict(new), KrigedNetwork(network, *none_since()).predict(new)


def test_errors_of_walks_nearby_correct_a_prediction(corrected):
    new, before, after = corrected
    unexplained = [1.0 - r_squared(bumpy(new), one.mean)[0] for one in (before, after)]
    assert unexplained[1] < 0.6 * unexplained[0]
    assert after.deviation.mean() < 0.85 * before.deviation.mean()


def test_the_intervals_hold_what_they_promise(corrected):
    new, _, after = corrected
    assert 0.55 < (np.abs(bumpy(new) - after.mean) < after.deviation).mean() < 0.9


def test_falls_nearby_correct_the_chance_to_survive(corrected):
    new, before, after = corrected
    assert (after.survival > 0.0).all()
    assert (after.survival <= 1.0).all()
    wrong_before, wrong_after = (
        np.mean((one.survival - survives(new)) ** 2) for one in (before, after)
    )
    assert wrong_after < 0.6 * wrong_before


def test_walks_that_a_network_has_not_learnt_from_correct_it_too(network):
    here = np.zeros((1, 3))
    x = here + 0.05 * points(12, seed=5)
    outputs, fell = np.full((12, 1), 0.9), np.zeros(12, dtype=bool)
    before = KrigedNetwork(network, *none_since()).predict(here)
    walked = KrigedNetwork(network, x, outputs, ~fell).predict(here)
    assert abs(walked.mean[0, 0] - 0.9) < 0.2 * abs(before.mean[0, 0] - 0.9)
    assert walked.survival[0] > before.survival[0] - 0.1
    fallen = KrigedNetwork(network, x, outputs, fell).predict(here)
    # How far a robot came that fell is no measure of a walk.
    assert fallen.mean == pytest.approx(before.mean)
    assert fallen.survival[0] < 0.2 < before.survival[0]


def test_only_the_latest_two_hundred_walks_count():
    x = points(300, seed=1)
    latest = points(200, seed=2)
    outputs = bumpy(latest)
    everyone = np.ones(300, dtype=bool)
    network = fit(x, bumpy(x), everyone)
    kriged = KrigedNetwork(network, latest, outputs, everyone[:200]).predict(x)
    lacked = ErrorProcesses(latest, outputs - network.predict(latest).mean)
    error, deviation = lacked.predict(x)
    assert kriged.mean == pytest.approx(network.predict(x).mean + error)
    assert kriged.deviation == pytest.approx(deviation)


def test_without_a_fall_none_is_expected():
    x = points(60, dimension=16)
    network = fit(x, x[:, :1], np.ones(60, dtype=bool))
    assert (KrigedNetwork(network, *none_since(16)).predict(x).survival == 1.0).all()


def test_nothing_is_said_far_from_all_walks(network):
    far = 1e4 * np.eye(3)
    kriged = KrigedNetwork(network, *none_since()).predict(far)
    assert kriged.mean == pytest.approx(network.predict(far).mean, abs=1e-9)
    near = KrigedNetwork(network, *none_since()).predict(network.x[:50])
    assert (kriged.deviation > near.deviation.max()).all()


def test_an_output_that_never_changes_is_left_as_it_is():
    x = points(60)
    network = fit(x, np.full((60, 1), 0.2), np.ones(60, dtype=bool))
    assert KrigedNetwork(network, *none_since()).predict(x[:5]).mean == pytest.approx(0.2)


def test_errors_that_are_all_nothing_are_expected_to_stay_so():
    mean, deviation = ErrorProcesses(points(30), np.zeros((30, 2))).predict(points(5, seed=1))
    assert (mean == 0.0).all()
    assert (deviation == 0.0).all()


def test_noise_is_not_kriged():
    x, noise = points(200, dimension=16), np.random.default_rng(1).normal(size=(200, 2))
    mean, deviation = ErrorProcesses(x, noise).predict(points(2000, seed=1, dimension=16))
    assert np.sqrt((mean**2).mean(axis=0)) == pytest.approx(0.0, abs=0.4)
    assert deviation == pytest.approx(noise.std(), rel=0.15)


def test_walks_at_one_point_are_averaged():
    errors = np.random.default_rng(0).normal(0.5, 0.1, (100, 1))
    mean, deviation = ErrorProcesses(np.zeros((100, 3)), errors).predict(np.zeros((1, 3)))
    assert mean[0] == pytest.approx(errors.mean(), abs=0.01)
    assert deviation[0] == pytest.approx(0.1, rel=0.4)


def test_the_process_is_the_likeliest_of_its_grid_and_that_of_a_library():
    """Against scikit-learn's posterior and scipy's density, for every length and noise."""
    x, new = points(40, seed=1), points(7, seed=2)
    errors = 0.3 * np.sin(2.0 * x.sum(axis=1)) + 0.02 * np.random.default_rng(3).normal(size=40)

    def of(length, noise):
        correlation = Matern(length, nu=2.5)(x) + noise * np.eye(40)
        variance = errors @ np.linalg.solve(correlation, errors) / 40
        likelihood = multivariate_normal(np.zeros(40), variance * correlation).logpdf(errors)
        return likelihood, length, noise, variance

    _, length, noise, variance = max(
        of(length, noise) for length in (0.5, 1.0, 2.0, 4.0, 8.0) for noise in (0.3, 1.0, 3.0, 10.0)
    )
    library = GaussianProcessRegressor(Matern(length, nu=2.5), alpha=noise, optimizer=None)
    expected, spread = library.fit(x, errors).predict(new, return_std=True)
    mean, deviation = ErrorProcesses(x, errors[:, None]).predict(new)
    assert mean[:, 0] == pytest.approx(expected, rel=1e-6)
    assert deviation[:, 0] == pytest.approx(np.sqrt(variance * (spread**2 + noise)), rel=1e-6)


def test_columns_know_nothing_of_each_other():
    x, new = points(80, seed=1), points(9, seed=2)
    smooth, noise = x.sum(axis=1), np.random.default_rng(3).normal(size=80)
    together = ErrorProcesses(x, np.column_stack([smooth, noise])).predict(new)
    for column, errors in enumerate((smooth, noise)):
        alone = ErrorProcesses(x, errors[:, None]).predict(new)
        for both, one in zip(together, alone, strict=True):
            assert both[:, column] == pytest.approx(one[:, 0], rel=1e-9)


def test_many_points_are_predicted_as_few_are(network):
    kriged = KrigedNetwork(network, *none_since())
    new = points(4100, seed=5)
    every, some = kriged.predict(new), kriged.predict(new[3990:])
    assert every.mean[3990:] == pytest.approx(some.mean, abs=1e-12)
    assert every.deviation.shape == (4100, 1)
