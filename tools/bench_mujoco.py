"""Walk the same gaits in Drake and in MuJoCo: `python tools/bench_mujoco.py [RUN...]`.

Both engines have the same robot (drake_gait/simulation/mujoco). Gaits are a Latin hypercube of the
study's box, and the finalists of the studies RUN. Tables, for each sole:

    agreement   MuJoCo, and Drake's search, against Drake's reference
    causes      with --causes: what changes a walk as much as another engine does

A row has the survivors in common, and of them correlation and median difference of distance Z,
drift X and turn R, the mean of what is added to X and R, and how often the sign of X is the same.
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from bench_walk import Batch, walks_of_box

from drake_gait.gait import FloatArray
from drake_gait.problem import Candidate
from drake_gait.simulation.mujoco import engine
from drake_gait.simulation.mujoco.model import Hardness
from drake_gait.simulation.simulate import simulate
from drake_gait.sole import Contact, Sole
from drake_gait.study.finalists import Tier, finalists
from drake_gait.study.reading import default_study
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Engine, Fidelity, Integrator, Walk, WalkSettings

Walker = Callable[[Candidate], Walk]

HEADINGS = (
    "walks",
    "CPU s",
    "survive",
    "same",
    "Z r (mm)",
    "X r (mm)",
    "R r (deg)",
    "X mm",
    "R deg",
    "same side",
)


def finalists_of(runs: Sequence[Path]) -> list[Candidate]:
    """The finalists of some studies that have held in at least one test."""
    found: list[Candidate] = []
    for run in runs:
        with Study.open(run / "study.db") as study:
            settings, walks = study_settings(study.description()["settings"]), study.walks()
        found += [
            one.walk.candidate for one in finalists(settings, walks) if one.tier >= Tier.REPEATS
        ]
    return found


def in_mujoco(candidate: Candidate, settings: WalkSettings, hardness: Hardness) -> Walk:
    """Walk a candidate in MuJoCo on contacts of another hardness."""
    commands = candidate.gait.commands_from(settings.start)
    return engine.follow(commands, candidate.foot, settings, hardness=hardness)


def agreement(walk: WalkSettings) -> dict[str, Walker]:
    """Drake's reference, and what is compared with it."""
    mujoco = replace(walk, engine=Engine.MUJOCO)
    return {
        "Drake, 1 ms (reference)": partial(simulate, settings=_reference(walk)),
        f"Drake, {1e3 * walk.step:g} ms (search)": partial(simulate, settings=walk),
        f"MuJoCo, {1e3 * mujoco.stepping.step:g} ms": partial(simulate, settings=mujoco),
    }


def causes(walk: WalkSettings) -> dict[str, Walker]:
    """Drake's reference, and what may change a walk as another engine does."""
    drake, mujoco = _reference(walk), replace(walk, engine=Engine.MUJOCO)
    contact = walk.contact or Contact()
    harder = replace(contact, stiffness=16.0 * contact.stiffness, modulus=16.0 * contact.modulus)
    fine = replace(walk, integrator=Integrator(step=0.0005))
    found: dict[str, Walker] = {
        "Drake, 1 ms (reference)": partial(simulate, settings=drake),
        "Drake, 0.5 ms": partial(simulate, settings=fine),
        "Drake, ground 16 times as hard": partial(
            simulate, settings=replace(drake, contact=harder)
        ),
        "Drake, friction + 5 %": partial(simulate, settings=replace(drake, friction=1.05)),
        "MuJoCo, 1 ms": partial(simulate, settings=mujoco),
        "MuJoCo, 0.5 ms": partial(simulate, settings=replace(mujoco, step=0.0005)),
        "MuJoCo, friction + 5 %": partial(simulate, settings=replace(mujoco, friction=1.05)),
    }
    for name, hardness in {
        "contact of 2 ms": Hardness(time=0.002),
        "contact of 10 ms": Hardness(time=0.010),
        "as soft sideways as across": Hardness(sideways=1.0),
        "100 times as hard sideways": Hardness(sideways=100.0),
        "friction as a pyramid": Hardness(pyramid=True),
    }.items():
        found[f"MuJoCo, {name}"] = partial(in_mujoco, settings=mujoco, hardness=hardness)
    return found


def _reference(walk: WalkSettings) -> WalkSettings:
    return replace(walk, fidelity=Fidelity.REFERENCE)


def alternate(engines: dict[str, Walker], candidates: Sequence[Candidate]) -> dict[str, Batch]:
    """Every candidate in each engine in turn, so that a noisy machine disturbs all alike."""
    walks: dict[str, list[Walk]] = {name: [] for name in engines}
    cpu: dict[str, list[float]] = {name: [] for name in engines}
    for candidate in candidates:
        for name, walk in engines.items():
            start = time.process_time()
            walks[name].append(walk(candidate))
            cpu[name].append(time.process_time() - start)
    # What takes turns has no wall-clock time of its own.
    return {name: Batch(walks[name], np.array(cpu[name]), elapsed=np.nan) for name in engines}


def row(name: str, batch: Batch, first: Batch) -> str:
    """One engine's row, compared with the first engine's walks."""
    both = batch.survived & first.survived
    mine, own = batch.numbers[both], first.numbers[both]
    cells = [
        f"{len(both)}",
        f"{median(batch.cpu[batch.survived]):.2f}",
        f"{100.0 * batch.survived.mean():.0f} %",
        f"{100.0 * (batch.survived == first.survived).mean():.0f} %",
    ]
    for a, b in zip(mine.T, own.T, strict=True):
        r = np.corrcoef(a, b)[0, 1] if len(a) > 2 else np.nan
        cells.append(f"{r:.2f} ({median(np.abs(a - b)):.1f})")
    added = (mine - own).mean(axis=0) if both.any() else np.full(3, np.nan)
    same = np.sign(mine[:, 1]) == np.sign(own[:, 1])
    cells += [f"{added[1]:+.1f}", f"{added[2]:+.1f}", f"{same.sum()} of {len(same)}"]
    return f"| {name} | {' | '.join(cells)} |"


def median(values: FloatArray) -> float:
    """The median; not a number if there are no values."""
    return float(np.median(values)) if len(values) else np.nan


def print_table(title: str, batches: dict[str, Batch]) -> None:
    """Print one row an engine."""
    print(f"\n{title}\n\n| engine | {' | '.join(HEADINGS)} |\n|{'---|' * (len(HEADINGS) + 1)}")
    first = next(iter(batches.values()))
    for name, batch in batches.items():
        print(row(name, batch, first), flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("runs", type=Path, nargs="*", metavar="RUN", help="studies' folders")
    parser.add_argument("--study", type=Path, default=default_study())
    parser.add_argument("--walks", type=int, default=30, help="gaits of the box")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--most", type=int, metavar="N", help="of the finalists, the first N")
    parser.add_argument(
        "--soles", nargs="+", choices=list(Sole), default=[Sole.POINTS, Sole.AREA], metavar="SOLE"
    )
    parser.add_argument("--causes", action="store_true", help="what changes a walk as much")
    options = parser.parse_args()
    gaits: dict[str, list[Candidate]] = {}
    if options.walks:
        settings, gaits["the box"] = walks_of_box(options.study, options.walks, options.seed)
    else:
        settings, _ = walks_of_box(options.study, 20, options.seed)
    if options.runs:
        gaits["finalists"] = finalists_of(options.runs)[: options.most]
    for sole in options.soles:
        walk = replace(settings.walk, sole=sole, fidelity=Fidelity.SEARCH)
        engines = causes(walk) if options.causes else agreement(walk)
        for name, candidates in gaits.items():
            print_table(f"{sole}, {name}", alternate(engines, candidates))


if __name__ == "__main__":
    main()
