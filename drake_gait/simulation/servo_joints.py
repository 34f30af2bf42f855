"""The joints of a robot that have servos, and what a gait's ten roles mean to them."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator

from drake_gait.gait import JOINTS, FloatArray
from drake_gait.robot.robot_file import RobotFile
from drake_gait.servo import Servo


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoJoints:
    """The m joints with servos, in the order of their commands."""

    names: tuple[str, ...]
    """Their names."""
    roles: tuple[int, ...]
    """Number of each joint's role among `gait.JOINTS`; -1: it holds the standing pose."""
    signs: FloatArray
    """1 or -1 for each joint, 0 for those without a role, shape (m,)."""
    standing: FloatArray
    """Angle of each in the standing pose [rad], shape (m,)."""

    stiffness: FloatArray
    """Factor of each joint's servo on the stiffness of the walk's servos, shape (m,)."""
    damping: FloatArray
    """Factor of each on their damping, shape (m,)."""
    no_load_speed: FloatArray
    """Factor of each on their no-load speed, shape (m,)."""

    def controller_torque(
        self, servo: Servo, error: FloatArray, speed: FloatArray, stall: FloatArray
    ) -> FloatArray:
        """Return the torque that each controller asks of its motor [N·m].

        Args:
            servo: The walk's servos.
            error: What winds up their springs, see `Servo.engaged` [rad], shape (m,) or (m, n).
            speed: Speed of each joint [rad/s], the same shape.
            stall: Stall torque of each [N·m], shape (m,).
        """
        shape = (-1, *(1,) * (error.ndim - 1))
        stiffness, damping, most = (
            one.reshape(shape) for one in (self.stiffness, self.damping, stall)
        )
        return servo.controller_torque(stiffness * error, damping * speed, most)

    def back_emf(self, servo: Servo, stall: FloatArray, supply: float) -> FloatArray:
        """Return the torque that each motor loses for each rad/s [N·m·s/rad], shape (m,)."""
        return servo.back_emf(stall / self.no_load_speed, supply)

    def sent(self, commands: FloatArray) -> FloatArray:
        """Return what servos are sent for a gait's angles.

        Args:
            commands: Angles of the roles [rad], shape (n, 10), columns as `gait.JOINTS`.

        Returns:
            Angles of the joints [rad], shape (n, m).
        """
        sent: FloatArray = commands[:, self.roles] * self.signs
        return sent + self.standing if self.standing.any() else sent

    def by_role(self, values: FloatArray, *, angles: bool = False) -> FloatArray:
        """Return values of the joints in the signs of the roles.

        Args:
            values: Of the joints, shape (..., m).
            angles: Whether they are angles, which a gait counts from the standing pose.

        Returns:
            Of the roles, shape (..., 10), ordered as `gait.JOINTS`; NaN without a joint.
        """
        found: FloatArray = np.full((*values.shape[:-1], len(JOINTS)), np.nan)
        if angles and self.standing.any():
            values = values - self.standing
        for joint, role in enumerate(self.roles):
            if role >= 0:
                found[..., role] = self.signs[joint] * values[..., joint]
        return found

    def limits_by_role(self, limits: FloatArray) -> FloatArray:
        """Return sizes that have no sign, shape (m,), of the roles, shape (10,)."""
        return np.abs(self.by_role(limits))


def actuators(plant: MultibodyPlant) -> list[JointActuator]:
    """Return the servos of a plant, in the order of their commands."""
    return [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]


def servo_joints(plant: MultibodyPlant, robot: RobotFile) -> ServoJoints:
    """Return the joints of a plant that have servos."""
    names = tuple(actuator.joint().name() for actuator in actuators(plant))
    known = {name: role for role, name in enumerate(robot.joints) if name is not None}
    roles = tuple(known.get(name, -1) for name in names)
    standing = dict(robot.standing or ())
    groups = [robot.group_of(name) for name in names]
    signs = [robot.signs[role] if role >= 0 else 0 for role in roles]
    return ServoJoints(
        names=names,
        roles=roles,
        signs=np.array(signs, dtype=float),
        standing=np.array([standing.get(name, 0.0) for name in names]),
        stiffness=np.array([one.stiffness for one in groups]),
        damping=np.array([one.damping for one in groups]),
        no_load_speed=np.array([one.no_load_speed for one in groups]),
    )


def toe_positions(plant: MultibodyPlant, robot: RobotFile) -> dict[int, int]:
    """Return where the angle of each toe is among the positions, by its number in `hinges`.

    Toes that are rigid have none.
    """
    found = {}
    for number, name in enumerate(robot.hinges):
        if name is not None and (joint := plant.GetJointByName(name)).num_positions():
            found[number] = joint.position_start()
    return found
