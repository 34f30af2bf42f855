"""Compare the measures of walks with those that Drake says: `python tools/bench_measures.py`.

Four tables:

    bands     each measure from the log of a walk's steps against the exact one, which asks Drake
              for contacts and torques at every step: differences over the gaits of a study's box
              and the winners of studies
    cost      processor time of measuring, of logging for it, and of the walk that is measured
    winners   both of the winners of studies
    definitions   slip of the winners, and other ways to count it

docs/experiments/ holds the tables that this printed.
"""

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from bench_walk import walks_of_box

from drake_gait.gait import FRAME_TIME, FRAMES, FloatArray
from drake_gait.problem import Candidate
from drake_gait.robot.robot_file import default_robot
from drake_gait.simulation import simulate as simulation
from drake_gait.sole import Sole
from drake_gait.study.finalists import winner
from drake_gait.study.reading import default_study
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Measures, WalkSettings

UNITS = {
    "energy": ("J", 1.0),
    "positive_energy": ("J", 1.0),
    "cost_of_transport": ("", 1.0),
    "peak_torque": ("N·m", 1.0),
    "peak_speed": ("rad/s", 1.0),
    "driving_torque": ("N·m", 1.0),
    "braking_torque": ("N·m", 1.0),
    "driving_speed": ("rad/s", 1.0),
    "braking_speed": ("rad/s", 1.0),
    "line_share": ("%", 100.0),
    "saturated_fraction": ("%", 100.0),
    "slip": ("mm", 1e3),
    "clearance": ("mm", 1e3),
    "duty_factor": ("%", 100.0),
    "peak_ground_reaction": ("weights", 1.0),
    "toe_range": ("degrees", np.degrees(1.0)),
    "torso_tilt": ("degrees", np.degrees(1.0)),
}


def numbers(measures: Measures, name: str) -> FloatArray:
    """One measure, in the unit of its row, shape (1,), or more for feet and toes."""
    return np.atleast_1d(getattr(measures, name)) * UNITS[name][1]


def winners_of(runs: Sequence[Path]) -> dict[str, tuple[Candidate, WalkSettings]]:
    """The winner of each study, on its usual ground."""
    found = {}
    for run in runs:
        with Study.open(run) as study:
            settings = study_settings(study.description()["settings"])
            best = winner(settings, study.walks())
        if best is not None:
            found[str(run)] = best.walk.candidate, settings.walk
    return found


def bands(walks: Sequence[tuple[Candidate, WalkSettings]]) -> None:
    """Print how far measures from the log are from the exact ones."""
    pairs = []
    for candidate, settings in walks:
        walk, exact = simulation.measured_at_every_step(candidate, settings)
        if walk.measures is not None:
            pairs.append((walk.measures, exact))
    print(f"\n{len(pairs)} walks; differences from the exact measures\n")
    print("| measure | unit | median of the exact | median difference | 95 % below | largest |")
    print("|---|---|---|---|---|---|")
    for field in fields(Measures):
        ours, exact = (
            np.concatenate([numbers(pair[which], field.name) for pair in pairs]) for which in (0, 1)
        )
        known = np.isfinite(ours) & np.isfinite(exact)
        difference = np.abs(ours - exact)[known]
        print(
            f"| {field.name} | {UNITS[field.name][0]} | {np.median(exact[known]):.3g} | "
            f"{np.median(difference):.2g} | {np.percentile(difference, 95):.2g} | "
            f"{difference.max():.2g} |",
            flush=True,
        )


def cost(candidates: Sequence[Candidate], settings: WalkSettings) -> None:
    """Print what measuring takes of a walk: both parts take turns on the same walks."""
    shares, logging, times = [], [], []
    measuring = simulation._measures
    spent = 0.0

    def timed(*arguments: object, **named: object) -> Measures:
        nonlocal spent
        start = time.thread_time()
        measures = measuring(*arguments, **named)  # type: ignore[arg-type]
        spent += time.thread_time() - start
        return measures

    simulation._measures = timed
    for number, candidate in enumerate([candidates[0], *candidates]):
        spent, start = 0.0, time.thread_time()
        simulation.simulate(candidate, settings)
        total = time.thread_time() - start
        bare = {}
        for logged in (False, True) if number % 2 else (True, False):
            robot, context = simulation.prepare(
                candidate.gait.commands_from(settings.start),
                candidate.foot,
                settings,
                logged=logged,
            )
            start = time.thread_time()
            simulator = simulation.start(robot.diagram, context, settings.stepping)
            simulator.AdvanceTo(FRAMES * FRAME_TIME, interruptible=False)
            bare[logged] = time.thread_time() - start
        if number:  # The first one builds the robot.
            shares.append(spent / (total - spent))
            logging.append(bare[True] / bare[False] - 1.0)
            times.append(total)
    simulation._measures = measuring
    print(f"\n{len(times)} walks of {1e3 * np.median(times):.0f} ms\n")
    print("| part | median % of a walk | quartiles |\n|---|---|---|")
    for name, part in (("measures from the log", shares), ("logging, frames included", logging)):
        low, middle, high = 100.0 * np.percentile(part, [25, 50, 75])
        print(f"| {name} | {middle:.1f} | {low:.1f} to {high:.1f} |", flush=True)


def winners(found: dict[str, tuple[Candidate, WalkSettings]]) -> None:
    """Print the manner of winners, from the log and exactly."""
    print(
        "\n| winner | from | forward mm | slip mm | % of the distance | clearance mm | "
        "peak torque N·m | peak speed rad/s | tilt degrees | duty % |\n"
        "|---|---|---|---|---|---|---|---|---|---|"
    )
    for name, (candidate, settings) in found.items():
        walk, exact = simulation.measured_at_every_step(candidate, settings)
        for source, measures in (("log", walk.measures), ("exact", exact)):
            if measures is None:
                continue
            cells = [
                ", ".join(f"{value:.{digits}f}" for value in numbers(measures, key))
                for key, digits in (
                    ("slip", 1),
                    ("clearance", 2),
                    ("peak_torque", 3),
                    ("peak_speed", 2),
                    ("torso_tilt", 1),
                    ("duty_factor", 0),
                )
            ]
            share = 100.0 * max(measures.slip) / walk.forward
            print(
                f"| {name} | {source} | {1e3 * walk.forward:.0f} | {cells[0]} | {share:.1f} | "
                f"{' | '.join(cells[1:])} |",
                flush=True,
            )


def definitions(found: dict[str, tuple[Candidate, WalkSettings]]) -> None:
    """Print slip by its definition, and as other definitions count it."""
    print(
        "\n| winner | foot | at the centre of load mm | at the middle of the heel mm | "
        "mean of the touching corners mm | turning of the loaded foot degrees |\n"
        "|---|---|---|---|---|---|"
    )
    for name, (candidate, settings) in found.items():
        commands = candidate.gait.commands_from(settings.start)
        robot, context = simulation.prepare(commands, candidate.foot, settings)
        search = (
            simulation._LINE_SEARCH_ON_BOXES
            if settings.sole is Sole.BOXES
            else simulation._LINE_SEARCH_TOLERANCE
        )
        simulator = simulation.start(robot.diagram, context, settings.stepping, search)
        for frame in range(1, FRAMES + 1):
            simulator.AdvanceTo(frame * FRAME_TIME)
        assert robot.steps is not None
        log = robot.steps.FindLog(context)
        seen, states = log.sample_times(), log.data()
        record, motions = robot.meter.record(seen, states, commands), robot.meter.motions(states)
        for foot, side in enumerate(("right", "left")):
            rows = slice(3 * foot, 3 * foot + 3)
            loads, sliding = record.loads[rows], record.sliding[rows]
            plate, instants = loads.argmax(axis=0), np.arange(len(seen))
            loaded = loads[plate, instants] > default_robot().load
            centre = np.where(loaded, sliding[plate, instants], 0.0)
            middle, corners, turning = np.zeros((3, len(seen)))
            for number, link in enumerate(default_robot().plates[rows]):
                of_it = loaded & (plate == number)
                motion, tread = motions[link]
                points = tread.corners
                speeds = np.array(
                    [np.hypot(*motion.velocity_at(point[:, None])[:2]) for point in points]
                )
                touches = motion.heights(points) < tread.radius
                mean = (speeds * touches).sum(axis=0) / np.maximum(touches.sum(axis=0), 1)
                corners[of_it] = mean[of_it]
                place = points.mean(axis=0)[:, None]
                middle[of_it] = np.hypot(*motion.velocity_at(place)[:2])[of_it]
                turning[of_it] = np.abs(motion.turning[2])[of_it]
            cells = [
                f"{factor * np.trapezoid(speed, seen):.{digits}f}"
                for speed, factor, digits in (
                    (centre, 1e3, 1),
                    (middle, 1e3, 1),
                    (corners, 1e3, 1),
                    (turning, np.degrees(1.0), 0),
                )
            ]
            print(f"| {name} | {side} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tables", nargs="*", default=["bands", "cost", "winners", "definitions"])
    parser.add_argument("--study", type=Path, default=default_study())
    parser.add_argument("--walks", type=int, default=60)
    parser.add_argument("--runs", type=Path, nargs="*", default=[], metavar="RUN")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    settings, candidates = walks_of_box(options.study, options.walks, options.seed)
    found = winners_of(options.runs)
    if "bands" in options.tables:
        box = [(candidate, settings.walk) for candidate in candidates]
        bands([*box, *found.values()])
    if "cost" in options.tables:
        upright = [one for one in candidates if simulation.simulate(one, settings.walk).survived]
        cost(upright[:30], settings.walk)
    if "winners" in options.tables:
        winners(found)
    if "definitions" in options.tables:
        definitions(found)


if __name__ == "__main__":
    main()
