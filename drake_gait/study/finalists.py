"""Finalists of a search and its winner, as the walks that confirm them have it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drake_gait.study.records import StudyWalk
from drake_gait.walk import Measures

if TYPE_CHECKING:  # Settings may be read from an earlier study, whose winner is asked for here.
    from drake_gait.study.settings import StudySettings

REFERENCE = -1
"""Variation number of a walk at reference fidelity."""
_SLIPPING = 0.1
"""A walk that slips by more than this part of its distance is a shuffle."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Finalist:
    """A candidate with the walks that confirm it, or do not."""

    walk: StudyWalk
    """The walk of the search."""
    variations: tuple[StudyWalk, ...]
    """Its perturbed walks; fewer than planned where it was dropped."""
    feasible: int
    """How many of them are feasible."""
    survived: int
    """How many of them ended on their feet."""
    measured: StudyWalk | None
    """The same walk again, with its measures."""
    reference: StudyWalk | None
    """The candidate at reference fidelity."""
    robust: bool
    """Whether as many are feasible as the study asks for."""

    @property
    def median(self) -> float:
        """Median distance of the perturbed walks [m]; NaN without any."""
        return float(np.median(self._distances)) if self.variations else np.nan

    @property
    def worst(self) -> float:
        """Shortest distance of the perturbed walks [m]; NaN without any."""
        return float(min(self._distances)) if self.variations else np.nan

    @property
    def slipping(self) -> bool | None:
        """Whether it advances by sliding; None where that was not measured."""
        if self.measured is None or self.measured.walk.measures is None:
            return None
        return shuffles(self.measured.walk.measures.slip, self.walk.walk.forward)

    @property
    def _distances(self) -> list[float]:
        return [walk.walk.forward for walk in self.variations]


def finalists(settings: "StudySettings", walks: Sequence[StudyWalk]) -> list[Finalist]:
    """The candidates that were walked again, the robust ones first, then by their distance."""
    found = [one for one in _looked_at(settings, walks) if one.variations]
    return sorted(found, key=lambda one: _rank(settings, one))


def winner(settings: "StudySettings", walks: Sequence[StudyWalk]) -> Finalist | None:
    """The robust candidate with the best median, if there is one."""
    found = finalists(settings, walks)
    return found[0] if found and found[0].robust else None


def best_unslipping(settings: "StudySettings", walks: Sequence[StudyWalk]) -> StudyWalk | None:
    """The best feasible walk that slips by less than a tenth of its distance, of those measured."""
    found = [one for one in _looked_at(settings, walks) if one.slipping is False]
    ranked = sorted(found, key=lambda one: settings.assess(one.walk.walk).objective)
    return ranked[0].walk if ranked else None


def shuffles(slip: Sequence[float], forward: float) -> bool:
    """Return whether a walk of this length advances by sliding, from the slip of each sole [m]."""
    return max(slip) > _SLIPPING * forward


def measured(walks: Sequence[StudyWalk]) -> dict[int, Measures]:
    """Measures by a walk's id: its own, or those of the same walk again."""
    found = {}
    for walk in walks:
        same = walk.id if walk.is_search_walk or walk.variation != 0 else walk.nominal
        if walk.walk.measures is not None and same is not None:
            found[same] = walk.walk.measures
    return found


def _looked_at(settings: "StudySettings", walks: Sequence[StudyWalk]) -> list[Finalist]:
    by_id = {walk.id: walk for walk in walks}
    numbers = dict.fromkeys(walk.nominal for walk in walks if not walk.is_search_walk)
    return [_finalist(settings, by_id[number], walks) for number in numbers if number is not None]


def _rank(settings: "StudySettings", finalist: Finalist) -> tuple[bool, float, int]:
    """Robust before others; by the median of what the study wants."""
    tried = finalist.variations if finalist.robust else (finalist.walk,)
    objectives = [settings.assess(walk.walk).objective for walk in tried]
    return not finalist.robust, float(np.median(objectives)), finalist.walk.id


def _finalist(
    settings: "StudySettings", nominal: StudyWalk, walks: Sequence[StudyWalk]
) -> Finalist:
    own = {
        walk.variation: walk
        for walk in walks
        if not walk.is_search_walk and walk.nominal == nominal.id
    }
    variations = tuple(own[number] for number in sorted(own) if number > 0)
    feasible = sum(settings.assess(walk.walk).feasible for walk in variations)
    return Finalist(
        walk=nominal,
        variations=variations,
        feasible=feasible,
        survived=sum(walk.walk.survived for walk in variations),
        measured=own.get(0),
        reference=own.get(REFERENCE),
        robust=feasible >= settings.confirmation.feasible,
    )
