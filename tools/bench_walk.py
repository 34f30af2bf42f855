"""Measure how fast and how well a walk is simulated: `python tools/bench_walk.py`.

Five tables, from one Latin hypercube of a study's box:

    integrators   each against the reference fidelity: survivors in common, correlation and median
                  difference of Z, X and yaw, processor time of a walk, walks per second
    convergence   feasible walks only: what a finer step, a tighter accuracy and small changes of
                  the coefficients do to them
    servo         feasible walks only: what other gains of the servos do to them
    overhead      processor time of `simulate` against a bare loop of Drake's own stepping
    workers       how long a worker process takes to start, and the most memory that one ever holds

With --runs, walks that studies found instead of the hypercube's.

docs/experiments/ holds the tables that this printed.
"""

import argparse
import contextlib
import functools
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from soak import children

from drake_gait.execution.local import LocalProcesses
from drake_gait.execution.machine import cores
from drake_gait.gait import FRAME_TIME, FRAMES, FloatArray, Gait
from drake_gait.problem import Candidate, assess
from drake_gait.search.proposer import design_of_experiments
from drake_gait.simulation import simulate as simulation
from drake_gait.study.ranking import feasible_walks
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.settings import StudySettings, study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Fidelity, Integrator, Walk, WalkSettings

INTEGRATORS = {
    "CENIC, 10 ms": Integrator(step=0.010),
    "CENIC, 5 ms": Integrator(step=0.005),
    "CENIC, 4 ms (search)": Integrator(step=0.004),
    "CENIC, 3.33 ms": Integrator(step=FRAME_TIME / 6.0),
    "CENIC, 2.5 ms": Integrator(step=0.0025),
    "CENIC, 2 ms": Integrator(step=0.002),
    "CENIC, accuracy 1e-3": Integrator(step=FRAME_TIME, accuracy=1e-3),
    "lagged, 4 ms": Integrator(step=0.004, discrete=True),
    "lagged, 2 ms": Integrator(step=0.002, discrete=True),
    "lagged, 1 ms": Integrator(step=0.001, discrete=True),
}
REFERENCE = "CENIC, accuracy 1e-4 (reference)"


@dataclass(frozen=True)
class Batch:
    """What an integrator made of all candidates."""

    walks: list[Walk]
    cpu: FloatArray
    """Processor time of each walk [s], shape (n,)."""
    elapsed: float
    """Wall-clock time of all of them [s]."""

    @property
    def survived(self) -> np.ndarray:
        """Who survived, shape (n,)."""
        return np.array([walk.survived for walk in self.walks])

    @property
    def numbers(self) -> FloatArray:
        """Z [mm], X [mm] and yaw [deg], shape (n, 3)."""
        return np.array([[1e3 * w.forward, 1e3 * w.lateral, np.degrees(w.yaw)] for w in self.walks])


def walks_of_box(study: Path, count: int, seed: int) -> tuple[StudySettings, list[Candidate]]:
    """A study's settings, and a Latin hypercube of `count` candidates in its box."""
    overrides = {
        ("study", "seed"): seed,
        ("search", "samples"): count,
        ("search", "simulations"): count,
    }
    settings = read_study(study, overrides)
    return settings, [settings.space.decode(x) for x in design_of_experiments(settings)]


def walks_of_studies(
    runs: Sequence[Path], count: int, seed: int
) -> tuple[StudySettings, list[Candidate]]:
    """The settings of the first of some studies, and feasible candidates, as many of each."""
    rng = np.random.default_rng(seed)
    described: list[StudySettings] = []
    chosen: list[Candidate] = []
    for run_ in runs:
        with Study.open(run_) as study:
            settings, walks = study_settings(study.description()["settings"]), study.walks()
        described.append(settings)
        found = feasible_walks(walks, settings.constraints, settings.search.objective)
        places = rng.choice(len(found), size=min(count // len(runs), len(found)), replace=False)
        chosen += [found[place].candidate for place in sorted(places)]
    return described[0], chosen


def timed(candidate: Candidate, settings: WalkSettings) -> tuple[Walk, float]:
    """One walk and its processor time [s]."""
    start = time.process_time()
    walk = simulation.simulate(candidate, settings)
    return walk, time.process_time() - start


def run(
    pool: ProcessPoolExecutor, candidates: Sequence[Candidate], settings: WalkSettings
) -> Batch:
    """All candidates, over all processes."""
    start = time.perf_counter()
    results = list(pool.map(timed, candidates, [settings] * len(candidates)))
    elapsed = time.perf_counter() - start
    walks, cpu = zip(*results, strict=True)
    return Batch(list(walks), np.array(cpu), elapsed)


def compare(one: Batch, other: Batch) -> str:
    """Survival in common, correlations and median differences, as a row's cells."""
    both = one.survived & other.survived
    a, b = one.numbers[both], other.numbers[both]
    same = float(np.mean(one.survived == other.survived))
    cells = [f"{100 * same:4.0f} %"]
    for column in range(3):
        r = np.corrcoef(a[:, column], b[:, column])[0, 1] if both.sum() > 2 else np.nan
        cells.append(f"{r:5.2f} ({np.median(np.abs(a - b)[:, column]):4.1f})")
    return " | ".join(cells)


def integrators(pool: ProcessPoolExecutor, candidates: list[Candidate], walk: WalkSettings) -> None:
    """Print how integrators compare with the reference."""
    reference = run(pool, candidates, replace(walk, fidelity=Fidelity.REFERENCE))
    print(
        "\n| integrator | same survival | Z r (mm) | X r (mm) | yaw r (deg) | survive "
        "| CPU s / completed walk | walks/s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    print_row(REFERENCE, "–| – | – | –", reference)
    for name, integrator in INTEGRATORS.items():
        batch = run(pool, candidates, replace(walk, integrator=integrator))
        print_row(name, compare(batch, reference), batch)


def print_row(name: str, cells: str, batch: Batch) -> None:
    """One integrator's row."""
    completed = batch.cpu[batch.survived]
    median = np.median(completed) if len(completed) else np.nan
    rate = len(batch.walks) / batch.elapsed
    print(
        f"| {name} | {cells} | {100 * batch.survived.mean():.0f} % | {median:.3f} | {rate:.1f} |",
        flush=True,
    )


def feasible(
    pool: ProcessPoolExecutor, candidates: list[Candidate], settings: StudySettings
) -> tuple[list[Candidate], Batch]:
    """The candidates that are feasible at search fidelity, and their walks."""
    found = run(pool, candidates, settings.walk)
    chosen = [
        candidate
        for candidate, result in zip(candidates, found.walks, strict=True)
        if assess(result, settings.constraints).feasible
    ]
    return chosen, run(pool, chosen, settings.walk)


def servo(pool: ProcessPoolExecutor, candidates: list[Candidate], settings: StudySettings) -> None:
    """Print how the servos' gains change walks that are feasible with the default ones."""
    chosen, base = feasible(pool, candidates, settings)
    print(f"\n{len(chosen)} feasible walks\n")
    print("| stiffness N·m/rad | damping N·m·s/rad | survive | feasible | median Z mm | Z r (mm) |")
    print("|---|---|---|---|---|---|")
    default = settings.walk.servo
    gains = [(default.stiffness, default.damping)]
    gains += [(value, default.damping) for value in (10.0, 15.0, 30.0, 50.0)]
    gains += [(default.stiffness, value) for value in (0.05, 0.1, 0.4)]
    for stiffness, damping in gains:
        changed = replace(default, stiffness=stiffness, damping=damping)
        batch = run(pool, chosen, replace(settings.walk, servo=changed))
        good = [assess(walk, settings.constraints).feasible for walk in batch.walks]
        forward = batch.numbers[batch.survived, 0]
        relation = compare(batch, base).split(" | ")[1]
        print(
            f"| {stiffness:g} | {damping:g} | {100 * batch.survived.mean():.0f} % | "
            f"{100 * np.mean(good):.0f} % | {np.median(forward):.0f} | {relation} |",
            flush=True,
        )


def convergence(
    pool: ProcessPoolExecutor, candidates: list[Candidate], settings: StudySettings, seed: int
) -> None:
    """Print what step, accuracy and noise change in walks that are feasible at search fidelity."""
    walk = settings.walk
    chosen, base = feasible(pool, candidates, settings)
    reference = replace(walk, fidelity=Fidelity.REFERENCE)
    exact = run(pool, chosen, reference)
    tight = replace(walk, integrator=Integrator(step=FRAME_TIME, accuracy=1e-5))
    rows = {
        "search, coefficients + 1e-6 deg": (run(pool, shifted(chosen, 1e-6, seed), walk), base),
        "search, coefficients ± 0.05 deg": (run(pool, shifted(chosen, 0.05, seed), walk), base),
        "search, half the step (2 ms)": (
            run(pool, chosen, replace(walk, integrator=Integrator(step=0.002))),
            base,
        ),
        "search, a quarter (1 ms)": (
            run(pool, chosen, replace(walk, integrator=Integrator(step=0.001))),
            base,
        ),
        "reference (1e-4)": (exact, base),
        "reference, 1e-5 instead of 1e-4": (run(pool, chosen, tight), exact),
        "reference, coefficients + 1e-6 deg": (
            run(pool, shifted(chosen, 1e-6, seed), reference),
            exact,
        ),
        "reference, coefficients ± 0.05 deg": (
            run(pool, shifted(chosen, 0.05, seed), reference),
            exact,
        ),
    }
    print(f"\n{len(chosen)} feasible walks; differences: median (90th percentile)\n")
    print("| changed | same survival | Z mm | X mm | yaw deg |\n|---|---|---|---|---|")
    for name, (changed, original) in rows.items():
        both = changed.survived & original.survived
        difference = np.abs(changed.numbers - original.numbers)[both]
        cells = " | ".join(
            f"{np.median(column):.2f} ({np.percentile(column, 90):.2f})" for column in difference.T
        )
        same = 100 * np.mean(changed.survived == original.survived)
        print(f"| {name} | {same:.0f} % | {cells} |", flush=True)


def shifted(candidates: list[Candidate], degrees: float, seed: int) -> list[Candidate]:
    """Candidates with every coefficient changed by a normal number of this deviation."""
    rng = np.random.default_rng([seed, 99])
    return [
        replace(
            candidate,
            gait=Gait(
                coefficients=candidate.gait.coefficients
                + np.radians(degrees) * rng.standard_normal((4, 4))
            ),
        )
        for candidate in candidates
    ]


def overhead(
    candidates: list[Candidate], walk: WalkSettings, count: int = 8, repeats: int = 7
) -> tuple[FloatArray, FloatArray]:
    """Measure what surrounds Drake: simulate() and the bare loop take turns on the same walks.

    Returns:
        How many times as long simulate() takes, and its processor time [s], of each walk.
    """
    ratios, times = [], []
    for candidate in [c for c in candidates if simulation.simulate(c, walk).survived][:count]:
        bare_time, full_time = [], []
        for _ in range(repeats):
            robot, context = simulation.prepare(
                candidate.gait.commands_from(walk.start), candidate.foot, walk, logged=False
            )
            start = time.process_time()
            simulator = simulation.start(robot.diagram, context, walk.stepping)
            simulator.AdvanceTo(FRAMES * FRAME_TIME, interruptible=False)
            bare_time.append(time.process_time() - start)
            full_time.append(timed(candidate, walk)[1])
        # The least of each: what else runs on the machine only ever adds.
        ratios.append(min(full_time) / min(bare_time))
        times.append(min(full_time))
    return np.array(ratios), np.array(times)


def workers(candidates: list[Candidate], walk: WalkSettings, starts: int = 5) -> None:
    """Print what a worker holds: one worker process walks all candidates, as in a search."""
    cold = []
    for _ in range(starts):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import drake_gait.simulation.simulate"], check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cold.append(
            (
                time.perf_counter() - start,
                after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            )
        )
    peak = 0.0
    with LocalProcesses(functools.partial(simulation.simulate, settings=walk), count=1) as one:
        for _ in one.run(candidates):
            peak = max(peak, *map(high_water, children(os.getpid())))
    elapsed, cpu = np.median(cold, axis=0)
    print(
        f"\na worker starts in {elapsed:.2f} s ({cpu:.2f} CPU s, median of {starts}); "
        f"at most {peak:.0f} MB over {len(candidates)} walks",
        flush=True,
    )


def high_water(process: int) -> float:
    """The most memory that a process has held [MB]; 0 if it has ended."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        status = Path(f"/proc/{process}/status").read_text().splitlines()
        return sum(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024.0
    return 0.0


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "tables", nargs="*", default=["workers", "integrators", "convergence", "servo", "overhead"]
    )
    # The box of the default study, of whose gaits too few are feasible to be compared.
    parser.add_argument("--study", type=Path, default=default_study().with_name("paper.toml"))
    parser.add_argument("--walks", type=int, default=200)
    parser.add_argument(
        "--runs", type=Path, nargs="+", metavar="RUN", help="feasible walks of studies, not the box"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=cores())
    options = parser.parse_args()
    if options.runs:
        settings, candidates = walks_of_studies(options.runs, options.walks, options.seed)
    else:
        settings, candidates = walks_of_box(options.study, options.walks, options.seed)
    if "workers" in options.tables:
        workers(candidates, settings.walk)
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        run(pool, candidates[: 2 * options.workers], settings.walk)  # Imports and builds.
        if "integrators" in options.tables:
            integrators(pool, candidates, settings.walk)
        if "servo" in options.tables:
            servo(pool, candidates, settings)
        if "convergence" in options.tables:
            convergence(pool, candidates, settings, options.seed)
    if "overhead" in options.tables:
        ratios, times = overhead(candidates, settings.walk)
        span = f"{np.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f})"
        print(f"\nsimulate() / bare stepping: {span}, {np.median(times):.3f} CPU s")


if __name__ == "__main__":
    main()
