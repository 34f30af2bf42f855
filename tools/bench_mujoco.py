"""Walk the same robot and the same gaits in Drake and in MuJoCo: `python tools/bench_mujoco.py`.

The MuJoCo model is written from the table in tools/make_models.py, as the SDF files are: links,
joints, toe springs and servos are the same to rounding. What cannot be the same:

    contact   Drake: pressure over the sole's area; MuJoCo: a force at each corner of a sole's boxes
    friction  Drake: static and kinetic; MuJoCo: one coefficient a pair, here the kinetic one
    steps     Drake: the search fidelity, wholly implicit; MuJoCo: implicit in velocities only

Every gait of a Latin hypercube of the study's box walks in each engine in turn, in one process. A
walk's processor time is without building and settling the robot, which is done before the first;
only studies that vary the foot pay for it at every walk, in all engines.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from xml.etree import ElementTree

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import make_models
import mujoco
import numpy as np
from bench_walk import Batch, compare, walks_of_box
from make_models import Mass, Shape, element, numbers

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FRAMES, JOINTS, FloatArray
from drake_gait.problem import Candidate
from drake_gait.servo import Servo
from drake_gait.simulation.plant import GROUND_FRICTION
from drake_gait.simulation.simulate import simulate
from drake_gait.study.reading import default_study
from drake_gait.walk import FALL_HEIGHT, FALL_TILT, Fidelity, Outcome, Walk, WalkSettings

STEPS = (0.001, 0.002)
"""Time steps of MuJoCo that are measured [s]."""

MASSES = {
    "khr3hv.sdf": make_models.raised_masses,
    "khr3hv_cad.sdf": make_models.cad_masses,
}
"""The link masses of each shipped robot."""

TORSO_ORIGIN = (0.01141, 0.0, 0.23490)  # m; of the torso's frame, as in the SDF files

CONTACT_TIME_CONSTANT = 0.004  # s; as stiff as MuJoCo bears at 2 ms. Drake's soles are stiffer.
SETTLING_TIME = 1.0  # s; as before a walk in Drake


# --- The model ------------------------------------------------------------------------------------


def mjcf(masses: dict[str, Mass], foot: FootDesign, servo: Servo, step: float) -> str:
    """The robot on the ground as MJCF text.

    Args:
        masses: Every link's mass, as make_models.raised_masses() gives them.
        foot: Width, springs and dampers of the toes.
        servo: Gains and torque-speed line of the ten servos.
        step: Time step [s].
    """
    root = ElementTree.Element("mujoco", model="khr3hv")
    element(root, "compiler", angle="radian")
    # Elliptic: as Drake's friction cone, and alike in all directions.
    option = element(root, "option", timestep=str(step), integrator="implicitfast", cone="elliptic")
    element(option, "flag", autoreset="disable")  # A walk that diverges must not begin anew.
    stiff = f"{CONTACT_TIME_CONSTANT} 1"
    default = element(root, "default")
    # Pairs alone decide what touches: every box the ground, and no box another.
    element(default, "geom", type="box", contype="0", conaffinity="0")
    # A box's corners are points apart, whose forces resist turning too: no torsional friction.
    element(default, "pair", condim="3", solref=stiff)
    element(default, "joint", solreflimit=stiff)
    world = element(root, "worldbody")
    element(world, "geom", name="ground", type="plane", size="0 0 1")
    contact, actuators = element(root, "contact"), element(root, "actuator")

    masses, shapes = with_toes(masses, make_models.link_shapes(), foot.big_toe_width)
    origins = {"torso": np.array(TORSO_ORIGIN)}
    bodies = {"torso": element(world, "body", name="torso", pos=numbers(origins["torso"]))}
    element(bodies["torso"], "freejoint", name="torso")
    for side, mirror in (("r", -1.0), ("l", 1.0)):
        for joint, parent, child, origin, axis, degrees in make_models.JOINTS:
            above, link = parent if parent == "torso" else f"{parent}_{side}", f"{child}_{side}"
            origins[link] = np.array(origin) * (1.0, mirror, 1.0)
            place = numbers(origins[link] - origins[above])
            bodies[link] = element(bodies[above], "body", name=link, pos=place)
            name = f"{joint}_{side}"
            hinge = element(bodies[link], "joint", name=name, axis=numbers(axis))
            if name in JOINTS:
                add_servo(actuators, hinge, servo)
            else:
                add_spring(hinge, foot, degrees)
    for link, body in bodies.items():
        add_inertia(body, masses[link], origins[link])
        add_boxes(contact, body, shapes[link], origins[link])
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def with_toes(
    masses: dict[str, Mass], shapes: dict[str, list[Shape]], big_toe_width: float
) -> tuple[dict[str, Mass], dict[str, list[Shape]]]:
    """Masses and shapes whose big toes are `big_toe_width` [m] wide (see robot.with_toes)."""
    foot = FootDesign(big_toe_width=big_toe_width)
    masses, shapes = dict(masses), dict(shapes)
    for side, inward in (("r", 1.0), ("l", -1.0)):
        for toe, width, fixed_edge in (
            ("big_toe", foot.big_toe_width, inward),
            ("lesser_toes", foot.lesser_toes_width, -inward),
        ):
            link = f"{toe}_{side}"
            (box,) = shapes[link]
            (x0, y0, z0), (x1, y1, z1) = box.lower, box.upper
            lower, upper = (y1 - width, y1) if fixed_edge > 0.0 else (y0, y0 + width)
            box = replace(box, lower=(x0, lower, z0), upper=(x1, upper, z1))
            mass = masses[link].mass * width / (y1 - y0)
            shapes[link] = [box]
            masses[link] = make_models.plate(mass, box.lower, box.upper)
    return masses, shapes


def add_servo(actuators: ElementTree.Element, hinge: ElementTree.Element, servo: Servo) -> None:
    """Make a hinge a servo's: the two terms of Servo's formula are an actuator and a damper."""
    stall = make_models.STALL_TORQUE
    hinge.set("armature", str(make_models.REFLECTED_ROTOR_INERTIA))
    hinge.set("damping", str(stall / servo.no_load_speed))  # back-EMF
    element(actuators, "position", joint=hinge.get("name", ""), kp=str(servo.stiffness),
            kv=str(servo.damping), forcerange=f"{-stall} {stall}")  # fmt: skip


def add_spring(hinge: ElementTree.Element, foot: FootDesign, degrees: Sequence[float]) -> None:
    """Make a hinge a toe's: spring, damper, and stops at an angle [deg] each."""
    big = hinge.get("name", "").startswith("big")
    hinge.set("stiffness", str(foot.big_toe_stiffness if big else foot.lesser_toes_stiffness))
    hinge.set("damping", str(foot.toe_damping))
    hinge.set("range", numbers(np.radians(degrees)))


def add_inertia(body: ElementTree.Element, mass: Mass, origin: np.ndarray) -> None:
    """Give a body its mass, in a frame that stands upright at `origin`."""
    upper_triangle = mass.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    element(body, "inertial", pos=numbers(mass.com - origin), mass=str(float(mass.mass)),
            fullinertia=numbers(upper_triangle))  # fmt: skip


def add_boxes(
    contact: ElementTree.Element,
    body: ElementTree.Element,
    shapes: Iterable[Shape],
    origin: np.ndarray,
) -> None:
    """Give a body what it touches the ground with, at the friction that Drake would combine."""
    for shape in shapes:
        if shape.touch is None:
            continue
        name, (_, kinetic) = f"{body.get('name')}_{shape.name}", shape.touch
        centre = np.add(shape.lower, shape.upper) / 2.0 - origin
        half_size = np.subtract(shape.upper, shape.lower) / 2.0
        element(body, "geom", name=name, pos=numbers(centre), size=numbers(half_size))
        pair = 2.0 * kinetic * GROUND_FRICTION / (kinetic + GROUND_FRICTION)
        element(contact, "pair", geom1="ground", geom2=name, friction=numbers([pair, pair]))


# --- The walk -------------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def settled_robot(
    model: str, foot: FootDesign, servo: Servo, step: float
) -> tuple[mujoco.MjModel, FloatArray]:
    """The compiled robot, and its positions when it has come to rest on its soles."""
    compiled = mujoco.MjModel.from_xml_string(mjcf(MASSES[model](), foot, servo, step))
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data, nstep=round(SETTLING_TIME / step))
    return compiled, data.qpos.copy()


def step_commands(commands: FloatArray, step: float) -> FloatArray:
    """What the servos follow in each time step [rad], shape (steps, 10).

    Linear between the frames of `commands`, shape (n, 10), as gait_system.desired_state.
    """
    ends = np.arange(len(commands)) * FRAME_TIME
    starts = np.arange(round(ends[-1] / step)) * step
    return np.column_stack([np.interp(starts, ends, column) for column in commands.T])


def walk_in_mujoco(candidate: Candidate, settings: WalkSettings, step: float) -> Walk:
    """Walk a candidate from a standing start in steps of `step` [s], as simulation.simulate."""
    model, standing = settled_robot(str(settings.model), candidate.foot, settings.servo, step)
    data = mujoco.MjData(model)
    data.qpos[:] = standing
    torso = data.body("torso")

    def posture() -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rotation R_WT, origin p_WT [m] and centre of mass p_WC [m] in the present state."""
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return torso.xmat.reshape(3, 3).copy(), torso.xpos.copy(), torso.subtree_com.copy()

    R_WT, p_WT, com_start = posture()
    fall_height = FALL_HEIGHT * p_WT[2]
    headings = [np.arctan2(R_WT[1, 0], R_WT[0, 0])]
    frames = step_commands(candidate.gait.commands_from(settings.start), step).reshape(
        FRAMES, -1, len(JOINTS)
    )
    outcome, completed = Outcome.WALKED, FRAMES
    for frame, commands in enumerate(frames):
        for command in commands:
            data.ctrl = command
            mujoco.mj_step(model, data)
        R_WT, p_WT, com_end = posture()
        headings.append(np.arctan2(R_WT[1, 0], R_WT[0, 0]))
        if not (R_WT[2, 2] > np.cos(FALL_TILT) and p_WT[2] > fall_height):
            outcome, completed = Outcome.FELL, frame
            break
    return Walk(
        outcome=outcome,
        frames=completed,
        forward=float(com_end[0] - com_start[0]),
        lateral=float(com_end[1] - com_start[1]),
        yaw=float(np.unwrap(headings)[-1] - headings[0]),
        com_height=float(com_end[2]),
    )


# --- The comparison -------------------------------------------------------------------------------


def alternate(
    engines: dict[str, Callable[[Candidate], Walk]], candidates: Sequence[Candidate]
) -> dict[str, Batch]:
    """Every candidate in each engine in turn, so that a noisy machine disturbs all alike."""
    walks: dict[str, list[Walk]] = {name: [] for name in engines}
    cpu: dict[str, list[float]] = {name: [] for name in engines}
    for candidate in candidates:
        for name, walk in engines.items():
            start = time.process_time()
            walks[name].append(walk(candidate))
            cpu[name].append(time.process_time() - start)
    # Who takes turns has no wall-clock time of his own.
    return {name: Batch(walks[name], np.array(cpu[name]), elapsed=np.nan) for name in engines}


def print_table(batches: dict[str, Batch]) -> None:
    """One row an engine; times and walks are compared with the first engine's."""
    print("| engine | CPU s / completed walk | ratio | survive | same survival | Z r (mm) "
          "| X r (mm) | yaw r (deg) | median Z mm |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    first = next(iter(batches.values()))
    for name, batch in batches.items():
        seconds = median(batch.cpu[batch.survived])
        ratio = seconds / median(first.cpu[first.survived])
        print(f"| {name} | {seconds:.3f} | {ratio:.2f} | {100 * batch.survived.mean():.0f} % "
              f"| {compare(batch, first)} | {median(batch.numbers[batch.survived, 0]):.1f} |",
              flush=True)  # fmt: skip


def median(values: FloatArray) -> float:
    """The median; not a number if there are no values."""
    return float(np.median(values)) if len(values) else np.nan


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--study", type=Path, default=default_study())
    parser.add_argument("--walks", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    settings, candidates = walks_of_box(options.study, options.walks, options.seed)
    walk = replace(settings.walk, fidelity=Fidelity.SEARCH)
    if walk.model not in MASSES:
        parser.error(f"no masses of '{walk.model}' in make_models.py; it has {', '.join(MASSES)}")
    engines: dict[str, Callable[[Candidate], Walk]] = {
        f"Drake, {1e3 * walk.stepping.step:g} ms": partial(simulate, settings=walk)
    }
    for step in STEPS:
        engines[f"MuJoCo, {1e3 * step:g} ms"] = partial(walk_in_mujoco, settings=walk, step=step)
    alternate(engines, candidates[:1])  # Builds the models.
    print_table(alternate(engines, candidates))


if __name__ == "__main__":
    main()
