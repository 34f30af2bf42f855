"""How a gait walks on real servos: `python tools/bench_servos.py [RUN]`.

Walks the centre of the default study, or the winner of a run, with one imperfection of the servos
at a time and with all of them, in Drake with steps of 4 and 1 ms, and in MuJoCo. Times are those of
this process.
"""

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drake_gait.cli._replay import choose
from drake_gait.problem import Candidate
from drake_gait.simulation.simulate import simulate
from drake_gait.study.reading import default_study, read_study
from drake_gait.walk import Engine, Fidelity, Outcome, Walk, WalkSettings

ALONE = {
    "coulomb_friction": 0.05,
    "load_friction": 0.25,
    "backlash": math.radians(0.5),
    "delay": 0.02,
    "voltage": 0.9,
}
"""What was found of comparable servos, and the paper's frame as delay."""
SERVOS = {"ideal": {}, **{name: {name: value} for name, value in ALONE.items()}, "all": ALONE}
ENGINES = ((Engine.DRAKE, 0.004), (Engine.DRAKE, 0.001), (Engine.MUJOCO, 0.001))


def cells(walk: Walk, seconds: float) -> str:
    """Return the cells of a walk."""
    if walk.outcome is not Outcome.WALKED:
        return f"{walk.outcome} after {0.02 * walk.frames:.1f} s | {seconds:.2f}"
    way = f"{1e3 * walk.forward:.0f} / {1e3 * walk.lateral:.0f} / {math.degrees(walk.yaw):.0f}"
    return f"{way} | {seconds:.2f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("run", nargs="?", type=Path, metavar="RUN", help="a study's folder")
    options = parser.parse_args(arguments)
    if options.run is None:
        gait = read_study(default_study()).space.decode(np.zeros(16)).gait
        candidate, settings = Candidate(gait=gait), WalkSettings()
    else:
        _, chosen, settings = choose(options.run, None)
        candidate = chosen.candidate
    heads = [f"{engine}, {1e3 * step:g} ms [mm / mm / degrees] | [s]" for engine, step in ENGINES]
    print(f"| servos | {' | '.join(heads)} |")
    print("|---" * (1 + 2 * len(ENGINES)) + "|")
    for name, changes in SERVOS.items():
        row = [name]
        for engine, step in ENGINES:
            servo = replace(settings.servo, **changes)
            how = replace(
                settings,
                servo=servo,
                engine=engine,
                step=step,
                fidelity=Fidelity.SEARCH,
                integrator=None,
            )
            begin = time.thread_time()
            walk = simulate(candidate, how)
            row.append(cells(walk, time.thread_time() - begin))
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
