"""Where walks run: in this process, or in several local ones; `cluster` has them on other machines.

A worker is expendable. A walk whose worker died is walked once more when all others are done, by
itself: what killed it may have been the memory that they took, or a person. Only one that dies
again, or hangs, is given up, as diverged.
"""

import pickle
import queue
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Protocol, Self

from drake_gait.errors import SettingsError
from drake_gait.execution.worker_process import WalkFunction, WorkerDiedError, WorkerProcess
from drake_gait.problem.problem import Trial
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


class Workers(Protocol):
    """Something that runs walks."""

    def run(self, trials: Sequence[Trial]) -> Iterator[Finished]:
        """Walk all trials; yield each as it finishes, in any order."""
        ...


class Serial:
    """Walks in this process, one after the other; for tests and debuggers."""

    def __init__(self, walk: WalkFunction) -> None:
        self._walk = walk

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
        """How workers died in the midst of a walk, and how often."""

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


class LocalProcesses(RemoteWorkers):
    """Walks in processes of this machine: `with LocalProcesses(walk, count=4) as workers`.

    Args:
        walk: What a worker runs, importable by its name (or a functools.partial of such).
        count: Number of processes.
        time_limit: Computing time, or standing still, after which a walk is given up and its
            process replaced [s].
    """

    def __init__(self, walk: WalkFunction, *, count: int, time_limit: float = 120.0) -> None:
        if not count >= 1:
            raise SettingsError(f"workers must be >= 1, got {count}")
        super().__init__()
        function = pickle.dumps(walk)
        self._processes = [WorkerProcess(function, time_limit=time_limit) for _ in range(count)]
        self._idle: queue.SimpleQueue[WorkerProcess] = queue.SimpleQueue()
        for process in self._processes:
            self._idle.put(process)
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="worker")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        for process in self._processes:
            process.stop()
        self._threads.shutdown(cancel_futures=True)
        for process in self._processes:
            process.close()

    def submit(self, trial: Trial) -> "Future[Timed]":
        """Have the next idle process walk a trial."""
        return self._threads.submit(self._walk, trial)

    def _walk(self, trial: Trial) -> Timed:
        process = self._idle.get()
        try:
            return process.walk(trial)
        finally:
            self._idle.put(process)
