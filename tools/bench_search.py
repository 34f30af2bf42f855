"""Compare searches by what can be trusted of them: the distance that holds at reference fidelity.

    python tools/bench_search.py --output runs/bench_search --seeds 10 --jobs 2 \
        --arms default default+search.grounds=false isade-network cmaes

An arm is a mode of the search, with settings after it where it has its own. Every arm searches the
same study with the same seeds; each (arm, seed) is an ordinary study in OUTPUT/<arm>/seed-<n>, and
the same command goes on with what is missing. Afterwards the winner, and the first candidate that
the search recommends, walk eight times at reference fidelity, with the same fresh noise and grounds
in all arms. The *trusted distance* is their median if seven are feasible, else 0. With --z50 forty
feasible candidates of each study, of all distances, walk on both grounds with noise, and the
distance at which half of them hold is told: it needs fewer seeds.

--figure draws the best feasible single walk against the number of walks; --table-ii prints those of
the first arm like the paper's Table II. Time is the processor time of the walks and of the search
itself. The mode "paper" has its 200 samples. Tables are in Markdown, and kept in OUTPUT/table.md.
"""

import argparse
import json
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.optimize import minimize
from scipy.stats import wilcoxon

from drake_gait.errors import SettingsError
from drake_gait.execution.base import Serial
from drake_gait.optimization import is_finished, open_study
from drake_gait.problem import Candidate, Trial
from drake_gait.report.result import PAPER_TABLE
from drake_gait.search.grounds import end_of_variation, on_ground
from drake_gait.search.loop import search
from drake_gait.search.recommendation import recommended
from drake_gait.search.seeding import Purpose, generator
from drake_gait.simulation.simulate import walk_trial
from drake_gait.study.finalists import winner
from drake_gait.study.ranking import Sample, best_walk, nominal_walks, sample, search_walks
from drake_gait.study.reading import default_study, read_override, read_study
from drake_gait.study.records import StudyWalk
from drake_gait.study.search_settings import Mode
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.walk import Fidelity, Walk

ARMS = ("default", "default+search.grounds=false", "isade-network", "cmaes", "isade")
WALKS, HOLDING = 8, 7
"""Walks of a candidate, and how many must be feasible for it to be trusted."""
STRATA = 40
"""Candidates of a study that tell at which distance half of them hold."""


def settings_of(study: Path, arm: str, seed: int, simulations: int | None) -> StudySettings:
    """The study's settings for one run; an arm's own come last."""
    mode, *own = arm.split("+")
    wanted: dict[tuple[str, str], Any] = {("search", "mode"): mode, ("study", "seed"): seed}
    if mode == Mode.PAPER:
        wanted["search", "samples"] = 200
    if simulations is not None:
        wanted["search", "simulations"] = simulations
    return read_study(study, {**wanted, **dict(map(read_override, own))})


def run(settings: StudySettings, folder: Path, z50: bool) -> str:
    """One study and what is to be trusted of it, in this process; what is there already stays."""
    if not is_finished(settings, folder):
        started, walking = time.process_time(), _Stopwatch()
        with open_study(settings, folder) as study:
            before = study.description()
            try:
                search(settings, study, Serial(walking.walk).run)
                study.set("finished", True)
            finally:
                own = time.process_time() - started - walking.seconds
                study.set("walks_cpu_s", before.get("walks_cpu_s", 0.0) + walking.seconds)
                study.set("own_cpu_s", before.get("own_cpu_s", 0.0) + own)
    with Study.open(folder) as study:
        walks = study.walks()
    _kept(folder / "trusted.json", lambda: trusted(settings, walks))
    if z50:
        _kept(folder / "z50.json", lambda: z50_of(settings, walks))
    return str(folder)


class _Stopwatch:
    """Walks, and the processor time that they took [s]."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def walk(self, trial: Trial) -> Walk:
        """Simulate; networks may be learnt in another thread meanwhile."""
        started = time.thread_time()
        walk = walk_trial(trial)
        self.seconds += time.thread_time() - started
        return walk


def trusted(settings: StudySettings, walks: Sequence[StudyWalk]) -> dict[str, Any]:
    """What the winner and the first recommended candidate are worth, at both fidelities."""
    won = winner(settings, walks)
    first = recommended(settings, samples_of(settings, walks))[:1]
    candidates = {
        "winner": won.walk.candidate if won else None,
        "recommended": first[0].candidate if first else None,
    }
    return {
        name: {
            kind: _walked(settings, one, fidelity)
            for kind, fidelity in (
                ("repeats", settings.walk.fidelity),
                ("converged", Fidelity.REFERENCE),
            )
        }
        for name, one in candidates.items()
    }


def _walked(
    settings: StudySettings, candidate: Candidate | None, fidelity: Fidelity
) -> dict[str, Any]:
    if candidate is None:
        return {"trusted_mm": 0.0, "feasible": 0, "upright": 0}
    found = [fresh(settings, candidate, number, fidelity) for number in range(1, WALKS + 1)]
    feasible = sum(settings.assess(walk).feasible for walk in found)
    median = 1e3 * float(np.median([walk.forward for walk in found]))
    return {
        "trusted_mm": median if feasible >= HOLDING else 0.0,
        "median_mm": median,
        "feasible": feasible,
        "upright": sum(walk.survived for walk in found),
        "walks": [
            [1e3 * walk.forward, 1e3 * walk.lateral, float(np.degrees(walk.yaw))] for walk in found
        ],
    }


def fresh(settings: StudySettings, candidate: Candidate, number: int, fidelity: Fidelity) -> Walk:
    """A perturbed walk whose noise no search has seen, the same noise for every candidate."""
    gait = candidate.gait
    noise = generator(0, Purpose.TRUST, number).standard_normal(gait.coefficients.shape)
    moved = gait.coefficients + settings.confirmation.noise * noise
    ground = on_ground(settings.walk, settings, end_of_variation(number))
    return walk_trial(
        Trial(
            candidate=replace(candidate, gait=replace(gait, coefficients=moved)),
            settings=replace(ground, fidelity=fidelity),
        )
    )


def samples_of(settings: StudySettings, walks: Sequence[StudyWalk]) -> list[Sample]:
    """Samples of a study's search, each of the walks of one candidate."""
    own: dict[int, list[StudyWalk]] = {}
    for walk in search_walks(walks):
        own.setdefault(walk.id if walk.nominal is None else walk.nominal, []).append(walk)
    return [sample(number, group, settings) for number, group in enumerate(own.values())]


def z50_of(settings: StudySettings, walks: Sequence[StudyWalk]) -> dict[str, Any]:
    """The distance at which half of the feasible candidates hold with noise, on both grounds."""
    searched = nominal_walks(walks)
    feasible = [walk for walk in searched if settings.assess(walk.walk).feasible]
    feasible.sort(key=lambda walk: walk.walk.forward)
    places = np.unique(np.linspace(0, len(feasible) - 1, STRATA).astype(int)) if feasible else []
    distance, held = [], []
    for place in places:
        for number in (1, 2):
            one = feasible[place]
            walk = fresh(settings, one.candidate, number, settings.walk.fidelity)
            distance.append(1e3 * one.walk.forward)
            held.append(settings.assess(walk).feasible)
    return {
        "z50_mm": half_hold(np.array(distance), np.array(held)),
        "held": int(np.sum(held)),
        "walks": len(held),
    }


def half_hold(distance: np.ndarray, held: np.ndarray) -> float:
    """Where a logistic curve through walks that held, or did not, is one half [mm]; 0 for none.

    Its slope is at most 0, with a prior of a tenth of a walk each way, so that it has an answer
    where all held, or none: the ends of what was walked.
    """
    if not len(held) or not held.any():
        return 0.0
    scale = max(float(distance.std()), 1.0)
    z = (distance - distance.mean()) / scale

    def unlikelihood(p: np.ndarray) -> float:
        logit = p[0] - np.exp(p[1]) * z
        return float(np.logaddexp(0.0, np.where(held, -logit, logit)).sum() + 0.05 * (p**2).sum())

    at, steep = minimize(unlikelihood, np.zeros(2)).x
    middle = float(distance.mean() + scale * at / np.exp(steep))
    return float(np.clip(middle, 0.0, distance.max()))


def table(found: dict[str, list[dict[str, float]]]) -> str:
    """A row for each arm: medians (smallest to largest) over the seeds, as Markdown."""
    columns = (
        "winner",
        "winner",
        "recommended",
        "repeats",
        "best_single",
        "z50",
        "walk_s",
        "own_s",
    )
    head = (
        "arm",
        "seeds",
        "trusted [mm]",
        "trusted winners",
        "first recommended, trusted [mm]",
        "the same at the search's step [mm]",
        "best single walk [mm]",
        "Z50 [mm]",
        "walks, CPU [s]",
        "own, CPU [s]",
        "p against the first arm",
    )
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    first = next(iter(found.values()))
    for arm, runs in found.items():
        cells = [_spread([one[key] for one in runs if key in one]) for key in columns]
        cells[1] = f"{sum(one['winner'] > 0 for one in runs)} of {len(runs)}"
        lines.append(f"| {arm} | {len(runs)} | {' | '.join(cells)} | {_p(first, runs)} |")
    return "\n".join(lines)


def _p(first: Sequence[dict[str, float]], other: Sequence[dict[str, float]]) -> str:
    """Chance of such paired differences in trusted distance between arms that are alike."""
    pairs = zip(first, other, strict=True)
    differences = [one["winner"] - two["winner"] for one, two in pairs]
    if first is other or not any(differences):
        return "-"
    return f"{wilcoxon(differences).pvalue:.2f}"


def figures(settings: StudySettings, folder: Path) -> dict[str, float]:
    """What a table tells of one study."""
    with Study.open(folder) as study:
        walks, known = study.walks(), study.description()
    told = json.loads((folder / "trusted.json").read_text())
    searched = nominal_walks(walks)
    single = [1e3 * one.walk.forward for one in searched if settings.assess(one.walk).feasible]
    found = {
        "winner": told["winner"]["converged"]["trusted_mm"],
        "recommended": told["recommended"]["converged"]["trusted_mm"],
        "repeats": told["recommended"]["repeats"]["trusted_mm"],
        "best_single": max(single, default=0.0),
        "walk_s": known["walks_cpu_s"],
        "own_s": known["own_cpu_s"],
    }
    if (folder / "z50.json").exists():
        found["z50"] = json.loads((folder / "z50.json").read_text())["z50_mm"]
    return found


def best_after(folder: Path, settings: StudySettings) -> np.ndarray:
    """Best feasible distance [mm] after 1, 2, ... walks; 0 for none yet."""
    with Study.open(folder) as study:
        walks = search_walks(study.walks())
    found = [
        1e3 * walk.walk.forward if settings.assess(walk.walk).feasible else 0.0 for walk in walks
    ]
    return np.maximum.accumulate(np.array(found or [0.0]))


def table_ii(folders: Sequence[Path], settings: Sequence[StudySettings], walks: int) -> str:
    """The best feasible walk of every seed's first walks, like the paper's Table II."""
    lines = ["| | X [mm] | Z [mm] | R [deg] | N |", "|---|---|---|---|---|"]
    for folder, one in zip(folders, settings, strict=True):
        with Study.open(folder) as study:
            best = best_walk([walk for walk in study.walks() if walk.id < walks], one.constraints)
        walk = best.walk
        lines.append(
            f"| seed {one.seed}, walk {best.id} | {1e3 * walk.lateral:.1f} | "
            f"{1e3 * walk.forward:.1f} | {np.degrees(walk.yaw):.2f} | {walk.frames} |"
        )
    for number, (lateral, forward, yaw, frames) in enumerate(PAPER_TABLE, 1):
        lines.append(f"| the paper's F{number} | {lateral} | {forward} | {yaw} | {frames} |")
    return "\n".join(lines)


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


def _kept(path: Path, made: Callable[[], dict[str, Any]]) -> None:
    """Make what a file is to hold, unless it is there."""
    if not path.exists():
        text = json.dumps(made(), indent=1)
        path.with_suffix(".new").write_text(text, encoding="utf-8")
        path.with_suffix(".new").replace(path)


def _spread(values: Sequence[float]) -> str:
    """Median (smallest to largest), in whole numbers."""
    if not values:
        return "-"
    return f"{np.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"


def main() -> None:
    """Run what is missing, and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--study", type=Path, default=default_study())
    parser.add_argument(
        "--arms", "--modes", nargs="+", default=ARMS, metavar="MODE[+section.key=value...]"
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--simulations", type=int, help="walks in all, instead of the study's")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--z50", action="store_true", help="80 more walks of each study")
    parser.add_argument("--table-ii", type=int, metavar="WALKS", help="the first arm's best walks")
    parser.add_argument("--figure", type=Path, help="draw the best single walk against walks")
    options = parser.parse_args()
    try:
        wanted = {
            (arm, seed): settings_of(options.study, arm, seed, options.simulations)
            for seed in range(options.seeds)
            for arm in options.arms
        }
    except SettingsError as error:
        parser.error(str(error))
    folders = {(arm, seed): options.output / arm / f"seed-{seed}" for arm, seed in wanted}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context, max_tasks_per_child=1) as pool:
        running = [pool.submit(run, wanted[key], folders[key], options.z50) for key in wanted]
        for future in as_completed(running):
            print(f"finished {future.result()}", flush=True)
    found: dict[str, list[dict[str, float]]] = {}
    for key, settings in wanted.items():
        found.setdefault(key[0], []).append(figures(settings, folders[key]))
    (options.output / "table.md").write_text(table(found) + "\n", encoding="utf-8")
    print(f"\n{table(found)}")
    if options.table_ii:
        keys = [key for key in wanted if key[0] == options.arms[0]]
        runs, settings = [folders[key] for key in keys], [wanted[key] for key in keys]
        print(f"\nTable II, {options.table_ii} walks\n")
        print(table_ii(runs, settings, options.table_ii))
    if options.figure:
        curves: dict[str, list[np.ndarray]] = {}
        for key, one in wanted.items():
            curves.setdefault(key[0], []).append(best_after(folders[key], one))
        draw(curves, options.figure)


if __name__ == "__main__":
    main()
