"""Walk the same gaits on every sole, and change one thing at a time.

Tables:
    halving       half the step, finer faces, half the compliance
    integrators   other steps, error control, Drake's discrete plant; each against steps of 1 ms
    slip          how far soles slide, with other stiffness, damping and friction

Each line says by how much walks that survive both move: the median and the 90th percentile of the
distance, the drift [mm] and the turn [deg], and how many end alike. Gaits are a Latin hypercube of
a study's box, with the start of that study; with --runs, feasible ones that studies have found.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_walk import walks_of_box, walks_of_studies

from drake_gait.gait import FRAME_TIME, Start
from drake_gait.problem import Candidate, assess
from drake_gait.simulation.simulate import prepare, simulate
from drake_gait.sole import Contact, Sole
from drake_gait.study.ranking import feasible_walks
from drake_gait.study.reading import default_study
from drake_gait.study.settings import StudySettings, study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Integrator, Walk, WalkSettings

OTHERS = {
    Sole.AREA: {
        "faces": Contact(finer=2),
        "compliance": Contact(modulus=2.0 * Contact().modulus),
    },
    Sole.POINTS: {"compliance": Contact(stiffness=2.0 * Contact().stiffness)},
    Sole.BOXES: {},
}
"""What is halved beside the step, by sole."""

FINE = Integrator(step=0.001)
"""What integrators are compared with, and soles slide in."""
INTEGRATORS = {
    "CENIC, 4 ms": Integrator(step=0.004),
    "CENIC, 3.33 ms": Integrator(step=FRAME_TIME / 6.0),
    "CENIC, 2.5 ms": Integrator(step=0.0025),
    "CENIC, 2 ms": Integrator(step=0.002),
    "CENIC, 1 ms": FINE,
    "CENIC, 0.5 ms": Integrator(step=0.0005),
    "CENIC, accuracy 1e-3": Integrator(step=FRAME_TIME, accuracy=1e-3),
    "CENIC, accuracy 1e-4": Integrator(step=FRAME_TIME, accuracy=1e-4),
    "CENIC, accuracy 1e-5": Integrator(step=FRAME_TIME, accuracy=1e-5),
    "discrete, 1 ms": Integrator(step=0.001, discrete=True),
    "discrete, 0.5 ms": Integrator(step=0.0005, discrete=True),
}
"""Fixed steps, error control, and Drake's discrete plant with its lagged solver."""

SLIDING = {
    Sole.AREA: {
        "as it is": Contact(),
        "dissipation / 4": Contact(dissipation=Contact().dissipation / 4.0),
        "modulus / 4": Contact(modulus=Contact().modulus / 4.0),
    },
    Sole.POINTS: {
        "as it is": Contact(),
        "dissipation / 4": Contact(dissipation=Contact().dissipation / 4.0),
        "stiffness x 4": Contact(stiffness=4.0 * Contact().stiffness),
    },
}
"""What could make a sole slide further, by sole."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Walks of all candidates."""

    walks: list[Walk]
    seconds: float
    """Median computing time of those that end on their feet [s]."""


def walk_all(candidates: Sequence[Candidate], settings: WalkSettings) -> Batch:
    """Walk candidates, each in a robot that was built and settled before the clock starts."""
    walks, times = [], []
    for candidate in candidates:
        prepare(candidate.gait.commands_from(settings.start), candidate.foot, settings)
        begin = time.thread_time()
        walks.append(simulate(candidate, settings))
        if walks[-1].survived:
            times.append(time.thread_time() - begin)
    return Batch(walks=walks, seconds=float(np.median(times)) if times else np.nan)


def difference(walks: Sequence[Walk], others: Sequence[Walk]) -> str:
    """Return by how much walks of the same gaits differ, in one line."""
    pairs = list(zip(walks, others, strict=True))
    alike = np.mean([one.survived == other.survived for one, other in pairs])
    moved = [
        (
            1e3 * abs(other.forward - one.forward),
            1e3 * abs(other.lateral - one.lateral),
            np.degrees(abs(other.yaw - one.yaw)),
        )
        for one, other in pairs
        if one.survived and other.survived
    ]
    if not moved:
        return f"none survives both; {alike:.0%} end alike"
    low, high = np.percentile(moved, [50, 90], axis=0)
    return (
        f"Z {low[0]:.1f}  X {low[1]:.1f}  R {low[2]:.2f}   90 %: {high[0]:.0f}  {high[1]:.0f}  "
        f"{high[2]:.1f}   {alike:.0%} of {len(pairs)} end alike"
    )


def halving(candidates: Sequence[Candidate], base: WalkSettings, soles: Sequence[Sole]) -> None:
    """Print what half the step, finer faces and half the compliance change."""
    on_sole = {}
    for sole in soles:
        walk = replace(base, sole=sole)
        found = walk_all(candidates, walk)
        on_sole[sole] = found.walks
        alive = sum(one.survived for one in found.walks)
        print(
            f"{sole}: {alive} of {len(found.walks)} survive, "
            f"{found.seconds:.3f} CPU s a completed walk"
        )
        finer = replace(walk, integrator=Integrator(step=walk.stepping.step / 2.0))
        halved = walk_all(candidates, finer).walks
        print(f"  {'step':<12}{difference(found.walks, halved)}", flush=True)
        for name, contact in OTHERS[sole].items():
            other = walk_all(candidates, replace(walk, contact=contact)).walks
            print(f"  {name:<12}{difference(found.walks, other)}", flush=True)
    if {Sole.AREA, Sole.POINTS} <= set(soles):
        print(f"area, points  {difference(on_sole[Sole.AREA], on_sole[Sole.POINTS])}")


def integrators(
    candidates: Sequence[Candidate],
    base: WalkSettings,
    soles: Sequence[Sole],
    settings: StudySettings,
) -> None:
    """Print how walks of each integrator differ from those in steps of 1 ms."""
    for sole in soles:
        walk = replace(base, sole=sole)
        fine = walk_all(candidates, replace(walk, integrator=FINE))
        for name, integrator in INTEGRATORS.items():
            same = integrator == FINE
            found = fine if same else walk_all(candidates, replace(walk, integrator=integrator))
            alive = sum(one.survived for one in found.walks)
            good = sum(assess(one, settings.constraints).feasible for one in found.walks)
            print(
                f"{sole}  {name:<22}{alive} survive  {good} feasible  {found.seconds:.3f} s  "
                f"{'' if same else difference(fine.walks, found.walks)}",
                flush=True,
            )


def slip(candidates: Sequence[Candidate], base: WalkSettings, soles: Sequence[Sole]) -> None:
    """Print how far both soles slide, over gaits that survive everything that is compared."""
    rows = {}
    for sole in soles:
        for name, contact in SLIDING.get(sole, {}).items():
            walk = replace(base, sole=sole, contact=contact, integrator=FINE)
            rows[f"{sole}, {name}"] = walk_all(candidates, walk).walks
    alive = np.all([[walk.survived for walk in walks] for walks in rows.values()], axis=0)
    print(f"{alive.sum()} of {len(candidates)} gaits survive all")
    for name, walks in rows.items():
        numbers = [
            (
                1e3 * walk.forward,
                1e3 * sum(walk.measures.slip),
                50.0 * sum(walk.measures.duty_factor),
            )
            for walk, counts in zip(walks, alive, strict=True)
            if counts and walk.measures is not None
        ]
        if numbers:
            forward, slid, duty = np.median(numbers, axis=0)
            print(
                f"{name:<28}Z {forward:.0f} mm  slip {slid:.0f} mm  duty {duty:.0f} %", flush=True
            )


def furthest(runs: Sequence[Path], count: int) -> tuple[StudySettings, list[Candidate]]:
    """The settings of the first of some studies, and the best feasible gaits, as many of each."""
    settings, chosen = [], []
    for run in runs:
        with Study.open(run) as study:
            described, walks = study_settings(study.description()["settings"]), study.walks()
        settings.append(described)
        found = feasible_walks(walks, described.constraints, described.search.objective)
        chosen += [walk.candidate for walk in found[: count // len(runs)]]
    return settings[0], chosen


def main() -> None:
    """Walk and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", nargs="?", type=Path, default=default_study())
    parser.add_argument("--table", choices=["halving", "integrators", "slip"], default="halving")
    parser.add_argument("--walks", type=int, default=40)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--step", type=float, default=4.0, help="step of the search [ms]")
    parser.add_argument("--start", type=Start, choices=list(Start), help="instead of the study's")
    parser.add_argument("--soles", type=Sole, nargs="+", choices=list(Sole), default=list(Sole))
    parser.add_argument("--runs", type=Path, nargs="+", metavar="RUN", help="gaits of studies")
    parser.add_argument("--furthest", action="store_true", help="of --runs: not drawn, the best")
    options = parser.parse_args()
    if options.runs and options.furthest:
        settings, candidates = furthest(options.runs, options.walks)
    elif options.runs:
        settings, candidates = walks_of_studies(options.runs, options.walks, options.seed)
    else:
        settings, candidates = walks_of_box(options.study, options.walks, options.seed)
    begin = options.start or settings.walk.start
    base = replace(settings.walk, step=1e-3 * options.step, start=begin)
    match options.table:
        case "halving":
            halving(candidates, base, options.soles)
        case "integrators":
            integrators(candidates, base, options.soles, settings)
        case _:
            slip(candidates, base, options.soles)


if __name__ == "__main__":
    main()
