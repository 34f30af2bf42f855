"""Finalists of a search and its winner, as the walks that confirm them have it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from drake_gait.study.records import StudyWalk
from drake_gait.study.search_settings import ConfirmationSettings
from drake_gait.walk import Measures

if TYPE_CHECKING:  # Settings may be read from an earlier study, whose winner is asked for here.
    from drake_gait.study.settings import StudySettings

REFERENCE = -1
"""Variation number of a walk at reference fidelity."""
OTHER_SOLE, OTHER_ENGINE = -2, -3
"""Variation numbers of a walk at reference fidelity that is on another sole, or in MuJoCo."""
_SLIPPING = 0.1
"""A walk that slips by more than this part of its distance is a shuffle."""


class Tier(IntEnum):
    """The degrees to which a candidate is to be trusted.

    The walks that test it are variations of its own walk, numbered through. From 1 on there are
    `replicas` of REPEATS, as many of CONVERGED, then those of SERVO. Those of TRANSFERS are -2 and
    -3. Nobody fails SERVO, and TRANSFERS takes CONVERGED and not SERVO.
    """

    FOUND = 0
    """It walked once, as the search proposed it."""
    REPEATS = 1
    """It is feasible with noise on its coefficients and other friction."""
    CONVERGED = 2
    """It is so with fresh noise at reference fidelity."""
    SERVO = 3
    """It was walked with other servos, supply, joint zeros and masses."""
    TRANSFERS = 4
    """It walks as far on the other sole, and in the other engine."""

    def variations(self, plan: ConfirmationSettings) -> range:
        """Return the numbers of the variations that test it; none of FOUND."""
        if self is Tier.TRANSFERS:
            return range(OTHER_ENGINE, OTHER_SOLE + 1)
        first = 1 + plan.replicas * (self.value - 1)
        count = plan.servo_walks if self is Tier.SERVO else plan.replicas
        return range(first, first + count) if self else range(0)


TESTS = (Tier.REPEATS, Tier.CONVERGED)
"""The tiers that a candidate can fail to reach."""


def tier_of(plan: ConfirmationSettings, variation: int) -> Tier:
    """Return the tier that a walk which confirms another one is a test of."""
    tests = (Tier.REPEATS, Tier.CONVERGED, Tier.SERVO, Tier.TRANSFERS)
    return next((one for one in tests if variation in one.variations(plan)), Tier.FOUND)


@dataclass(frozen=True, kw_only=True, eq=False)
class Finalist:
    """A candidate with the walks that confirm it, or do not."""

    walk: StudyWalk
    """The walk of the search; of a mean of neighbours the first walk of its confirmation."""
    tier: Tier
    """The highest tier whose test it has passed; never SERVO, which nobody fails."""
    variations: tuple[StudyWalk, ...]
    """Its perturbed walks; fewer than planned where it was dropped."""
    feasible: int
    """How many of them are feasible."""
    survived: int
    """How many of them ended on their feet."""
    converged: tuple[StudyWalk, ...]
    """Its perturbed walks at reference fidelity; fewer than planned where it was dropped."""
    converged_feasible: int
    """How many of them are feasible."""
    servo: tuple[StudyWalk, ...]
    """Its walks with other servos and masses; none but of a winner."""
    servo_feasible: int
    """How many of them are feasible."""
    measured: StudyWalk | None
    """Its own walk, if it has measures; in older studies the same walk again."""
    reference: StudyWalk | None
    """The candidate at reference fidelity, without noise."""
    other_sole: StudyWalk | None = None
    """The same on the other sole; none but of a winner."""
    other_engine: StudyWalk | None = None
    """The same in the other engine; none but of a winner, and where that is installed."""

    @property
    def robust(self) -> bool:
        """Return whether it repeats at the search's fidelity."""
        return self.tier >= Tier.REPEATS

    @property
    def trusted(self) -> float | None:
        """Trusted distance [m]: median of the walks at reference fidelity; None if it fails."""
        if self.tier < Tier.CONVERGED:
            return None
        return float(np.median(_distances(self.converged)))

    @property
    def median(self) -> float:
        """Median distance of the perturbed walks [m]; NaN without any."""
        return float(np.median(_distances(self.variations))) if self.variations else np.nan

    @property
    def worst(self) -> float:
        """Shortest distance of the perturbed walks [m]; NaN without any."""
        return float(min(_distances(self.variations))) if self.variations else np.nan

    @property
    def slipping(self) -> bool | None:
        """Return whether it advances by sliding; None where that was not measured."""
        if self.measured is None or self.measured.walk.measures is None:
            return None
        return shuffles(self.measured.walk.measures.slip, self.walk.walk.forward)

    @property
    def tested(self) -> tuple[StudyWalk, ...]:
        """The walks of the highest tier up to CONVERGED that it has reached."""
        return ((self.walk,), self.variations, self.converged)[min(self.tier, Tier.CONVERGED)]

    def transfers(self, other: StudyWalk | None, tolerance: float) -> bool | None:
        """Return whether a walk elsewhere is upright and as far as that at reference fidelity.

        Args:
            other: The walk on the other sole, or in the other engine.
            tolerance: Part of the distance that it may differ by.

        Returns:
            None where it was not walked.
        """
        if other is None or self.reference is None:
            return None
        forward = self.reference.walk.forward
        near = abs(other.walk.forward - forward) <= tolerance * abs(forward)
        return other.walk.survived and near

    def part_of_distance(self, other: StudyWalk | None) -> float | None:
        """Return the distance of another walk / that at reference fidelity; None if unknown."""
        if other is None or self.reference is None or not self.reference.walk.forward:
            return None
        return other.walk.forward / self.reference.walk.forward


def finalists(settings: "StudySettings", walks: Sequence[StudyWalk]) -> list[Finalist]:
    """The candidates that were walked again: the highest tier first, then by their distance."""
    found = [one for one in _looked_at(settings, walks) if one.variations]
    return sorted(found, key=lambda one: _rank(settings, one))


def winner(settings: "StudySettings", walks: Sequence[StudyWalk]) -> Finalist | None:
    """The best of the highest tier up to CONVERGED; None where no candidate repeats.

    The tiers beyond are reported of it, and decide nothing.
    """
    found = finalists(settings, walks)
    return found[0] if found and found[0].tier > Tier.FOUND else None


def best_unslipping(settings: "StudySettings", walks: Sequence[StudyWalk]) -> StudyWalk | None:
    """The best feasible walk that slips by less than a tenth of its distance, of those measured."""
    known = measured(walks)
    found = []
    for one in walks:
        if not (one.is_nominal or one.is_mean) or one.id not in known:
            continue
        assessment = settings.assess(one.walk)
        if assessment.feasible and not shuffles(known[one.id].slip, one.walk.forward):
            found.append((assessment.objective, one.id, one))
    return min(found)[2] if found else None


def shuffles(slip: Sequence[float], forward: float) -> bool:
    """Return whether a walk of this length advances by sliding, from the slip of each sole [m]."""
    return max(slip) > _SLIPPING * forward


def measured(walks: Sequence[StudyWalk]) -> dict[int, Measures]:
    """Measures by a walk's id: its own, or in older studies those of the same walk again."""
    found = {}
    for walk in walks:
        same = walk.confirms if walk.variation == 0 and walk.confirms is not None else walk.id
        if walk.walk.measures is not None:
            found[same] = walk.walk.measures
    return found


def _distances(walks: Sequence[StudyWalk]) -> list[float]:
    return [walk.walk.forward for walk in walks]


def _looked_at(settings: "StudySettings", walks: Sequence[StudyWalk]) -> list[Finalist]:
    by_id = {walk.id: walk for walk in walks}
    own: dict[int, dict[int, StudyWalk]] = {}
    for walk in walks:
        if walk.confirms is not None:
            own.setdefault(walk.confirms, {})[walk.variation] = walk
    # The walks of a mean may be known before its own: they are under way together.
    return [
        _finalist(settings, by_id[number], found)
        for number, found in own.items()
        if number in by_id
    ]


def _rank(settings: "StudySettings", finalist: Finalist) -> tuple[int, float, int]:
    """The highest tier first; then by the median of what the study wants."""
    objectives = [settings.assess(walk.walk).objective for walk in finalist.tested]
    reached = min(finalist.tier, Tier.CONVERGED)
    return -reached, float(np.median(objectives)), finalist.walk.id


def _finalist(settings: "StudySettings", nominal: StudyWalk, own: dict[int, StudyWalk]) -> Finalist:
    plan = settings.confirmation
    tests = {
        tier: tuple(own[number] for number in tier.variations(plan) if number in own)
        for tier in (*TESTS, Tier.SERVO)
    }
    feasible = {
        tier: sum(settings.assess(walk.walk).feasible for walk in found)
        for tier, found in tests.items()
    }
    tier = Tier.FOUND
    for test in TESTS:
        if feasible[test] < plan.feasible or tier != test - 1:
            break
        tier = test
    found = Finalist(
        walk=nominal,
        tier=tier,
        variations=tests[Tier.REPEATS],
        feasible=feasible[Tier.REPEATS],
        survived=sum(walk.walk.survived for walk in tests[Tier.REPEATS]),
        converged=tests[Tier.CONVERGED],
        converged_feasible=feasible[Tier.CONVERGED],
        servo=tests[Tier.SERVO],
        servo_feasible=feasible[Tier.SERVO],
        measured=nominal if nominal.walk.measures else own.get(0),
        reference=own.get(REFERENCE),
        other_sole=own.get(OTHER_SOLE),
        other_engine=own.get(OTHER_ENGINE),
    )
    elsewhere = (found.other_sole, found.other_engine)
    transfers = all(found.transfers(one, plan.transfer_distance) for one in elsewhere)
    return replace(found, tier=Tier.TRANSFERS) if tier is Tier.CONVERGED and transfers else found
