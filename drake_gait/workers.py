"""Where walks run: in this process, or in several local ones.

A worker is expendable. One that dies (the solver is C++ and may abort it), hangs or grows is
replaced, and only the candidate that it was walking is given up, as diverged.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.resource_tracker import ensure_running
from typing import Protocol, Self

from pebble import ProcessExpired, ProcessPool

from drake_gait.errors import SettingsError, WorkerError
from drake_gait.problem import Candidate
from drake_gait.walk import Walk

WalkFunction = Callable[[Candidate], Walk]

_WALKS_PER_PROCESS = 1000
"""A process is replaced after so many walks, so that its memory stays bounded."""

# Two cores run two walks faster than two walks that each want two threads.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


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

    def run(self, candidates: Sequence[Candidate]) -> Iterator[Finished]:
        """Walk all candidates; yield each as it finishes, in any order."""
        ...


class Serial:
    """Walks in this process, one after the other; for tests and debuggers."""

    def __init__(self, walk: WalkFunction) -> None:
        self._walk = walk

    def run(self, candidates: Sequence[Candidate]) -> Iterator[Finished]:
        """Walk all candidates in order."""
        for index, candidate in enumerate(candidates):
            yield _timed(self._walk, index, candidate)


class LocalProcesses:
    """Walks in processes of this machine: `with LocalProcesses(walk, count=4) as workers`.

    Args:
        walk: What a worker runs, importable by its name (or a functools.partial of such).
        count: Number of processes.
        time_limit: Wall-clock time after which a walk is given up and its process replaced [s].
    """

    def __init__(self, walk: WalkFunction, *, count: int, time_limit: float = 120.0) -> None:
        if not count >= 1:
            raise SettingsError(f"workers must be >= 1, got {count}")
        self._walk = walk
        self._count = count
        self._time_limit = time_limit
        os.environ.update(_ONE_THREAD)  # What spawned processes inherit.
        self._pool = ProcessPool(
            max_workers=count, max_tasks=_WALKS_PER_PROCESS, context=get_context("spawn")
        )
        with _interrupts_blocked():
            started = self._pool.active
        if not started:
            raise WorkerError(f"cannot start {count} processes")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self._pool.close()  # type: ignore[no-untyped-call]
        else:
            self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()

    def run(self, candidates: Sequence[Candidate]) -> Iterator[Finished]:
        """Walk all candidates; a worker's death or silence is its candidate's outcome."""
        pending: dict[Future[Finished], int] = {
            self._pool.schedule(
                _timed, args=(self._walk, index, candidate), timeout=self._time_limit
            ): index
            for index, candidate in enumerate(candidates)
        }
        while pending:
            done, _ = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                yield self._finished(future, pending.pop(future))

    def _finished(self, future: "Future[Finished]", index: int) -> Finished:
        try:
            return future.result()
        except ProcessExpired as death:
            reason = f"its process died with exit code {death.exitcode}"
            return Finished(index=index, walk=Walk.diverged(reason), seconds=0.0)
        except TimeoutError:
            reason = f"gave no sign for {self._time_limit:g} s"
            return Finished(index=index, walk=Walk.diverged(reason), seconds=self._time_limit)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Keep Ctrl-C from what is started inside: threads and processes inherit the mask for good.

    It reaches the whole process group; the driver alone decides what it means.
    """
    ensure_running()  # Where it does not run yet, the first process starts it and lifts the mask.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _timed(walk: WalkFunction, index: int, candidate: Candidate) -> Finished:
    start = time.perf_counter()
    result = walk(candidate)
    return Finished(index=index, walk=result, seconds=time.perf_counter() - start)
