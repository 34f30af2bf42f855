"""Confirmation: candidates of a search are walked again, tier by tier, to be trusted.

A single walk says little: a twentieth of a degree may turn it by degrees. Candidates are walked
with noise on every coefficient, and friction that is lower and higher in turn. Those that repeat
are walked with fresh noise at reference fidelity. Fresh, because whoever is chosen for its luck has
none left. One that fails too often is dropped at once. The winner is walked with other servos.

What is walked next is what the search recommends, by chance times gain, and not its luckiest walk.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_gait.gait import JOINTS
from drake_gait.problem import Trial
from drake_gait.search.grounds import end_of, on_ground
from drake_gait.search.recommendation import Adviser
from drake_gait.search.runner import Planned, Runner, perturbed
from drake_gait.search.seeding import Purpose, generator
from drake_gait.study.finalists import (
    REFERENCE,
    TESTS,
    Finalist,
    Tier,
    finalists,
    tier_of,
    winner,
)
from drake_gait.study.ranking import Sample
from drake_gait.study.records import CONFIRMATION, CONFIRMATIONS, StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.walk import Disturbance, Fidelity, WalkSettings

__all__ = ["Finalist", "Tier", "confirm", "finalists", "walked_as", "winner"]

_IN_FLIGHT = 6
"""Walks under way at once: each is decided when all but the last five before it are known.

The number is not that of the workers, so that any number of them makes the same walks.
"""
_LOOKED_AT = 12
"""Feasible walks, the best first, that are looked at for one that does not slip."""
_BELIEF = 2.0
"""Walks that what the search says of a candidate counts for, beside the candidate's own."""
_WORTH = 0.01
"""Gain to expect, in parts of what is trusted, that a candidate is still walked for."""

_JOINT_ZERO = np.radians(0.5)
_STIFFNESS, _VOLTAGE, _MASS = 0.1, 0.1, 0.03
"""Largest changes of a walk with other servos, drawn evenly: angle [rad], and parts."""


def confirm(settings: StudySettings, runner: Runner, samples: Sequence[Sample]) -> None:
    """Walk the best candidates of a finished search again.

    The same walks give the same confirmation: one that was interrupted goes on.
    """
    if settings.confirmation.walks == 0:
        return
    race = _Race(settings, runner, samples)
    race.run()
    runner.start(race.listed_walks())
    runner.finish()
    runner.start(race.servo_walks())
    runner.finish()


def walked_as(settings: StudySettings, walk: StudyWalk) -> WalkSettings:
    """Return how any walk of a study was simulated, its ground, fidelity and servos included."""
    return _simulated_as(settings, settings.walk, walk)


def other_servo(
    settings: StudySettings, walk: WalkSettings, nominal: int, number: int
) -> WalkSettings:
    """Return how a walk is simulated with other servos, supply, joint zeros and masses.

    Args:
        settings: Fix the changes by their seed.
        walk: How it is simulated without them.
        nominal: Id of the walk of the candidate as it is.
        number: The variation's number.
    """
    rng = generator(settings.seed, Purpose.SERVO, nominal, number)
    zeros = rng.uniform(-_JOINT_ZERO, _JOINT_ZERO, len(JOINTS))
    stiffness, voltage, mass = 1.0 + rng.uniform(-1.0, 1.0, 3) * (_STIFFNESS, _VOLTAGE, _MASS)
    servo = replace(
        walk.servo,
        stiffness=float(stiffness * walk.servo.stiffness),
        no_load_speed=float(voltage * walk.servo.no_load_speed),
    )
    disturbance = Disturbance(
        joint_zeros=tuple(zeros.tolist()), voltage=float(voltage), mass=float(mass)
    )
    return replace(walk, servo=servo, disturbance=disturbance)


def _simulated_as(settings: StudySettings, how: WalkSettings, walk: StudyWalk) -> WalkSettings:
    """Return how a walk of a study is simulated, from how those of its search are."""
    how = on_ground(how, settings, end_of(settings, walk))
    if walk.is_search_walk or walk.nominal is None:
        return how
    tier = tier_of(settings.confirmation, walk.variation)
    if walk.variation == REFERENCE or tier >= Tier.CONVERGED:
        how = replace(how, fidelity=Fidelity.REFERENCE)
    if tier is Tier.SERVO:
        how = other_servo(settings, how, walk.nominal, walk.variation)
    return how


@dataclass(kw_only=True, eq=False)
class _Test:
    """The walks of one candidate in one tier."""

    begun: int = 0
    """Walks that were begun."""
    known: list[StudyWalk] = field(default_factory=list)
    """Those that ended, in the order of their variation."""
    held: int = 0
    """How many of them are feasible."""


class _Race:
    """Candidates that are walked again, the most promising first, until enough can be trusted."""

    def __init__(self, settings: StudySettings, runner: Runner, samples: Sequence[Sample]) -> None:
        self._settings, self._plan = settings, settings.confirmation
        self._runner = runner
        ranked = sorted(samples, key=lambda one: one.rank)
        self._field = [one for one in ranked if one.assessment.feasible]
        self._samples = {one.number: one for one in self._field}
        self._adviser = Adviser(settings, samples) if self._field else None
        self._tests = {tier: {number: _Test() for number in self._samples} for tier in self._tiers}
        self._answers: list[StudyWalk] = []

    @property
    def _tiers(self) -> tuple[Tier, ...]:
        return TESTS if self._plan.reference_walks else TESTS[:1]

    def run(self) -> None:
        """Walk until no candidate is worth another walk.

        Answers are heard in the order in which they were asked for, however they come in.
        """
        under_way: deque[tuple[int, Tier, Callable[[], StudyWalk]]] = deque()
        while True:
            following = self._following()
            if following is not None:
                number, tier = following
                planned = self._planned(self._samples[number], self._begun(number, tier))
                under_way.append((number, tier, self._runner.begin(planned)))
            if under_way and (following is None or len(under_way) == _IN_FLIGHT):
                number, tier, wait = under_way.popleft()
                self._note(number, tier, wait())
            elif following is None:
                return

    def listed_walks(self) -> Iterator[Planned]:
        """Yield all that is reported of the best single walk and of each that holds."""
        reached = self._reached(self._tiers[-1]) or self._reached(self._tiers[0])
        listed = dict.fromkeys([*reached, *(one.number for one in self._field[:1])])
        for number in listed:
            one = self._samples[number]
            for tier in self._tiers:
                if tier is Tier.REPEATS or number in self._reached(tier):
                    for variation in tier.variations(self._plan):
                        yield self._planned(one, variation)
            yield self._planned(one, REFERENCE)
        measured = dict.fromkeys([*listed, *(one.number for one in self._field[:_LOOKED_AT])])
        for number in measured:
            yield self._planned(self._samples[number], 0)

    def servo_walks(self) -> Iterator[Planned]:
        """Yield the walks of the winner with other servos, if it converges."""
        found = winner(self._settings, list(self._runner.walks.values()))
        if found is None or found.tier < Tier.CONVERGED:
            return
        own = [one for one in self._field if one.walks[0].id == found.walk.id]
        for one in own:
            for variation in Tier.SERVO.variations(self._plan):
                yield self._planned(one, variation)

    def _following(self) -> tuple[int, Tier] | None:
        """Return the candidate to walk next, and in which tier; None if there is nothing to do."""
        for number in self._promising():
            tier = self._tier_under_test(number)
            if tier is not None and self._may_walk(number, tier):
                return number, tier
        return None

    def _promising(self) -> list[int]:
        """Return the candidates that are worth a walk, the most promising first."""
        if self._adviser is None:
            return []
        last = self._tiers[-1]
        trusted = [self._gain(one) for one in self._samples if self._has_passed(one, last)]
        beyond = max([0.0, *trusted])
        enough = len(trusted) >= self._plan.winners
        promises = {}
        for one in self._adviser.recommended(self._answers):
            # Means have no walk of their own, whose id would be theirs for good.
            if one.number is None or self._tier_under_test(one.number) is None:
                continue
            chance, gain = self._chance(one.number, one.chance), self._gain(one.number, one.gain)
            # With too few that hold, those that promise less are still wanted, after the others.
            promise = chance * (gain - beyond)
            if enough and promise <= _WORTH * beyond:
                continue
            promises[one.number] = (promise <= 0.0, -promise if promise > 0.0 else -chance * gain)
        return sorted(promises, key=lambda number: (promises[number], number))

    def _chance(self, number: int, chance: float) -> float:
        """Return the chance that a candidate's next walk holds: what is said, and what was seen."""
        own = [self._tests[tier][number] for tier in self._tiers]
        known, held = sum(len(one.known) for one in own), sum(one.held for one in own)
        return (_BELIEF * chance + held) / (_BELIEF + known)

    def _gain(self, number: int, expected: float = 0.0) -> float:
        """Return what a candidate gains: the median of the last test it has passed, if any."""
        for tier in reversed(self._tiers):
            if self._has_passed(number, tier):
                known = self._tests[tier][number].known
                return -float(
                    np.median([self._settings.assess(one.walk).objective for one in known])
                )
        return expected

    def _tier_under_test(self, number: int) -> Tier | None:
        """Return the tier that a candidate can still reach next; None if there is none."""
        for tier in self._tiers:
            if self._failures(number, tier) > self._bearable:
                return None
            if not self._has_passed(number, tier):
                return tier
        return None

    def _may_walk(self, number: int, tier: Tier) -> bool:
        """Return whether another walk of a candidate may begin: none is begun in vain."""
        test = self._tests[tier][number]
        budget = {
            Tier.REPEATS: self._plan.walks, Tier.CONVERGED: self._plan.reference_walks
        }[tier]  # fmt: skip
        pending = test.begun - len(test.known)
        left = sum(one.begun for one in self._tests[tier].values()) < budget
        may_fail = self._bearable + 1 - self._failures(number, tier)
        return left and test.begun < self._plan.replicas and pending < may_fail

    @property
    def _bearable(self) -> int:
        """Failures that a test bears."""
        return self._plan.replicas - self._plan.feasible

    def _failures(self, number: int, tier: Tier) -> int:
        test = self._tests[tier][number]
        return len(test.known) - test.held

    def _has_passed(self, number: int, tier: Tier) -> bool:
        test = self._tests[tier][number]
        return len(test.known) == self._plan.replicas and test.held >= self._plan.feasible

    def _reached(self, tier: Tier) -> list[int]:
        """Return the candidates with as many feasible walks of a tier as it takes."""
        tests = self._tests[tier]
        return [number for number in tests if tests[number].held >= self._plan.feasible]

    def _begun(self, number: int, tier: Tier) -> int:
        """Begin a candidate's next walk of a tier; return its variation."""
        test = self._tests[tier][number]
        test.begun += 1
        return tier.variations(self._plan)[test.begun - 1]

    def _note(self, number: int, tier: Tier, walk: StudyWalk) -> None:
        test = self._tests[tier][number]
        test.known.append(walk)
        test.held += self._settings.assess(walk.walk).feasible
        self._answers.append(walk)

    def _planned(self, one: Sample, variation: int) -> Planned:
        nominal, settings = one.walks[0], self._settings
        trial = Trial(candidate=nominal.candidate, settings=settings.trial_settings)
        if tier_of(self._plan, variation) in TESTS:
            # Other noise than that of the search's own replicas.
            other = variation + settings.search.replicas - 1
            trial = perturbed(trial, settings, nominal.id, other)
        walk = StudyWalk(
            id=self._id(one, variation),
            stage=CONFIRMATION,
            iteration=nominal.iteration,
            nominal=nominal.id,
            variation=variation,
            candidate=trial.candidate,
            walk=nominal.walk,
        )
        how = _simulated_as(settings, settings.trial_settings, walk)
        return Planned(
            id=walk.id,
            stage=walk.stage,
            iteration=walk.iteration,
            trial=replace(trial, settings=replace(how, measures=how.measures or variation == 0)),
            nominal=walk.nominal,
            variation=variation,
        )

    def _id(self, one: Sample, variation: int) -> int:
        """A walk's id, the same whatever else is confirmed: with room for every variation."""
        last = Tier.SERVO if self._plan.reference_walks else Tier.REPEATS
        room = last.variations(self._plan).stop + 1
        return CONFIRMATIONS + one.number * room + variation - REFERENCE
