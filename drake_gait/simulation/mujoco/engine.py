"""One walk in MuJoCo: step the model of a robot frame by frame, return what it left behind."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
from pydrake.systems.framework import Context

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FloatArray, Schedule, schedule_of
from drake_gait.robot.description import read_model, servo_of
from drake_gait.simulation.command_source import commands_at
from drake_gait.simulation.measures import measures_of
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.mujoco.model import GROUND, Hardness, compiled
from drake_gait.simulation.observer import Observer, Touch
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
from drake_gait.simulation.stance import check_placed, check_toes
from drake_gait.walk import Disturbance, Measures, Outcome, Walk, WalkSettings

_INSTANTS = 0.004
"""Longest time between two instants of which measures are made [s], as long as Drake's steps."""

Watch = Callable[[float, FloatArray], None]
Integers = np.ndarray[Any, np.dtype[np.int_]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Model:
    """A robot in MuJoCo, and the same robot in Drake, which knows its kinematics."""

    robot: Robot
    """The diagram that it was written from; nothing steps it."""
    context: Context
    """A context of the diagram, with the foot and the masses."""
    model: mujoco.MjModel
    """The model."""
    positions: Integers
    """Where MuJoCo's positions are among Drake's, shape (n,)."""
    velocities: Integers
    """Where MuJoCo's velocities are among Drake's, shape (m,)."""
    plates: Integers
    """Number of the foot's link of each shape, as in `RobotFile.plates`; -1 of no foot's."""
    floor: int
    """Number of the ground among the shapes."""

    def show(self, time: float, qpos: FloatArray, qvel: FloatArray) -> Context:
        """Put a state of MuJoCo's into the context of Drake's diagram."""
        plant = self.robot.plant
        plant_context = plant.GetMyMutableContextFromRoot(self.context)
        self.context.SetTime(time)
        plant.SetPositionsAndVelocities(plant_context, self.state(qpos, qvel))
        return self.context

    def state(self, qpos: FloatArray, qvel: FloatArray) -> FloatArray:
        """Return a state of MuJoCo's as Drake has it: positions, then velocities."""
        # A free body turns in its own axes in MuJoCo, and in the world's in Drake.
        turned: FloatArray = qvel.copy()
        rotation: FloatArray = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, qpos[3:7])
        turned[3:6] = rotation.reshape(3, 3) @ qvel[3:6]
        return np.concatenate([qpos[self.positions], turned[self.velocities]])

    def centre_of_mass(self, qpos: FloatArray) -> FloatArray:
        """Return p_WC [m], shape (3,), at positions of MuJoCo's."""
        context = self.show(0.0, qpos, np.zeros(self.model.nv))
        plant = self.robot.plant
        plant_context = plant.GetMyContextFromRoot(context)
        centre: FloatArray = plant.CalcCenterOfMassPositionInWorld(plant_context)
        return centre


class _Observer(Observer):
    """An observer of a walk whose forces on the ground are MuJoCo's."""

    def __init__(
        self,
        found: _Model,
        data: mujoco.MjData,
        commands: FloatArray,
        sent: FloatArray,
        mass: float,
        delay: float,
        schedule: Schedule,
    ) -> None:
        super().__init__(
            found.robot, commands, sent=sent, mass=mass, delay=delay, schedule=schedule
        )
        self._found, self._data = found, data

    def _contacts(self, plant_context: Context) -> list[Touch]:
        """Return where feet touch the ground, in the step that was made last."""
        found, plant = self._found, self._robot.plant
        links = self._robot.model.robot.plates
        touches = []
        wrench: FloatArray = np.zeros(6)
        for number, contact in enumerate(self._data.contact):
            one, other = contact.geom.tolist()
            plate = int(max(found.plates[one], found.plates[other]))
            if found.floor not in (one, other) or plate < 0:
                continue
            mujoco.mj_contactForce(found.model, self._data, number, wrench)
            # Rows of the frame are its axes; the force is on the second shape.
            sign = 1.0 if one == found.floor else -1.0
            force = sign * (contact.frame.reshape(3, 3).T @ wrench[:3])
            touches.append(
                Touch(
                    foot=2 * plate // len(links),
                    body=plant.GetBodyByName(links[plate]),
                    force=force,
                    place=contact.pos.copy(),
                )
            )
        return touches


class _Log:
    """States of a walk at its instants, with what the ground does to each plate."""

    def __init__(self, found: _Model, data: mujoco.MjData) -> None:
        self._found, self._data = found, data
        self._time: list[float] = []
        self._states: list[FloatArray] = []
        self._loads: list[FloatArray] = []
        self._sliding: list[FloatArray] = []

    def begin(self) -> None:
        """Take the state, before a step is made from it."""
        self._time.append(self._data.time)
        self._states.append(self._found.state(self._data.qpos, self._data.qvel))

    def end(self) -> None:
        """Take the forces of the step that was made, which are those of its beginning."""
        found, contact = self._found, self._data.contact
        plates = len(found.robot.model.robot.plates)
        sums = np.zeros((3, plates))
        if len(contact):
            geoms = contact.geom
            plate = found.plates[geoms].max(axis=1)
            rows = contact.efc_address
            counts = (geoms == found.floor).any(axis=1) & (plate >= 0) & (rows >= 0)
            plate, rows = plate[counts], rows[counts]
            # The first row of a contact is its normal's, the other two are along the ground.
            load = self._data.efc_force[rows]
            axes = contact.frame[counts].reshape(-1, 3, 3)
            speeds = self._data.efc_vel[rows + 1], self._data.efc_vel[rows + 2]
            along = speeds[0][:, None] * axes[:, 1] + speeds[1][:, None] * axes[:, 2]
            weights = load, load * along[:, 0], load * along[:, 1]
            sums = np.array([np.bincount(plate, one, minlength=plates) for one in weights])
        self._loads.append(sums[0])
        # Speeds of a plate are linear in place: their mean by load is that at the load's centre.
        self._sliding.append(np.hypot(sums[1], sums[2]) / np.maximum(sums[0], _LIGHTEST))

    def measures(
        self, walk: Walk, sent: FloatArray, mass: float, delay: float, schedule: Schedule
    ) -> Measures:
        """Return the measures of the walk."""
        # A robot that flies apart has numbers that grow beyond all bounds.
        with np.errstate(all="ignore"):
            meter = self._found.robot.meter
            states = np.array(self._states).T
            record = meter.record(np.array(self._time), states, sent, mass, delay=delay)
            record = replace(
                record,
                loads=np.array(self._loads).T,
                sliding=np.array(self._sliding).T,
                schedule=schedule,
            )
            return measures_of(record, forward=walk.forward)


_LIGHTEST = 1e-6
"""A load whose centre is not looked for [N]."""


def follow(
    commands: FloatArray,
    foot: FootDesign,
    settings: WalkSettings,
    *,
    history: bool = False,
    watch: Watch | None = None,
    frames: int | None = None,
    schedule: Schedule | None = None,
    hardness: Hardness | None = None,
) -> Walk:
    """Let the servos follow joint commands from a standing start.

    Args:
        commands: Joint angles [rad], shape (n + 1, 10), columns as gait.JOINTS, one row a frame.
        foot: The toes.
        settings: How to simulate.
        history: Whether to record time histories.
        watch: Told of every frame as it is reached.
        frames: How many to walk; all by default.
        schedule: The gait's cycle and frames.
        hardness: Of the contacts; for comparisons.

    Raises:
        ModelError: the robot description cannot be used, or not in MuJoCo.
    """
    frames = len(commands) - 1 if frames is None else frames
    schedule = schedule or schedule_of(len(commands) - 1)
    mass, late = (settings.disturbance or Disturbance()).mass, settings.delay
    with _warnings() as warnings:
        ready = prepare(commands, foot, settings, hardness=hardness)
        found, data, sent = ready.model, ready.data, ready.sent
        observer = _Observer(found, data, commands, sent, mass, late, schedule) if history else None
        log = _Log(found, data)
        walk = _advance(
            found, data, ready.targets, log, settings.time_limit, observer, watch, frames, warnings
        )
    if walk.outcome is Outcome.DIVERGED:
        return walk
    measures = log.measures(walk, sent, mass, late, schedule)
    return replace(walk, history=observer.history() if observer else None, measures=measures)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """A robot that stands, about to follow commands."""

    model: _Model
    """The robot."""
    data: mujoco.MjData
    """Its state."""
    sent: FloatArray
    """Commands with the servos' own zeros [rad], shape (n + 1, m)."""
    targets: FloatArray
    """What the servos follow in each step [rad], shape (n, steps, m)."""


def prepare(
    commands: FloatArray,
    foot: FootDesign,
    settings: WalkSettings,
    *,
    hardness: Hardness | None = None,
) -> Prepared:
    """Stand a robot up, about to follow `commands`; the arguments are those of `follow`."""
    changed, step = settings.disturbance or Disturbance(), settings.stepping.step
    model = read_model(settings.model, settings.robot)
    config = PlantConfig(
        model=model,
        foot=foot if model.robot.outline is not None else None,
        servo=servo_of(settings),
        sole=settings.sole,
        contact=settings.contact,
        friction=settings.friction,
        voltage=changed.voltage,
    )
    of_papers = FootDesign(rigid_toes=foot.rigid_toes)
    foot_stands = None if config.foot is None else of_papers
    standing = replace(config, foot=foot_stands, friction=1.0, voltage=1.0)
    found = _model(config, step, changed.mass, hardness)
    data = mujoco.MjData(found.model)
    data.qpos[:] = _standing(standing, step, hardness)
    sent = found.robot.joints.sent(commands + np.array(changed.joint_zeros))
    targets = _in_steps(sent, step, settings.delay)
    return Prepared(model=found, data=data, sent=sent, targets=targets)


def _advance(
    found: _Model,
    data: mujoco.MjData,
    commands: FloatArray,
    log: _Log,
    time_limit: float,
    observer: _Observer | None,
    watch: Watch | None,
    frames: int,
    warnings: list[str],
) -> Walk:
    """Step through the frames until the end, a fall or a failure."""
    # Computing time: a busy machine changes no walk.
    deadline = time.thread_time() + time_limit
    servos = _Servos(found)
    stride = _stride(commands.shape[1], found.model.opt.timestep)
    start = data.qpos.copy()
    postures, fall = [_posture(data)], None
    for frame in range(1, frames + 1):
        for number, command in enumerate(commands[frame - 1]):
            servos.follow(data, command)
            if number % stride:
                mujoco.mj_step(found.model, data)
                continue
            log.begin()
            seen = found.show(data.time, data.qpos, data.qvel) if observer and not number else None
            mujoco.mj_step(found.model, data)
            log.end()
            if observer and seen is not None:
                observer.record(seen)
        postures.append(_posture(data))
        if watch:
            watch(frame * FRAME_TIME, data.qpos[found.positions])
        fall = first_fall(postures, frame, found.robot.model.robot)
        if warnings or fall is not None:
            break
        if time.thread_time() > deadline:
            return Walk.diverged(f"took longer than {time_limit:g} s", frames=frame)
    if warnings:
        return Walk.diverged(f"solver: {warnings[0]}", frames=len(postures) - 2)
    log.begin()
    mujoco.mj_forward(found.model, data)
    log.end()
    if observer:
        observer.record(found.show(data.time, data.qpos, data.qvel))
    centres = [found.centre_of_mass(qpos) for qpos in (start, data.qpos)]
    return walk_of(postures, centres, fall, frames)


def _stride(steps: int, step: float) -> int:
    """Return every how many of the steps of a frame an instant is logged."""
    return max(
        count for count in range(1, steps + 1)
        if steps % count == 0 and (count == 1 or count * step < _INSTANTS + 1e-9)
    )  # fmt: skip


def _posture(data: mujoco.MjData) -> Posture:
    """Return the posture of the torso."""
    place, quaternion = data.qpos[:3], data.qpos[3:7]
    return torso_posture(np.concatenate([quaternion, place]))


class _Servos:
    """What of the servos follows the motion: their play, and friction that grows with the load.

    MuJoCo's own friction takes another limit in every step, as BAM's simulation has it.
    """

    def __init__(self, found: _Model) -> None:
        self._servo, self._model = found.robot.config.servo, found.model
        self._joints = found.robot.joints
        joints = found.model.actuator_trnid[:, 0]
        self._angles = found.model.jnt_qposadr[joints]
        self._speeds = found.model.jnt_dofadr[joints]
        self._stall, self._back_emf = found.robot.meter.stall, found.robot.meter.back_emf
        if self._servo.has_friction:  # A model is kept, with the friction of its last walk.
            self._model.dof_frictionloss[self._speeds] = self._servo.coulomb_friction

    def follow(self, data: mujoco.MjData, command: FloatArray) -> None:
        """Set commands [rad], shape (m,), and friction for the step that begins."""
        servo = self._servo
        if servo.backlash:
            angles = data.qpos[self._angles]
            command = angles + servo.engaged(command - angles)
        data.ctrl = command
        if servo.load_friction:
            speeds = data.qvel[self._speeds]
            error = command - data.qpos[self._angles]
            controller = self._joints.controller_torque(servo, error, speeds, self._stall)
            motor = servo.motor_torque(controller, speeds, self._back_emf)
            self._model.dof_frictionloss[self._speeds] = servo.friction_limit(motor)


def _in_steps(commands: FloatArray, step: float, delay: float = 0.0) -> FloatArray:
    """Return what the servos follow in each step [rad], shape (frames, steps, m).

    Linear between the frames of `commands`, shape (n, m), as `command_source.desired_state`, and
    late by `delay` [s].
    """
    steps = round(FRAME_TIME / step)
    if delay:
        times: FloatArray = np.arange((len(commands) - 1) * steps, dtype=float) * step - delay
        late: FloatArray = commands_at(commands, times).reshape(len(commands) - 1, steps, -1)
        return late
    progress = np.arange(steps)[:, None] / steps
    sent: FloatArray = commands[:-1, None] + progress * np.diff(commands, axis=0)[:, None]
    return sent


@lru_cache(maxsize=8)
def _model(
    config: PlantConfig, step: float, mass: float = 1.0, hardness: Hardness | None = None
) -> _Model:
    """One model serves every gait on a foot."""
    name, robot = read_model(config.model), build_robot(config)
    feet = name.robot.plates
    context, plant = default_context(robot.diagram), robot.plant
    plant_context = plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, config.foot or FootDesign())
    robot.scale_masses(plant_context, mass)
    try:
        model = compiled(robot, plant_context, step, hardness)
    except ModelError as error:
        raise ModelError(f"{name}{error}") from None
    except ValueError as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelError(
            f"{name}: MuJoCo refuses the robot: {reason}; mend the file, or let walk.engine be "
            "'drake'"
        ) from None
    positions, velocities = _places(robot, model)
    owners = [model.body(number).name for number in model.geom_bodyid]
    plates = [feet.index(owner) if owner in feet else -1 for owner in owners]
    return _Model(
        robot=robot,
        context=context,
        model=model,
        positions=positions,
        velocities=velocities,
        plates=np.array(plates),
        floor=model.geom(GROUND).id,
    )


def _places(robot: Robot, model: mujoco.MjModel) -> tuple[Integers, Integers]:
    """Return where MuJoCo's positions and velocities are among Drake's."""
    plant = robot.plant
    torso = plant.GetBodyByName(robot.model.robot.torso)
    first, first_speed = torso.floating_positions_start(), torso.floating_velocities_start_in_v()
    positions: Integers = np.empty(plant.num_positions(), dtype=int)
    velocities: Integers = np.empty(plant.num_velocities(), dtype=int)
    positions[first : first + 7] = [3, 4, 5, 6, 0, 1, 2]
    velocities[first_speed : first_speed + 6] = [3, 4, 5, 0, 1, 2]
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_positions() == 1:
            positions[joint.position_start()] = model.joint(joint.name()).qposadr[0]
            velocities[joint.velocity_start()] = model.joint(joint.name()).dofadr[0]
    return positions, velocities


@lru_cache(maxsize=4)
def _standing(config: PlantConfig, step: float, hardness: Hardness | None = None) -> FloatArray:
    """Return the positions in MuJoCo of the robot at rest on the paper's feet.

    As in Drake, every foot starts its walk from them.
    """
    found, name = _model(config, step, hardness=hardness), read_model(config.model)
    plant = found.robot.plant
    default = default_context(found.robot.diagram)
    plant_context = plant.GetMyContextFromRoot(default)
    check_placed(found.robot, plant_context, name)
    check_toes(name)
    data = mujoco.MjData(found.model)
    data.qpos[found.positions] = plant.GetPositions(plant_context)
    data.ctrl = found.robot.joints.standing
    _Servos(found)
    before = _posture(data)
    mujoco.mj_step(found.model, data, nstep=round(SETTLING_TIME / step))
    check_stands(before, _posture(data), name)
    standing: FloatArray = data.qpos.copy()
    standing.setflags(write=False)
    return standing


_one_at_a_time = threading.Lock()


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Inside, what MuJoCo would print and write into a file is collected instead."""
    collected: list[str] = []
    with _one_at_a_time:
        before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda text: collected.append(text.strip().splitlines()[0]))
        try:
            yield collected
        finally:
            mujoco.set_mju_user_warning(before)
