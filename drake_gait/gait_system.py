"""The gait as a Drake system: time in, desired joint state out."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_gait.gait import FRAME_TIME, FRAMES, JOINTS, FloatArray


def desired_state(commands: FloatArray, time: float) -> FloatArray:
    """Desired angles [rad], then rates [rad/s], at `time` [s]: shape (20,).

    Angles are linear between the frames of `commands`, shape (n, 10), and held after the last one.
    Rates are zero, because a servo is sent positions only (see `servo.Servo`).
    """
    frame = min(int(time / FRAME_TIME), len(commands) - 2)
    progress = min(time / FRAME_TIME - frame, 1.0)
    angles = commands[frame] + progress * (commands[frame + 1] - commands[frame])
    return np.concatenate([angles, np.zeros_like(angles)])


class GaitSystem(LeafSystem):
    """Sends a walk's joint commands to the servos.

    The commands are a parameter of the context, not of the system, so that one diagram serves every
    gait: `set_commands` writes them.

    Output port:
        desired_state: angles [rad] and zero rates of gait.JOINTS, size 20, as
        MultibodyPlant.get_desired_state_input_port() takes them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_name("gait")
        standing = np.zeros((FRAMES + 1, len(JOINTS)))
        self._commands = self.DeclareAbstractParameter(AbstractValue.Make(standing))
        no_lead: FloatArray = np.zeros(1)
        self._lead = self.DeclareNumericParameter(BasicVector(no_lead))
        self.DeclareVectorOutputPort("desired_state", 2 * len(JOINTS), self._calc_desired_state)

    def set_commands(self, context: Context, commands: FloatArray, *, lead: float = 0.0) -> None:
        """Put commands into this system's context.

        Args:
            context: The context of this system.
            commands: Joint angles [rad], shape (n, 10), one row a frame.
            lead: How far ahead they are read [s], see `walk.Integrator.lead`.
        """
        value = AbstractValue.Make(np.array(commands, dtype=float))
        context.get_mutable_abstract_parameter(self._commands).SetFrom(value)
        context.get_mutable_numeric_parameter(self._lead).SetAtIndex(0, lead)

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        parameter: Any = context.get_abstract_parameter(self._commands)
        lead = context.get_numeric_parameter(self._lead).GetAtIndex(0)
        output.SetFromVector(desired_state(parameter.get_value(), context.get_time() + lead))
