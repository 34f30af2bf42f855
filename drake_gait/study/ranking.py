"""Order of a study's walks: feasible before infeasible, then further (or cheaper)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drake_gait.problem import Assessment, Candidate, Constraints, Objective, assess
from drake_gait.study.records import StudyWalk
from drake_gait.walk import Outcome

if TYPE_CHECKING:  # Settings may be read from an earlier study, whose walks are ranked here.
    from drake_gait.study.settings import StudySettings

ROBUST_SHARE = 7 / 8
"""Part of a candidate's walks that must be feasible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """A candidate with all its walks: one, or as many as the study has replicas."""

    number: int
    """Its place among the study's candidates, from 0."""
    walks: tuple[StudyWalk, ...]
    """Its walks; the first is that of the candidate as it is."""
    replicated: bool
    """Whether it has as many walks as the study wants of a candidate."""
    assessment: Assessment
    """The median of their objectives, and the violations that seven of eight keep below."""

    @property
    def candidate(self) -> Candidate:
        """The candidate."""
        return self.walks[0].candidate

    @property
    def rank(self) -> tuple[int, float, int]:
        """Return the key that sorts samples, the best first.

        A candidate that was walked once is behind those with all replicas. A walk on its feet is
        nearer to a feasible one than a fall. Last comes a walk that could not be simulated: its
        numbers mean nothing.
        """
        outcome = list(Outcome).index(self.walks[0].walk.outcome)
        if self.assessment.feasible:
            return int(not self.replicated), self.assessment.objective, self.number
        return 2 + outcome, float(self.assessment.violations.sum()), self.number


def sample(number: int, walks: Sequence[StudyWalk], settings: "StudySettings") -> Sample:
    """A candidate's walks, in the order of their variation, as one sample."""
    found = [settings.assess(walk.walk) for walk in walks]
    by_violation = sorted(found, key=lambda one: float(one.violations.sum()))
    most = by_violation[robust_count(len(found)) - 1]
    objective = float(np.median([one.objective for one in found]))
    return Sample(
        number=number,
        walks=tuple(walks),
        replicated=len(walks) == settings.search.replicas,
        assessment=Assessment(objective=objective, violations=most.violations),
    )


def robust_count(walks: int) -> int:
    """Return how many of a candidate's walks must be feasible."""
    return int(np.ceil(ROBUST_SHARE * walks))


def search_walks(walks: Iterable[StudyWalk]) -> list[StudyWalk]:
    """Return the walks that a search asked for, replicas included, without confirmations."""
    return [walk for walk in walks if walk.is_search_walk]


def nominal_walks(walks: Iterable[StudyWalk]) -> list[StudyWalk]:
    """The walks that a search proposed, without their variations."""
    return [walk for walk in walks if walk.is_nominal]


def feasible_walks(
    walks: Iterable[StudyWalk], limits: Constraints, objective: Objective = Objective.DISTANCE
) -> list[StudyWalk]:
    """The walks of a search that satisfy every constraint, the best first."""
    found = [(assess(walk.walk, limits, objective), walk) for walk in nominal_walks(walks)]
    feasible = [(one.objective, walk.id, walk) for one, walk in found if one.feasible]
    return [walk for _, _, walk in sorted(feasible, key=lambda entry: entry[:2])]


def best_walk(
    walks: Sequence[StudyWalk], limits: Constraints, objective: Objective = Objective.DISTANCE
) -> StudyWalk:
    """The best feasible walk, or, where none is feasible, the one nearest to it."""
    feasible = feasible_walks(walks, limits, objective)
    if feasible:
        return feasible[0]
    order = list(Outcome)

    def distance(walk: StudyWalk) -> tuple[int, float, int]:
        violation = float(assess(walk.walk, limits, objective).violations.sum())
        return order.index(walk.walk.outcome), violation, walk.id

    return min(nominal_walks(walks), key=distance)
