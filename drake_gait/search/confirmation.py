"""Confirmation: candidates of a search are walked again, tier by tier, to be trusted.

A single walk says little: a twentieth of a degree may turn it by degrees. Candidates are walked
with noise on every coefficient, and friction that is lower and higher in turn. Those that repeat
are walked with fresh noise at reference fidelity. Fresh, because whoever is chosen for its luck has
none left. One that fails too often is dropped at once. The winner is walked with other servos, on
the other sole, and in the other engine.

What is walked next is what the search recommends, by chance times gain, and not its luckiest walk.
"""

import math
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

import numpy as np

from drake_gait.errors import ModelError, SettingsError
from drake_gait.gait import FRAME_TIME, JOINTS
from drake_gait.problem import Candidate, Trial
from drake_gait.robot.description import servo_of
from drake_gait.search.grounds import end_of, on_ground
from drake_gait.search.recommendation import Adviser, Recommended
from drake_gait.search.runner import Planned, Runner, perturbed
from drake_gait.search.seeding import Purpose, generator
from drake_gait.sole import Sole
from drake_gait.study.finalists import (
    OTHER_ENGINE,
    OTHER_SOLE,
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
from drake_gait.study.search_settings import MOST_SIMULATIONS
from drake_gait.study.settings import StudySettings
from drake_gait.walk import Disturbance, Engine, Fidelity, Integrator, Walk, WalkSettings

__all__ = ["Finalist", "Tier", "confirm", "finalists", "walked_as", "winner"]

_IN_FLIGHT = 8
"""Walks of the race under way at once: each is decided when all but seven before it are known.

The number is not that of the workers, so that any number of them makes the same walks.
"""
_AT_ONCE = 32
"""Walks under way at once, those that decide nothing included."""
_AHEAD = 2
"""Walks of a candidate that are begun beyond those that could drop it, if all of them failed.

Without them the race would walk candidates that promise less meanwhile.
"""
_BELIEF = 2.0
"""Walks that what the search says of a candidate counts for, beside the candidate's own."""
_WORTH = 0.01
"""Gain to expect, in parts of what is trusted, that a candidate is still walked for."""

_MOST_MEANS = 100
"""Means of neighbours that a search may recommend."""
_MEANS = MOST_SIMULATIONS
"""Numbers of candidates are less; those of means begin here, `_MOST_MEANS` for each budget."""
_ELSEWHERE = 1_000_000_000
"""Beyond all numbers; added to that of a candidate for the ids of walks elsewhere."""

_OTHER_SOLES = {Sole.AREA: Sole.POINTS, Sole.POINTS: Sole.AREA, Sole.BOXES: Sole.POINTS}
_OTHER_ENGINES = {Engine.DRAKE: Engine.MUJOCO, Engine.MUJOCO: Engine.DRAKE}


def confirm(
    settings: StudySettings,
    runner: Runner,
    samples: Sequence[Sample],
    *,
    advise: Callable[[Sequence[StudyWalk]], list[Recommended]] | None = None,
) -> None:
    """Walk the best candidates of a finished search again.

    The same walks give the same confirmation: one that was interrupted goes on. Workers always have
    something to walk. Walks that are made whatever the race finds come first, and fill in where it
    waits for an answer.

    Args:
        settings: The study.
        runner: Simulates, and keeps every walk.
        samples: All samples of the search.
        advise: Recommends candidates, answers so far considered; by default `Adviser.recommended`.
    """
    if settings.confirmation.walks == 0:
        return
    race, window = _Race(settings, runner, samples, advise), _Window(runner)
    spare = deque(race.certain_walks())
    deciding: list[Planned] | None = None
    trusted = False
    while True:
        while spare and len(window) < _AT_ONCE:
            window.begin(spare.popleft())
        if race.under_way < _IN_FLIGHT and (following := race.begin()) is not None:
            window.begin(following, race.hear)
        elif race.under_way:
            window.hear()
        elif deciding is None:
            deciding = list(race.missing_walks())
            spare.extendleft(reversed(deciding))
            spare.extend(race.listed_walks())
        elif not trusted and all(one.id in runner.walks for one in deciding):
            trusted = True
            spare.extendleft(reversed([*race.winner_s_walks()]))
        elif len(window):
            window.hear()
        elif not spare:
            return


class _Window:
    """Walks under way, each of which is heard of in the order in which they were begun."""

    def __init__(self, runner: Runner) -> None:
        self._runner = runner
        self._begun: dict[int, Callable[[], StudyWalk]] = {}
        self._waiting: deque[tuple[Planned, Callable[[StudyWalk], None] | None]] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def begin(self, plan: Planned, hear: Callable[[StudyWalk], None] | None = None) -> None:
        """Begin a walk, unless it has begun; `hear` gets it when its turn has come."""
        begun = plan.id in self._begun
        if not begun:
            self._begun[plan.id] = self._runner.begin(plan)
        if not begun or hear is not None:
            self._waiting.append((plan, hear))

    def hear(self) -> None:
        """Wait for the walk that was begun first."""
        plan, hear = self._waiting.popleft()
        try:
            walk = self._begun[plan.id]()
        except (ModelError, SettingsError):
            if plan.variation != OTHER_ENGINE:
                raise
            return  # The other engine cannot have this robot or sole: it is left out.
        if hear is not None:
            hear(walk)


def walked_as(settings: StudySettings, walk: StudyWalk) -> WalkSettings:
    """Return how any walk of a study was simulated, its ground, fidelity and servos included.

    Raises:
        SettingsError: a user's own change was made, and the settings know it by its name only.
    """
    return _simulated_as(settings, walk, walk.candidate).settings


def other_servo(
    settings: StudySettings, walk: WalkSettings, nominal: int, number: int
) -> WalkSettings:
    """Return how a walk is simulated with other servos, supply, joint zeros and masses.

    Args:
        settings: Say how much ([confirmation]), and fix the changes by their seed.
        walk: How it is simulated without them.
        nominal: Id of the walk of the candidate as it is.
        number: The variation's number, whose tier says what is changed.
    """
    plan = settings.confirmation
    made = plan.changes(tier_of(plan, number))
    most = {name: getattr(plan, name) if name in made else 0.0 for name in _OF_THE_ROBOT}
    if not any(most.values()):
        return walk
    # In the order of `_OF_THE_ROBOT`, all of them: none moves the numbers of another.
    rng = generator(settings.seed, Purpose.SERVO, nominal, number)
    zeros = rng.uniform(-most["joint_zero"], most["joint_zero"], len(JOINTS))
    evenly = ("servo_stiffness", "supply_voltage", "mass")
    stiffness, voltage, mass = 1.0 + rng.uniform(-1.0, 1.0, 3) * [most[name] for name in evenly]
    late, finer = rng.uniform(0.0, 1.0, 2) * [most["command_delay"], most["integrator_step"]]
    own = servo_of(walk)
    servo = replace(own, stiffness=float(stiffness * own.stiffness))
    disturbance = Disturbance(
        joint_zeros=tuple(zeros.tolist()),
        voltage=float(voltage),
        mass=float(mass),
        delay=float(late),
    )
    how = replace(walk, servo=servo, disturbance=disturbance)
    return replace(how, integrator=_finer(how.stepping, float(finer))) if finer else how


_OF_THE_ROBOT = (
    "joint_zero",
    "servo_stiffness",
    "supply_voltage",
    "mass",
    "command_delay",
    "integrator_step",
)
"""Changes that are drawn, in the order in which they are."""


def _finer(stepping: Integrator, part: float) -> Integrator:
    """Return an integrator whose steps are shorter by a part, and its errors smaller likewise."""
    shorter = (1.0 - part) * stepping.step
    accuracy = stepping.accuracy and (1.0 - part) * stepping.accuracy
    # Equal steps in a frame, as WalkSettings.stepping has them.
    step = FRAME_TIME / math.ceil(FRAME_TIME / shorter - 1e-9)
    return replace(stepping, step=step, accuracy=accuracy)


def _simulated_as(settings: StudySettings, walk: StudyWalk, candidate: Candidate) -> Trial:
    """Return what a walk of a study simulates.

    Args:
        settings: The study.
        walk: Its id, its variation and what it is a variation of.
        candidate: Its candidate, before changes of a user's own.
    """
    how = on_ground(settings.walk, settings, end_of(settings, walk))
    if walk.confirms is None:
        return Trial(candidate=candidate, settings=how)
    plan = settings.confirmation
    tier = tier_of(plan, walk.variation)
    if walk.variation == REFERENCE or tier >= Tier.CONVERGED:
        how = replace(how, fidelity=Fidelity.REFERENCE)
    if walk.variation == OTHER_SOLE:
        how = replace(how, sole=_OTHER_SOLES[how.sole], contact=None)
    if walk.variation == OTHER_ENGINE:
        how = replace(how, engine=_OTHER_ENGINES[how.engine])
    trial = Trial(
        candidate=candidate, settings=other_servo(settings, how, walk.confirms, walk.variation)
    )
    for place, change in enumerate(plan.own):
        if change in plan.own_changes(tier):
            address = (walk.confirms, walk.variation, place)
            trial = change(trial, generator(settings.seed, Purpose.OWN_CHANGE, *address))
    return trial


def other_engine_installed(how: WalkSettings) -> bool:
    """Return whether walks of a study can be walked in the other engine too."""
    return _OTHER_ENGINES[how.engine] is not Engine.MUJOCO or find_spec("mujoco") is not None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Entrant:
    """A candidate that may be walked again."""

    number: int
    """That of its sample; those of means are beyond all samples."""
    candidate: Candidate
    """What is walked."""
    iteration: int
    """That of its sample, or of the one whose neighbourhood it is the mean of."""
    own: int | None
    """Id of its walk in the search; None of a mean, whose own walk the confirmation makes."""


@dataclass(kw_only=True, eq=False)
class _Test:
    """The walks of one candidate in one tier."""

    begun: int = 0
    """Walks that were begun."""
    known: list[StudyWalk] = field(default_factory=list)
    """Those that ended, in the order of their variation."""
    held: int = 0
    """How many of them are feasible."""
    objectives: list[float] = field(default_factory=list)
    """What each of them is worth, in the same order."""


class _Race:
    """Candidates that are walked again, the most promising first, until enough can be trusted."""

    def __init__(
        self,
        settings: StudySettings,
        runner: Runner,
        samples: Sequence[Sample],
        advise: Callable[[Sequence[StudyWalk]], list[Recommended]] | None,
    ) -> None:
        self._settings, self._plan = settings, settings.confirmation
        self._runner, self._searched = runner, samples
        ranked = sorted(samples, key=lambda one: one.rank)
        self._field = [_entrant_of(one) for one in ranked if one.assessment.feasible]
        self._entrants = {one.number: one for one in self._field}
        self._advise = advise
        self._numbers_of_means: dict[bytes, int] = {}
        self._tests: dict[tuple[int, Tier], _Test] = defaultdict(_Test)
        self._used = {False: 0, True: 0}  # Walks begun, at reference fidelity or not.
        self._answers: list[StudyWalk] = []
        self._advice: tuple[int, list[Recommended]] | None = None  # And how many answers it had.
        self.under_way = 0
        """Walks of the race that were begun, and not heard of yet."""

    @property
    def _tiers(self) -> tuple[Tier, ...]:
        return TESTS if self._plan.reference_walks else TESTS[:1]

    def begin(self) -> Planned | None:
        """Return the walk that the race asks for next; None if it has nothing to ask for yet.

        It may ask again once it has heard of another walk.
        """
        following = self._following()
        if following is None:
            return None
        number, tier = following
        test = self._tests[number, tier]
        test.begun += 1
        self._used[tier is Tier.CONVERGED] += 1
        self.under_way += 1
        variation = 0 if tier is Tier.FOUND else tier.variations(self._plan)[test.begun - 1]
        return self._planned(self._entrants[number], variation)

    def hear(self, walk: StudyWalk) -> None:
        """Count a walk that the race has asked for; they come in the order of asking."""
        own = walk.id if walk.nominal is None else walk.nominal
        number = next(one.number for one in self._entrants.values() if self._own_id(one) == own)
        test = self._tests[number, tier_of(self._plan, walk.variation)]
        test.known.append(walk)
        assessment = self._settings.assess(walk.walk)
        test.held += assessment.feasible
        test.objectives.append(assessment.objective)
        self._answers.append(walk)
        self.under_way -= 1

    def certain_walks(self) -> Iterator[Planned]:
        """Yield what is reported of the best single walk, whatever the race finds."""
        for one in self._field[:1]:
            yield self._planned(one, REFERENCE)
            for variation in Tier.REPEATS.variations(self._plan):
                yield self._planned(one, variation)

    def missing_walks(self) -> Iterator[Planned]:
        """Yield the walks that complete the tests of gaits with enough feasible ones."""
        for number in self._listed():
            for tier in self._tiers:
                if tier is Tier.REPEATS or number in self._reached(tier):
                    for variation in tier.variations(self._plan):
                        yield self._planned(self._entrants[number], variation)

    def listed_walks(self) -> Iterator[Planned]:
        """Yield what else is reported of each that holds."""
        for number in self._listed():
            yield self._planned(self._entrants[number], REFERENCE)

    def winner_s_walks(self) -> Iterator[Planned]:
        """Yield the walks of the winner with other servos and elsewhere, if it converges."""
        found = winner(self._settings, list(self._runner.walks.values()))
        if found is None or found.tier < Tier.CONVERGED:
            return
        for one in self._entrants.values():
            if self._own_id(one) == found.walk.id:
                for variation in Tier.SERVO.variations(self._plan):
                    yield self._planned(one, variation)
                if self._plan.transfer:
                    yield self._planned(one, OTHER_SOLE)
                    if other_engine_installed(self._settings.walk):
                        yield self._planned(one, OTHER_ENGINE)

    def _listed(self) -> list[int]:
        """Return the numbers of gaits that hold, and of the best single walk."""
        reached = self._reached(self._tiers[-1]) or self._reached(self._tiers[0])
        return list(dict.fromkeys([*reached, *(one.number for one in self._field[:1])]))

    def _following(self) -> tuple[int, Tier] | None:
        """Return the candidate to walk next, and in which tier; None if there is nothing to do."""
        for number in self._promising():
            tier = self._tier_under_test(number)
            if tier is not None and self._may_walk(number, tier):
                return number, tier
        return None

    def _promising(self) -> list[int]:
        """Return the candidates that are worth a walk, the most promising first."""
        last = self._tiers[-1]
        trusted = [self._gain(one) for one in self._entrants if self._has_passed(one, last)]
        beyond = max([0.0, *trusted])
        enough = len(trusted) >= self._plan.winners
        promises = {}
        for one in self._recommended():
            number = self._number(one)
            if number is None or self._tier_under_test(number) is None:
                continue
            chance, gain = self._chance(number, one.chance), self._gain(number, one.gain)
            # With too few that hold, those that promise less are still wanted, after the others.
            promise = chance * (gain - beyond)
            if enough and promise <= _WORTH * beyond:
                continue
            promises[number] = (promise <= 0.0, -promise if promise > 0.0 else -chance * gain)
        return sorted(promises, key=lambda number: (promises[number], number))

    def _recommended(self) -> list[Recommended]:
        """Return what the search recommends, all that was heard of considered."""
        if not self._field:
            return []
        if self._advise is None:  # Now: it learns, while the first walks are under way.
            self._advise = Adviser(self._settings, self._searched).recommended
        if self._plan.means and not self._answers:
            self._enter_means(self._advise([]))
        # Between two answers the advice stays.
        if self._advice is None or self._advice[0] != len(self._answers):
            self._advice = len(self._answers), self._advise(self._answers)
        return self._advice[1]

    def _enter_means(self, recommended: Sequence[Recommended]) -> None:
        """Give means their numbers: by the size of the search and their place in its advice."""
        first = _MEANS + _MOST_MEANS * len(self._searched)
        means = [one for one in recommended if one.number is None][:_MOST_MEANS]
        for number, one in enumerate(means, start=first):
            self._numbers_of_means[one.x.tobytes()] = number
            nearest = self._entrants[one.nearest]
            entrant = _Entrant(
                number=number, candidate=one.candidate, iteration=nearest.iteration, own=None
            )
            # One that was begun with another library's last digits goes on as it was begun.
            known = self._runner.walks.get(self._own_id(entrant))
            candidate = one.candidate if known is None else known.candidate
            self._entrants[number] = replace(entrant, candidate=candidate)

    def _number(self, one: Recommended) -> int | None:
        """Return the number of a recommended candidate; None of a mean that is not wanted."""
        if one.number is not None:
            return one.number
        return self._numbers_of_means.get(one.x.tobytes())

    def _chance(self, number: int, chance: float) -> float:
        """Return the chance that a candidate's next walk holds: what is said, and what was seen."""
        own = [self._tests[number, tier] for tier in (Tier.FOUND, *self._tiers)]
        known, held = sum(len(one.known) for one in own), sum(one.held for one in own)
        return (_BELIEF * chance + held) / (_BELIEF + known)

    def _gain(self, number: int, expected: float = 0.0) -> float:
        """Return what a candidate gains: the median of the last test it has passed, if any."""
        for tier in reversed(self._tiers):
            if self._has_passed(number, tier):
                return -float(np.median(self._tests[number, tier].objectives))
        return expected

    def _tier_under_test(self, number: int) -> Tier | None:
        """Return the tier that a candidate can still reach next; None if there is none."""
        if self._entrants[number].own is None:  # A mean, which is walked as it is first.
            if self._failures(number, Tier.FOUND):
                return None
            if not self._tests[number, Tier.FOUND].begun:
                return Tier.FOUND
        for tier in self._tiers:
            if self._failures(number, tier) > self._bearable:
                return None
            if not self._has_passed(number, tier):
                return tier
        return None

    def _may_walk(self, number: int, tier: Tier) -> bool:
        """Return whether another walk of a candidate may begin: few are begun in vain."""
        if not self._is_left(tier):
            return False
        if tier is Tier.FOUND:
            return True
        test = self._tests[number, tier]
        pending = test.begun - len(test.known)
        may_fail = self._bearable + 1 - self._failures(number, tier)
        return test.begun < self._plan.replicas and pending < may_fail + _AHEAD

    def _is_left(self, tier: Tier) -> bool:
        """Return whether the budget of a tier has a walk left; a mean's own is one of REPEATS."""
        fine = tier is Tier.CONVERGED
        budget = self._plan.reference_walks if fine else self._plan.walks
        return self._used[fine] < budget

    @property
    def _bearable(self) -> int:
        """Failures that a test bears."""
        return self._plan.replicas - self._plan.feasible

    def _failures(self, number: int, tier: Tier) -> int:
        test = self._tests[number, tier]
        return len(test.known) - test.held

    def _has_passed(self, number: int, tier: Tier) -> bool:
        test = self._tests[number, tier]
        return len(test.known) == self._plan.replicas and test.held >= self._plan.feasible

    def _reached(self, tier: Tier) -> list[int]:
        """Return the candidates with as many feasible walks of a tier as it takes."""
        return [
            number
            for number in self._entrants
            if self._tests[number, tier].held >= self._plan.feasible
        ]

    def _planned(self, one: _Entrant, variation: int) -> Planned:
        settings, plan, nominal = self._settings, self._plan, self._own_id(one)
        is_own = one.own is None and variation == 0
        tier, candidate = tier_of(plan, variation), one.candidate
        if tier and "noise" in plan.changes(tier):
            # Other noise than that of the search's own replicas.
            other = variation + settings.search.replicas - 1
            trial = Trial(candidate=candidate, settings=settings.walk)
            candidate = perturbed(trial, settings, nominal, other).candidate
        walk = StudyWalk(
            id=self._id(one, variation),
            stage=CONFIRMATION,
            iteration=one.iteration,
            nominal=None if is_own else nominal,
            variation=variation,
            candidate=candidate,
            walk=Walk.diverged("not walked yet"),
        )
        return Planned(
            id=walk.id,
            stage=walk.stage,
            iteration=walk.iteration,
            trial=_simulated_as(settings, walk, candidate),
            nominal=walk.nominal,
            variation=variation,
        )

    def _own_id(self, one: _Entrant) -> int:
        """Return the id of a candidate's own walk, which all others are variations of."""
        return self._id(one, 0) if one.own is None else one.own

    def _id(self, one: _Entrant, variation: int) -> int:
        """A walk's id, the same whatever else is confirmed: with room for every variation."""
        last = Tier.SERVO if self._plan.reference_walks else Tier.REPEATS
        room = last.variations(self._plan).stop + 1
        if variation < REFERENCE:
            return CONFIRMATIONS + (_ELSEWHERE + one.number) * room + OTHER_SOLE - variation
        return CONFIRMATIONS + one.number * room + variation - REFERENCE


def _entrant_of(one: Sample) -> _Entrant:
    nominal = one.walks[0]
    return _Entrant(
        number=one.number,
        candidate=nominal.candidate,
        iteration=nominal.iteration,
        own=nominal.id,
    )
