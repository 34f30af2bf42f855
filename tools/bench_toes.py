"""What a new foot costs a walk, and what it changes that every foot starts from the same pose.

    python tools/bench_toes.py [--feet 24]

Times are CPU time of this process. Feet are random within their limits, gaits within half of the
paper's box.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from drake_gait import Candidate, FootDesign, Gait, simulate
from drake_gait.execution.worker_process import resident_memory
from drake_gait.foot import DESIGN_LIMITS
from drake_gait.gait import FloatArray
from drake_gait.simulation import simulate as simulation
from drake_gait.simulation.plant import add_robot, build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.study.reading import default_study, read_study
from drake_gait.walk import Walk, WalkSettings

NOISE = np.radians(0.05)


def cpu_ms(function: Callable[[], object], repetitions: int = 10) -> float:
    """CPU time of one call [ms], the first one left out."""
    function()
    started = time.process_time()
    for _ in range(repetitions):
        function()
    return 1e3 * (time.process_time() - started) / repetitions


def settled(foot: FootDesign) -> FloatArray:
    """Positions after standing on this very foot for a second."""
    robot = build_robot(PlantConfig(foot=foot))
    context = robot.diagram.CreateDefaultContext()
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    simulation.start(robot.diagram, context, WalkSettings().stepping).AdvanceTo(1.0)
    positions: FloatArray = robot.plant.GetPositions(plant_context)
    return positions


def walk_from(candidate: Candidate, positions: FloatArray) -> Walk:
    """Walk a candidate from given positions."""
    settings = WalkSettings()
    robot, context = simulation.prepare(
        candidate.gait.commands_from(settings.start), candidate.foot, settings
    )
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.plant.SetPositions(plant_context, positions)
    return simulation._advance(robot, context, settings)


def differences(pairs: list[tuple[Walk, Walk]]) -> str:
    """Median and 90th percentile of |ΔZ|, |ΔX| [mm] and |Δyaw| [degrees] where both survived."""
    both = [(one, two) for one, two in pairs if one.survived and two.survived]
    apart = np.abs([
        [1e3 * (one.forward - two.forward), 1e3 * (one.lateral - two.lateral),
         np.degrees(one.yaw - two.yaw)]
        for one, two in both
    ])  # fmt: skip
    other = sum(one.survived != two.survived for one, two in pairs)
    median, most = np.median(apart, axis=0), np.percentile(apart, 90, axis=0)
    cells = [f"{low:.2f} ({high:.2f})" for low, high in zip(median, most, strict=True)]
    return f"Z {cells[0]} mm, X {cells[1]} mm, yaw {cells[2]} degrees; {other} ended otherwise"


def main() -> None:
    """Print what the page of the toes says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--feet", type=int, default=24, help="random feet (24)")
    feet = parser.parse_args().feet
    space = read_study(default_study()).space
    middle = space.decode(np.zeros(space.dimension))
    simulate(middle)
    print(f"a walk: {cpu_ms(lambda: simulate(middle), 3):.0f} ms")
    with_looks = cpu_ms(lambda: add_robot(DiagramBuilder(), PlantConfig()))
    print(f"a robot as the file has it: {with_looks:.0f} ms")
    before = resident_memory()
    bare = cpu_ms(lambda: build_robot(PlantConfig()), 50)
    print(f"a robot for walks: {bare:.0f} ms, {(resident_memory() - before) / 51e6:.2f} MB kept")
    print(f"and to settle on it: {cpu_ms(lambda: settled(FootDesign())) - bare:.0f} ms")
    opened = replace(
        space, foot_ranges=tuple((name, *ends) for name, ends in DESIGN_LIMITS.items())
    )
    rng = np.random.default_rng(1)
    starts, noises = [], []
    for _ in range(feet):
        x = rng.uniform(-1.0, 1.0, opened.dimension)
        x[:16] /= 2.0
        candidate = opened.decode(x)
        usual = simulate(candidate)
        starts.append((walk_from(candidate, settled(candidate.foot)), usual))
        noise = rng.uniform(-NOISE, NOISE, (4, 4))
        gait = Gait(coefficients=candidate.gait.coefficients + noise)
        noises.append((simulate(replace(candidate, gait=gait)), usual))
    print(f"settled on its own foot: {differences(starts)}")
    print(f"0.05 degrees of noise:   {differences(noises)}")


if __name__ == "__main__":
    main()
