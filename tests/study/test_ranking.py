"""Which walks and candidates are better, and what a candidate's walks amount to together."""

import dataclasses
import math

import numpy as np
import pytest

from drake_gait.problem import Constraints, Objective
from drake_gait.study.ranking import best_walk, feasible_walks, nominal_walks, sample
from drake_gait.study.search_settings import SearchSettings
from drake_gait.walk import Outcome, Walk


def kept(entry, number, **changes):
    return dataclasses.replace(entry, id=number, walk=dataclasses.replace(entry.walk, **changes))


def test_the_best_walk_is_the_furthest_that_is_feasible(entry):
    walks = [
        kept(entry, 0, forward=0.10),
        kept(entry, 1, forward=0.15),
        kept(entry, 2, forward=0.20, lateral=0.03),
        kept(entry, 3, forward=0.15),
    ]
    assert best_walk(walks, Constraints()).id == 1
    assert [walk.id for walk in feasible_walks(walks, Constraints())] == [1, 3, 0]


def test_without_a_feasible_walk_the_best_is_the_one_that_violates_least(entry):
    walks = [
        kept(entry, 0, lateral=0.10, forward=0.2),
        kept(entry, 1, lateral=0.03, forward=0.1),
        kept(entry, 2, yaw=1.0),
    ]
    assert best_walk(walks, Constraints()).id == 1


def test_a_robot_on_its_feet_is_nearer_to_a_feasible_walk_than_one_that_fell_or_was_lost(entry):
    crooked = kept(entry, 0, yaw=np.radians(40.0), lateral=0.1)
    fallen = kept(entry, 1, outcome=Outcome.FELL, frames=230, lateral=0.1, com_height=0.05)
    lost = dataclasses.replace(entry, id=2, walk=Walk.diverged("its process died"))
    assert best_walk([lost, fallen, crooked], Constraints()).id == 0
    assert best_walk([lost, fallen], Constraints()).id == 1
    assert best_walk([lost], Constraints()).id == 2


def test_the_best_walk_is_none_of_the_variations(entry):
    lucky = dataclasses.replace(kept(entry, 1, forward=0.3), nominal=0, variation=1)
    walks = [kept(entry, 0, forward=0.1), lucky]
    assert nominal_walks(walks) == walks[:1]
    assert feasible_walks(walks, Constraints()) == walks[:1]
    assert best_walk(walks, Constraints()).id == 0
    lost = [kept(entry, 0, lateral=0.5), lucky]
    assert best_walk(lost, Constraints()).id == 0


def test_the_best_walk_by_cost_is_the_cheapest(entry, measures):
    walks = [
        kept(entry, number, measures=dataclasses.replace(measures, cost_of_transport=cost))
        for number, cost in enumerate([2.0, 1.5, math.inf])
    ]
    cheapest = Objective.COST_OF_TRANSPORT
    assert [walk.id for walk in feasible_walks(walks, Constraints(), cheapest)] == [1, 0, 2]


def sampled(settings, entry, forwards, fallen=()):
    """A sample of walks with these distances, some of which sway too far."""
    walks = [
        kept(entry, number, forward=forward, lateral=0.1 if number in fallen else 0.0)
        for number, forward in enumerate(forwards)
    ]
    return sample(3, walks, settings)


def test_a_sample_of_one_walk_is_worth_what_the_walk_is(study, entry):
    found = sample(3, [entry], study)
    alone = study.assess(entry.walk)
    assert found.assessment.objective == alone.objective
    assert (found.assessment.violations == alone.violations).all()
    assert found.candidate == entry.candidate


@pytest.mark.parametrize(
    ("walks", "may_fail"), [(1, 0), (2, 0), (4, 0), (7, 0), (8, 1), (15, 1), (16, 2), (24, 3)]
)
def test_a_sample_is_feasible_while_seven_of_eight_of_its_walks_are(study, entry, walks, may_fail):
    good = sampled(study, entry, [0.1] * walks, range(may_fail))
    bad = sampled(study, entry, [0.1] * walks, range(may_fail + 1))
    assert good.assessment.feasible
    assert not bad.assessment.feasible


@pytest.mark.parametrize(
    "forwards", [[0.3], [0.1, 0.2], [0.2, -0.1, 0.15], [0.12, 0.1, 0.5, 0.11, 0.0, 0.14]]
)
def test_a_sample_s_objective_is_the_median_in_any_order(study, entry, forwards):
    found = sampled(study, entry, forwards)
    assert found.assessment.objective == pytest.approx(-np.median(forwards), abs=1e-15)
    again = sampled(study, entry, forwards[::-1])
    assert again.assessment.objective == found.assessment.objective


def test_an_infeasible_sample_is_as_far_off_as_the_walk_that_seven_of_eight_keep_below(
    study, entry
):
    laterals = [0.0, 0.0, 0.0, 0.0, 0.0, 0.03, 0.04, 0.1]
    walks = [kept(entry, number, lateral=value) for number, value in enumerate(laterals)]
    # The largest is not counted; 40 mm is once the limit of 20 mm too far.
    assert sample(0, walks, study).assessment.violations.sum() == pytest.approx(1.0)


def test_samples_rank_feasible_ones_by_their_median_then_upright_then_fallen_then_lost_ones(
    study, entry
):
    fall = {"outcome": Outcome.FELL, "frames": 230}
    worth = [
        [kept(entry, 0, forward=0.2)],
        [kept(entry, 1, forward=0.1)],
        [kept(entry, 2, forward=0.9, lateral=0.03)],
        [kept(entry, 3, forward=0.1, lateral=0.9)],
        [kept(entry, 4, **fall)],
        [dataclasses.replace(entry, id=5, walk=Walk.diverged("made up"))],
    ]
    samples = [sample(number, walks, study) for number, walks in enumerate(worth)]
    shuffled = [samples[place] for place in (3, 5, 1, 0, 4, 2)]
    ranked = sorted(shuffled, key=lambda one: one.rank)
    assert [one.number for one in ranked] == [0, 1, 2, 3, 4, 5]


def test_of_equal_samples_the_earlier_ranks_first(study, entry):
    one, other = sample(1, [entry], study), sample(0, [entry], study)
    assert min([one, other], key=lambda found: found.rank) is other


def test_a_sample_is_worth_what_the_study_wants(study, entry, measures):
    wanted = SearchSettings(
        samples=40, simulations=55, batch=5, objective=Objective.COST_OF_TRANSPORT
    )
    settings = dataclasses.replace(study, search=wanted)
    found = sample(0, [kept(entry, 0, measures=measures)], settings)
    assert found.assessment.objective == pytest.approx(-1.0 / measures.cost_of_transport)
