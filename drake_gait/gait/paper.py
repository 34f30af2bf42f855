"""The gait function: sixteen coefficients to joint angle commands over 4.8 s (paper, III.B)."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.arrays import numbers
from drake_gait.errors import SettingsError
from drake_gait.servo import TRAVEL

# With any shape: the shapes in Drake's stubs are not tuples.
FloatArray = np.ndarray[Any, np.dtype[np.float64]]

FRAME_TIME = 0.02
"""Time between two commands to the servos [s]."""
FRAMES = 240
"""Control frames in one walk: 4.8 s."""
CYCLE_TIME = 1.2
"""Duration of one gait cycle, two steps [s]."""
ANGULAR_VELOCITY = 2.0 * np.pi / CYCLE_TIME  # Eq. 2
"""Angular velocity of the gait function [rad/s]."""

WAVEFORMS = ("roll", "hip", "knee", "ankle")
"""Rows of the coefficients: phi_1 (hip and ankle roll), phi_2, phi_3, phi_4 (pitch)."""
TERMS = ("a", "b", "c", "d")
"""Columns of the coefficients."""

ANGLE_LIMITS: FloatArray = np.radians([(-15.0, 15.0), (-50.0, 50.0), (0.0, 60.0), (-50.0, 50.0)])
"""Ranges of the waveforms [rad], shape (4, 2), rows as WAVEFORMS: the paper's Table I."""

_LEG_JOINTS = ("hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
JOINTS = tuple(f"{joint}_{side}" for side in ("r", "l") for joint in _LEG_JOINTS)
"""The ten actuated joints, in the order of every array of joint values."""

WALKING = (15, 165)
"""Frames in which walking starts and ends: 0.3 and 3.3 s (Eqs. 3-9)."""
_START, _END = WALKING
_STAND = 180  # Frame in which standing begins.
_LEG_PHASE = CYCLE_TIME / 2.0
_NODE_ROLL = np.radians(1.5)
_NODE_PITCH: FloatArray = np.radians([15.0, 30.0, 15.0])  # hip, knee, ankle in mid-swing


class Start(StrEnum):
    """Beginning of a walk; it ends as in the paper."""

    SHIFT = "shift"
    """The weight shifts first: raised cosines from 0 to 0.3 s for the roll, 0.75 s for the legs."""
    RAMP = "ramp"
    """The gait function grows from nothing by a raised cosine, from 0 to 0.9 s."""
    PAPER = "paper"
    """The left leg swings to its node in mid-swing until 0.3 s; then the gait function is whole."""


_GROWTH = {Start.SHIFT: (15, 37.5), Start.RAMP: (45, 45)}
"""Frames in which the gait function grows from nothing: those of the roll, those of the legs."""


def _joint_rows(roll: FloatArray, right: FloatArray, left: FloatArray) -> FloatArray:
    """Order one roll (n,) and two legs' pitch angles (n, 3) as JOINTS, shape (n, 10)."""
    return np.column_stack([roll, right, roll, roll, left, roll])


@dataclass(frozen=True, kw_only=True, eq=False)
class Gait:
    """Sixteen coefficients of the gait function, Eq. 1."""

    coefficients: FloatArray
    """Coefficients [rad], shape (4, 4), rows as WAVEFORMS, columns as TERMS."""

    def __post_init__(self) -> None:
        try:
            values = np.array(self.coefficients, dtype=float)
        except (TypeError, ValueError) as error:
            raise SettingsError(
                f"gait coefficients must be numbers, shape (4, 4): {error}"
            ) from None
        if values.shape != (4, 4):
            raise SettingsError(f"gait coefficients must have shape (4, 4), got {values.shape}")
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            raise SettingsError(
                f"gait coefficients must be finite, got {values[row, column]} for "
                f"{TERMS[column]} of {WAVEFORMS[row]}"
            )
        if np.abs(values).max() > np.pi:
            row, column = np.unravel_index(np.abs(values).argmax(), (4, 4))
            raise SettingsError(
                f"gait coefficients must lie within ±180 degrees, got "
                f"{np.degrees(values[row, column]):g} for {TERMS[column]} of {WAVEFORMS[row]}; "
                "Gait takes radians, Gait.from_degrees degrees"
            )
        values += 0.0  # Equal gaits must have equal bytes to hash: -0.0 becomes 0.0.
        values.setflags(write=False)
        object.__setattr__(self, "coefficients", values)

    @classmethod
    def from_degrees(cls, coefficients: ArrayLike | Sequence[Sequence[float]]) -> "Gait":
        """A gait from coefficients in degrees, shape (4, 4)."""
        try:
            return cls(coefficients=np.radians(np.asarray(coefficients, dtype=float)))
        except (TypeError, ValueError) as error:
            if isinstance(error, SettingsError):
                raise
            raise SettingsError(
                f"gait coefficients must be numbers, shape (4, 4): {error}"
            ) from None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Gait):
            return NotImplemented
        return bool(np.array_equal(self.coefficients, other.coefficients))

    def __hash__(self) -> int:
        return hash(self.coefficients.tobytes())

    @property
    def degrees(self) -> FloatArray:
        """The coefficients [deg], shape (4, 4)."""
        return np.degrees(self.coefficients)

    def waveforms(self, time: ArrayLike) -> FloatArray:
        """The gait function at `time` [s], shape (n,): angles [rad], shape (n, 4), as WAVEFORMS.

        Held inside ANGLE_LIMITS, as a servo's stops do.
        """
        angle = ANGULAR_VELOCITY * np.atleast_1d(np.asarray(time, dtype=float))
        basis = np.stack(
            [np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2.0 * angle)], axis=1
        )
        values = basis @ self.coefficients.T  # Eq. 1
        return np.clip(values, ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])

    def commands_from(self, start: Start) -> FloatArray:
        """Return the commands to the servos after a start, as `commands`, shape (241, 10)."""
        return self.commands if start is Start.PAPER else self._grown_commands[start]

    @cached_property
    def _grown_commands(self) -> dict[Start, FloatArray]:
        frame = np.arange(FRAMES + 1)
        smooth = self._smooth(frame * FRAME_TIME)
        grown = {}
        for start, (of_roll, of_legs) in _GROWTH.items():
            roll, legs = (
                0.5 - 0.5 * np.cos(np.pi * np.minimum(frame / whole, 1.0))
                for whole in (of_roll, of_legs)
            )
            pitch = np.repeat(legs[:, None], 3, axis=1)
            commands = np.array(self.commands)
            commands[:_END] = (_joint_rows(roll, pitch, pitch) * smooth)[:_END]
            commands.setflags(write=False)
            grown[start] = commands
        return grown

    def _smooth(self, time: ArrayLike) -> FloatArray:
        """The gait function on all joints [rad], shape (n, 10), without a schedule."""
        left, right = self.waveforms(time), self.waveforms(np.add(time, _LEG_PHASE))
        return _joint_rows(left[:, 0], right[:, 1:], left[:, 1:])

    @cached_property
    def commands(self) -> FloatArray:
        """Return the commands to the servos by the paper's schedule, frames 0 to 240 (Eqs. 3-9).

        Joint angles [rad], shape (241, 10), columns as JOINTS; frame k is sent at k * FRAME_TIME.
        """
        frame = np.arange(FRAMES + 1)
        time = frame * FRAME_TIME
        walking = (frame > _START) & (frame < _END)

        left_phase = self.waveforms(time)
        right_phase = self.waveforms(time + _LEG_PHASE)
        swing_at_start = np.interp(frame, [0, _START, _START + 1], [0.0, 1.0, 0.0])
        swing_at_end = np.interp(frame, [_END - 1, _END, _STAND], [0.0, 1.0, 0.0])

        # Eq. 3: over the right leg at first, over the left leg at last.
        roll = np.where(walking, left_phase[:, 0], _NODE_ROLL * (swing_at_start - swing_at_end))
        # Eqs. 4-6: the right leg swings once more at the end.
        right = np.where(walking[:, None], right_phase[:, 1:], swing_at_end[:, None] * _NODE_PITCH)
        # Eqs. 7-9: the left leg takes the first step.
        left = np.where(walking[:, None], left_phase[:, 1:], swing_at_start[:, None] * _NODE_PITCH)
        commands = _joint_rows(roll, right, left)
        commands.setflags(write=False)  # They are kept.
        return commands

    def jumps_from(self, start: Start) -> FloatArray:
        """`jumps` of what is sent after a start, shape (2, 10): only the paper's jumps at 0.3 s."""
        sent = [1.0 if start is Start.PAPER else 0.0, 1.0]
        return np.array(sent)[:, None] * self.jumps

    @property
    def jumps(self) -> FloatArray:
        """Return how far the gait function misses the schedule's nodes at 0.3 s and 3.3 s.

        Angles [rad], shape (2, 10), columns as JOINTS. The command covers each in one frame.
        """
        smooth = self._smooth(np.array([_START, _END]) * FRAME_TIME)
        jumps: FloatArray = smooth - self.commands[[_START, _END]]
        return jumps


STANDING = Gait(coefficients=np.zeros((4, 4)))
"""All coefficients zero. Its command still makes the schedule's first and last half step."""


def joint_commands(commands: ArrayLike) -> FloatArray:
    """Check commands that servos are to follow; returns them as an array.

    Args:
        commands: Joint angles [rad], shape (241, 10), columns as JOINTS, one row a frame.

    Raises:
        SettingsError: the shape is another, or an angle is not finite or beyond a servo's travel;
            the text names it, with its frame and joint.
    """
    found = numbers("commands", commands)
    shape = (FRAMES + 1, len(JOINTS))
    if found.shape != shape:
        cure = "; transpose them" if found.shape == shape[::-1] else ""
        raise SettingsError(
            f"commands must be {shape} in shape, one row a frame from 0 to {FRAMES} and one column "
            f"a joint as gait.JOINTS, got {found.shape}{cure}"
        )
    wrong = ~(np.abs(found) <= TRAVEL)  # What is no number too.
    if wrong.any():
        frame, joint = np.argwhere(wrong)[0].tolist()
        raise SettingsError(
            f"commands[{frame}, {joint}], of {JOINTS[joint]} in frame {frame}, is "
            f"{found[frame, joint]:g} rad; a servo turns {TRAVEL:.3f} rad to either side "
            f"({np.degrees(TRAVEL):g} degrees): give finite radians, as numpy.radians(degrees)"
        )
    return found
