"""One walk: build the diagram, step it frame by frame, return what it left behind."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.cenic import CenicIntegrator
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import VectorLogSink

from drake_gait.errors import ModelError, SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FloatArray, Schedule, joint_commands, schedule_of
from drake_gait.problem import Candidate, Needs, Trial, evaluated
from drake_gait.robot.description import RobotModel, read_model, servo_of
from drake_gait.simulation.measures import measures_of
from drake_gait.simulation.messages import default_context, drake_messages
from drake_gait.simulation.observer import Observer
from drake_gait.simulation.plant import Robot, build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.posture import (
    SETTLING_TIME,
    Posture,
    check_stands,
    first_fall,
    torso_posture,
    walk_of,
)
from drake_gait.simulation.servo_effects import effects_of
from drake_gait.simulation.stance import check_placed, check_toes
from drake_gait.sole import Sole
from drake_gait.walk import (
    SEARCH_STEP,
    Disturbance,
    Engine,
    Integrator,
    Measures,
    Outcome,
    Walk,
    WalkSettings,
)

Watch = Callable[[float, FloatArray], None]
"""Takes an instant [s] and the positions of the plant, shape (n,)."""

_TOLERANCE, _LINE_SEARCH_TOLERANCE = 1e-5, 1e-3
"""Of CENIC's convex solver in steps of fixed length; with errors controlled it follows them."""

_LINE_SEARCH_ON_BOXES = 0.1
"""Boxes let it be found more loosely (docs/experiments/2026-11-22-integrators.md).

On a rim it would find no solution in three of twelve walks.
"""

_LINE_SEARCH_OF_SETTLING = 1e-8
"""Drake's own: last digits of where a robot stood grow to 0.1 mm where errors are controlled."""

_TRIED_OUT = 5
"""Frames of a walk in which a robot is tried out."""

_FRAMES_AT_A_TIME = 10
"""Frames between two looks at a walk that nobody watches; Drake logs each of them by itself.

To come back to Python at every frame costs 4 % of a walk; to look seldom, the steps after a fall.
"""

_SAME_TIME = 1e-9
"""Instants that differ by less are the same [s]."""

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
    """Walk a candidate from a standing start, for the time of its gait.

    The same candidate and settings give the same numbers, bit for bit, in any process.

    Args:
        candidate: The gait, and the foot it walks on.
        settings: How to simulate; by default the shipped robot at search fidelity.
        history: Whether to record time histories at the control frames.
        watch: Told of every frame as it is reached; it changes no number.

    Raises:
        ModelError: the robot description cannot be used.
    """
    settings = settings or WalkSettings()
    gait, foot = candidate.gait, candidate.foot
    commands, schedule = gait.commands_from(settings.start), gait.schedule
    return follow(commands, foot, settings, schedule=schedule, history=history, watch=watch)


def walk_trial(trial: Trial, model: RobotModel | None = None) -> Walk:
    """Walk a trial; what a worker runs.

    Args:
        trial: The candidate, and how to simulate.
        model: The robot as it was read, whatever the trial names.
    """
    settings = trial.settings if model is None else replace(trial.settings, model=model)
    history = any(one.needs is Needs.HISTORY for one in trial.quantities)
    return evaluated(simulate(trial.candidate, settings, history=history), trial)


def follow(
    commands: ArrayLike,
    foot: FootDesign | None = None,
    settings: WalkSettings | None = None,
    *,
    schedule: Schedule | None = None,
    history: bool = False,
    watch: Watch | None = None,
) -> Walk:
    """Let the servos follow any joint commands from a standing start.

    Args:
        commands: Joint angles [rad], shape (n + 1, 10), columns as gait.JOINTS, one row a frame.
        foot: The toes; the paper's by default.
        settings: How to simulate; by default the shipped robot at search fidelity.
        schedule: The cycle and the frames of the gait, which measures and figures know it by; by
            default the paper's, or that of one walk from end to end.
        history: Whether to record time histories at the control frames.
        watch: Told of every frame as it is reached.

    Raises:
        SettingsError: the commands have another shape, or one that no servo can follow.
        ModelError: the robot description cannot be used.
    """
    commands = joint_commands(commands)
    foot, settings = foot or FootDesign(), _whole(settings or WalkSettings())
    schedule = schedule or schedule_of(len(commands) - 1)
    if settings.engine is Engine.MUJOCO:
        walk = follow_in_mujoco()(
            commands, foot, settings, schedule=schedule, history=history, watch=watch
        )
        return replace(walk, planned=schedule.frames)
    robot, context = prepare(commands, foot, settings)
    observer = _observer(robot, commands, settings, schedule) if history else None
    with drake_messages():
        sent = _sent(robot, commands, settings)
        walk = _advance(robot, context, settings, sent, schedule, observer=observer, watch=watch)
    return replace(walk, planned=schedule.frames)


def measured_at_every_step(candidate: Candidate, settings: WalkSettings) -> tuple[Walk, Measures]:
    """Walk a candidate, and let Drake's own contact say its measures, at every step.

    It takes three times as long as `simulate`, whose measures it tests.

    Raises:
        ModelError: the robot description cannot be used.
    """
    settings = _whole(settings)
    commands, schedule = candidate.gait.commands_from(settings.start), candidate.gait.schedule
    robot, context = prepare(commands, candidate.foot, settings)
    sent = _sent(robot, commands, settings)
    observer = _observer(robot, commands, settings, schedule)
    with drake_messages():
        walk = _advance(robot, context, settings, sent, schedule, observer=observer, monitored=True)
    return walk, observer.measures(observer.history(), walk.forward)


def _whole(settings: WalkSettings) -> WalkSettings:
    """Return settings with the servos that a walk has."""
    return replace(settings, servo=servo_of(settings))


def follow_in_mujoco() -> Callable[..., Walk]:
    """Return what follows commands in MuJoCo, which is imported when it is first asked for.

    Raises:
        SettingsError: it is not installed.
    """
    if find_spec("mujoco") is None:
        raise SettingsError(
            "walk.engine = \"mujoco\" needs MuJoCo: pip install 'drake-gait[mujoco]'"
        )
    from drake_gait.simulation.mujoco import engine

    return engine.follow


def try_out(candidate: Candidate, settings: WalkSettings) -> None:
    """Stand a robot up and walk it for a moment, with all that is ever measured of a walk.

    Raises:
        ModelError: the robot cannot be used.
    """
    settings = _whole(settings)
    commands, foot = candidate.gait.commands_from(settings.start), candidate.foot
    schedule, frames = candidate.gait.schedule, min(_TRIED_OUT, candidate.gait.frames)
    if settings.engine is Engine.MUJOCO:
        walk = follow_in_mujoco()(commands, foot, settings, history=True, frames=frames)
    else:
        robot, context = prepare(commands, foot, settings)
        with drake_messages():
            observer = _observer(robot, commands, settings, schedule)
            sent = _sent(robot, commands, settings)
            walk = _advance(
                robot, context, settings, sent, schedule, observer=observer, frames=frames
            )
    if not walk.survived:
        raise ModelError(
            f"{settings.model}: the robot does not walk for {_TRIED_OUT * FRAME_TIME:g} s: "
            f"{walk.reason}; look at its masses, inertias and contacts"
        )


def prepare(
    commands: FloatArray, foot: FootDesign, settings: WalkSettings, *, logged: bool = True
) -> tuple[Robot, Context]:
    """A robot, and a context of its diagram in which it stands, about to follow `commands`."""
    stepping, changed = settings.stepping, settings.disturbance or Disturbance()
    model = read_model(settings.model, settings.robot)
    config = PlantConfig(
        model=model,
        foot=foot.body if model.robot.outline is not None else None,
        servo=servo_of(settings),
        sole=settings.sole,
        contact=settings.contact,
        friction=settings.friction,
        voltage=changed.voltage,
        time_step=stepping.step if stepping.discrete else 0.0,
    )
    robot = _robot(config, logged=logged)
    context = default_context(robot.diagram)
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    standing = None if config.foot is None else FootDesign(rigid_toes=foot.rigid_toes)
    positions = _standing(replace(config, foot=standing, friction=1.0, voltage=1.0, time_step=0.0))
    robot.plant.SetPositions(plant_context, positions)
    robot.scale_masses(plant_context, changed.mass)
    gait_context = robot.gait.GetMyMutableContextFromRoot(context)
    lead = stepping.lead - settings.delay
    robot.gait.set_commands(gait_context, _sent(robot, commands, settings), lead=lead)
    return robot, context


def _sent(robot: Robot, commands: FloatArray, settings: WalkSettings) -> FloatArray:
    """Return the commands that reach m servos [rad], (n_frames, m); zeros may be displaced."""
    zeros: FloatArray = np.array((settings.disturbance or Disturbance()).joint_zeros)
    return robot.joints.sent(commands + zeros)


def _observer(
    robot: Robot, commands: FloatArray, settings: WalkSettings, schedule: Schedule
) -> Observer:
    mass = (settings.disturbance or Disturbance()).mass
    sent = _sent(robot, commands, settings)
    return Observer(robot, commands, sent=sent, mass=mass, delay=settings.delay, schedule=schedule)


@lru_cache(maxsize=4)
def _robot(config: PlantConfig, *, logged: bool = False) -> Robot:
    """One diagram serves every gait and every toe spring of a foot's body."""
    return build_robot(config, logged=logged)


@lru_cache(maxsize=4)
def _standing(config: PlantConfig) -> FloatArray:
    """Positions of the robot at rest on the paper's feet: shape (21,) of the KHR-3HV.

    Every foot starts its walk from them. Other toes would change a thousandth of a radian in the
    toes themselves and microns elsewhere, and settling costs a fifth of a walk.
    """
    model, foot = read_model(config.model), config.foot or FootDesign()
    robot = _robot(config)
    context = default_context(robot.diagram)
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    check_placed(robot, plant_context, model)
    check_toes(model)
    before = _posture(robot, plant_context)
    gait_context = robot.gait.GetMyMutableContextFromRoot(context)
    robot.gait.set_commands(gait_context, np.tile(robot.joints.standing, (2, 1)))
    stepping = Integrator(step=SEARCH_STEP)
    with drake_messages():
        try:
            simulator = start(robot.diagram, context, stepping, _LINE_SEARCH_OF_SETTLING)
            simulator.AdvanceTo(SETTLING_TIME)
        except (RuntimeError, SystemExit) as error:
            reason = str(error).strip().splitlines()[0]
            raise ModelError(f"{model}: the robot cannot be stood up: {reason}") from None
    check_stands(before, _posture(robot, plant_context), model)
    positions: FloatArray = robot.plant.GetPositions(plant_context)
    positions.setflags(write=False)
    return positions


def _posture(robot: Robot, plant_context: Context) -> Posture:
    """Return the posture of a robot's torso."""
    torso = robot.plant.GetBodyByName(robot.model.robot.torso)
    first = torso.floating_positions_start()
    return torso_posture(robot.plant.GetPositions(plant_context)[first : first + 7])


def start(
    diagram: Diagram,
    context: Context,
    stepping: Integrator,
    line_search_tolerance: float = _LINE_SEARCH_TOLERANCE,
) -> Simulator:
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
            integrator = cast(CenicIntegrator, simulator.get_mutable_integrator())
            _loosen(integrator, line_search_tolerance)
    simulator.Initialize()
    return simulator


def _loosen(integrator: CenicIntegrator, line_search_tolerance: float) -> None:
    """Ask less of the convex solver, whose default takes a third more iterations."""
    parameters = integrator.get_solver_parameters()
    parameters.min_tolerance = _TOLERANCE
    parameters.linesearch_tolerance = line_search_tolerance
    integrator.SetSolverParameters(parameters)


def _advance(
    robot: Robot,
    context: Context,
    settings: WalkSettings,
    sent: FloatArray,
    schedule: Schedule,
    *,
    observer: Observer | None = None,
    monitored: bool = False,
    watch: Watch | None = None,
    frames: int | None = None,
) -> Walk:
    """Step through the frames, all by default, until the end, a fall or a failure."""
    frames = schedule.frames if frames is None else frames
    plant = robot.plant
    torso = plant.GetBodyByName(robot.model.robot.torso)
    pose = slice(torso.floating_positions_start(), torso.floating_positions_start() + 7)
    log = cast(VectorLogSink, robot.frames).FindLog(context)
    # Computing time: a busy machine changes no walk.
    deadline = time.thread_time() + settings.time_limit
    on_boxes = settings.sole is Sole.BOXES
    line_search = _LINE_SEARCH_ON_BOXES if on_boxes else _LINE_SEARCH_TOLERANCE
    monitors = effects_of(robot)
    for update in monitors:
        update(context)
    simulator = start(robot.diagram, context, settings.stepping, line_search)
    if observer:
        observer.record(context)
    if observer and monitored:
        monitors.append(observer.monitor)
    if monitors:
        simulator.set_monitor(lambda root: [monitor(root) for monitor in monitors][-1])
    postures: list[Posture] = []
    stride = 1 if observer or watch else _FRAMES_AT_A_TIME
    for frame in (*range(stride, frames, stride), frames):
        failure = ""
        try:
            # Ctrl-C is heard between two calls; Drake would look for it in every step.
            simulator.AdvanceTo(frame * FRAME_TIME, interruptible=False)
        # Drake raises a failed assertion of its solver as SystemExit.
        except (RuntimeError, SystemExit) as error:
            failure = f"solver: {str(error).splitlines()[0]}"
        positions: FloatArray = log.data()[: plant.num_positions()].T
        seen = len(postures)
        postures += [torso_posture(one) for one in positions[seen:, pose]]
        if observer and not failure:
            observer.record(context)
        if watch and not failure:
            watch(frame * FRAME_TIME, positions[-1])
        fall = first_fall(postures, seen, robot.model.robot)
        if fall is not None:
            break
        if failure:
            return Walk.diverged(failure, frames=len(postures) - 1)
        if time.thread_time() > deadline:
            return Walk.diverged(f"took longer than {settings.time_limit:g} s", frames=frame)
    end = frames if fall is None else fall
    walk = walk_of(postures, _centres_of_mass(robot, positions[[0, end]]), fall, frames)
    if walk.outcome is Outcome.DIVERGED:
        return walk
    measured = _measures(robot, context, settings, sent, schedule, end=end, forward=walk.forward)
    return replace(walk, history=observer.history() if observer else None, measures=measured)


def _measures(
    robot: Robot,
    context: Context,
    settings: WalkSettings,
    sent: FloatArray,
    schedule: Schedule,
    *,
    end: int,
    forward: float,
) -> Measures:
    """Return the measures of a walk up to the frame `end`, from what Drake has logged."""
    log = cast(VectorLogSink, robot.steps).FindLog(context)
    time, states = log.sample_times(), log.data()
    count = int(np.searchsorted(time, end * FRAME_TIME + _SAME_TIME))
    mass = (settings.disturbance or Disturbance()).mass
    # A robot that flies apart has numbers that grow beyond all bounds.
    with np.errstate(all="ignore"):
        record = robot.meter.record(
            time[:count], states[:, :count], sent, mass, delay=settings.delay
        )
        return measures_of(replace(record, schedule=schedule), forward=forward)


def _centres_of_mass(robot: Robot, postures: FloatArray) -> list[FloatArray]:
    """p_WC [m], shape (3,) each, of postures, shape (n, positions)."""
    context = robot.plant.CreateDefaultContext()
    centres: list[FloatArray] = []
    for positions in postures:
        robot.plant.SetPositions(context, positions)
        centres.append(robot.plant.CalcCenterOfMassPositionInWorld(context))
    return centres
