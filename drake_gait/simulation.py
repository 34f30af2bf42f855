"""One walk: build the diagram, step it frame by frame, return what it left behind."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import cast

import numpy as np
from pydrake.multibody.cenic import CenicIntegrator
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FRAMES, FloatArray
from drake_gait.observer import Observer
from drake_gait.problem import Candidate, Trial
from drake_gait.robot import Robot, build_robot
from drake_gait.servo import Servo
from drake_gait.walk import INTEGRATORS, Fidelity, Integrator, Outcome, Walk, WalkSettings

FALL_TILT = math.radians(45.0)
"""The robot has fallen when its torso leans further than this from upright [rad]."""
FALL_HEIGHT = 0.8
"""The robot has fallen when its torso is below this part of its standing height."""

Watch = Callable[[float, FloatArray], None]
"""Takes an instant [s] and the positions of the plant, shape (n,)."""

_UPRIGHT = math.cos(FALL_TILT)

_TOLERANCE = 1e-5
"""Of CENIC's convex solver in steps of fixed length; with errors controlled it follows them."""

_SETTLING_TIME = 1.0
"""How long the robot stands before its walk, to come to rest on its soles [s]."""


# A step must not miss a frame's instant by rounding: the sliver of a step that is left has no
# solution, and CENIC fails an assertion. A step this much longer is always cut at the frame.
_STEP_EXCESS = 1.0 + 1e-6


def simulate(
    candidate: Candidate,
    settings: WalkSettings | None = None,
    *,
    history: bool = False,
    watch: Watch | None = None,
) -> Walk:
    """Walk a candidate for 4.8 s from a standing start.

    The same candidate and settings give the same numbers, bit for bit, in any process.

    Args:
        candidate: The gait, and the foot it walks on.
        settings: How to simulate; by default the shipped robot at search fidelity.
        history: Whether to record time histories at the control frames, and measures.
        watch: Told of every frame as it is reached; it changes no number.

    Raises:
        ModelError: the robot description cannot be used.
    """
    return follow(candidate.gait.commands, candidate.foot, settings, history=history, watch=watch)


def walk_trial(trial: Trial) -> Walk:
    """Walk a trial; what a worker runs."""
    return simulate(trial.candidate, trial.settings)


def follow(
    commands: FloatArray,
    foot: FootDesign | None = None,
    settings: WalkSettings | None = None,
    *,
    history: bool = False,
    watch: Watch | None = None,
) -> Walk:
    """Let the servos follow any joint commands from a standing start, for 4.8 s.

    Args:
        commands: Joint angles [rad], shape (241, 10), columns as gait.JOINTS, one row a frame.
        foot: The toes; the paper's by default.
        settings: How to simulate; by default the shipped robot at search fidelity.
        history: Whether to record time histories at the control frames, and measures.
        watch: Told of every frame as it is reached.

    Raises:
        ModelError: the robot description cannot be used.
    """
    foot, settings = foot or FootDesign(), settings or WalkSettings()
    robot, context = prepare(commands, foot, settings)
    observer = Observer(robot, commands) if history or settings.measures else None
    walk = _advance(robot, context, settings, observer, watch)
    return walk if history else replace(walk, history=None)


def prepare(
    commands: FloatArray, foot: FootDesign, settings: WalkSettings
) -> tuple[Robot, Context]:
    """A robot, and a context of its diagram in which it stands, about to follow `commands`."""
    stepping = settings.stepping
    time_step = stepping.step if stepping.discrete else 0.0
    robot = _robot(settings.model, foot.body, settings.servo, time_step, settings.friction)
    context = robot.diagram.CreateDefaultContext()
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    standing = _standing(settings.model, settings.servo, rigid_toes=foot.rigid_toes)
    robot.plant.SetPositions(plant_context, standing)
    gait_context = robot.gait.GetMyMutableContextFromRoot(context)
    robot.gait.set_commands(gait_context, commands, lead=stepping.lead)
    return robot, context


@lru_cache(maxsize=4)
def _robot(
    model: str | Path,
    body: FootDesign,
    servo: Servo,
    time_step: float = 0.0,
    friction: float = 1.0,
) -> Robot:
    """One diagram serves every gait and every toe spring of a foot's body."""
    return build_robot(model, body, servo, time_step=time_step, friction=friction)


@lru_cache(maxsize=4)
def _standing(model: str | Path, servo: Servo, *, rigid_toes: bool) -> FloatArray:
    """Positions of the robot at rest on the paper's feet, shape (21,), or (17,) with rigid toes.

    Every foot starts its walk from them: what other toes would change is a thousandth of a radian
    in the toes themselves and microns elsewhere, and settling costs a fifth of a walk.
    """
    foot = FootDesign(rigid_toes=rigid_toes)
    robot = _robot(model, foot, servo)
    context = robot.diagram.CreateDefaultContext()
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    simulator = start(robot.diagram, context, INTEGRATORS[Fidelity.SEARCH])
    simulator.AdvanceTo(_SETTLING_TIME)
    positions: FloatArray = robot.plant.GetPositions(plant_context)
    positions.setflags(write=False)
    return positions


def start(diagram: Diagram, context: Context, stepping: Integrator) -> Simulator:
    """A simulator of a diagram with a plant, at the start of its context."""
    # A fresh one for each walk: a second run in the same simulator differs in its last digits.
    simulator = Simulator(diagram, context)
    config = SimulatorConfig(
        integration_scheme="cenic",
        max_step_size=stepping.step * _STEP_EXCESS,
        accuracy=stepping.accuracy or 1e-3,
        use_error_control=stepping.accuracy is not None,
    )
    if not stepping.discrete:
        ApplySimulatorConfig(config, simulator)
        if stepping.accuracy is None:
            _loosen(cast(CenicIntegrator, simulator.get_mutable_integrator()))
    simulator.Initialize()
    return simulator


def _loosen(integrator: CenicIntegrator) -> None:
    """Ask less of the convex solver, whose default takes a third more iterations."""
    parameters = integrator.get_solver_parameters()
    parameters.min_tolerance = _TOLERANCE
    integrator.SetSolverParameters(parameters)


def _advance(
    robot: Robot,
    context: Context,
    settings: WalkSettings,
    observer: Observer | None,
    watch: Watch | None,
) -> Walk:
    """Step through the frames until the end, a fall or a failure."""
    plant = robot.plant
    plant_context = plant.GetMyContextFromRoot(context)
    torso = plant.GetBodyByName("torso")
    pose = slice(torso.floating_positions_start(), torso.floating_positions_start() + 7)
    com_start = _centre_of_mass(robot, plant_context)
    heading, upright, height = torso_posture(plant.GetPositions(plant_context)[pose])
    fall_height = FALL_HEIGHT * height
    headings = [heading]
    # Computing time: a busy machine changes no walk.
    deadline = time.thread_time() + settings.time_limit
    outcome, reason, steps = Outcome.WALKED, "", FRAMES
    simulator = start(robot.diagram, context, settings.stepping)
    if observer:
        observer.record(context)
        simulator.set_monitor(observer.monitor)
    for frame in range(1, FRAMES + 1):
        try:
            # Ctrl-C is heard between frames; Drake would look for it in every step.
            simulator.AdvanceTo(frame * FRAME_TIME, interruptible=False)
        # Drake raises a failed assertion of its solver as SystemExit.
        except (RuntimeError, SystemExit) as error:
            return Walk.diverged(f"solver: {str(error).splitlines()[0]}", steps=frame - 1)
        if observer:
            observer.record(context)
        if watch:
            watch(frame * FRAME_TIME, plant.GetPositions(plant_context))
        heading, upright, height = torso_posture(plant.GetPositions(plant_context)[pose])
        headings.append(heading)
        # Written so that a state that is not a number counts as a fall.
        if not (upright > _UPRIGHT and height > fall_height):
            outcome, steps = Outcome.FELL, frame - 1
            reason = f"fell at {frame * FRAME_TIME:.2f} s"
            break
        if time.thread_time() > deadline:
            return Walk.diverged(f"took longer than {settings.time_limit:g} s", steps=frame)
    com_end = _centre_of_mass(robot, plant_context)
    if not np.isfinite(com_end).all():
        return Walk.diverged("the state is not finite", steps=steps)
    forward, lateral = (
        float(end - begin) for begin, end in zip(com_start[:2], com_end[:2], strict=True)
    )
    history = observer.history() if observer else None
    return Walk(
        outcome=outcome,
        steps=steps,
        forward=forward,
        lateral=lateral,
        yaw=float(np.unwrap(headings)[-1] - headings[0]),
        com_height=float(com_end[2]),
        reason=reason,
        history=history,
        measures=observer.measures(history, forward) if observer and history else None,
    )


def _centre_of_mass(robot: Robot, plant_context: Context) -> FloatArray:
    """p_WC [m], shape (3,)."""
    # CENIC's fixed steps leave the caches of a context behind its state, by up to a step: what a
    # walk did is read from another context.
    posture = robot.plant.CreateDefaultContext()
    robot.plant.SetPositions(posture, robot.plant.GetPositions(plant_context))
    com: FloatArray = robot.plant.CalcCenterOfMassPositionInWorld(posture)
    return com


def torso_posture(pose: FloatArray) -> tuple[float, float, float]:
    """Heading [rad], cosine of the lean from upright, and height [m] of the torso.

    Args:
        pose: Quaternion (w, x, y, z) and position [m] of the torso in the world, shape (7,).
    """
    w, x, y, z, _, _, height = pose.tolist()
    heading = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return heading, 1.0 - 2.0 * (x * x + y * y), height
