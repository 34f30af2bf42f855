"""The gait as a Drake system: time in, desired joint state out."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_gait.gait import FRAME_TIME, JOINTS, FloatArray
from drake_gait.servo import Servo


def desired_state(commands: FloatArray, time: float) -> FloatArray:
    """Desired angles [rad], then rates [rad/s], at `time` [s]: shape (20,).

    Angles are linear between the frames of `commands`, shape (n, 10), and held before the first and
    after the last one.
    Rates are zero, because a servo is sent positions only (see `servo.Servo`).
    """
    return _between_frames(_with_rates(commands), time)


def commands_at(commands: FloatArray, time: FloatArray) -> FloatArray:
    """Commands [rad] at many instants [s], shape (k,): shape (k, 10); see `desired_state`."""
    frames = np.arange(len(commands)) * FRAME_TIME
    columns = [np.interp(time, frames, column) for column in commands.T]
    return np.column_stack(columns)


def _with_rates(commands: FloatArray) -> FloatArray:
    """Commands followed by zero rates, shape (n, 20)."""
    return np.hstack([commands, np.zeros_like(commands)])


def _between_frames(states: FloatArray, time: float) -> FloatArray:
    """Rows of `states`, shape (n, k), interpolated at `time` [s]: shape (k,)."""
    time = max(time, 0.0)  # Delayed commands begin later.
    frame = min(int(time / FRAME_TIME), len(states) - 2)
    progress = min(time / FRAME_TIME - frame, 1.0)
    start = states[frame]
    state: FloatArray = start + progress * (states[frame + 1] - start)
    return state


class GaitSystem(LeafSystem):
    """Sends a walk's joint commands to the servos.

    The commands are a parameter of the context, not of the system, so that one diagram serves every
    gait: `set_commands` writes them.

    Output port:
        desired_state: angles [rad] and zero rates of the joints with servos, by default 10, as
        MultibodyPlant.get_desired_state_input_port() takes them.
    """

    def __init__(self, servo: Servo | None = None, joints: int = len(JOINTS)) -> None:
        """Declare the port, for servos whose play lets the joints be; by default without play."""
        super().__init__()
        self._servo, self._joints = servo or Servo(), joints
        nowhere: FloatArray = np.zeros(joints)
        self._angles = self.DeclareNumericParameter(BasicVector(nowhere))
        self.set_name("gait")
        # One parameter and full rows: this port is asked in every step of a walk.
        standing = np.zeros((2, 2 * joints)), 0.0
        self._sent = self.DeclareAbstractParameter(AbstractValue.Make(standing))
        self.DeclareVectorOutputPort("desired_state", 2 * joints, self._calc_desired_state)

    def set_commands(self, context: Context, commands: FloatArray, *, lead: float = 0.0) -> None:
        """Put commands into this system's context.

        Args:
            context: The context of this system.
            commands: Joint angles [rad], shape (n, 10), one row a frame.
            lead: How far ahead they are read [s], see `walk.Integrator.lead`; less than 0 where
                they are late.
        """
        value = AbstractValue.Make((_with_rates(np.asarray(commands, dtype=float)), lead))
        context.get_mutable_abstract_parameter(self._sent).SetFrom(value)

    def set_angles(self, context: Context, angles: FloatArray) -> None:
        """Put the joints' angles [rad], shape (10,), into this system's context, for its play."""
        context.get_mutable_numeric_parameter(self._angles).SetFromVector(angles)

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        parameter: Any = context.get_abstract_parameter(self._sent)
        states, lead = parameter.get_value()
        desired = _between_frames(states, context.get_time() + lead)
        if self._servo.backlash:
            # The spring sees what is left of the error beyond the play.
            angles = context.get_numeric_parameter(self._angles).value()
            asked = desired[: self._joints]
            desired[: self._joints] = angles + self._servo.engaged(asked - angles)
        output.SetFromVector(desired)
