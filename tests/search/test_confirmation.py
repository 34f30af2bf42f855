"""The race of a study's best candidates, on walks that are looked up instead of simulated."""

import dataclasses
import sys

import numpy as np
import pytest
from conftest import Interruption, numbers, walk_at

from drake_gait.execution.local import Finished
from drake_gait.problem.problem import Trial
from drake_gait.search.confirmation import confirm, walked_as
from drake_gait.search.grounds import end_of_proposal, on_ground
from drake_gait.search.runner import Runner, perturbed
from drake_gait.study.finalists import REFERENCE, best_unslipping, finalists, measured, winner
from drake_gait.study.ranking import sample
from drake_gait.study.records import CONFIRMATION, CONFIRMATIONS, StudyWalk
from drake_gait.study.search_settings import ConfirmationSettings
from drake_gait.study.store import Study
from drake_gait.walk import Fidelity, Outcome

STEADY = dataclasses.replace(walk_at(np.zeros(16)), lateral=0.0, yaw=0.0, com_height=0.245)
CANDIDATES = 20
FORWARD = [0.20 - 0.005 * number for number in range(CANDIDATES)]
"""Distance of each candidate's own walk: the first is the best."""
FRAGILE = {0: {1, 2}, 1: {2, 8}, 3: set(range(1, 9)), 4: {7}}
"""Variations of a candidate that fall."""
MEDIANS = {2: 0.10, 4: 0.17, 5: 0.15}
"""What candidates walk when perturbed, where that is not what they walk alone."""


class Track:
    """Looks walks up by their trial, and remembers the variations that it was asked for."""

    def __init__(self, settings, *, stop_after=None, slip=()):
        self.stop_after, self.slip = stop_after, slip
        self.asked = []
        self.rounds = []
        self.known = {}
        for number in range(CANDIDATES):
            id_ = number * settings.search.replicas
            nominal = Trial(candidate=candidate(settings, number), settings=settings.walk)
            for variation in range(1, 9):
                noisy = perturbed(nominal, settings, id_, variation + settings.search.replicas - 1)
                self.known[noisy] = number, variation
            fine = dataclasses.replace(settings.walk, fidelity=Fidelity.REFERENCE)
            self.known[dataclasses.replace(nominal, settings=fine)] = number, REFERENCE
            own = on_ground(settings.walk, settings, end_of_proposal(settings, 1, id_))
            full = dataclasses.replace(own, measures=True)
            self.known[dataclasses.replace(nominal, settings=full)] = number, 0

    def __call__(self, trials):
        self.rounds.append(len(trials))
        for index in reversed(range(len(trials))):  # Any order will do.
            if len(self.asked) == self.stop_after:
                raise Interruption
            number, variation = self.known[trials[index]]
            self.asked.append((number, variation))
            yield Finished(index=index, walk=self.walk(number, variation), seconds=0.0)

    def walk(self, number, variation):
        alone = dataclasses.replace(STEADY, forward=FORWARD[number])
        if variation == REFERENCE:
            return alone
        if variation == 0:
            return dataclasses.replace(alone, measures=self.slip[number] if self.slip else None)
        if variation in FRAGILE.get(number, ()):
            return dataclasses.replace(STEADY, outcome=Outcome.FELL, steps=100, forward=0.01)
        return dataclasses.replace(STEADY, forward=MEDIANS.get(number, FORWARD[number]))

    def tried(self, number):
        """Perturbed walks of a candidate."""
        return sorted(variation for one, variation in self.asked if one == number and variation > 0)


def candidate(settings, number):
    return settings.space.decode(np.random.default_rng(number).uniform(-1.0, 1.0, 16))


def confirmed_alone(settings, entry):
    """A confirmation of one candidate: the trials that it asks for, and the walks that it keeps."""
    asked, kept = [], []

    def evaluate(trials):
        asked.extend(trials)
        for index in range(len(trials)):
            yield Finished(index=index, walk=STEADY, seconds=0.0)

    class Kept:
        def walks(self):
            return []

        def add(self, walk):
            kept.append(walk)

    runner = Runner(settings, Kept(), evaluate, lambda progress: None)
    first = dataclasses.replace(entry, id=0, walk=STEADY)
    confirm(settings, runner, [sample(0, [first] * settings.search.replicas, settings)])
    return asked, kept


@pytest.fixture
def raced(study):
    """A study whose race has room."""
    return dataclasses.replace(study, confirmation=ConfirmationSettings(walks=120, winners=3))


def confirmed(settings, path, track=None, *, lost=()):
    """Confirm a study of twenty candidates; its walks. Those in `lost` were infeasible."""
    track = track or Track(settings)
    opened = Study.open(path, driver=True) if path.exists() else Study.create(path, {})
    with opened as study:
        if not study.walks():
            for number in range(CANDIDATES):
                lateral = 0.5 if number in lost else 0.0
                study.add(
                    StudyWalk(
                        id=number,
                        stage="infill",
                        iteration=1,
                        candidate=candidate(settings, number),
                        walk=dataclasses.replace(STEADY, forward=FORWARD[number], lateral=lateral),
                    )
                )
        runner = Runner(settings, study, track, lambda progress: None)
        samples = [sample(id_, [runner.walks[id_]], settings) for id_ in range(CANDIDATES)]
        confirm(settings, runner, samples)
        return study.walks()


def planned(settings, **changes):
    return dataclasses.replace(
        settings, confirmation=dataclasses.replace(settings.confirmation, **changes)
    )


def test_a_candidate_is_dropped_at_its_second_failure_of_eight(raced, path):
    track = Track(raced)
    confirmed(raced, path, track)
    assert track.tried(3) == [1, 2]  # Falls every time.
    assert track.tried(1) == list(range(1, 9))  # Falls the second time at its last walk.
    robust = {one.walk.id for one in finalists(raced, confirmed(raced, path)) if one.robust}
    assert robust == {2, 4, 5}


def test_the_race_ends_when_enough_are_robust(raced, path, tmp_path):
    track = Track(raced)
    confirmed(raced, path, track)
    assert {number for number, variation in track.asked if variation > 0} <= set(range(9))
    one = planned(raced, winners=1)
    track = Track(one)
    walks = confirmed(one, tmp_path / "one.db", track)
    assert sum(found.robust for found in finalists(one, walks)) >= 1
    assert not any(track.tried(number) for number in range(6, CANDIDATES))


@pytest.mark.parametrize("budget", [1, 4, 7, 13, 30, 33, 60, 119])
def test_a_race_without_an_end_makes_exactly_the_walks_that_it_may(raced, path, budget):
    settings = planned(raced, walks=budget, winners=CANDIDATES)
    track = Track(settings)
    confirmed(settings, path, track)
    assert len(set(track.asked)) == len(track.asked)
    # The last round is not the race's: it completes what is listed, and measures.
    assert sum(track.rounds[:-1]) == budget


def test_the_listed_are_walked_in_full_and_at_reference_fidelity_and_twelve_with_measures(
    raced, path
):
    track = Track(raced)
    walks = confirmed(raced, path, track)
    references = {number for number, variation in track.asked if variation == REFERENCE}
    assert references == {0, 2, 4, 5}  # The robust ones, and the best single walk.
    for number in references:
        assert track.tried(number) == list(range(1, 9))
    assert {number for number, variation in track.asked if variation == 0} == set(range(12))
    for one in finalists(raced, walks):
        assert (one.reference is not None) == (one.walk.id in references)
        assert one.reference is None or one.reference.variation == REFERENCE
        assert one.measured is not None


def test_the_winner_is_the_robust_candidate_with_the_best_median(raced, path):
    walks = confirmed(raced, path)
    found = winner(raced, walks)
    assert found.walk.id == 4
    assert (found.median, found.worst) == (pytest.approx(0.17), pytest.approx(0.01))
    assert (found.feasible, found.survived) == (7, 7)
    ranked = finalists(raced, walks)
    assert [one.walk.id for one in ranked][:3] == [4, 5, 2]
    assert [one.walk.id for one in ranked[3:]] == sorted(one.walk.id for one in ranked[3:])
    assert not any(one.robust for one in ranked[3:])


def test_where_none_is_robust_nobody_wins(raced, path, monkeypatch):
    monkeypatch.setattr(
        sys.modules[__name__], "FRAGILE", {number: {1, 2} for number in range(CANDIDATES)}
    )
    track = Track(raced)
    walks = confirmed(raced, path, track)
    assert winner(raced, walks) is None
    assert not any(one.robust for one in finalists(raced, walks))
    # Every candidate had its two walks, and the best single one all of them.
    assert [len(track.tried(number)) for number in range(CANDIDATES)] == [8] + [2] * 19


def test_only_feasible_candidates_race(raced, path):
    track = Track(raced)
    walks = confirmed(raced, path, track, lost=(0, 4))
    assert not {number for number, _ in track.asked} & {0, 4}
    assert winner(raced, walks).walk.id not in {0, 4}


def test_a_study_without_a_feasible_walk_has_nothing_to_confirm(raced, path):
    track = Track(raced)
    walks = confirmed(raced, path, track, lost=range(CANDIDATES))
    assert track.asked == []
    assert winner(raced, walks) is None
    assert best_unslipping(raced, walks) is None
    assert finalists(raced, walks) == []


def test_no_walks_switch_the_confirmation_off(raced, path):
    track = Track(raced)
    settings = planned(raced, walks=0)
    assert len(confirmed(settings, path, track)) == CANDIDATES
    assert track.asked == []


@pytest.mark.parametrize("walks", [0, 1, 6, 21, 40, 50, 55])
def test_a_confirmation_that_was_interrupted_ends_with_the_same_walks(raced, tmp_path, walks):
    whole = Track(raced)
    expected = confirmed(raced, tmp_path / "whole.db", whole)
    assert walks < len(whole.asked)
    with pytest.raises(Interruption):
        confirmed(raced, tmp_path / "parted.db", Track(raced, stop_after=walks))
    rest = Track(raced)
    found = confirmed(raced, tmp_path / "parted.db", rest)
    assert numbers(found) == numbers(expected)
    assert len(rest.asked) == len(whole.asked) - walks
    assert winner(raced, found).walk.id == winner(raced, expected).walk.id


def test_a_confirmation_that_is_done_walks_nothing_more(raced, path):
    expected = numbers(confirmed(raced, path))
    again = Track(raced)
    assert numbers(confirmed(raced, path, again)) == expected
    assert again.asked == []


def test_ids_of_confirmations_leave_room_for_any_budget_and_say_whose_they_are(raced, path):
    walks = confirmed(raced, path)
    confirmations = [walk for walk in walks if not walk.is_search_walk]
    assert min(walk.id for walk in confirmations) >= CONFIRMATIONS
    assert {walk.id for walk in walks if walk.is_search_walk} == set(range(CANDIDATES))
    expected = {(walk.nominal, walk.variation): walk.id for walk in confirmations}
    assert len(set(expected.values())) == len(confirmations)
    # A longer race gives the same walk the same id.
    more = confirmed(planned(raced, winners=9), path.with_name("more.db"))
    for walk in more:
        if (key := (walk.nominal, walk.variation)) in expected:
            assert walk.id == expected[key]


def test_variations_differ_from_the_replicas_of_the_search(raced, entry):
    search = dataclasses.replace(raced.search, samples=9, simulations=9, replicas=3)
    settings = dataclasses.replace(raced, search=search)
    nominal = Trial(candidate=entry.candidate, settings=settings.walk)
    own = {perturbed(nominal, settings, 0, variation) for variation in (1, 2)}
    asked, _ = confirmed_alone(settings, entry)
    assert len(set(asked)) == len(asked) == 10  # Eight variations, a reference, measures.
    assert not own & set(asked)


@pytest.mark.parametrize("replicas", [1, 2, 3])
def test_how_a_walk_was_simulated_is_known_from_the_study(raced, entry, replicas):
    # One replica more changes which variations are the slippery ones.
    search = dataclasses.replace(raced.search, samples=6, simulations=6, replicas=replicas)
    settings = dataclasses.replace(raced, search=search)
    asked, walks = confirmed_alone(settings, entry)
    assert {walk.variation for walk in walks} == {REFERENCE, *range(9)}
    for trial, walk in zip(asked, walks, strict=True):
        assert walked_as(settings, walk) == dataclasses.replace(trial.settings, measures=False)
    nominal = Trial(candidate=entry.candidate, settings=settings.walk)
    replica = dataclasses.replace(entry, nominal=0, variation=1)
    assert walked_as(settings, replica) == perturbed(nominal, settings, 0, 1).settings


def test_measures_are_a_walk_s_own_or_those_of_the_same_walk_again(entry, measures):
    full = dataclasses.replace(entry.walk, measures=measures)
    again = dataclasses.replace(entry, id=7, walk=full, stage=CONFIRMATION, nominal=0)
    perturbed_one = dataclasses.replace(again, id=8, variation=1)
    own = dataclasses.replace(entry, id=3, walk=full)
    bare = dataclasses.replace(entry, id=4)
    found = measured([entry, own, bare, again, perturbed_one])
    assert {number: found.get(number) for number in (0, 3, 4)} == {
        0: measures,
        3: measures,
        4: None,
    }


def test_the_best_walk_that_does_not_slip_is_the_furthest_of_those_measured(raced, path, measures):
    slips = [(0.001, 0.05), (0.05, 0.001), (0.01, 0.018), *[(0.0, 0.0)] * 17]
    found = [dataclasses.replace(measures, slip=slip) for slip in slips]
    walks = confirmed(raced, path, Track(raced, slip=found))
    by_id = {one.walk.id: one for one in finalists(raced, walks)}
    # A tenth of the distances is 20, 19.5 and 19 mm; the worse foot counts.
    assert [by_id[number].slipping for number in (0, 1, 2)] == [True, True, False]
    assert best_unslipping(raced, walks).id == 2


def test_where_slip_was_not_measured_none_is_said_not_to_slip(raced, path):
    walks = confirmed(raced, path)
    assert {one.slipping for one in finalists(raced, walks)} == {None}
    assert best_unslipping(raced, walks) is None
