"""Simulates what a study plans, keeps every walk as it finishes, and tells how far it is."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from drake_gait.errors import WorkerError
from drake_gait.execution.base import Finished
from drake_gait.problem import Trial, evaluated
from drake_gait.search.grounds import end_of_variation, on_ground
from drake_gait.search.seeding import Purpose, generator
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.walk import Walk

if TYPE_CHECKING:  # It loads torch, which whoever asks how a walk was simulated need not.
    from drake_gait.surrogates.ensemble import Surrogate

Evaluate = Callable[[Sequence[Trial]], Iterable[Finished]]
"""Starts to simulate trials, and yields them as they finish, in any order."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Progress of a search."""

    walks: int
    """Walks simulated."""
    total: int
    """Walks that the study may simulate."""
    survivors: int
    """Walks whose robot stayed on its feet."""
    feasible: int
    """Walks that satisfy every constraint."""
    failures: Mapping[str, int]
    """The other walks by what kept them from their last frame, as Walk.failure says it."""
    best: StudyWalk | None
    """The best feasible walk, by distance or by whatever the study wants."""
    network: "Surrogate | None"
    """The latest network, when one has been trained since the command was started."""
    confirmations: int = 0
    """Walks simulated to confirm others."""


@dataclass(frozen=True, kw_only=True)
class Planned:
    """One walk that a study is to have."""

    id: int
    """Its place in the study."""
    stage: str
    """What it is for."""
    iteration: int
    """The batch that it belongs to."""
    trial: Trial
    """What is simulated."""
    nominal: int | None = None
    """The walk that it is a variation of."""
    variation: int = 0
    """Which variation, see StudyWalk."""
    predicted: Mapping[str, float] | None = None
    """What a network expects."""


@dataclass(kw_only=True, eq=False)
class _Batch:
    """Walks that were started together."""

    planned: Sequence[Planned]
    """What they are for."""
    walking: Iterator[Finished]
    """Yields them."""
    waiting: set[int] = field(init=False)
    """Places of those that have not finished."""

    def __post_init__(self) -> None:
        self.waiting = set(range(len(self.planned)))


@dataclass
class Runner:
    """The walks of a study, known or under way."""

    settings: StudySettings
    study: Study
    evaluate: Evaluate
    report: Callable[[Progress], None]
    walks: dict[int, StudyWalk] = field(init=False)
    """Every walk that is known, by its id."""
    network: "Surrogate | None" = field(init=False, default=None)
    """The latest network, for the report."""
    _under_way: "list[_Batch]" = field(init=False, default_factory=list)
    _best: tuple[float, int] = field(init=False, default=(np.inf, -1))
    _counts: Counter[str] = field(init=False, default_factory=Counter)
    _failures: Counter[str] = field(init=False, default_factory=Counter)

    def __post_init__(self) -> None:
        self.walks = {walk.id: walk for walk in self.study.walks()}
        for walk in self.walks.values():
            self._count(walk)

    def start(self, planned: Iterable[Planned], *, beside: bool = False) -> None:
        """Start to simulate those that are not known yet.

        Args:
            planned: The walks.
            beside: Whether others may still be under way; else they are finished first.
        """
        if not beside:
            self.finish()
        missing = [one for one in planned if one.id not in self.walks]
        if missing:
            walking = iter(self.evaluate([self._asked(one) for one in missing]))
            self._under_way.append(_Batch(planned=missing, walking=walking))

    def wait(self, ids: Collection[int]) -> None:
        """Wait for some of the walks that are under way, and keep each as it finishes."""
        for batch in self._under_way:
            wanted = {place for place, one in enumerate(batch.planned) if one.id in ids}
            while wanted & batch.waiting:
                self._take_next(batch)
        self._under_way = [batch for batch in self._under_way if batch.waiting]

    def finish(self) -> None:
        """Wait for the walks that are under way, and keep each as it finishes."""
        for batch in self._under_way:
            while batch.waiting:
                self._take_next(batch)
        self._under_way = []

    def _take_next(self, batch: "_Batch") -> None:
        """Keep the next walk of a batch that finishes."""
        planned, waiting = batch.planned, batch.waiting
        finished = next(batch.walking, None)
        if finished is None:
            raise WorkerError(
                f"the executor ends without the walk {min(waiting)} of {len(planned)} trials; it "
                "must yield every one, as diverged where it cannot be simulated"
            )
        if finished.index not in waiting:
            raise _unasked(finished, planned)
        waiting.remove(finished.index)
        _check(finished)
        self._keep(planned[finished.index], finished)
        if not waiting:
            for more in batch.walking:
                raise _unasked(more, planned)

    def begin(self, plan: Planned) -> Callable[[], StudyWalk]:
        """Start one walk beside others that are under way; return what waits for it.

        Whoever begins walks waits for each: one that nobody waits for is not kept.
        """
        if plan.id in self.walks:
            return lambda: self.walks[plan.id]
        walking = iter(self.evaluate([self._asked(plan)]))

        def wait() -> StudyWalk:
            for finished in walking:
                self._keep(plan, finished)
            return self.walks[plan.id]

        return wait

    def _asked(self, plan: Planned) -> Trial:
        """Return the trial of a walk, with the quantities of the study's own."""
        return replace(plan.trial, quantities=self.settings.quantities)

    def _keep(self, plan: Planned, finished: Finished) -> None:
        walk = StudyWalk(
            id=plan.id,
            stage=plan.stage,
            iteration=plan.iteration,
            nominal=plan.nominal,
            variation=plan.variation,
            candidate=plan.trial.candidate,
            walk=replace(
                evaluated(finished.walk, self._asked(plan)),
                planned=plan.trial.candidate.gait.frames,
            ),
            predicted=plan.predicted,
            seconds=finished.seconds,
        )
        self.study.add(walk)
        self.walks[walk.id] = walk
        self._count(walk)
        self.report(self.progress())

    def progress(self) -> Progress:
        """Return how far the study is."""
        return Progress(
            walks=self._counts["walks"],
            total=self.settings.search.simulations,
            survivors=self._counts["survivors"],
            feasible=self._counts["feasible"],
            failures=dict(self._failures),
            best=self.walks.get(self._best[1]),
            network=self.network,
            confirmations=self._counts["confirmations"],
        )

    def _count(self, walk: StudyWalk) -> None:
        if not walk.is_search_walk:
            self._counts["confirmations"] += 1
            return
        assessment = self.settings.assess(walk.walk)
        self._counts["walks"] += 1
        self._counts["survivors"] += walk.walk.survived
        self._counts["feasible"] += assessment.feasible
        if (failure := walk.walk.failure) is not None:
            self._failures[failure] += 1
        if assessment.feasible and walk.is_nominal:
            self._best = min(self._best, (assessment.objective, walk.id))


def _check(finished: Finished) -> None:
    """Refuse what a user's executor may yield and no study can keep."""
    if not isinstance(finished.walk, Walk):
        raise WorkerError(
            f"the executor yields {finished.walk!r} for trial {finished.index}; it must be a Walk"
        )
    seconds = finished.seconds
    if not (isinstance(seconds, int | float) and math.isfinite(seconds)):
        raise WorkerError(
            f"the executor yields {seconds!r} seconds for trial {finished.index}; it must be a "
            "finite number"
        )


def _unasked(finished: Finished, planned: Sequence[Planned]) -> WorkerError:
    """Return the error of an executor that yields what nobody waits for."""
    return WorkerError(
        f"the executor yields the walk {finished.index!r} of {len(planned)} trials, "
        "which is none, or was yielded before"
    )


def perturbed(trial: Trial, settings: StudySettings, nominal: int, variation: int) -> Trial:
    """A variation of a trial: noise on every angle of its gait, and another friction.

    Args:
        trial: The trial as it is.
        settings: Say how much ([confirmation]), and fix the noise by their seed.
        nominal: Id of the walk of the trial as it is.
        variation: Which variation, from 1; odd ones are more slippery, even ones less.
    """
    plan = settings.confirmation
    rng = generator(settings.seed, Purpose.NOISE, nominal, variation)
    gait = trial.candidate.gait
    noise = plan.noise * rng.standard_normal(len(gait.variables))
    return Trial(
        candidate=replace(trial.candidate, gait=gait.moved(noise)),
        settings=on_ground(trial.settings, settings, end_of_variation(variation)),
    )
