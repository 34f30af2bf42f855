"""Laws of every way to search, on walks that are computed instead of simulated."""

import dataclasses
import functools

import numpy as np
import pytest
from conftest import QUICK_NETWORK, Ground, Interruption, numbers, planned, run, walk_at

from drake_gait.problem import assess
from drake_gait.search.isade_network import NetworkIsade
from drake_gait.search.loop import search
from drake_gait.search.trust_region import TrustRegion
from drake_gait.study.ranking import best_walk
from drake_gait.study.search_settings import Mode
from drake_gait.study.store import Study

PLANS = {
    "default": {"samples": 20, "simulations": 33, "batch": 5},
    "isade-network": {"mode": Mode.ISADE_NETWORK, "samples": 20, "simulations": 33, "batch": 5},
    "nominal": {"samples": 20, "simulations": 33, "batch": 5, "grounds": False},
    "paper": {"mode": Mode.PAPER, "samples": 20, "simulations": 26},
    "isade": {"mode": Mode.ISADE, "samples": 1, "simulations": 75},
    "cmaes": {"mode": Mode.CMAES, "samples": 1, "simulations": 41},
    "replicas": {"samples": 24, "simulations": 42, "batch": 4, "replicas": 3},
    "isade replicas": {"mode": Mode.ISADE, "samples": 2, "simulations": 130, "replicas": 2},
}
"""Every mode; budgets that end in the midst of a batch."""

INTERRUPTED = {
    "default": [1, 20, 27, 32],
    "isade-network": [20, 27, 31],
    "nominal": [27],
    "paper": [19, 23],
    "isade": [0, 30, 44, 74],
    "cmaes": [5, 12, 40],
    "replicas": [10, 25, 31],  # In the midst of a candidate.
    "isade replicas": [60, 99],
}
FIRST_BUDGETS = {
    "default": [20, 23],
    "isade-network": [23],
    "nominal": [23],
    "paper": [22],
    "isade": [20, 30, 61],
    "cmaes": [12, 17],
    "replicas": [27],
    "isade replicas": [90],
}


def cases(table):
    return [(name, value) for name, values in table.items() for value in values]


@pytest.fixture(scope="module")
def whole(study, told, tmp_path_factory):
    """Settings and walks of a study of each plan that ran from start to end, by its name."""
    folder = tmp_path_factory.mktemp("whole")

    @functools.cache
    def made(name):
        settings = planned(study, **PLANS[name])
        ground, reports = Ground(settings.space), []
        told[name] = ground, reports
        return settings, run(settings, folder / f"{name}.db", ground, reports.append)

    return made


@pytest.fixture(scope="module")
def told():
    """Where the walks of each such study were computed, and what was reported of them."""
    return {}


@pytest.mark.parametrize("name", PLANS)
def test_a_study_uses_its_budget_and_stores_each_walk_once(whole, told, name):
    settings, walks = whole(name)
    ground, _ = told[name]
    assert len(ground.asked) == settings.search.simulations
    assert [walk.id for walk in walks] == list(range(settings.search.simulations))
    assert len({walk.candidate for walk in walks}) == len(walks)
    for walk in walks:
        expected = walk_at(settings.space.encode(walk.candidate))
        # The file knows the jump of every gait too.
        simulated = dataclasses.replace(walk.walk, values={})
        assert dataclasses.astuple(simulated) == dataclasses.astuple(expected)


@pytest.mark.parametrize("name", PLANS)
def test_walks_that_finish_in_another_order_make_the_same_study(whole, path, name):
    settings, expected = whole(name)
    shuffled = Ground(settings.space, shuffle=1)
    assert numbers(run(settings, path, shuffled)) == numbers(expected)


@pytest.mark.parametrize(("name", "walks"), cases(INTERRUPTED))
def test_a_study_that_was_interrupted_goes_on_walk_for_walk(whole, path, name, walks):
    settings, expected = whole(name)
    with pytest.raises(Interruption):
        run(settings, path, Ground(settings.space, shuffle=walks, stop_after=walks))
    with Study.open(path) as kept:
        assert len(kept.walks()) == walks
    second = Ground(settings.space, shuffle=2)
    assert numbers(run(settings, path, second)) == numbers(expected)
    assert len(second.asked) == settings.search.simulations - walks


@pytest.mark.parametrize(("name", "first"), cases(FIRST_BUDGETS))
def test_a_study_with_a_grown_budget_is_the_one_that_had_it_from_the_start(
    whole, path, name, first
):
    settings, expected = whole(name)
    run(planned(settings, **{**PLANS[name], "simulations": first}), path)
    ground = Ground(settings.space)
    grown = run(settings, path, ground)
    assert len(ground.asked) == settings.search.simulations - first
    # The last digits of a prediction depend on how many are made together.
    assert [row[:-1] for row in numbers(grown)] == [row[:-1] for row in numbers(expected)]


@pytest.mark.parametrize("name", PLANS)
def test_another_seed_walks_other_candidates(whole, path, name):
    settings, one = whole(name)
    other = run(dataclasses.replace(settings, seed=1), path)
    assert not {walk.candidate for walk in one} & {walk.candidate for walk in other}


@pytest.mark.parametrize("name", PLANS)
def test_the_best_that_is_reported_is_a_stored_walk(whole, told, name):
    settings, walks = whole(name)
    _, reports = told[name]
    best = reports[-1].best
    assert numbers([best])[0][:6] == numbers([walks[best.id]])[0][:6]
    expected = best_walk(walks, settings.constraints)
    assert assess(expected.walk, settings.constraints).feasible
    assert best.id == expected.id
    assert best.nominal is None


@pytest.mark.parametrize("name", PLANS)
def test_what_is_proposed_stays_within_the_limits(study, path, name):
    # A box at the edge of Table I: walking improves towards and beyond the edge.
    centre = np.array(study.space.centre)
    centre[0] = np.radians([14.0, -14.0, 14.0, 14.0])
    space = dataclasses.replace(study.space, centre=centre)

    def outward(x):
        forward = 0.1 + 0.02 * (x[0] - x[1] + x[2] + x[3])
        return dataclasses.replace(walk_at(np.zeros(16)), forward=float(forward))

    settings = planned(dataclasses.replace(study, space=space), **PLANS[name])
    walks = run(settings, path, Ground(space, outward))
    x = np.array([space.encode(walk.candidate) for walk in walks if walk.nominal is None])
    assert (x >= space.limits[:, 0] - 1e-9).all()
    assert (x <= space.limits[:, 1] + 1e-9).all()
    # The law is tested at the edge only if some trial went there.
    assert (np.abs(x[:, :4]) > 0.9 * np.abs(space.limits[:4]).min(axis=1)).any()


# --- proposers that a user hands over ------------------------------------------------------------

HANDED = {
    "all told": functools.partial(
        TrustRegion, network=QUICK_NETWORK, tells_all=True, overlaps=False
    ),
    "by isade": functools.partial(TrustRegion, network=QUICK_NETWORK, isade_points=3),
    "history": functools.partial(NetworkIsade, variant="history", network=QUICK_NETWORK),
}


@pytest.fixture(scope="module")
def usual(study, tmp_path_factory):
    """Candidates of the default proposer."""
    settings = planned(study, samples=20, simulations=38, batch=5)
    walks = run(settings, tmp_path_factory.mktemp("usual") / "study.db")
    return {walk.candidate for walk in walks}


@pytest.mark.parametrize("name", HANDED)
def test_a_search_with_another_proposer_is_as_exact_as_any(study, usual, tmp_path, name):
    settings = planned(study, samples=20, simulations=38, batch=5)
    proposer = HANDED[name]

    def searched(path, ground):
        opened = Study.open(path, driver=True) if path.exists() else Study.create(path, {})
        with opened as file:
            search(settings, file, ground, proposer=proposer(settings))
            return file.walks()

    whole = searched(tmp_path / "whole.db", Ground(settings.space, shuffle=1))
    assert len(whole) == 38
    with pytest.raises(Interruption):
        searched(tmp_path / "parted.db", Ground(settings.space, shuffle=2, stop_after=32))
    parted = searched(tmp_path / "parted.db", Ground(settings.space))
    assert numbers(parted) == numbers(whole)
    assert not {walk.candidate for walk in whole[30:]} & usual
