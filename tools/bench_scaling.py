"""Measure how a study scales: walks per second by workers, and the cost of the driver.

    python tools/bench_scaling.py real [--walks N]      # 1 and 2 processes on real walks
    python tools/bench_scaling.py driver [--dask]       # up to 256 stand-in workers, 0.25 s a walk
    python tools/bench_scaling.py search [--dask]       # whole searches on them, by batch
    python tools/bench_scaling.py busy [--seconds S]    # the default study on 2 and 4 of them

A stand-in worker is a thread that sleeps: 256 of them cost no processor. With --dask it is a thread
of a Dask worker in another process, behind a scheduler.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from markdown_table import heading, row
from stand_in import StandIn

from drake_gait.execution.base import RemoteWorkers, Timed
from drake_gait.execution.local import LocalProcesses
from drake_gait.problem import Candidate, DesignSpace, Trial
from drake_gait.search.loop import search
from drake_gait.search.runner import Progress
from drake_gait.simulation.simulate import walk_trial
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.walk import Outcome, Walk

WALK_TIME = 0.25
"""Duration of a stand-in walk [s]."""

COUNTS = (1, 16, 64, 256)


class Sleepers(RemoteWorkers):
    """Stand-in workers in any executor.

    Args:
        executor: Where they sleep.
        walk: What they do; a stand-in walk of 0.25 s by default.
    """

    def __init__(self, executor: Executor, walk: Callable[[Trial], Timed] | None = None) -> None:
        super().__init__()
        self._executor, self._walk = executor, walk or sleep

    def submit(self, trial: Trial) -> "Future[Timed]":
        """Have a trial slept."""
        return self._executor.submit(self._walk, trial)


def sleep(trial: Trial) -> Timed:
    """A walk that takes its time and goes further the nearer its gait is to a certain one."""
    time.sleep(WALK_TIME)
    away = float(np.abs(trial.candidate.gait.coefficients).sum())
    walk = Walk(
        outcome=Outcome.WALKED,
        frames=240,
        forward=0.5 - 0.1 * away,
        lateral=0.001,
        yaw=0.01,
        com_height=0.245,
    )
    return walk, WALK_TIME


@contextmanager
def sleepers(count: int, dask: bool) -> Iterator[Sleepers]:
    """So many stand-in workers."""
    if not dask:
        with ThreadPoolExecutor(count) as threads:
            yield Sleepers(threads)
        return
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=1, threads_per_worker=count, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield Sleepers(client.get_executor(pure=False))


def trials_of(space: DesignSpace, count: int) -> list[Trial]:
    """Trials drawn from a study's box."""
    x = np.random.default_rng(0).uniform(-1.0, 1.0, size=(count, space.dimension))
    return [Trial(candidate=space.decode(row)) for row in x]


def bench_real(settings: StudySettings, walks: int) -> None:
    """Real walks by 1 and 2 processes."""
    trials, rates = trials_of(settings.space, walks), []
    for count in (1, 2):
        with LocalProcesses(walk_trial, count=count) as workers:
            list(workers.run(trials[: 2 * count]))  # Imports, and builds the robot.
            start = time.perf_counter()
            list(workers.run(trials))
            rates.append(walks / (time.perf_counter() - start))
        efficiency = rates[-1] / count / rates[0]
        print(f"{count} processes: {rates[-1]:.2f} walks/s, efficiency {efficiency:.2f}")


def driven(count: int, dask: bool, walks_each: int = 8) -> tuple[float, float]:
    """Have stand-in workers walk, and keep every walk in a study.

    Returns:
        Walks per second, and the driver's processor time for one of them [s].
    """
    trials = trials_of(read_study(default_study(), {}).space, walks_each * count)
    with (
        tempfile.TemporaryDirectory() as folder,
        Study.create(Path(folder) / "study.db", {}) as study,
        sleepers(count, dask) as workers,
    ):
        list(workers.run(trials[:count]))
        start, cpu = time.perf_counter(), time.process_time()
        for finished in workers.run(trials):
            study.add(entry(finished.index, trials[finished.index].candidate, finished.walk))
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    return len(trials) / wall, cpu / len(trials)


def bench_driver(settings: StudySettings, dask: bool) -> None:
    """Print the walks per second that workers, futures and store let through."""
    for count in COUNTS:
        rate, cpu = driven(count, dask)
        ideal = count / WALK_TIME
        print(
            f"{count:4d} workers: {rate:7.1f} walks/s of {ideal:6.0f}, busy "
            f"{rate / ideal:.2f}, driver {1e3 * cpu:.2f} ms a walk"
        )
    trial = trials_of(settings.space, 1)[0]
    walk, _ = sleep(trial)
    with (
        tempfile.TemporaryDirectory() as folder,
        Study.create(Path(folder) / "commits.db", {}) as study,
    ):
        start = time.perf_counter()
        for number in range(2000):
            study.add(entry(number, trial.candidate, walk))
        print(f"store: {2000 / (time.perf_counter() - start):.0f} commits/s")


def entry(number: int, candidate: Candidate, walk: Walk) -> StudyWalk:
    """A walk as the store has it."""
    return StudyWalk(id=number, stage="design", iteration=0, candidate=candidate, walk=walk)


def bench_search(dask: bool) -> None:
    """Whole searches: samples, and three batches of the same size."""
    for batch in (16, 64, 256):
        plan = {"samples": batch, "simulations": 4 * batch, "batch": batch}
        settings = read_study(
            default_study(), {("search", key): value for key, value in plan.items()}
        )
        with (
            tempfile.TemporaryDirectory() as folder,
            Study.create(Path(folder) / "study.db", {}) as study,
            sleepers(batch, dask) as workers,
        ):
            start = time.perf_counter()
            search(settings, study, workers.run)
            wall, walks = time.perf_counter() - start, len(study.walks())
        ideal = walks * WALK_TIME / batch
        print(
            f"{batch:4d} workers, batches of {batch}: {walks} walks in {wall:.1f} s, "
            f"busy {ideal / wall:.2f}"
        )


def bench_busy(settings: StudySettings, seconds: float) -> None:
    """Print how busy a whole study keeps its workers, in its search and in its confirmation."""
    columns = ("workers", "walks", "search, busy [%]", "its second half", "confirming walks",
               "confirmation, busy [%]", "its second half", "driver [CPU s]")  # fmt: skip
    print(heading(columns, len(columns)))
    for count in (2, 4):
        spans: list[tuple[float, float]] = []
        walk = StandIn(settings, seconds)

        def timed(
            trial: Trial, walk: StandIn = walk, spans: list[tuple[float, float]] = spans
        ) -> Timed:
            begin = time.perf_counter()
            found = walk.timed(trial)
            spans.append((begin, time.perf_counter()))
            return found

        turn = [0.0]

        def note(progress: Progress, turn: list[float] = turn) -> None:
            if progress.walks == progress.total and not turn[0]:
                turn[0] = time.perf_counter()

        with (
            tempfile.TemporaryDirectory() as folder,
            Study.create(Path(folder) / "study.db", {}) as study,
            ThreadPoolExecutor(count) as threads,
        ):
            begin, cpu = time.perf_counter(), time.process_time()
            search(settings, study, Sleepers(threads, timed).run, note)
            end, cpu = time.perf_counter(), time.process_time() - cpu
        parts = [
            100.0 * _busy(spans, count, first, last)
            for start, last in ((begin, turn[0]), (turn[0], end))
            for first in (start, (start + last) / 2.0)
        ]
        searched = settings.search.simulations
        shown = [f"{part:.1f}" for part in parts]
        cells = [count, searched, *shown[:2], len(spans) - searched, *shown[2:], f"{cpu:.0f}"]
        print(row(cells), flush=True)


def _busy(spans: list[tuple[float, float]], workers: int, begin: float, end: float) -> float:
    """Share of the time of so many workers that they walked in."""
    inside = sum(max(0.0, min(last, end) - max(first, begin)) for first, last in spans)
    return inside / (workers * (end - begin))


def main() -> int:
    """Run the tool."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("real", "driver", "search", "busy"))
    parser.add_argument("--walks", type=int, default=100, help="real walks (100)")
    parser.add_argument("--dask", action="store_true", help="stand-ins behind a Dask scheduler")
    parser.add_argument("--seconds", type=float, default=0.25, help="of a walk, for busy (0.25)")
    options = parser.parse_args()
    settings = read_study(default_study(), {})
    if options.what == "real":
        bench_real(settings, options.walks)
    elif options.what == "driver":
        bench_driver(settings, options.dask)
    elif options.what == "busy":
        bench_busy(settings, options.seconds)
    else:
        bench_search(options.dask)
    return 0


if __name__ == "__main__":
    sys.exit(main())
