"""The paper's family: sixteen coefficients of Eq. 1, and its schedule (paper, III.B)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.errors import SettingsError
from drake_gait.gait.family import (
    AnyGait,
    GaitFamily,
    Schedule,
    Variable,
    frames_of,
    raised_cosine,
    setting,
)
from drake_gait.gait.joints import ANGLE_LIMITS, FRAME_TIME, WAVEFORMS, FloatArray, joint_rows

TERMS = ("a", "b", "c", "d")
"""Columns of the coefficients."""
COEFFICIENTS = tuple(f"{waveform}_{term}" for waveform in WAVEFORMS for term in TERMS)
"""Names of the sixteen coefficients, in the order of every design vector."""

_NODE_ROLL = np.radians(1.5)
_NODE_PITCH: FloatArray = np.radians([15.0, 30.0, 15.0])  # hip, knee, ankle in mid-swing


class Start(StrEnum):
    """Beginning of a walk."""

    SHIFT = "shift"
    """The weight shifts first: raised cosines from 0 to 0.3 s for the roll, 0.75 s for the legs."""
    RAMP = "ramp"
    """The gait function grows from nothing by a raised cosine, from 0 to 0.9 s."""
    PAPER = "paper"
    """The left leg swings to its node in mid-swing until 0.3 s; then the gait function is whole."""


_GROWTH = {Start.SHIFT: (0.25, 0.625), Start.RAMP: (0.75, 0.75)}
"""Parts of a cycle in which the gait function grows from nothing: of the roll, of the legs."""


class Stop(StrEnum):
    """End of a walk."""

    PAPER = "paper"
    """The right leg swings to its node in mid-swing at 3.3 s, and the robot stands at 3.6 s."""
    SETTLE = "settle"
    """The gait function shrinks by raised cosines until 4.2 s: the roll from 3.3 s on, the legs
    from 3.45 s on. Then the legs' mean angles do, until 4.8 s."""


_SHRINKING = {"roll": (-0.25, 0.5), "legs": (-0.125, 0.5), "mean": (0.5, 1.0)}
"""Parts of a cycle from the last one's end on in which a settling walk shrinks to standing."""


def coefficient_limits() -> FloatArray:
    """Smallest and largest coefficients [rad], shape (4, 4, 2), that Table I leaves room for.

    The mean a may be any angle of the joint's range, an amplitude at most half of the range.
    """
    lower, upper = ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1]
    amplitude = np.tile(((upper - lower) / 2.0)[:, None], (1, 3))
    return np.stack(
        [np.column_stack([lower, -amplitude]), np.column_stack([upper, amplitude])], axis=-1
    )


_VARIABLES = tuple(
    Variable(name, lower=low, upper=high)
    for name, (low, high) in zip(
        COEFFICIENTS, coefficient_limits().reshape(-1, 2).tolist(), strict=True
    )
)


@dataclass(frozen=True, kw_only=True)
class PaperFamily(GaitFamily):
    """The paper's family: Eq. 1 for every waveform, between the nodes of Eqs. 3-9."""

    name: ClassVar[str] = "paper"

    stop: str = setting(Stop.PAPER.value)
    """End of a walk: "paper" or "settle", see `Stop`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stop not in list(Stop):
            raise SettingsError(
                f"stop of the gait family {self.label} must be one of {', '.join(Stop)}, got "
                f"'{self.stop}'"
            )
        if self.stop == Stop.SETTLE and self.standing < self.period:
            raise SettingsError(
                f"standing of the gait family {self.label} must be at least the period, "
                f'{self.period:g} s, with stop = "{Stop.SETTLE}", got {self.standing:g}; the walk '
                "ends in that time"
            )

    @property
    def variables(self) -> Sequence[Variable]:
        """The sixteen coefficients."""
        return _VARIABLES

    def schedule(self, x: FloatArray) -> Schedule:
        """Return the frames of Eqs. 3-9, whatever the coefficients.

        Walking begins at a node after a quarter of a cycle, and ends at one a quarter of a cycle
        before the last cycle does.
        """
        last = frames_of(self.cycles * self.period)
        return Schedule(
            period=self.period,
            begin=frames_of(self.period / 4.0),
            end=frames_of((self.cycles - 0.25) * self.period),
            frames=last + frames_of(self.standing),
        )

    def gait(self, x: ArrayLike) -> "Gait":
        """Return the gait of sixteen coefficients [rad], shape (16,)."""
        return Gait(coefficients=np.reshape(np.asarray(x, dtype=float), (4, 4)), family=self)

    def commands(self, x: FloatArray) -> FloatArray:
        """Return the commands by the paper's schedule, see `Gait.commands`."""
        return self.gait(x).commands


PAPER = PaperFamily()
"""The paper's family with its own period, cycles and standing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gait(AnyGait):
    """Sixteen coefficients of the gait function, Eq. 1."""

    coefficients: FloatArray
    """Coefficients [rad], shape (4, 4), rows as WAVEFORMS, columns as TERMS."""
    family: PaperFamily = field(default=PAPER)
    """The paper's, with its settings."""

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

    @property
    def variables(self) -> FloatArray:
        """The coefficients [rad], shape (16,), ordered as COEFFICIENTS."""
        return self.coefficients.ravel()

    def moved(self, by: FloatArray) -> "Gait":
        """Return a gait whose coefficients differ by so much [rad], shape (16,)."""
        return Gait(coefficients=self.coefficients + np.reshape(by, (4, 4)), family=self.family)

    @property
    def degrees(self) -> FloatArray:
        """The coefficients [deg], shape (4, 4)."""
        return np.degrees(self.coefficients)

    def waveforms(self, time: ArrayLike) -> FloatArray:
        """The gait function at `time` [s], shape (n,): angles [rad], shape (n, 4), as WAVEFORMS.

        Held inside ANGLE_LIMITS, as a servo's stops do.
        """
        angular_velocity = 2.0 * np.pi / self.family.period  # Eq. 2
        angle = angular_velocity * np.atleast_1d(np.asarray(time, dtype=float))
        basis = np.stack(
            [np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2.0 * angle)], axis=1
        )
        values = basis @ self.coefficients.T  # Eq. 1
        return np.clip(values, ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])

    def commands_from(self, start: Start) -> FloatArray:
        """Return the commands to the servos after a start, as `commands`, shape (241, 10)."""
        return self.commands if start is Start.PAPER else self._grown_commands[start]

    def _settled(self, commands: FloatArray, roll: FloatArray, legs: FloatArray) -> FloatArray:
        """Return commands whose end settles.

        Args:
            commands: Commands that begin as they are to, shape (frames + 1, 10).
            roll: Growth of the roll, shape (frames + 1,).
            legs: Growth of the legs, shape (frames + 1,).
        """
        family, frame = self.family, np.arange(self.frames + 1)
        cycles = frame * FRAME_TIME / family.period - family.cycles
        left = {
            part: 1.0 - raised_cosine((cycles - begin) / (end - begin))
            for part, (begin, end) in _SHRINKING.items()
        }
        # Held inside the ranges too, so that what lies between it and the waveforms is.
        mean = np.clip(self.coefficients[None, :, 0], *ANGLE_LIMITS.T)
        means = joint_rows(np.zeros(1), mean[:, 1:], mean[:, 1:])
        swing = np.repeat((legs * left["legs"])[:, None], 3, axis=1)
        settled = (
            joint_rows(roll * left["roll"], swing, swing)
            * (self._smooth(frame * FRAME_TIME) - means)
            + means * (legs * left["mean"])[:, None]
        )
        # Until then all factors are 1.
        return np.where((frame < self.schedule.end)[:, None], commands, settled)

    @cached_property
    def _grown_commands(self) -> dict[Start, FloatArray]:
        frame, end = np.arange(self.frames + 1), self.schedule.end
        cycle = round(self.family.period / FRAME_TIME, 6)  # frames
        smooth = self._smooth(frame * FRAME_TIME)
        grown = {}
        for start, parts in _GROWTH.items():
            roll, legs = (raised_cosine(frame / (part * cycle)) for part in parts)
            pitch = np.repeat(legs[:, None], 3, axis=1)
            commands = np.array(self.commands)
            commands[:end] = (joint_rows(roll, pitch, pitch) * smooth)[:end]
            if self.family.stop == Stop.SETTLE:
                commands = self._settled(commands, roll, legs)
            commands.setflags(write=False)
            grown[start] = commands
        return grown

    def _smooth(self, time: ArrayLike) -> FloatArray:
        """The gait function on all joints [rad], shape (n, 10), without a schedule."""
        left = self.waveforms(time)
        right = self.waveforms(np.add(time, self.family.period / 2.0))
        return joint_rows(left[:, 0], right[:, 1:], left[:, 1:])

    @cached_property
    def commands(self) -> FloatArray:
        """Return the commands to the servos by the paper's schedule (Eqs. 3-9), or as they settle.

        Joint angles [rad], shape (241, 10) at the paper's period, columns as JOINTS; frame k is
        sent at k * FRAME_TIME.
        """
        begin, end = self.walking
        stand = frames_of(self.family.cycles * self.family.period)
        frame = np.arange(self.frames + 1)
        time = frame * FRAME_TIME
        walking = (frame > begin) & (frame < end)

        left_phase = self.waveforms(time)
        right_phase = self.waveforms(time + self.family.period / 2.0)
        swing_at_start = np.interp(frame, [0, begin, begin + 1], [0.0, 1.0, 0.0])
        swing_at_end = np.interp(frame, [end - 1, end, stand], [0.0, 1.0, 0.0])

        # Eq. 3: over the right leg at first, over the left leg at last.
        roll = np.where(walking, left_phase[:, 0], _NODE_ROLL * (swing_at_start - swing_at_end))
        # Eqs. 4-6: the right leg swings once more at the end.
        right = np.where(walking[:, None], right_phase[:, 1:], swing_at_end[:, None] * _NODE_PITCH)
        # Eqs. 7-9: the left leg takes the first step.
        left = np.where(walking[:, None], left_phase[:, 1:], swing_at_start[:, None] * _NODE_PITCH)
        commands = joint_rows(roll, right, left)
        if self.family.stop == Stop.SETTLE:
            whole: FloatArray = np.ones(len(frame))
            commands = self._settled(commands, whole, whole)
        commands.setflags(write=False)  # They are kept.
        return commands

    def jumps_from(self, start: Start) -> FloatArray:
        """`jumps` of what is sent after a start, shape (2, 10): only the paper's at the first."""
        settles = self.family.stop == Stop.SETTLE
        sent = [1.0 if start is Start.PAPER else 0.0, 0.0 if settles else 1.0]
        return np.array(sent)[:, None] * self.jumps

    @property
    def jumps(self) -> FloatArray:
        """Return how far the gait function misses the schedule's nodes, at 0.3 s and 3.3 s.

        Angles [rad], shape (2, 10), columns as JOINTS. The command covers each in one frame.
        """
        nodes = list(self.walking)
        smooth = self._smooth(np.array(nodes) * FRAME_TIME)
        jumps: FloatArray = smooth - self.commands[nodes]
        return jumps


STANDING = Gait(coefficients=np.zeros((4, 4)))
"""All coefficients zero. Its command still makes the schedule's first and last half step."""

CYCLE_TIME = PAPER.period
"""Duration of the paper's gait cycle, two steps [s]."""
ANGULAR_VELOCITY = 2.0 * np.pi / CYCLE_TIME  # Eq. 2
"""Angular velocity of the paper's gait function [rad/s]."""
FRAMES = STANDING.frames
"""Control frames in the paper's walk: 4.8 s."""
WALKING = STANDING.walking
"""Frames in which the paper's walking starts and ends: 0.3 and 3.3 s (Eqs. 3-9)."""


def schedule_of(frames: int) -> Schedule:
    """Return the schedule of commands of which only the number of frames is known.

    As many as the paper's have its schedule; others are walked from end to end.
    """
    if frames == FRAMES:
        return STANDING.schedule
    return Schedule(period=PAPER.period, begin=0, end=frames, frames=frames)
