"""Candidates that are walked again tier by tier, on walks that are looked up, not simulated."""

import dataclasses
import heapq
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

import numpy as np
import pytest
from conftest import Interruption, numbers, run, walk_at
from robust_problem import LIMIT, Grounds

from drake_gait.execution.base import Finished
from drake_gait.problem import Trial
from drake_gait.report.result import summary
from drake_gait.report.tables import tiers
from drake_gait.search.confirmation import confirm, other_servo, walked_as
from drake_gait.search.grounds import BETWEEN, end_of
from drake_gait.search.recommendation import Adviser
from drake_gait.search.runner import Runner, perturbed
from drake_gait.sole import Sole
from drake_gait.study.finalists import (
    OTHER_ENGINE,
    OTHER_SOLE,
    REFERENCE,
    TESTS,
    Tier,
    best_unslipping,
    finalists,
    measured,
    tier_of,
    winner,
)
from drake_gait.study.ranking import best_walk, sample
from drake_gait.study.records import CONFIRMATION, CONFIRMATIONS, StudyWalk
from drake_gait.study.search_settings import ConfirmationSettings, Mode, SearchSettings
from drake_gait.study.store import Study
from drake_gait.walk import Engine, Fidelity, Outcome

STEADY = dataclasses.replace(walk_at(np.zeros(16)), lateral=0.0, yaw=0.0, com_height=0.245)
CANDIDATES = 20
FORWARD = [0.20 - 0.005 * number for number in range(CANDIDATES)]
"""Distance of each candidate's own walk: the first is the best."""
FRAGILE = {
    0: {1, 2},
    1: {2, 8},
    2: {10, 11},
    3: set(range(1, 17)),
    4: {7},
    5: {9},
    6: {3, 12, 16},
    7: {4, 13},
    9: {1, 3},
    10: {8, 9, 16},
}
"""Variations of a candidate that fall: to 8 those of T1, to 16 those of T2."""
MEDIANS = {4: 0.15, 5: 0.17, 7: 0.16}
"""What candidates walk when perturbed, where that is not what they walk alone."""


class Track:
    """Looks walks up by their trial, and remembers the variations that it was asked for."""

    def __init__(self, settings, *, stop_after=None, fragile=FRAGILE):
        self.stop_after, self.fragile = stop_after, fragile
        self.asked = []
        self.known = {}
        for number in range(CANDIDATES):
            id_ = number * settings.search.replicas
            nominal = Trial(candidate=candidate(settings, number), settings=settings.walk)
            fine = dataclasses.replace(settings.walk, fidelity=Fidelity.REFERENCE)
            self.keep(nominal, number, REFERENCE, fine)
            for variation in Tier.REPEATS.variations(settings.confirmation):
                self.keep(self.noisy(settings, nominal, id_, variation), number, variation)
            for variation in Tier.CONVERGED.variations(settings.confirmation):
                noisy = self.noisy(settings, nominal, id_, variation)
                finer = dataclasses.replace(noisy.settings, fidelity=Fidelity.REFERENCE)
                self.keep(noisy, number, variation, finer)
            for variation in Tier.SERVO.variations(settings.confirmation):
                other = other_servo(settings, fine, id_, variation)
                self.keep(nominal, number, variation, other)
            elsewhere = dataclasses.replace(fine, sole=Sole.POINTS)
            self.keep(nominal, number, OTHER_SOLE, elsewhere)
            elsewhere = dataclasses.replace(fine, engine=Engine.MUJOCO)
            self.keep(nominal, number, OTHER_ENGINE, elsewhere)

    def keep(self, trial, number, variation, settings=None):
        settings = settings or trial.settings
        self.known[dataclasses.replace(trial, settings=settings)] = number, variation

    def noisy(self, settings, nominal, id_, variation):
        return perturbed(nominal, settings, id_, variation + settings.search.replicas - 1)

    def __call__(self, trials):
        for index in reversed(range(len(trials))):  # Any order will do.
            if len(self.asked) == self.stop_after:
                raise Interruption
            number, variation = self.known[trials[index]]
            self.asked.append((number, variation))
            yield Finished(index=index, walk=self.walk(number, variation), seconds=0.0)

    def walk(self, number, variation):
        if variation == REFERENCE:
            return dataclasses.replace(STEADY, forward=FORWARD[number])
        if variation in self.fragile.get(number, ()):
            return dataclasses.replace(STEADY, outcome=Outcome.FELL, frames=100, forward=0.01)
        return dataclasses.replace(STEADY, forward=MEDIANS.get(number, FORWARD[number]))

    def tried(self, number, tier=Tier.REPEATS):
        """Variations of a candidate that were walked in a tier, as numbers from 1."""
        asked = sorted(variation for one, variation in self.asked if one == number)
        first = tier.variations(ConfirmationSettings()).start
        return [
            one - first + 1
            for one in asked
            if tier_of(ConfirmationSettings(), one) is tier and one > 0
        ]


class Hurried:
    """The same walks from several threads, which end in no order."""

    def __init__(self, track, workers):
        self.track, self.pool = track, ThreadPoolExecutor(workers)

    def __call__(self, trials):
        futures = {self.pool.submit(self.one, trial): n for n, trial in enumerate(trials)}
        return self.finished(futures)

    def finished(self, futures):
        for future in as_completed(futures):
            yield Finished(index=futures[future], walk=future.result(), seconds=0.0)

    def one(self, trial):
        number, variation = self.track.known[trial]
        time.sleep(0.001 * ((7 * number + 3 * variation) % 5))
        return self.track.walk(number, variation)


def candidate(settings, number):
    return settings.space.decode(np.random.default_rng(number).uniform(-1.0, 1.0, 16))


def confirmed_alone(settings, entry):
    """A confirmation of one candidate: the trials that it asks for, and the walks that it keeps."""
    asked, kept = [], []
    first = dataclasses.replace(entry, id=0, walk=STEADY)

    def evaluate(trials):
        asked.extend(trials)
        for index in range(len(trials)):
            yield Finished(index=index, walk=STEADY, seconds=0.0)

    class Kept:
        def walks(self):
            return [first]

        def add(self, walk):
            kept.append(walk)

    runner = Runner(settings, Kept(), evaluate, lambda progress: None)
    confirm(settings, runner, [sample(0, [first] * settings.search.replicas, settings)])
    return asked, kept


@pytest.fixture(scope="module")
def raced(study):
    """A study whose race has room; its candidates are looked up, so that means are unknown."""
    return dataclasses.replace(study, confirmation=ConfirmationSettings(walks=120, means=False))


@pytest.fixture(scope="module")
def whole(raced, tmp_path_factory):
    """An undisturbed confirmation: what was asked for, and the study's walks after it."""
    track = Track(raced)
    return track, confirmed(raced, tmp_path_factory.mktemp("whole") / "study.db", track)


@pytest.fixture(scope="module")
def wide(raced):
    """A confirmation that stops at its budget alone."""
    return planned(raced, winners=CANDIDATES, walks=400, reference_walks=400)


@pytest.fixture(scope="module")
def widest(wide, tmp_path_factory):
    """The same of that one."""
    track = Track(wide)
    return track, confirmed(wide, tmp_path_factory.mktemp("wide") / "study.db", track)


def confirmed(settings, path, track=None, *, lost=(), measures=()):
    """Confirm a study of twenty candidates; its walks. Those in `lost` were infeasible."""
    track = track or Track(settings)
    opened = Study.open(path, driver=True) if path.exists() else Study.create(path, {})
    with opened as study:
        if not study.walks():
            for number in range(CANDIDATES):
                own = dataclasses.replace(
                    STEADY,
                    forward=FORWARD[number],
                    lateral=0.5 if number in lost else 0.0,
                    measures=measures[number] if measures else None,
                )
                study.add(
                    StudyWalk(
                        id=number,
                        stage="infill",
                        iteration=1,
                        candidate=candidate(settings, number),
                        walk=own,
                    )
                )
        runner = Runner(settings, study, track, lambda progress: None)
        samples = [sample(id_, [runner.walks[id_]], settings) for id_ in range(CANDIDATES)]
        # What is learnt of the same walks is the same: it is learnt once.
        known = settings.seed, tuple(lost)
        if known not in ADVISERS:
            ADVISERS[known] = Adviser(settings, samples)
        confirm(settings, runner, samples, advise=ADVISERS[known].recommended)
        return study.walks()


ADVISERS = {}
"""Advice on the twenty candidates, by the seed of the study and those that are lost."""


def planned(settings, **changes):
    return dataclasses.replace(
        settings, confirmation=dataclasses.replace(settings.confirmation, **changes)
    )


def test_a_candidate_is_dropped_at_its_second_failure_of_a_tier(wide, widest):
    track, _ = widest
    assert track.tried(1) == list(range(1, 9))  # Falls the second time at its last walk.
    dropped = 0
    for number in range(1, CANDIDATES):  # The best single walk is walked in full.
        for tier in TESTS:
            first = tier.variations(wide.confirmation).start
            tried = [n + first - 1 for n in track.tried(number, tier)]
            fallen = [n for n in tried if n in FRAGILE.get(number, ())]
            if len(fallen) >= 2:
                dropped += 1
                # Two may be under way when it is known.
                assert len([n for n in tried if n > fallen[1]]) <= 2
                assert tier is Tier.CONVERGED or not track.tried(number, Tier.CONVERGED)
            else:
                assert not fallen or len(tried) == 8
    assert dropped >= 4


def test_a_tier_is_tested_when_the_one_before_it_is_passed_and_its_law_is_seven_of_eight(
    wide, widest
):
    _, walks = widest
    for one in finalists(wide, walks):
        counts = (one.feasible, one.converged_feasible)
        passed = [count >= 7 for count in counts]
        assert min(one.tier, 2) == (2 if all(passed) else 1 if passed[0] else 0)
        assert not one.converged or passed[0]
        assert (one.trusted is None) == (one.tier < 2)
        if one.tier == 2:
            assert len(one.converged) == len(one.variations) == 8
    tiers = {one.walk.id: one.tier for one in finalists(wide, walks)}
    # The winner, 5, is tried on another sole and in the other engine too.
    assert [tiers[number] for number in range(8)] == [0, 0, 1, 0, 2, 4, 1, 2]
    assert tiers[10] == 1


def test_the_winner_has_the_best_trusted_median_and_not_the_furthest_single_walk(wide, widest):
    _, walks = widest
    found = winner(wide, walks)
    assert found.walk.id == 5
    assert found.tier >= Tier.CONVERGED
    assert found.trusted == pytest.approx(0.17)
    ranked = [(-one.tier, -(one.trusted or 0.0)) for one in finalists(wide, walks)]
    assert ranked == sorted(ranked)


def test_without_a_candidate_that_converges_the_best_that_repeats_wins_and_is_not_trusted(
    raced, path
):
    fragile = {number: {9, 10} for number in range(1, CANDIDATES)} | {0: {1, 2}}
    track = Track(raced, fragile=fragile)
    walks = confirmed(raced, path, track)
    found = winner(raced, walks)
    assert found.tier is Tier.REPEATS
    assert found.trusted is None
    assert found.median == max(one.median for one in finalists(raced, walks) if one.robust)
    assert not any(tier_of(raced.confirmation, v) is Tier.SERVO for _, v in track.asked)


TRUSTED = {"fragile": FRAGILE}
REPEATING = {"fragile": {number: {9, 10} for number in range(CANDIDATES)}}
FALLING = {"fragile": {number: {1, 2} for number in range(CANDIDATES)}}


@pytest.mark.parametrize(
    ("walked", "changes", "tier", "first"),
    [
        (TRUSTED, {}, 2, "The winner of 20 walks is walk 5, which can be trusted: 170.0 mm"),
        (REPEATING, {}, 1, "No gait holds at reference fidelity"),
        (FALLING, {}, 0, "No gait holds: none repeats"),
        (TRUSTED, {"walks": 0}, 0, "No gait is known to hold: none was walked again"),
        (TRUSTED, {"reference_walks": 0}, 1, "No gait is known to hold at reference fidelity"),
    ],
)
def test_a_result_says_first_whether_its_gait_can_be_trusted(
    raced, path, walked, changes, tier, first
):
    settings = planned(raced, **changes)
    walks = confirmed(settings, path, Track(settings, **walked))
    result = summary(settings, walks, None, wall_s=0.0)
    assert result["verdict"].startswith(first)
    assert min(result["tier"], 2) == tier  # The winner may be tried elsewhere too.
    assert (result["trusted_mm"] is None) == (tier < 2)
    for entry in result["finalists"]:
        assert (entry["trusted_mm"] is None) == (entry["tier"] < 2)
        assert min(entry["tier"], 2) <= tier
    if tier == 2:
        best = result["finalists"][0]
        assert result["trusted_mm"] == best["trusted_mm"] == best["converged"]["median_mm"]
        assert best["servo"]["of"] == 16
    assert not result["finalists"] or tiers(settings, walks).rows[0][-1] == f"T{result['tier']}"
    if not tier:
        assert result["winner"] is None


def test_where_none_repeats_nobody_wins(raced, path):
    track = Track(raced, fragile={number: {1, 2} for number in range(CANDIDATES)})
    walks = confirmed(raced, path, track)
    assert winner(raced, walks) is None
    assert {one.tier for one in finalists(raced, walks)} == {Tier.FOUND}
    # The best single one had all of them, every other two, and two that were under way.
    counts = [len(track.tried(number)) for number in range(CANDIDATES)]
    assert counts[0] == 8
    assert all(2 <= count <= 4 for count in counts[1:])


def test_the_confirmation_ends_when_nobody_promises_more_than_is_trusted(raced, path):
    track = Track(raced, fragile={})
    walks = confirmed(raced, path, track)
    trusted = winner(raced, walks).trusted
    # Who was not walked had less to offer; the first ones are under way together.
    tried = {number for number, variation in track.asked if variation > 0}
    assert all(FORWARD[number] <= trusted for number in set(range(CANDIDATES)) - tried)
    assert len(tried) < CANDIDATES / 2


@pytest.mark.parametrize("budget", [1, 4, 7, 13, 30])
@pytest.mark.parametrize("finer", [1, 5, 8, 20])
def test_no_tier_has_more_walks_than_its_budget_and_what_completes_the_listed(
    wide, path, budget, finer
):
    settings = planned(wide, walks=budget, reference_walks=finer)
    track = Track(settings, fragile={})
    walks = confirmed(settings, path, track)
    assert len(set(track.asked)) == len(track.asked)
    listed = {one.walk.id for one in finalists(settings, walks) if one.reference}
    for tier, most in zip(TESTS, (budget, finer), strict=True):
        counts = [len(track.tried(number, tier)) for number in range(CANDIDATES)]
        completed = sum(1 for number in listed if counts[number] == 8)
        assert most <= sum(counts) <= most + 8 * completed or tier is Tier.CONVERGED
        assert tier is Tier.REPEATS or sum(counts) <= most + completed


def test_noise_at_reference_fidelity_is_fresh(wide, widest):
    walks = [walk for walk in widest[1] if walk.variation > 0 and walk.nominal == 5]
    noise = {walk.variation: walk.candidate.gait.coefficients.tobytes() for walk in walks}
    plan = wide.confirmation
    perturbed_ones = [n for tier in TESTS for n in tier.variations(plan)]
    assert len({noise[number] for number in perturbed_ones}) == 16
    fine = {
        n for n in noise if walked_as(wide, walks[list(noise).index(n)]).fidelity == "reference"
    }
    assert fine == set(noise) - set(Tier.REPEATS.variations(plan))


def test_the_winner_alone_walks_with_other_servos_within_the_ranges(raced, whole, tmp_path):
    _, walks = whole
    found = winner(raced, walks)
    assert {one.walk.id for one in finalists(raced, walks) if one.servo} == {found.walk.id}
    assert (len(found.servo), found.servo_feasible) == (16, 16)
    hows = [walked_as(raced, walk) for walk in found.servo]
    assert len(set(hows)) == 16
    for how, walk in zip(hows, found.servo, strict=True):
        assert walk.candidate == found.walk.candidate
        assert end_of(raced, walk) == BETWEEN
        assert how.friction == raced.walk.friction
        assert max(map(abs, how.disturbance.joint_zeros)) <= np.radians(0.5)
        assert 0.97 <= how.disturbance.mass <= 1.03
        assert 0.9 <= how.disturbance.voltage <= 1.1
        assert how.servo.no_load_speed == raced.walk.servo.no_load_speed  # The supply scales it.
        assert 0.9 <= how.servo.stiffness / raced.walk.servo.stiffness <= 1.1
    none = planned(raced, servo_walks=0)
    assert winner(none, confirmed(none, tmp_path / "none.db")).servo == ()


def test_only_feasible_candidates_are_walked_again(raced, path):
    track = Track(raced)
    walks = confirmed(raced, path, track, lost=(0, 5))
    assert not {number for number, _ in track.asked} & {0, 5}
    assert winner(raced, walks).walk.id not in {0, 5}


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


@pytest.mark.parametrize(
    "walks", [0, 6, 40, *(pytest.param(one, marks=pytest.mark.slow) for one in (1, 21, 50, 55))]
)
def test_a_confirmation_that_was_interrupted_ends_with_the_same_walks(raced, whole, path, walks):
    asked, expected = whole[0].asked, whole[1]
    assert walks < len(asked)
    with pytest.raises(Interruption):
        confirmed(raced, path, Track(raced, stop_after=walks))
    rest = Track(raced)
    found = confirmed(raced, path, rest)
    assert numbers(found) == numbers(expected)
    assert len(rest.asked) == len(asked) - walks
    assert winner(raced, found).walk.id == winner(raced, expected).walk.id


@pytest.mark.parametrize("workers", [1, 2, 4, 7])
def test_any_number_of_workers_makes_the_same_walks_however_they_end(raced, whole, path, workers):
    hurried = Hurried(Track(raced), workers)
    assert numbers(confirmed(raced, path, hurried)) == numbers(whole[1])


def test_a_confirmation_that_is_done_walks_nothing_more(raced, path):
    expected = numbers(confirmed(raced, path))
    again = Track(raced)
    assert numbers(confirmed(raced, path, again)) == expected
    assert again.asked == []


def test_ids_of_confirmations_leave_room_for_any_budget_and_say_whose_they_are(whole, widest):
    _, walks = whole
    confirmations = [walk for walk in walks if not walk.is_search_walk]
    assert min(walk.id for walk in confirmations) >= CONFIRMATIONS
    assert {walk.id for walk in walks if walk.is_search_walk} == set(range(CANDIDATES))
    expected = {(walk.nominal, walk.variation): walk.id for walk in confirmations}
    assert len(set(expected.values())) == len(confirmations)
    # A longer one gives the same walk the same id.
    for walk in widest[1]:
        if (key := (walk.nominal, walk.variation)) in expected:
            assert walk.id == expected[key]


def test_a_study_of_before_the_tiers_keeps_its_ids_and_its_robust_winner(raced, path):
    settings = planned(raced, reference_walks=0, servo_walks=0, winners=3)
    walks = confirmed(settings, path)
    for walk in walks:
        if not walk.is_search_walk:
            assert walk.id == CONFIRMATIONS + 10 * walk.nominal + walk.variation + 1
    assert {walk.variation for walk in walks} <= set(range(REFERENCE, 9))
    found = winner(settings, walks)
    assert (found.tier, found.trusted, found.converged) == (Tier.REPEATS, None, ())
    assert found.reference is not None
    assert sum(one.robust for one in finalists(settings, walks)) >= 3


def test_variations_differ_from_the_replicas_of_the_search(raced, entry):
    search = dataclasses.replace(raced.search, samples=9, simulations=9, replicas=3)
    settings = dataclasses.replace(raced, search=search)
    nominal = Trial(candidate=entry.candidate, settings=settings.walk)
    own = {perturbed(nominal, settings, 0, variation) for variation in (1, 2)}
    asked, _ = confirmed_alone(settings, entry)
    # Eight variations in each of two tiers, sixteen servos, a reference, another sole and engine.
    assert len(set(asked)) == len(asked) == 35
    assert not own & set(asked)


@pytest.mark.parametrize("replicas", [1, 2, 3])
def test_how_a_walk_was_simulated_is_known_from_the_study(raced, entry, replicas):
    # One replica more changes which variations are the slippery ones.
    search = dataclasses.replace(raced.search, samples=6, simulations=6, replicas=replicas)
    settings = dataclasses.replace(raced, search=search)
    asked, walks = confirmed_alone(settings, entry)
    assert {walk.variation for walk in walks} == {
        OTHER_ENGINE,
        OTHER_SOLE,
        REFERENCE,
        *range(1, 33),
    }
    for trial, walk in zip(asked, walks, strict=True):
        assert walked_as(settings, walk) == trial.settings
    nominal = Trial(candidate=entry.candidate, settings=settings.walk)
    replica = dataclasses.replace(entry, nominal=0, variation=1)
    assert walked_as(settings, replica) == perturbed(nominal, settings, 0, 1).settings


class Biased(Grounds):
    """The robust problem, whose walks drift otherwise at reference fidelity the further they go."""

    def walk(self, trial):
        found = super().walk(trial)
        if trial.settings.fidelity is not Fidelity.REFERENCE:
            return found
        x = self.settings.space.encode(trial.candidate)
        return dataclasses.replace(found, lateral=found.lateral + 0.15 * LIMIT * x[0])


@pytest.mark.parametrize("mode", [Mode.CMAES, Mode.ISADE])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_winner_that_holds_is_found_where_the_luckiest_walk_fails(study, tmp_path, mode, seed):
    plan = SearchSettings(samples=40, simulations=160, batch=10, mode=mode)
    settings = dataclasses.replace(
        study, seed=seed, search=plan, confirmation=ConfirmationSettings()
    )
    walks = run(settings, tmp_path / "s.db", Biased(settings))
    found = winner(settings, walks)
    assert found.tier >= Tier.CONVERGED
    searched = [walk for walk in walks if walk.is_search_walk]
    luckiest = best_walk(searched, settings.constraints)
    (lucky,) = (one for one in finalists(settings, walks) if one.walk.id == luckiest.id)
    assert lucky.tier < Tier.CONVERGED
    assert luckiest.walk.forward > found.trusted > 0.15


# --- other soles, other engines ------------------------------------------------------------------


def elsewhere(settings, walks, *, sole=None, engine=None):
    """The winner of a study whose walks elsewhere went otherwise; None leaves a walk out."""
    first = winner(settings, walks).walk
    others = {OTHER_SOLE: sole, OTHER_ENGINE: engine}
    kept = [walk for walk in walks if walk.variation not in others]
    for variation, walk in others.items():
        if walk is not None:
            again = {"id": CONFIRMATIONS * 10 - variation, "stage": CONFIRMATION}
            kept.append(
                dataclasses.replace(
                    first, nominal=first.id, variation=variation, walk=walk, **again
                )
            )
    return winner(settings, kept)


def far(part):
    """A walk that goes a part of the way that candidate 5 goes alone."""
    return dataclasses.replace(STEADY, forward=part * FORWARD[5], lateral=0.5, yaw=1.0)


FALLEN = dataclasses.replace(far(1.0), outcome=Outcome.FELL)


@pytest.mark.parametrize(
    ("sole", "engine", "tier"),
    [
        (far(0.91), far(1.09), Tier.TRANSFERS),  # Drift and turn are reported, and decide nothing.
        (far(0.89), far(1.0), Tier.CONVERGED),
        (far(1.0), far(1.11), Tier.CONVERGED),
        (far(1.0), FALLEN, Tier.CONVERGED),
        (far(1.0), None, Tier.CONVERGED),
        (None, far(1.0), Tier.CONVERGED),
    ],
)
def test_a_winner_transfers_that_is_upright_and_as_far_on_another_sole_and_in_another_engine(
    raced, whole, sole, engine, tier
):
    found = elsewhere(raced, whole[1], sole=sole, engine=engine)
    assert found.walk.id == 5
    assert found.tier is tier
    assert found.trusted == pytest.approx(0.17)
    assert len(found.servo) == 16


def test_another_tolerance_bears_other_distances(raced, whole):
    _, walks = whole
    for tolerance, tier in ((0.3, Tier.TRANSFERS), (0.2, Tier.CONVERGED)):
        settings = planned(raced, transfer_distance=tolerance)
        assert elsewhere(settings, walks, sole=far(0.75), engine=far(1.0)).tier is tier


def test_a_gait_that_does_not_converge_transfers_nowhere(raced, path):
    walks = confirmed(raced, path, Track(raced, **REPEATING))
    assert not any(walk.variation in (OTHER_SOLE, OTHER_ENGINE) for walk in walks)
    assert elsewhere(raced, walks, sole=far(1.0), engine=far(1.0)).tier is Tier.REPEATS


def test_what_transfers_is_reported_and_does_not_decide_who_wins(raced, whole, wide, widest):
    _, walks = whole
    (own,) = (walk for walk in walks if walk.variation == OTHER_SOLE)
    assert own.nominal == winner(raced, walks).walk.id == 5
    how = walked_as(raced, own)
    assert (how.sole, how.fidelity, how.disturbance) == (Sole.POINTS, Fidelity.REFERENCE, None)
    assert own.candidate == winner(raced, walks).walk.candidate
    # Another converges too, and transfers; it goes less far, so that it does not win.
    moved = [
        dataclasses.replace(walk, id=CONFIRMATIONS * 10 + n, variation=variation, nominal=4)
        for n, variation in enumerate((OTHER_SOLE, OTHER_ENGINE))
        for walk in walks
        if walk.variation == REFERENCE and walk.nominal == 5
    ]
    moved.append(
        dataclasses.replace(moved[0], id=CONFIRMATIONS * 10 + 2, variation=REFERENCE, nominal=4)
    )
    known = [walk for walk in widest[1] if (walk.nominal, walk.variation) != (4, REFERENCE)]
    tiers = {one.walk.id: one.tier for one in finalists(wide, [*known, *moved])}
    assert tiers[4] is Tier.TRANSFERS
    assert winner(wide, [*known, *moved]).walk.id == 5


def test_without_transfer_no_walk_is_elsewhere(raced, path):
    settings = planned(raced, transfer=False)
    walks = confirmed(settings, path)
    assert min(walk.variation for walk in walks) == REFERENCE
    assert winner(settings, walks).tier is Tier.CONVERGED


# --- workers -------------------------------------------------------------------------------------


class Virtual:
    """Workers on a clock of their own: walks cost what they would, and nobody waits."""

    def __init__(self, track, workers):
        self.track, self.now, self.work = track, 0.0, 0.0
        self.free = [0.0] * workers

    def __call__(self, trials):
        done = []
        for index, trial in enumerate(trials):
            fine = trial.settings.fidelity is Fidelity.REFERENCE
            cost = 1.0 if fine else 0.2
            end = max(self.now, heapq.heappop(self.free)) + cost
            heapq.heappush(self.free, end)
            self.work += cost
            done.append((end, index, self.track.walk(*self.track.known[trial])))
        return self.finished(sorted(done, key=lambda one: one[:2]))

    def finished(self, done):
        for end, index, walk in done:
            self.now = max(self.now, end)
            yield Finished(index=index, walk=walk, seconds=0.0)

    @property
    def busy(self):
        return self.work / (len(self.free) * max(self.free))


@pytest.mark.parametrize(("workers", "share"), [(1, 0.999), (2, 0.97), (8, 0.55)])
def test_workers_are_kept_busy_to_the_end(raced, path, workers, share):
    # Eight wait at times: the race has no more under way, and hears of them in order.
    clock = Virtual(Track(raced), workers)
    confirmed(raced, path, clock)
    assert clock.busy > share


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


@pytest.mark.parametrize("again", [True, False])
def test_a_finalist_slips_as_its_own_walk_does_or_the_same_walk_again(
    raced, whole, measures, again
):
    slid = dataclasses.replace(measures, slip=(0.0, 0.1))
    walks = []
    for walk in whole[1]:
        if walk.id != 5:
            walks.append(walk)
            continue
        full = dataclasses.replace(walk, walk=dataclasses.replace(walk.walk, measures=slid))
        walks.append(walk if again else full)
        if again:  # As older versions walked it to measure it.
            where = {"id": CONFIRMATIONS * 10, "stage": CONFIRMATION, "nominal": walk.id}
            walks.append(dataclasses.replace(full, **where))
    assert {one.walk.id: one.slipping for one in finalists(raced, walks)}[5] is True


def test_the_best_walk_that_does_not_slip_is_the_furthest_of_those_measured(raced, path, measures):
    slips = [(0.001, 0.05), (0.05, 0.001), (0.01, 0.018), *[(0.0, 0.0)] * 17]
    found = [dataclasses.replace(measures, slip=slip) for slip in slips]
    walks = confirmed(raced, path, measures=found)
    by_id = {one.walk.id: one for one in finalists(raced, walks)}
    # A tenth of the distances is 20, 19.5 and 19 mm; the worse foot counts.
    assert [by_id[number].slipping for number in (0, 1, 2)] == [True, True, False]
    assert best_unslipping(raced, walks).id == 2


def test_where_slip_was_not_measured_none_is_said_not_to_slip(raced, whole):
    _, walks = whole
    assert {one.slipping for one in finalists(raced, walks)} == {None}
    assert best_unslipping(raced, walks) is None
