"""Count how many gaits of a study's box survive and are feasible: `python tools/check_box.py`.

A box for a search should let at least 60 % of a Latin hypercube of 200 survive and at least 10 % be
feasible. The walks are those that a search of this study would begin with, on its two grounds. Each
limit has a line of its own, and further figures say how the survivors walk.
"""

import argparse
from pathlib import Path

import numpy as np
from bench_walk import walks_of_box

from drake_gait.execution.local import LocalProcesses
from drake_gait.execution.machine import cores
from drake_gait.problem import Trial
from drake_gait.search.grounds import end_of_proposal, on_ground
from drake_gait.simulation.simulate import walk_trial
from drake_gait.study.reading import default_study


def main() -> None:
    """Walk the design of experiments and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("study", nargs="?", type=Path, default=default_study())
    parser.add_argument("--walks", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=cores())
    options = parser.parse_args()
    settings, candidates = walks_of_box(options.study, options.walks, options.seed)
    trials = [
        Trial(
            candidate=candidate,
            settings=on_ground(settings.walk, settings, end_of_proposal(settings, 0, number)),
        )
        for number, candidate in enumerate(candidates)
    ]
    with LocalProcesses(walk_trial, count=options.workers) as workers:
        walks = [finished.walk for finished in workers.run(trials)]
    survivors = [walk for walk in walks if walk.survived]
    found = [settings.assess(walk) for walk in survivors]
    print(f"survive   {len(survivors) / len(walks):6.1%} of {len(walks)}")
    print(f"feasible  {sum(one.feasible for one in found) / len(walks):6.1%}")
    print("within each limit, of the survivors")
    held = np.array([one.violations == 0.0 for one in found]).mean(axis=0)
    for name, share in zip(settings.constraints.names, held, strict=True):
        print(f"  {name:<24} {share:8.1%}")
    columns = {
        "forward [mm]": [1e3 * walk.forward for walk in survivors],
        "lateral [mm]": [1e3 * walk.lateral for walk in survivors],
        "yaw [deg]": [np.degrees(walk.yaw) for walk in survivors],
        "slip, worse foot [mm]": [1e3 * max(walk.measures.slip) for walk in survivors],
        "clearance, worse [mm]": [1e3 * min(walk.measures.clearance) for walk in survivors],
        "duty factor": [np.mean(walk.measures.duty_factor) for walk in survivors],
        "yaw swing [deg]": [np.degrees(walk.yaw_swing) for walk in survivors],
        "peak torque [N·m]": [walk.measures.peak_torque for walk in survivors],
    }
    print("survivors: median (10th to 90th percentile)")
    for name, values in columns.items():
        low, middle, high = np.percentile(values, [10, 50, 90])
        print(f"  {name:<24} {middle:8.2f} ({low:.2f} to {high:.2f})")


if __name__ == "__main__":
    main()
