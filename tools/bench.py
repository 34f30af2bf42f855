"""Measure how fast everything is, in one table: `python tools/bench.py [PART...]`.

    walks    walks per second, CPU time of a walk, ratio to MuJoCo, overhead around Drake
    start    until a command line is answered
    report   of a finished study, made for the first time and made again
    growth   a proposal, memory and file of a search of 1,000 and of 20,000 walks
    busy     walks that a driver lets 256 stand-in workers make, and those that Dask does

The parts have tools of their own with more to say: bench_walk.py, bench_mujoco.py, bench_start.py,
bench_growth.py and bench_scaling.py. CPU times grow on a busy machine; ratios are paired.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import bench_growth
import numpy as np
from bench_mujoco import alternate
from bench_scaling import WALK_TIME, driven
from bench_start import seconds
from bench_walk import overhead, walks_of_box
from markdown_table import heading, row

from drake_gait.execution.local import LocalProcesses
from drake_gait.execution.machine import cores
from drake_gait.files.shipped import find
from drake_gait.simulation.simulate import simulate
from drake_gait.study.reading import default_study
from drake_gait.walk import Engine

Rows = Iterator[tuple[str, float, str]]
"""Lines of the table: what was measured, the number, its unit."""

LINES = ("--help", "optimize --help", "optimize none.toml", "report none")
STAND_INS = 256


def walks(options: argparse.Namespace) -> Rows:
    """Walks of a Latin hypercube of the default study's box, at its step."""
    settings, candidates = walks_of_box(default_study(), options.walks, seed=0)
    walk, count = settings.trial_settings, cores()
    with LocalProcesses(partial(simulate, settings=walk), count=count) as workers:
        list(workers.run(candidates[: 2 * count]))  # Imports, and builds the robot.
        start = time.perf_counter()
        list(workers.run(candidates))
        elapsed = time.perf_counter() - start
    yield (
        f"walks on {count} cores, step of {1e3 * walk.stepping.step:g} ms",
        (len(candidates) / elapsed),
        "1/s",
    )
    engines = {"drake": partial(simulate, settings=walk)}
    if find_spec("mujoco") is not None:
        other = replace(walk, engine=Engine.MUJOCO)
        engines["mujoco"] = partial(simulate, settings=other)
    for one in engines.values():
        one(candidates[0])
    taken = alternate(engines, candidates)
    drake = taken["drake"]
    completed = float(drake.cpu[drake.survived].mean())
    yield "a walk", float(drake.cpu.mean()), "CPU s"
    yield "a walk to the last frame", completed, "CPU s"
    if "mujoco" in taken:
        found = taken["mujoco"]
        both = found.survived & drake.survived
        step = 1e3 * replace(walk, engine=Engine.MUJOCO).stepping.step
        ratio = float(np.median(drake.cpu[both] / found.cpu[both]))
        yield f"the same / in MuJoCo at {step:g} ms", ratio, ""
    ratios, _ = overhead(candidates, walk, count=4, repeats=3)
    yield "simulate() / Drake's bare stepping", float(np.median(ratios)), ""


def start(options: argparse.Namespace) -> Rows:
    """Time until command lines are answered: the best of five."""
    lines = {"import drake_gait": ["-c", "import drake_gait"]}
    lines |= {f"drake-gait {line}": ["-m", "drake_gait", *line.split()] for line in LINES}
    for name, command in lines.items():
        yield name, min(seconds(command)[1] for _ in range(5)), "CPU s"


def report(options: argparse.Namespace) -> Rows:
    """Report of a finished study: without anything of an earlier one, and with all of it."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(find(options.run) / "study.db", folder)
        command = ["-m", "drake_gait", "report", folder]
        for name in ("first", "again"):
            wall, used = seconds(command)
            yield f"report of {options.run.name}, {name}", used, "CPU s"
            yield f"report of {options.run.name}, {name}", wall, "s"


def growth(options: argparse.Namespace) -> Rows:
    """Numbers of a search whose walks are computed in no time."""
    for count in bench_growth.WALKS:
        for name, value in zip(
            bench_growth.COLUMNS[1:], bench_growth.in_a_process(count)[1:], strict=True
        ):
            what, _, unit = name.rstrip("]").partition(" [")
            yield f"{count} walks: {what}", float(value), unit


def busy(options: argparse.Namespace) -> Rows:
    """Share of the time that stand-in workers walk in."""
    for dask in (False, True):
        if dask and find_spec("distributed") is None:
            continue
        rate, cpu = driven(STAND_INS, dask)
        name = f"{STAND_INS} stand-ins of {WALK_TIME:g} s{', behind Dask' if dask else ''}"
        yield f"{name}: busy", 100.0 * rate * WALK_TIME / STAND_INS, "%"
        yield f"{name}: driver, a walk", 1e3 * cpu, "CPU ms"


PARTS: dict[str, Callable[[argparse.Namespace], Rows]] = {
    "walks": walks,
    "start": start,
    "report": report,
    "growth": growth,
    "busy": busy,
}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--walks", type=int, default=24, help="gaits of the box (24)")
    parser.add_argument(
        "--run", type=Path, default=Path("studies/best"), help="a finished study (studies/best)"
    )
    options = parser.parse_args()
    if unknown := set(options.parts) - PARTS.keys():
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    columns = heading(("what", "value", "unit"))
    print(f"{time.strftime('%Y-%m-%d')}, {cores()} cores\n\n{columns}", flush=True)
    for name in options.parts or PARTS:
        for what, value, unit in PARTS[name](options):
            shown = f"{value:.3g}" if value < 1000.0 else f"{value:.0f}"
            print(row((what, shown, unit)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
