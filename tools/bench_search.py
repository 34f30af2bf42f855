"""Compare the search's modes: best feasible walk against number of walks simulated.

    python tools/bench_search.py --output runs/bench_search --seeds 5 --simulations 600 --jobs 2

Every mode searches the same study with the same seeds; each (mode, seed) is an ordinary study in
OUTPUT/<mode>/seed-<n>, which is gone on with where it stands. It prints a table of the best
feasible distance after so many walks, median (smallest to largest) over the seeds, with 0 for none
yet, and of the median distance of the robust winner; with --figure it draws the curves. The mode
"paper" has the 200 samples of the paper.
"""

import argparse
import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from drake_gait.execution.local import Serial
from drake_gait.optimization import open_study
from drake_gait.report.result import PAPER_TABLE
from drake_gait.search.loop import search
from drake_gait.simulation.simulate import walk_trial
from drake_gait.study.finalists import winner
from drake_gait.study.ranking import best_walk
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.records import CONFIRMATIONS
from drake_gait.study.search_settings import Mode
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study

CONFIRMED = (Mode.DEFAULT, Mode.CMAES)
"""Modes whose best candidates are walked again; the others do not come near them."""
WALKS = (100, 200, 300, 400, 600, 1000, 1500, 2000, 2500)


def settings_of(study: Path, mode: str, seed: int, simulations: int) -> StudySettings:
    """The study's settings for one run."""
    settings = read_study(study)
    samples = 200 if mode == Mode.PAPER else settings.search.samples
    plan = replace(settings.search, mode=Mode(mode), samples=samples, simulations=simulations)
    if Mode(mode) not in CONFIRMED:
        settings = replace(settings, confirmation=replace(settings.confirmation, walks=0))
    return replace(settings, seed=seed, search=plan)


def run(settings: StudySettings, folder: Path) -> str:
    """One study, in this process."""
    with open_study(settings, folder) as study:
        search(settings, study, Serial(walk_trial).run)
        study.set("finished", True)
    return str(folder)


def best_after(folder: Path, settings: StudySettings) -> np.ndarray:
    """Best feasible distance [mm] after 1, 2, ... walks; 0 for none yet."""
    with Study.open(folder) as study:
        walks = [walk for walk in study.walks() if walk.id < CONFIRMATIONS]
    found = [
        1e3 * walk.walk.forward if settings.assess(walk.walk).feasible else 0.0 for walk in walks
    ]
    return np.maximum.accumulate(np.array(found or [0.0]))


def confirmed(folder: Path, settings: StudySettings) -> float:
    """Median distance of the robust winner [mm]; 0 for none."""
    with Study.open(folder) as study:
        found = winner(settings, study.walks())
    return 1e3 * found.median if found else 0.0


def table(curves: dict[str, list[np.ndarray]], robust: dict[str, list[float]]) -> str:
    """Rows of modes, columns of walks, as Markdown."""
    most = max(len(curve) for mode in curves.values() for curve in mode)
    columns = [count for count in WALKS if count <= most]
    lines = [
        "| mode | seeds | " + " | ".join(f"{count} walks" for count in columns) + " | robust |",
        "|---|---|" + "---|" * (len(columns) + 1),
    ]
    for mode, runs in curves.items():
        cells = []
        for count in columns:
            values = [curve[count - 1] for curve in runs if len(curve) >= count]
            cells.append(spread(values))
        cells.append(spread(robust[mode] if Mode(mode) in CONFIRMED else []))
        lines.append(f"| {mode} | {len(runs)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def table_ii(folders: Sequence[Path], settings: Sequence[StudySettings], walks: int) -> str:
    """The best feasible walk of every seed's first walks, like the paper's Table II."""
    lines = ["| | X [mm] | Z [mm] | R [deg] | N |", "|---|---|---|---|---|"]
    for folder, one in zip(folders, settings, strict=True):
        with Study.open(folder) as study:
            best = best_walk([walk for walk in study.walks() if walk.id < walks], one.constraints)
        walk = best.walk
        lines.append(
            f"| seed {one.seed}, walk {best.id} | {1e3 * walk.lateral:.1f} | "
            f"{1e3 * walk.forward:.1f} | {np.degrees(walk.yaw):.2f} | {walk.steps} |"
        )
    for number, (lateral, forward, yaw, steps) in enumerate(PAPER_TABLE, 1):
        lines.append(f"| the paper's F{number} | {lateral} | {forward} | {yaw} | {steps} |")
    return "\n".join(lines)


def spread(values: Sequence[float]) -> str:
    """Median (smallest to largest), in whole millimetres."""
    if not values:
        return "-"
    return f"{np.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"


def draw(curves: dict[str, list[np.ndarray]], path: Path) -> None:
    """Median and range of every mode against the number of walks."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5.5, 3.5), layout="constrained")
    for (mode, runs), colour in zip(curves.items(), ("C0", "C1", "C2", "C7"), strict=False):
        length = min(map(len, runs))
        stacked = np.array([curve[:length] for curve in runs])
        count = np.arange(1, length + 1)
        axes.plot(count, np.median(stacked, axis=0), color=colour, label=mode)
        axes.fill_between(count, stacked.min(0), stacked.max(0), color=colour, alpha=0.15, lw=0)
    axes.axhline(177.96, color="0.4", ls=":", lw=1)
    end = axes.get_xlim()[1]
    axes.text(end, 172, "the paper's best", fontsize=7, color="0.4", ha="right", va="top")
    axes.set(xlabel="walks simulated", ylabel="best feasible walk [mm]")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=200)


def main() -> None:
    """Run what is missing, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--study", type=Path, default=default_study())
    parser.add_argument("--modes", nargs="+", default=[str(mode) for mode in Mode])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--simulations", type=int, default=600)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--table-ii", type=int, metavar="WALKS", help="print the default's best")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    wanted = {
        (mode, seed): settings_of(options.study, mode, seed, options.simulations)
        for seed in range(options.seeds)
        for mode in options.modes
    }
    folders = {key: options.output / key[0] / f"seed-{key[1]}" for key in wanted}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context, max_tasks_per_child=1) as pool:
        running = [pool.submit(run, wanted[key], folders[key]) for key in wanted]
        for future in as_completed(running):
            print(f"finished {future.result()}", flush=True)
    curves: dict[str, list[np.ndarray]] = {}
    robust: dict[str, list[float]] = {}
    for key, settings in wanted.items():
        curves.setdefault(key[0], []).append(best_after(folders[key], settings))
        robust.setdefault(key[0], []).append(confirmed(folders[key], settings))
    print(f"\nbest feasible distance [mm]\n\n{table(curves, robust)}")
    if options.table_ii:
        seeds = [key for key in wanted if key[0] == Mode.DEFAULT]
        runs, settings = [folders[key] for key in seeds], [wanted[key] for key in seeds]
        print(f"\nTable II, {options.table_ii} walks\n")
        print(table_ii(runs, settings, options.table_ii))
    if options.figure:
        draw(curves, options.figure)


if __name__ == "__main__":
    main()
