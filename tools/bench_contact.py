"""Walk the same gaits on every sole, then on half the step, finer faces and half the compliance.

Each line says by how much walks that survive both move: the median and the 90th percentile of the
distance, the drift [mm] and the turn [deg], and how many end alike. Gaits are a Latin hypercube of
a study's box, with the start of that study.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_walk import walks_of_box

from drake_gait.gait import Start
from drake_gait.problem import Candidate
from drake_gait.simulation.simulate import prepare, simulate
from drake_gait.sole import Contact, Sole
from drake_gait.study.reading import default_study
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


def walk_all(candidates: Sequence[Candidate], settings: WalkSettings) -> tuple[list[Walk], float]:
    """Walk candidates; returns also the median computing time of those that end on their feet."""
    walks, times = [], []
    for candidate in candidates:
        prepare(candidate.gait.commands, candidate.foot, settings)  # Builds and settles.
        begin = time.thread_time()
        walks.append(simulate(candidate, settings))
        if walks[-1].survived:
            times.append(time.thread_time() - begin)
    return walks, float(np.median(times)) if times else np.nan


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


def main() -> None:
    """Walk and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("study", nargs="?", type=Path, default=default_study())
    parser.add_argument("--walks", type=int, default=40)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--step", type=float, default=4.0, help="step of the search [ms]")
    parser.add_argument("--start", type=Start, choices=list(Start), help="instead of the study's")
    options = parser.parse_args()
    settings, candidates = walks_of_box(options.study, options.walks, options.seed)
    begin = options.start or settings.walk.start
    on_sole, base = {}, replace(settings.walk, step=1e-3 * options.step, start=begin)
    for sole, others in OTHERS.items():
        walk = replace(base, sole=sole)
        walks, seconds = walk_all(candidates, walk)
        on_sole[sole] = walks
        alive = sum(one.survived for one in walks)
        print(f"{sole}: {alive} of {len(walks)} survive, {seconds:.3f} CPU s a completed walk")
        finer = replace(walk, integrator=Integrator(step=walk.stepping.step / 2.0))
        print(f"  {'step':<12}{difference(walks, walk_all(candidates, finer)[0])}", flush=True)
        for name, contact in others.items():
            other = walk_all(candidates, replace(walk, contact=contact))[0]
            print(f"  {name:<12}{difference(walks, other)}", flush=True)
    print(f"area, points  {difference(on_sole[Sole.AREA], on_sole[Sole.POINTS])}")


if __name__ == "__main__":
    main()
