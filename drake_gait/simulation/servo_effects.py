"""Dry friction and play of the servos, which follow the motion and are set before every step.

Friction is a damper. CENIC has no dry friction in joints. A second actuator on a joint does not
help: the solver limits the sum of both torques by one effort limit. Joint damping is implicit, and
is read anew in every step. So each step has the damper that gives the friction at the speed that it
begins with:

    damping = friction / max(|v|, CREEP)

It takes energy at any speed and any step, and brings no chatter. Below CREEP it holds a joint that
creeps. It turns around late by about a step's time: shorter steps, less error.

Play moves the command to where the spring begins to wind up at the angle that a step begins with.
Within its play a joint feels the controller's damping, and in a step of h another h x stiffness.
"""

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, EventStatus

from drake_gait.gait import FloatArray
from drake_gait.servo import CREEP, Servo
from drake_gait.simulation.plant import Robot

Motors = Callable[[Context], FloatArray]
"""Takes a context of the diagram, and returns the torques of the motors [N·m]."""


class DryFriction:
    """Sets the dampers of servos; call `update` before every step."""

    def __init__(
        self, plant: MultibodyPlant, joints: Sequence[str], servo: Servo, motors: Motors
    ) -> None:
        """Take the constants of a finalized plant.

        Args:
            plant: The plant; the damping of its joints is their own, and acts on.
            joints: Names of the n joints with servos.
            servo: The servos.
            motors: Gives their motors' torques, shape (n,); asked where friction knows the load.
        """
        self._plant, self._servo, self._motors = plant, servo, motors
        self._joints = [plant.GetJointByName(name) for name in joints]
        self._speeds = [joint.velocity_start() for joint in self._joints]
        self._own: FloatArray = np.array(
            [joint.default_damping_vector()[0] for joint in self._joints]
        )
        self._idle: FloatArray = np.zeros(len(self._joints))

    def update(self, context: Context) -> EventStatus:
        """Set the dampers for the step that begins in a context of the diagram."""
        plant, servo = self._plant, self._servo
        plant_context = plant.GetMyMutableContextFromRoot(context)
        speeds = plant.GetVelocities(plant_context)[self._speeds]
        motors = self._motors(context) if servo.load_friction else self._idle
        friction = servo.friction_limit(motors) / np.maximum(np.abs(speeds), CREEP)
        for joint, own, added in zip(self._joints, self._own, friction, strict=True):
            damping: FloatArray = np.array([own + added])
            joint.SetDampingVector(plant_context, damping)
        return EventStatus.DidNothing()


Update = Callable[[Context], EventStatus]
"""To be called with a context of the diagram before every step."""


def effects_of(robot: Robot) -> list[Update]:
    """Return what is to be done for a robot's servos before every step, in this order."""
    servo = robot.config.servo
    found: list[Update] = [_play_of(robot)] if servo.backlash else []
    return [*found, _friction_of(robot).update] if servo.has_friction else found


def _play_of(robot: Robot) -> Update:
    plant, gait = robot.plant, robot.gait
    angles = [plant.GetJointByName(name).position_start() for name in robot.joints.names]

    def update(context: Context) -> EventStatus:
        # Not by a port: the cache of the plant's state would lag behind by a step.
        positions = plant.GetPositions(plant.GetMyContextFromRoot(context))
        gait.set_angles(gait.GetMyMutableContextFromRoot(context), positions[angles])
        return EventStatus.DidNothing()

    return update


def _friction_of(robot: Robot) -> DryFriction:
    servo, plant, gait, meter = robot.config.servo, robot.plant, robot.gait, robot.meter
    names = robot.joints.names
    joints = [plant.GetJointByName(name) for name in names]
    angles = [joint.position_start() for joint in joints]
    speeds = [plant.num_positions() + joint.velocity_start() for joint in joints]

    def motors(context: Context) -> FloatArray:
        port = gait.GetOutputPort("desired_state")
        desired = cast(FloatArray, port.Eval(gait.GetMyContextFromRoot(context)))[: len(names)]
        state = plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(context))
        error = desired - state[angles]
        controllers = robot.joints.controller_torque(servo, error, state[speeds], meter.stall)
        return servo.motor_torque(controllers, state[speeds], meter.back_emf)

    return DryFriction(plant, names, servo, motors)
