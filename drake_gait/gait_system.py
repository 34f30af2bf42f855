"""The gait as a Drake system: time in, desired joint state out."""

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from drake_gait.gait import FRAME_TIME, FRAMES, JOINTS, FloatArray

# Times that mean a frame's instant miss it by rounding, not by more than this part of a frame.
_FRAME_ROUNDING = 1e-9


def desired_state(commands: FloatArray, time: float) -> FloatArray:
    """Desired angles [rad], then rates [rad/s], at `time` [s]: shape (20,).

    Linear between the frames of `commands`, shape (n, 10), and held after the last one. A frame
    belongs to the interval that it begins.
    """
    frame = min(int(time / FRAME_TIME + _FRAME_ROUNDING), len(commands) - 1)
    start = commands[frame]
    if frame == len(commands) - 1:
        return np.concatenate([start, np.zeros_like(start)])
    rate = (commands[frame + 1] - start) / FRAME_TIME
    return np.concatenate([start + rate * (time - frame * FRAME_TIME), rate])


class GaitSystem(LeafSystem):
    """Sends a walk's joint commands to the servos.

    The commands are a parameter of the context, not of the system, so that one diagram serves every
    gait: `set_commands` writes them.

    Output port:
        desired_state: angles [rad] and rates [rad/s] of gait.JOINTS, size 20, as
        MultibodyPlant.get_desired_state_input_port() takes them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_name("gait")
        standing = np.zeros((FRAMES + 1, len(JOINTS)))
        self._commands = self.DeclareAbstractParameter(AbstractValue.Make(standing))
        self.DeclareVectorOutputPort("desired_state", 2 * len(JOINTS), self._calc_desired_state)

    def set_commands(self, context: Context, commands: FloatArray) -> None:
        """Put joint angles [rad], shape (n, 10), one row a frame, into this system's context."""
        value = AbstractValue.Make(np.array(commands, dtype=float))
        context.get_mutable_abstract_parameter(self._commands).SetFrom(value)

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        parameter: Any = context.get_abstract_parameter(self._commands)
        output.SetFromVector(desired_state(parameter.get_value(), context.get_time()))
