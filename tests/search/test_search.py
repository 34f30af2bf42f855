"""The procedure, on walks that are computed instead of simulated."""

import dataclasses
import threading

import numpy as np
import pytest
from conftest import (
    Ground,
    Interruption,
    fall_at,
    numbers,
    planned,
    quick_proposer,
    run,
    walk_at,
)

from drake_gait.problem import assess
from drake_gait.search import loop as search
from drake_gait.study.ranking import best_walk, feasible_walks
from drake_gait.study.store import Study
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.walk import Walk


@pytest.mark.parametrize(("samples", "simulations", "batch"), [(40, 55, 5), (40, 53, 4), (7, 7, 5)])
def test_a_study_uses_exactly_its_budget_and_stores_every_walk_once(
    study, path, samples, simulations, batch
):
    settings = planned(study, samples=samples, simulations=simulations, batch=batch)
    ground = Ground(settings.space)
    walks = run(settings, path, ground)
    assert len(ground.asked) == simulations
    assert [walk.id for walk in walks] == list(range(simulations))
    assert len({walk.candidate for walk in walks}) == simulations
    for walk in walks:
        expected = walk_at(settings.space.encode(walk.candidate))
        # The file knows the jump of every gait too.
        simulated = dataclasses.replace(walk.walk, values={})
        assert dataclasses.astuple(simulated) == dataclasses.astuple(expected)
    design = [walk for walk in walks if walk.stage == "design"]
    assert len(design) == samples
    assert all(walk.iteration == 0 and walk.predicted is None for walk in design)
    assert all(walk.stage == "infill" and walk.predicted for walk in walks[samples:])


def test_an_infill_walk_tells_which_network_proposed_it_and_what_was_expected(study, path):
    walks = run(study, path)
    assert [walk.iteration for walk in walks[40:]] == [1] * 5 + [2] * 5 + [3] * 5
    for walk in walks[40:]:
        assert set(walk.predicted) == {"forward", "lateral", "yaw", "survival"}
        assert 0.0 <= walk.predicted["survival"] <= 1.0


def test_walks_that_finish_in_another_order_give_the_same_study(study, tmp_path):
    expected = numbers(run(study, tmp_path / "ordered.db"))
    for seed in (1, 2):
        ground = Ground(study.space, shuffle=seed)
        assert numbers(run(study, tmp_path / f"{seed}.db", ground)) == expected


@pytest.mark.parametrize("walks", [0, 1, 39, 40, 43, 45, 54])
def test_an_interrupted_study_that_goes_on_is_the_same_walk_for_walk(study, tmp_path, walks):
    expected = numbers(run(study, tmp_path / "whole.db"))
    path = tmp_path / "parted.db"
    first = Ground(study.space, shuffle=walks, stop_after=walks)
    with pytest.raises(Interruption):
        run(study, path, first)
    with Study.open(path) as kept:
        assert len(kept.walks()) == walks
    second = Ground(study.space)
    assert numbers(run(study, path, second)) == expected
    assert len(second.asked) == 55 - walks


def test_a_batch_begins_before_the_one_before_has_ended(study, path):
    ground, begun = Ground(study.space), []

    def evaluate(trials):
        begun.append(len(ground.asked))
        return ground(trials)

    with Study.create(path, {}) as opened:
        search.search(study, opened, evaluate, proposer=quick_proposer(study))
    # Batches of five; two walks of each are still missing. The first batch needs the whole design.
    assert begun[:4] == [0, 40, 43, 48]


def test_a_proposal_does_not_depend_on_walks_that_are_under_way(study, tmp_path):
    def but_for(changed):
        asked = iter(range(55))

        def walk(x):
            return fall_at(x) if next(asked) in changed else walk_at(x)

        return walk

    one = run(study, tmp_path / "one.db")
    other = run(study, tmp_path / "other.db", Ground(study.space, but_for({43, 44})))
    assert [walk.candidate for walk in one[:50]] == [walk.candidate for walk in other[:50]]
    assert one[50].candidate != other[50].candidate


def test_an_interrupted_study_does_not_wait_for_a_network(study, path, monkeypatch):
    interrupted, learned = threading.Event(), threading.Event()

    def learn():
        interrupted.wait(60.0)
        learned.set()

    learning = search._Run.learning
    monkeypatch.setattr(
        search._Run,
        "learning",
        lambda self, vintage: learn if vintage == 2 else learning(self, vintage),
    )
    settings = planned(study, samples=40, simulations=60, batch=5)
    with pytest.raises(Interruption):
        run(settings, path, Ground(study.space, stop_after=52))
    assert not learned.is_set()
    interrupted.set()
    assert learned.wait(60.0)


def test_a_finished_study_simulates_nothing_more(study, path):
    expected = numbers(run(study, path))
    again = Ground(study.space)
    assert numbers(run(study, path, again)) == expected
    assert again.asked == []


@pytest.mark.parametrize("first", [41, 47, 50])
def test_a_study_whose_budget_grew_is_the_one_that_had_it_from_the_start(study, tmp_path, first):
    plan = {"samples": 40, "batch": 5}
    run(planned(study, simulations=first, **plan), tmp_path / "grown.db")
    ground = Ground(study.space)
    grown = run(planned(study, simulations=53, **plan), tmp_path / "grown.db", ground)
    whole = run(planned(study, simulations=53, **plan), tmp_path / "whole.db")
    assert len(ground.asked) == 53 - first
    # The last digits of a prediction depend on how many are made together.
    assert [row[:-1] for row in numbers(grown)] == [row[:-1] for row in numbers(whole)]
    for one, other in zip(grown[40:], whole[40:], strict=True):
        assert one.predicted == pytest.approx(other.predicted, rel=1e-9)


def test_another_seed_gives_another_study(study, tmp_path):
    one = run(study, tmp_path / "0.db")
    other = run(dataclasses.replace(study, seed=1), tmp_path / "1.db")
    assert not {walk.candidate for walk in one} & {walk.candidate for walk in other}


def test_trials_stay_within_the_limits(study, path):
    # A box at the edge of Table I, and feet: walking improves towards and beyond the edge.
    centre = np.array(study.space.centre)
    centre[0] = np.radians([14.0, -14.0, 14.0, 14.0])
    space = dataclasses.replace(
        study.space, centre=centre, foot_ranges=(("big_toe_width", 0.010, 0.040),)
    )

    def outward(x):
        walk = walk_at(np.zeros(16))
        forward = 0.1 + 0.02 * (x[0] - x[1] + x[2] + x[3]) + 0.02 * x[16]
        return dataclasses.replace(walk, forward=float(forward))

    settings = dataclasses.replace(study, space=space)
    walks = run(settings, path, Ground(space, outward))
    x = np.array([space.encode(walk.candidate) for walk in walks])
    assert (x >= space.limits[:, 0] - 1e-9).all()
    assert (x <= space.limits[:, 1] + 1e-9).all()
    # The law is tested at the edge only if some trial went there.
    assert (np.abs(x[40:, 16]) > 0.9).any()


def test_every_number_reported_is_that_of_a_simulated_walk(study, path):
    reports = []
    ground = Ground(study.space)
    walks = run(study, path, ground, reports.append)
    last = reports[-1]
    assert (last.walks, last.total) == (55, 55)
    assert last.survivors == sum(walk.walk.survived for walk in walks)
    assert last.feasible == len(feasible_walks(walks, study.constraints))
    assert last.best.walk.forward == best_walk(walks, study.constraints).walk.forward
    assert any((study.space.encode(last.best.candidate) == x).all() for x in ground.asked)
    assert [one.walks for one in reports] == sorted(one.walks for one in reports)
    assert {one.walks for one in reports} == set(range(1, 56))


@pytest.mark.slow
def test_the_search_beats_as_many_samples_on_most_seeds(study, tmp_path):
    better = 0
    for seed in range(4):
        settings = dataclasses.replace(study, seed=seed)
        found = best_walk(run(settings, tmp_path / f"{seed}.db"), study.constraints)
        sampling = planned(settings, samples=55, simulations=55)
        sampled = best_walk(run(sampling, tmp_path / f"{seed}-sampled.db"), study.constraints)
        assert assess(found.walk, study.constraints).feasible
        better += found.walk.forward > sampled.walk.forward + 0.005
    assert better >= 3


def test_stagnation_ends_a_study_before_its_budget(study, path):
    def plateau(x):
        return dataclasses.replace(walk_at(np.zeros(16)), forward=0.1)

    settings = planned(study, samples=40, simulations=100, batch=5, stagnation=2)
    ground = Ground(settings.space, plateau)
    assert len(run(settings, path, ground)) == 50
    # The same command again does not go on with what has ended.
    again = Ground(settings.space, plateau)
    assert len(run(settings, path, again)) == 50
    assert again.asked == []


def test_a_study_that_improves_does_not_stagnate(study, path):
    # Each walk goes further than the one before.
    count = iter(range(1000))

    def further(x):
        return dataclasses.replace(walk_at(np.zeros(16)), forward=0.1 + 1e-3 * next(count))

    settings = planned(study, samples=40, simulations=60, batch=5, stagnation=1)
    assert len(run(settings, path, Ground(settings.space, further))) == 60


def test_where_nothing_survives_the_study_goes_on_sampling(study, path):
    ground = Ground(study.space, fall_at)
    walks = run(study, path, ground)
    assert len(walks) == 55
    assert {walk.stage for walk in walks} == {"design"}
    assert [walk.iteration for walk in walks[40:]] == [1] * 5 + [2] * 5 + [3] * 5
    assert len({walk.candidate for walk in walks}) == 55
    assert (np.abs(np.array(ground.asked)) <= 1.0 + 1e-9).all()


def test_sampling_on_ends_with_enough_survivors_for_a_network(study, tmp_path):
    def rarely(x):
        return walk_at(x) if x[0] > 0.1 else fall_at(x)

    settings = planned(study, samples=20, simulations=70, batch=10)
    walks = run(settings, tmp_path / "whole.db", Ground(settings.space, rarely))
    stages = [walk.stage for walk in walks]
    first = stages.index("infill")
    assert first > 20
    # Its network is learnt while the ten walks before it are under way, before half of those before
    # them have ended, and knows the others.
    survived = np.cumsum([walk.walk.survived for walk in walks])
    assert survived[first - 21] >= surrogate.FEWEST_SURVIVORS
    assert survived[first - 31] < surrogate.FEWEST_SURVIVORS
    # Interrupted while it samples on, it is the same study.
    path = tmp_path / "parted.db"
    with pytest.raises(Interruption):
        run(settings, path, Ground(settings.space, rarely, stop_after=23, shuffle=1))
    assert numbers(run(settings, path, Ground(settings.space, rarely))) == numbers(walks)


def test_a_study_of_diverged_walks_ends_without_a_crash(study, path):
    walks = run(study, path, Ground(study.space, lambda x: Walk.diverged("made up")))
    assert len(walks) == 55
    assert best_walk(walks, study.constraints).id == 0


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ({"samples": 100, "simulations": 400}, 100),
        ({"samples": 12, "simulations": 20}, 5),  # A process is worth four walks.
        ({"samples": 2, "simulations": 400, "batch": 12}, 12),
        ({"samples": 2, "simulations": 1002, "batch": 10, "replicas": 4}, 40),
        ({"samples": 1, "simulations": 1}, 1),
    ],
)
def test_no_more_processes_are_started_than_a_study_can_use(study, plan, expected):
    assert search.useful_workers(planned(study, **plan)) == expected
