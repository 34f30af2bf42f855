"""Executors: objects that run walks, and what all of those with other processes share.

A worker is expendable. A walk whose worker died is walked once more, alone, when all others are
done. The memory that they took may have killed it, or a person. Only one that dies again, or hangs,
is given up, as diverged.
"""

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from dataclasses import dataclass
from typing import Protocol

from drake_gait.execution.worker_process import WalkFunction, WorkerDiedError
from drake_gait.problem import Trial
from drake_gait.walk import Walk

Timed = tuple[Walk, float]
"""What a walk did, and the time that it took its worker [s]."""


@dataclass(frozen=True, kw_only=True)
class Finished:
    """One walk that is done."""

    index: int
    """Its place in the list that was handed in."""
    walk: Walk
    """What it did."""
    seconds: float
    """Time that it took its worker [s]."""


class Executor(Protocol):
    """Something that runs walks, such as Serial, LocalProcesses or DaskCluster.

    A study runs on any object that has these two, see docs/howto/own_executor.md.
    """

    @property
    def deaths(self) -> Mapping[str, int]:
        """Deaths of workers that were walking, counted by their cause; empty where none can die."""
        ...

    def run(self, trials: Sequence[Trial]) -> Iterator[Finished]:
        """Start to walk all trials; yield each as it finishes, in any order.

        Args:
            trials: What is walked, each with its whole settings, its robot among them. A walk
                depends on nothing else.
        """
        ...


class Serial:
    """Walks in this process, one after the other; for tests and debuggers.

    Args:
        walk: Walks a trial, as `walk_trial` does.
    """

    def __init__(self, walk: WalkFunction) -> None:
        self._walk = walk
        self.deaths: Mapping[str, int] = {}
        """None: a walk that kills its process kills this one."""

    def run(self, trials: Sequence[Trial]) -> Iterator[Finished]:
        """Walk all trials in order."""
        for index, trial in enumerate(trials):
            start = time.perf_counter()
            walk = self._walk(trial)
            yield Finished(index=index, walk=walk, seconds=time.perf_counter() - start)


class RemoteWorkers(ABC):
    """Walks in other processes, each promised by a `concurrent.futures.Future`."""

    def __init__(self) -> None:
        self.deaths: Counter[str] = Counter()
        """Deaths of workers that were walking, counted by their cause."""

    @abstractmethod
    def submit(self, trial: Trial) -> "Future[Timed]":
        """Have a trial walked; the future raises WorkerDiedError where its worker died."""

    def run(self, trials: Sequence[Trial]) -> Iterator[Finished]:
        """Start to walk all trials; yield each as it finishes, in any order."""
        pending = {self.submit(trial): index for index, trial in enumerate(trials)}
        return self._finished(trials, pending)

    def _finished(
        self, trials: Sequence[Trial], pending: "dict[Future[Timed], int]"
    ) -> Iterator[Finished]:
        died = []
        try:
            for future in as_completed(list(pending)):
                index = pending.pop(future)
                try:
                    walk, seconds = future.result()
                except WorkerDiedError as death:
                    self.deaths[str(death)] += 1
                    died.append(index)
                    continue
                yield Finished(index=index, walk=walk, seconds=seconds)
            for index in died:
                yield self._alone(index, trials[index])
        finally:
            for future in pending:
                future.cancel()

    def _alone(self, index: int, trial: Trial) -> Finished:
        """Walk a trial whose worker died once more, with nothing beside it."""
        try:
            walk, seconds = self.submit(trial).result()
        except WorkerDiedError as death:
            self.deaths[str(death)] += 1
            walk, seconds = Walk.diverged(f"{death}, twice"), 0.0
        return Finished(index=index, walk=walk, seconds=seconds)
