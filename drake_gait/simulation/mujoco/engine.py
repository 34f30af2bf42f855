"""One walk in MuJoCo: step the model of a robot frame by frame, return what it left behind."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco
import numpy as np
from pydrake.systems.framework import Context

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FRAMES, FloatArray
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.robot.sdf import BASE, FOOT_LINKS, SIDES
from drake_gait.servo import Servo
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.mujoco.model import GROUND, mjcf
from drake_gait.simulation.observer import Observer, Touch
from drake_gait.simulation.plant import Robot, build_robot
from drake_gait.simulation.posture import (
    SETTLING_TIME,
    Posture,
    check_stands,
    first_fall,
    torso_posture,
    walk_of,
)
from drake_gait.simulation.stance import check_placed, check_toes
from drake_gait.sole import Contact, Sole
from drake_gait.walk import Disturbance, Outcome, Walk, WalkSettings


@dataclass(frozen=True, kw_only=True, eq=False)
class _Model:
    """A robot in MuJoCo, and the same robot in Drake, which knows its kinematics."""

    robot: Robot
    """The diagram that it was written from; nothing steps it."""
    context: Context
    """A context of the diagram, with the foot and the masses."""
    model: mujoco.MjModel
    """The model."""
    positions: FloatArray
    """Where MuJoCo's positions are among Drake's, shape (n,)."""
    velocities: FloatArray
    """Where MuJoCo's velocities are among Drake's, shape (m,)."""

    def show(self, time: float, qpos: FloatArray, qvel: FloatArray) -> Context:
        """Put a state of MuJoCo's into the context of Drake's diagram."""
        plant = self.robot.plant
        plant_context = plant.GetMyMutableContextFromRoot(self.context)
        self.context.SetTime(time)
        plant.SetPositions(plant_context, qpos[self.positions])
        # A free body turns in its own axes in MuJoCo, and in the world's in Drake.
        turned: FloatArray = qvel.copy()
        rotation: FloatArray = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, qpos[3:7])
        turned[3:6] = rotation.reshape(3, 3) @ qvel[3:6]
        plant.SetVelocities(plant_context, turned[self.velocities])
        return self.context

    def centre_of_mass(self, qpos: FloatArray) -> FloatArray:
        """Return p_WC [m], shape (3,), at positions of MuJoCo's."""
        context = self.show(0.0, qpos, np.zeros(self.model.nv))
        plant = self.robot.plant
        plant_context = plant.GetMyContextFromRoot(context)
        centre: FloatArray = plant.CalcCenterOfMassPositionInWorld(plant_context)
        return centre


class _Observer(Observer):
    """An observer of a walk whose forces on the ground are MuJoCo's."""

    def __init__(self, found: _Model, data: mujoco.MjData, commands: FloatArray) -> None:
        super().__init__(found.robot, commands)
        self._model, self._data = found.model, data
        plant = found.robot.plant
        feet = {f"{link}_{side}": foot for foot, side in enumerate(SIDES) for link in FOOT_LINKS}
        owners = [found.model.body(number).name for number in found.model.geom_bodyid]
        self._owners = {
            geom: (feet[name], plant.GetBodyByName(name))
            for geom, name in enumerate(owners)
            if name in feet
        }
        self._floor = found.model.geom(GROUND).id

    def _contacts(self, plant_context: Context) -> list[Touch]:
        """Where feet touch the ground, in the step that was made last."""
        touches = []
        wrench: FloatArray = np.zeros(6)
        for number, contact in enumerate(self._data.contact):
            one, other = contact.geom.tolist()
            sign, foot_geom = (1.0, other) if one == self._floor else (-1.0, one)
            if self._floor not in (one, other) or foot_geom not in self._owners:
                continue
            mujoco.mj_contactForce(self._model, self._data, number, wrench)
            # Rows of the frame are its axes; the force is on the second shape.
            force = sign * (contact.frame.reshape(3, 3).T @ wrench[:3])
            foot, body = self._owners[foot_geom]
            touches.append(Touch(foot=foot, body=body, force=force, place=contact.pos.copy()))
        return touches


def follow(
    commands: FloatArray,
    foot: FootDesign,
    settings: WalkSettings,
    *,
    observed: bool = False,
    watch: Callable[[float, FloatArray], None] | None = None,
    frames: int = FRAMES,
) -> Walk:
    """Let the servos follow joint commands from a standing start.

    Args:
        commands: Joint angles [rad], shape (241, 10), columns as gait.JOINTS, one row a frame.
        foot: The toes.
        settings: How to simulate.
        observed: Whether to record time histories and measures.
        watch: Told of every frame as it is reached.
        frames: How many to walk.

    Raises:
        ModelError: the robot description cannot be used, or not in MuJoCo.
    """
    changed = settings.disturbance or Disturbance()
    name, step = read_model(settings.model), settings.stepping.step
    ground = settings.sole, settings.contact
    found = _model(
        name, foot, settings.servo, *ground, step, settings.friction, changed.voltage, changed.mass
    )
    data = mujoco.MjData(found.model)
    data.qpos[:] = _standing(name, settings.servo, *ground, step, rigid_toes=foot.rigid_toes)
    sent = _in_steps(commands + np.array(changed.joint_zeros), step)
    observer = _Observer(found, data, commands) if observed else None
    with _warnings() as warnings:
        return _advance(found, data, sent, settings, observer, watch, frames, warnings)


def _advance(
    found: _Model,
    data: mujoco.MjData,
    sent: FloatArray,
    settings: WalkSettings,
    observer: _Observer | None,
    watch: Callable[[float, FloatArray], None] | None,
    frames: int,
    warnings: list[str],
) -> Walk:
    """Step through the frames until the end, a fall or a failure."""
    # Computing time: a busy machine changes no walk.
    deadline = time.thread_time() + settings.time_limit
    start = data.qpos.copy()
    postures, fall = [_posture(data)], None
    for frame in range(1, frames + 1):
        for number, command in enumerate(sent[frame - 1]):
            state = (data.time, data.qpos.copy(), data.qvel.copy()) if observer else None
            data.ctrl = command
            mujoco.mj_step(found.model, data)
            if observer and state:  # Forces in the data are those of the step's beginning.
                context = found.show(*state)
                observer.monitor(context)
                if number == 0:
                    observer.record(context)
        postures.append(_posture(data))
        if watch:
            watch(frame * FRAME_TIME, data.qpos[found.positions])
        fall = first_fall(postures, frame)
        if warnings or fall is not None:
            break
        if time.thread_time() > deadline:
            return Walk.diverged(f"took longer than {settings.time_limit:g} s", steps=frame)
    if warnings:
        return Walk.diverged(f"solver: {warnings[0]}", steps=len(postures) - 2)
    centres = [found.centre_of_mass(qpos) for qpos in (start, data.qpos)]
    walk = walk_of(postures, centres, fall, frames)
    if not observer or walk.outcome is Outcome.DIVERGED:
        return walk
    mujoco.mj_forward(found.model, data)
    context = found.show(data.time, data.qpos, data.qvel)
    observer.monitor(context)
    observer.record(context)
    history = observer.history()
    measures = observer.measures(history, walk.forward, walk.yaw_swing or 0.0)
    return replace(walk, history=history, measures=measures)


def _posture(data: mujoco.MjData) -> Posture:
    """Return the posture of the torso."""
    place, quaternion = data.qpos[:3], data.qpos[3:7]
    return torso_posture(np.concatenate([quaternion, place]))


def _in_steps(commands: FloatArray, step: float) -> FloatArray:
    """Return what the servos follow in each step [rad], shape (frames, steps, 10).

    Linear between the frames of `commands`, shape (n, 10), as `command_source.desired_state`.
    """
    steps = round(FRAME_TIME / step)
    progress = np.arange(steps)[:, None] / steps
    sent: FloatArray = commands[:-1, None] + progress * np.diff(commands, axis=0)[:, None]
    return sent


@lru_cache(maxsize=8)
def _model(
    name: RobotModel,
    foot: FootDesign,
    servo: Servo,
    sole: Sole,
    contact: Contact | None,
    step: float,
    friction: float = 1.0,
    voltage: float = 1.0,
    mass: float = 1.0,
) -> _Model:
    """One model serves every gait on a foot."""
    robot = build_robot(name, foot, servo, friction=friction, sole=sole, contact=contact)
    robot.scale_stall_torques(voltage)
    context = default_context(robot.diagram)
    plant = robot.plant
    plant_context = plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    robot.scale_masses(plant_context, mass)
    try:
        model = mujoco.MjModel.from_xml_string(mjcf(robot, plant_context, step))
    except ModelError as error:
        raise ModelError(f"{name}{error}") from None
    except ValueError as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelError(
            f"{name}: MuJoCo refuses the robot: {reason}; mend the file, or let walk.engine be "
            "'drake'"
        ) from None
    torso = plant.GetBodyByName(BASE)
    first, first_speed = torso.floating_positions_start(), torso.floating_velocities_start_in_v()
    positions = np.empty(plant.num_positions(), dtype=int)
    velocities = np.empty(plant.num_velocities(), dtype=int)
    positions[first : first + 7] = [3, 4, 5, 6, 0, 1, 2]
    velocities[first_speed : first_speed + 6] = [3, 4, 5, 0, 1, 2]
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        if joint.num_positions() == 1:
            positions[joint.position_start()] = model.joint(joint.name()).qposadr[0]
            velocities[joint.velocity_start()] = model.joint(joint.name()).dofadr[0]
    return _Model(
        robot=robot, context=context, model=model, positions=positions, velocities=velocities
    )


@lru_cache(maxsize=4)
def _standing(
    name: RobotModel, servo: Servo, sole: Sole, contact: Contact | None, step: float, *,
    rigid_toes: bool,
) -> FloatArray:  # fmt: skip
    """Return the positions in MuJoCo of the robot at rest on the paper's feet.

    As in Drake, every foot starts its walk from them.
    """
    found = _model(name, FootDesign(rigid_toes=rigid_toes), servo, sole, contact, step)
    plant = found.robot.plant
    default = default_context(found.robot.diagram)
    plant_context = plant.GetMyContextFromRoot(default)
    check_placed(found.robot, plant_context, name)
    check_toes(name)
    data = mujoco.MjData(found.model)
    data.qpos[found.positions] = plant.GetPositions(plant_context)
    before = _posture(data)
    with _warnings() as warnings:
        mujoco.mj_step(found.model, data, nstep=round(SETTLING_TIME / step))
    if warnings:
        raise ModelError(f"{name}: the robot cannot be stood up in MuJoCo: {warnings[0]}")
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
