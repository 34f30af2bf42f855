"""What the network is measured against: baselines on the same walks and folds."""

import numpy as np
import pytest
from conftest import QUICK_NETWORK

from drake_gait.surrogates import baselines as surrogate_baselines
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.baselines import (
    area_under_curve,
    compare,
    heldout,
    kriging,
    logistic,
    ridge,
)
from drake_gait.surrogates.ensemble import folds_of, r_squared


def points(count, *, dimension=6):
    return np.random.default_rng(0).uniform(-1.0, 1.0, (count, dimension))


@pytest.fixture(scope="module")
def x():
    return points(120)


@pytest.fixture(scope="module")
def folds(x):
    return folds_of(len(x), 0)


@pytest.fixture(scope="module")
def linear(x):
    return x[:, :2] @ np.array([[1.0, 0.2], [-2.0, 0.1]]) * [1.0, 1e-3] + [5.0, 0.1]


@pytest.fixture(scope="module")
def bent(x):
    # Even in every coordinate: no slope to find.
    return (x[:, :1] ** 2 + np.cos(2.0 * x[:, 1:2])) * 0.01


def test_ridge_recovers_what_is_linear_whatever_its_unit(x, linear, folds):
    explained = r_squared(linear, heldout(ridge, x, linear, folds))
    assert (explained > 0.999).all()


def test_kriging_recovers_a_bend_where_ridge_fails(x, bent, folds):
    assert r_squared(bent, heldout(ridge, x, bent, folds))[0] < 0.2
    assert r_squared(bent, heldout(kriging(x, bent), x, bent, folds))[0] > 0.9


def test_noise_is_explained_by_neither(x, folds):
    noise = np.random.default_rng(1).normal(size=(len(x), 2))
    for model in (ridge, kriging(x, noise)):
        assert (r_squared(noise, heldout(model, x, noise, folds)) < 0.1).all()


def test_a_walk_is_predicted_without_itself(x, linear, folds):
    changed = linear.copy()
    changed[7] += 100.0
    for model in (ridge, kriging(x, linear)):
        before, after = (heldout(model, x, outputs, folds) for outputs in (linear, changed))
        same_fold = folds == folds[7]
        assert after[same_fold] == pytest.approx(before[same_fold], abs=1e-9)
        assert np.abs(after - before)[~same_fold].max() > 1e-3


def test_an_output_that_does_not_vary_is_predicted_as_it_is(x, linear, folds):
    outputs = np.column_stack([linear[:, 0], np.full(len(x), 0.25)])
    for model in (ridge, kriging(x, outputs)):
        assert heldout(model, x, outputs, folds)[:, 1] == pytest.approx(0.25, abs=1e-9)


def test_logistic_regression_tells_a_half_space(x, folds):
    survived = x[:, 0] + x[:, 1] > 0.2
    expected = heldout(logistic, x, survived[:, None].astype(float), folds)
    assert ((expected >= 0.0) & (expected <= 1.0)).all()
    assert area_under_curve(survived, expected[:, 0]) > 0.97


def test_the_area_is_one_for_perfect_order_and_a_half_for_none():
    survived = np.array([True, False, True, False])
    assert area_under_curve(survived, np.array([0.6, 0.5, 0.9, 0.1])) == 1.0
    assert area_under_curve(survived, np.full(4, 0.7)) == 0.5
    assert area_under_curve(survived, np.array([0.1, 0.9, 0.2, 0.8])) == 0.0
    assert area_under_curve(np.ones(4, dtype=bool), np.full(4, 0.7)) is None


def test_the_baselines_have_the_folds_of_the_network(x, linear, monkeypatch):
    survived = x[:, 2] < 0.4
    network = surrogate.fit(x, linear, survived, seed=3, settings=QUICK_NETWORK)
    seen = []
    plain = surrogate_baselines.heldout

    def noted(model, x, outputs, folds):
        seen.append(folds)
        return plain(model, x, outputs, folds)

    monkeypatch.setattr(surrogate_baselines, "heldout", noted)
    compare(network, x, linear, survived, seed=3)
    survivors = int(survived.sum())
    for folds, count in zip(seen, (len(x), survivors, survivors), strict=True):
        assert (folds == folds_of(count, 3)).all()


def test_without_a_fall_survival_is_not_compared(x, linear):
    everyone = np.ones(len(x), dtype=bool)
    network = surrogate.fit(x, linear, everyone, settings=QUICK_NETWORK)
    found = compare(network, x, linear, everyone)
    assert (network.survival_heldout == 1.0).all()
    assert (found.network_auc, found.logistic_auc) == (None, None)
    assert (found.ridge > 0.99).all()
    assert (found.kriging > 0.99).all()


def test_both_tell_survivors_by_a_half_space(x, linear):
    survived = x[:, 0] + x[:, 1] > 0.0
    found = compare(surrogate.fit(x, linear, survived), x, linear, survived)
    assert found.network_auc > 0.9
    assert found.logistic_auc > 0.9
