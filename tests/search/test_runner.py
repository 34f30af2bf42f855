"""Walks that are planned are simulated once, kept as they finish, and counted."""

import dataclasses

import numpy as np
import pytest
from conftest import Ground, Interruption, fall_at, planned, run, walk_at

from drake_gait.problem import Trial
from drake_gait.search.runner import Planned, Runner, perturbed
from drake_gait.study.records import CONFIRMATION, CONFIRMATIONS
from drake_gait.study.search_settings import ConfirmationSettings
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.walk import WalkSettings


@pytest.fixture
def opened(path):
    with Study.create(path, {}) as study:
        yield study


def plans(settings, count, *, first=0, stage="design", **changes):
    x = np.random.default_rng(first).uniform(-1.0, 1.0, (count, 16))
    return [
        Planned(
            id=first + place,
            stage=stage,
            iteration=0,
            trial=Trial(candidate=settings.space.decode(point)),
            **changes,
        )
        for place, point in enumerate(x)
    ]


def runner_of(settings, study, ground, report=lambda progress: None):
    return Runner(settings, study, ground, report)


def test_a_walk_is_kept_as_soon_as_it_is_finished(study, opened):
    ground = Ground(study.space, shuffle=3, stop_after=4)
    runner = runner_of(study, opened, ground)
    runner.start(plans(study, 6))
    with pytest.raises(Interruption):
        runner.finish()
    kept = opened.walks()
    assert len(kept) == 4
    finished = {trial.candidate for trial in ground.trials}
    assert {walk.candidate for walk in kept} == finished


def test_walks_keep_their_plan_in_whatever_order_they_finish(study, opened):
    wanted = plans(study, 8, nominal=3, variation=2, predicted={"forward": 0.1})
    runner = runner_of(study, opened, Ground(study.space, shuffle=1))
    runner.start(wanted)
    runner.finish()
    assert sorted(runner.walks) == list(range(8))
    for plan in wanted:
        walk = runner.walks[plan.id]
        assert walk.candidate == plan.trial.candidate
        assert (walk.nominal, walk.variation) == (3, 2)
        assert walk.walk.forward == walk_at(study.space.encode(walk.candidate)).forward


def test_only_what_is_not_known_yet_is_simulated(study, opened):
    wanted = plans(study, 6)
    first = Ground(study.space)
    runner = runner_of(study, opened, first)
    runner.start(wanted[1:4])
    runner.finish()
    again = Ground(study.space)
    runner = runner_of(study, opened, again)
    runner.start(wanted)
    runner.finish()
    assert [trial.candidate for trial in again.trials] == [
        wanted[place].trial.candidate for place in (0, 4, 5)
    ]
    runner.start(wanted)
    runner.finish()
    assert len(again.trials) == 3


def test_batches_beside_each_other_are_kept_as_far_as_they_are_waited_for(study, opened):
    runner = runner_of(study, opened, Ground(study.space))
    runner.start(plans(study, 4))
    runner.start(plans(study, 3, first=4), beside=True)
    runner.wait({1, 2})
    assert sorted(runner.walks) == [0, 1, 2]
    runner.wait({1, 5})
    assert sorted(runner.walks) == [0, 1, 2, 4, 5]
    runner.finish()
    assert sorted(runner.walks) == list(range(7))


def test_starting_more_finishes_what_is_under_way(study, opened):
    runner = runner_of(study, opened, Ground(study.space))
    runner.start(plans(study, 3))
    assert runner.walks == {}  # Under way only.
    runner.start(plans(study, 2, first=3))
    assert sorted(runner.walks) == [0, 1, 2]
    runner.finish()
    assert sorted(runner.walks) == [0, 1, 2, 3, 4]


def test_progress_tells_what_the_walks_are_after_each(study, opened):
    reports = []
    ground = Ground(study.space, lambda x: fall_at(x) if x[0] > 0.3 else walk_at(x))
    runner = runner_of(study, opened, ground, reports.append)
    runner.start(plans(study, 30))
    runner.finish()
    assert [one.walks for one in reports] == list(range(1, 31))
    last, walks = reports[-1], opened.walks()
    assert last.total == study.search.simulations
    assert last.survivors == sum(walk.walk.survived for walk in walks) < 30
    assert last.failures == {"fell": 30 - last.survivors}
    feasible = [walk for walk in walks if study.assess(walk.walk).feasible]
    assert last.feasible == len(feasible) > 0
    assert last.best.walk.forward == max(walk.walk.forward for walk in feasible)


def test_a_runner_that_takes_up_a_study_tells_the_same(study, opened):
    runner = runner_of(study, opened, Ground(study.space))
    runner.start(plans(study, 20))
    runner.finish()
    again = runner_of(study, opened, Ground(study.space)).progress()
    expected = runner.progress()
    for field in dataclasses.fields(expected):
        if field.name != "best":
            assert getattr(again, field.name) == getattr(expected, field.name)
    assert again.best.id == expected.best.id


def test_walks_that_confirm_others_are_counted_apart(study, opened):
    runner = runner_of(study, opened, Ground(study.space))
    runner.start(plans(study, 4))
    again = {"first": CONFIRMATIONS, "stage": CONFIRMATION, "nominal": 1, "variation": 1}
    runner.start(plans(study, 3, **again))
    runner.finish()
    progress = runner.progress()
    assert (progress.walks, progress.confirmations) == (4, 3)


def test_a_variation_is_never_the_best_walk(study, opened):
    runner = runner_of(study, opened, Ground(study.space, lambda x: walk_at(np.zeros(16))))
    runner.start(plans(study, 3, nominal=0, variation=1))
    runner.finish()
    progress = runner.progress()
    assert progress.feasible == 3
    assert progress.best is None


# --- variations ----------------------------------------------------------------------------------


@pytest.fixture
def trial(space):
    return Trial(candidate=space.decode(np.full(16, 0.2)), settings=WalkSettings(friction=0.8))


def noise(trial, settings, nominal, variation):
    """What a variation adds to the coefficients [rad], shape (16,)."""
    varied = perturbed(trial, settings, nominal, variation).candidate.gait.coefficients
    return (varied - trial.candidate.gait.coefficients).ravel()


def test_the_address_of_a_variation_fixes_its_noise(study, trial, space):
    other = Trial(candidate=space.decode(np.zeros(16)))
    found = noise(trial, study, 7, 2)
    assert noise(other, study, 7, 2) == pytest.approx(found, abs=1e-15)
    busy = dataclasses.replace(study, name="other", question="another")
    assert (noise(trial, busy, 7, 2) == found).all()
    for elsewhere in (
        noise(trial, study, 7, 3),
        noise(trial, study, 8, 2),
        noise(trial, dataclasses.replace(study, seed=1), 7, 2),
    ):
        assert (elsewhere != found).all()


def test_the_noise_has_the_deviation_that_is_set(study, trial):
    plan = ConfirmationSettings(noise=0.002, walks=0)
    settings = dataclasses.replace(study, confirmation=plan)
    drawn = np.array([noise(trial, settings, number, 1) for number in range(200)])
    assert drawn.std() == pytest.approx(0.002, rel=0.05)
    assert np.abs(drawn.mean(axis=0)).max() < 0.001
    assert (drawn[0] != 0.0).all()  # Every coefficient has its own.


def test_friction_is_lower_and_higher_in_turn(study, trial):
    settings = dataclasses.replace(study, confirmation=ConfirmationSettings(friction=0.25))
    found = [perturbed(trial, settings, 7, variation).settings for variation in range(1, 5)]
    assert [one.friction for one in found] == pytest.approx([0.6, 1.0, 0.6, 1.0])
    assert dataclasses.replace(found[0], friction=0.8) == trial.settings


def test_without_noise_and_change_of_friction_a_variation_is_the_same_trial(study, trial):
    plan = ConfirmationSettings(noise=0.0, friction=0.0)
    settings = dataclasses.replace(study, confirmation=plan)
    assert perturbed(trial, settings, 7, 1) == trial


def test_every_candidate_of_a_search_has_its_replicas_in_order(study, path):
    settings: StudySettings = planned(study, samples=25, simulations=43, batch=4, replicas=3)
    ground = Ground(settings.space)
    walks = run(settings, path, ground)
    assert len(walks) == len(ground.trials) == 43
    trials = {trial.candidate: trial for trial in ground.trials}
    assert all(walk.nominal is None and walk.stage == "design" for walk in walks[:25])
    for start in range(25, 43, 3):
        nominal, *variations = walks[start : start + 3]
        assert (nominal.nominal, nominal.variation) == (None, 0)
        between = Trial(candidate=nominal.candidate, settings=settings.walk)
        for number, one in enumerate(variations, 1):
            assert (one.nominal, one.variation, one.stage) == (start, number, nominal.stage)
            expected = perturbed(between, settings, start, number)
            assert trials[one.candidate] == expected
