"""How a study scales: walks per second by workers, and what the driver costs.

    python tools/bench_scaling.py real [--walks N]      # 1 and 2 processes on real walks
    python tools/bench_scaling.py driver [--dask]       # up to 256 stand-in workers, 0.25 s a walk
    python tools/bench_scaling.py search [--dask]       # whole searches on them, by batch

A stand-in worker is a thread that sleeps, so that 256 of them cost no processor; with --dask it is
a thread of a Dask worker in another process, behind a scheduler.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from drake_gait.execution.base import RemoteWorkers, Timed
from drake_gait.execution.local import LocalProcesses
from drake_gait.problem import Candidate, DesignSpace, Trial
from drake_gait.search.loop import search
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
    """Stand-in workers in any executor."""

    def __init__(self, executor: Executor) -> None:
        super().__init__()
        self._executor = executor

    def submit(self, trial: Trial) -> "Future[Timed]":
        """Have a trial slept."""
        return self._executor.submit(sleep, trial)


def sleep(trial: Trial) -> Timed:
    """A walk that takes its time and goes further the nearer its gait is to a certain one."""
    time.sleep(WALK_TIME)
    away = float(np.abs(trial.candidate.gait.coefficients).sum())
    walk = Walk(
        outcome=Outcome.WALKED, frames=240, forward=0.5 - 0.1 * away, lateral=0.001, yaw=0.01,
        com_height=0.245,
    )  # fmt: skip
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


def bench_driver(settings: StudySettings, dask: bool) -> None:
    """What the workers, the futures and the store let through."""
    with tempfile.TemporaryDirectory() as folder:
        for count in COUNTS:
            trials = trials_of(settings.space, 8 * count)
            with (
                Study.create(Path(folder) / f"{count}.db", {}) as study,
                sleepers(count, dask) as workers,
            ):
                list(workers.run(trials[:count]))
                start, cpu = time.perf_counter(), time.process_time()
                for finished in workers.run(trials):
                    study.add(
                        entry(finished.index, trials[finished.index].candidate, finished.walk)
                    )
                wall, cpu = time.perf_counter() - start, time.process_time() - cpu
            rate, ideal = len(trials) / wall, count / WALK_TIME
            print(
                f"{count:4d} workers: {rate:7.1f} walks/s of {ideal:6.0f}, busy "
                f"{rate / ideal:.2f}, driver {1e3 * cpu / len(trials):.2f} ms a walk"
            )
        with Study.create(Path(folder) / "commits.db", {}) as study:
            candidate, (walk, _) = trials[0].candidate, sleep(trials[0])
            start = time.perf_counter()
            for number in range(2000):
                study.add(entry(number, candidate, walk))
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


def main() -> int:
    """Run the tool."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("real", "driver", "search"))
    parser.add_argument("--walks", type=int, default=100, help="real walks (100)")
    parser.add_argument("--dask", action="store_true", help="stand-ins behind a Dask scheduler")
    options = parser.parse_args()
    settings = read_study(default_study(), {})
    if options.what == "real":
        bench_real(settings, options.walks)
    elif options.what == "driver":
        bench_driver(settings, options.dask)
    else:
        bench_search(options.dask)
    return 0


if __name__ == "__main__":
    sys.exit(main())
