"""Searches on two grounds: which walk is on which, and what a network is asked about both."""

import dataclasses

import numpy as np
import pytest
from conftest import Ground, planned, quick_proposer, run
from robust_problem import FURTHEST, ROBUST_BEST, Grounds, forward_of, trusted

from drake_gait.search.confirmation import walked_as
from drake_gait.search.grounds import (
    BETWEEN,
    SLIPPERY,
    STICKY,
    Grounded,
    end_of,
    grounded_inputs,
    on_ground,
    predictions,
    together,
)
from drake_gait.search.recommendation import recommended
from drake_gait.search.trust_region import IN_REGION
from drake_gait.study.ranking import best_walk, sample
from drake_gait.study.search_settings import ConfirmationSettings, Mode, SearchSettings
from drake_gait.surrogates.prediction import Prediction
from drake_gait.surrogates.settings import NetworkSettings

SEARCHED = [Mode.DEFAULT, Mode.ISADE_NETWORK, Mode.CMAES, Mode.ISADE]


@pytest.mark.parametrize("mode", SEARCHED)
def test_batches_alternate_between_slippery_and_sticky_ground(study, path, mode):
    settings = planned(study, mode=mode, samples=20, simulations=70, batch=5)
    ground = Ground(settings.space)
    walks = run(settings, path, ground)
    trials = {trial.candidate: trial for trial in ground.trials}
    change = settings.confirmation.friction
    for walk in walks:
        odd = (walk.iteration if walk.iteration else walk.id + 1) % 2
        expected = 1.0 - change if odd else 1.0 + change
        assert trials[walk.candidate].settings.friction == pytest.approx(expected)
        assert end_of(settings, walk) == (SLIPPERY if odd else STICKY)


@pytest.mark.parametrize(
    ("changes", "friction"),
    [({"grounds": False}, 0.1), ({"mode": Mode.PAPER}, 0.1), ({}, 0.0)],
)
def test_a_search_without_grounds_walks_between_them(study, path, changes, friction):
    settings = planned(study, samples=20, simulations=26, batch=5, **changes)
    plan = ConfirmationSettings(walks=0, friction=friction)
    settings = dataclasses.replace(settings, confirmation=plan)
    ground = Ground(settings.space)
    walks = run(settings, path, ground)
    assert {trial.settings.friction for trial in ground.trials} == {1.0}
    assert {end_of(settings, walk) for walk in walks} == {BETWEEN}
    assert grounded_inputs(settings, walks).shape == (26, 16)


@pytest.mark.parametrize("mode", SEARCHED)
@pytest.mark.parametrize("replicas", [1, 2])
def test_how_a_search_walked_is_known_from_the_study_file(study, path, mode, replicas):
    budget = {"samples": 20, "simulations": 60, "batch": 5, "replicas": replicas}
    settings = planned(study, mode=mode, **budget)
    ground = Ground(settings.space)
    trials = {}
    for walk in run(settings, path, ground):
        trials = trials or {trial.candidate: trial for trial in ground.trials}
        assert walked_as(settings, walk) == trials[walk.candidate].settings


def test_the_ground_is_the_last_input_of_a_network(study, path):
    walks = run(study, path)
    inputs = grounded_inputs(study, walks)
    assert inputs.shape == (len(walks), 17)
    assert inputs[:, :16] == pytest.approx(
        np.array([study.space.encode(walk.candidate) for walk in walks])
    )
    assert inputs[:, 16].tolist() == [end_of(study, walk) for walk in walks]
    assert set(inputs[:, 16]) == {SLIPPERY, STICKY}


def test_the_ends_have_the_frictions_of_the_confirmation(study):
    plan = ConfirmationSettings(friction=0.25, walks=0)
    settings = dataclasses.replace(study, confirmation=plan)
    walk = dataclasses.replace(settings.walk, friction=0.8)
    frictions = [on_ground(walk, settings, end).friction for end in (SLIPPERY, BETWEEN, STICKY)]
    assert frictions == pytest.approx([0.6, 0.8, 1.0])


class Tilted:
    """Expects of a walk that it drifts by its ground."""

    def predict(self, x):
        drift = 0.01 + 0.04 * x[:, -1:]
        return Prediction(
            mean=np.column_stack([x[:, :1], drift]),
            deviation=np.full((len(x), 2), 0.003),
            survival=0.75 + 0.5 * x[:, -1],
        )


def test_a_candidate_is_expected_on_both_ends():
    x = np.array([[0.1], [0.2], [0.3]])
    slippery, sticky = predictions(Grounded(Tilted()), x)
    assert slippery.mean[:, 0].tolist() == sticky.mean[:, 0].tolist() == [0.1, 0.2, 0.3]
    assert slippery.mean[:, 1] == pytest.approx(np.full(3, -0.01))
    assert sticky.mean[:, 1] == pytest.approx(np.full(3, 0.03))
    (alone,) = predictions(Grounded(Tilted()).on(STICKY), x)
    assert (alone.mean == sticky.mean).all()


def test_both_ends_together_are_a_mean_with_half_of_their_difference_and_the_lesser_survival():
    x = np.array([[0.1], [0.2]])
    found = Grounded(Tilted()).predict(x)
    assert found.mean[:, 1] == pytest.approx(np.full(2, 0.01))
    assert found.deviation[:, 1] == pytest.approx(np.full(2, np.hypot(0.003, 0.02)))
    assert found.deviation[:, 0] == pytest.approx(np.full(2, 0.003))
    assert found.survival == pytest.approx(np.full(2, 0.5))


def test_a_network_of_one_ground_says_the_same_alone_and_together():
    prediction = Tilted().predict(np.array([[0.1, 0.2]]))
    for name in ("mean", "deviation", "survival"):
        assert getattr(together([prediction]), name) == pytest.approx(getattr(prediction, name))


# --- the robust problem --------------------------------------------------------------------------


def robust_settings(study, seed, **changes):
    plan = {"samples": 40, "simulations": 120, "batch": 10, **changes}
    settings = dataclasses.replace(study, seed=seed, search=SearchSettings(**plan))
    return dataclasses.replace(settings, confirmation=ConfirmationSettings(walks=0))


def searched(settings, path):
    """Samples of a search on the robust problem."""
    proposer = quick_proposer(settings, NetworkSettings(epochs=60), IN_REGION)
    walks = run(settings, path, Grounds(settings), proposer=proposer)
    return [sample(walk.id, [walk], settings) for walk in walks]


def test_the_robust_optimum_is_the_furthest_that_holds(study):
    best = np.array([FURTHEST, -0.5, *np.zeros(14)])
    assert trusted(study, study.space.decode(best)) == pytest.approx(ROBUST_BEST, abs=0.01)
    for place, change in ((0, 0.3), (1, 0.3), (1, -0.3)):
        beyond = best.copy()
        beyond[place] += change
        assert trusted(study, study.space.decode(beyond)) == 0.0
    assert forward_of(best) == ROBUST_BEST


def best_recommended(settings, samples):
    """The furthest that is trusted of what a confirmation would walk first [m]."""
    return max(trusted(settings, one.candidate) for one in recommended(settings, samples)[:8])


@pytest.mark.parametrize(
    "mode", [Mode.DEFAULT, pytest.param(Mode.ISADE_NETWORK, marks=pytest.mark.slow)]
)
def test_a_search_on_two_grounds_recommends_what_holds(study, tmp_path, mode):
    found = []
    for seed in range(3):
        settings = robust_settings(study, seed, mode=mode)
        samples = searched(settings, tmp_path / f"{seed}.db")
        found.append(best_recommended(settings, samples))
        # The luckiest single walk went further, and does not hold.
        luckiest = best_walk([one.walks[0] for one in samples], settings.constraints)
        assert luckiest.walk.forward > found[-1]
        assert trusted(settings, luckiest.candidate) == 0.0
    assert min(found) > 0.6 * ROBUST_BEST
    assert np.median(found) > 0.65 * ROBUST_BEST


@pytest.mark.slow
@pytest.mark.parametrize("risk", ["mean", "worst"])
def test_every_risk_recommends_what_holds(study, tmp_path, risk):
    found = []
    for seed in range(3):
        settings = robust_settings(study, seed, risk=risk)
        samples = searched(settings, tmp_path / f"{seed}.db")
        found.append(best_recommended(settings, samples))
    assert np.median(found) > 0.6 * ROBUST_BEST


def test_a_search_that_never_leaves_its_ground_finds_nothing_that_holds(study, tmp_path):
    settings = robust_settings(study, 0, grounds=False)
    samples = searched(settings, tmp_path / "s.db")
    # All of them are feasible where they were walked.
    furthest = sorted(
        (one for one in samples if one.assessment.feasible), key=lambda one: one.rank
    )[:20]
    assert len(furthest) == 20
    assert {trusted(settings, one.candidate) for one in furthest} == {0.0}
    assert trusted(settings, recommended(settings, samples)[0].candidate) == 0.0
