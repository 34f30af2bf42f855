"""The general family: Fourier series of any length, with period and duty as variables."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

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
from drake_gait.gait.paper import Gait
from drake_gait.ranges import NONE, SECONDS

MID_SWING = 0.25
"""Phase at which a leg is in the middle of its swing: the left one is there at 0.3 s in Eq. 1."""


@dataclass(frozen=True, kw_only=True)
class Blending(GaitFamily):
    """Base of families whose waveforms grow from standing and shrink to it again.

    At the start the roll grows first, so that the weight shifts before the left leg swings. The
    factors are raised cosines.
    """

    walking: float = setting(0.0, SECONDS, lower=0.0, upper=60.0)
    """Time of walking [s], which then does not depend on the period; 0: `cycles` gait cycles."""
    start_roll: float = setting(0.25, lower=0.01, upper=10.0)
    """Part of a cycle in which the roll grows."""
    start_legs: float = setting(0.625, lower=0.01, upper=10.0)
    """Part of a cycle in which the other joints' angles grow."""
    stop_roll: float = setting(0.5, lower=0.01, upper=10.0)
    """Part of a cycle in which the roll shrinks at the end."""
    stop_legs: float = setting(0.625, lower=0.01, upper=10.0)
    """Part of a cycle in which the other joints' angles shrink."""

    def schedule(self, x: FloatArray) -> Schedule:
        """Return the frames of a gait: walking from frame 0 on, then standing."""
        period = self.period_of(x)
        end = frames_of(self.walking or self.cycles * period)
        return Schedule(period=period, begin=0, end=end, frames=end + frames_of(self.standing))

    def factors(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the factors on the roll and on the other angles, shape (frames + 1,) each."""
        schedule = self.schedule(x)
        time = self.times(x)
        end = schedule.end * FRAME_TIME
        roll, legs = (
            raised_cosine(time / (start * schedule.period))
            * raised_cosine((end - time) / (stop * schedule.period))
            for start, stop in (
                (self.start_roll, self.stop_roll),
                (self.start_legs, self.stop_legs),
            )
        )
        return roll, legs


@dataclass(frozen=True, kw_only=True)
class Harmonics(Blending):
    """The general family: a mean and harmonics of sine and cosine for every waveform.

    Eq. 1 is the special case with two harmonics, no second sine, and duty 0.5.
    """

    name: ClassVar[str] = "harmonics"

    harmonics: int = setting(2, lower=1, upper=8)
    """Harmonics of every waveform."""
    duty: float = setting(0.5, lower=0.3, upper=0.7)
    """Share of the cycle that a leg spends in its stance, where no variable says it."""
    asymmetric: bool = setting(default=False)
    """Whether the legs may differ: variables for right minus left."""

    @cached_property
    def _variables(self) -> tuple[Variable, ...]:
        waveforms = [
            Variable(f"{name}_{term}", lower=low, upper=high, default=default)
            for name in WAVEFORMS
            for term, low, high, default in self._terms(name)
        ]
        differences = [
            Variable(f"{one.name}_difference", lower=one.lower, upper=one.upper, default=0.0)
            for one in waveforms[1 + 2 * self.harmonics :]
            if self.asymmetric
        ]
        manner = [
            Variable("duty", NONE, lower=0.3, upper=0.7, default=self.duty),
            Variable("period", SECONDS, lower=0.3, upper=10.0, default=self.period),
        ]
        return (*waveforms, *differences, *manner)

    def _terms(self, waveform: str) -> list[tuple[str, float, float, float | None]]:
        """Return names, limits and defaults of a waveform's terms, as Table I leaves room."""
        lower, upper = ANGLE_LIMITS[WAVEFORMS.index(waveform)].tolist()
        most = (upper - lower) / 2.0
        found: list[tuple[str, float, float, float | None]] = [("mean", lower, upper, None)]
        for number in range(1, self.harmonics + 1):
            default = None if number == 1 else 0.0
            found += [(f"{term}{number}", -most, most, default) for term in ("cos", "sin")]
        return found

    @property
    def variables(self) -> Sequence[Variable]:
        """Terms of the waveforms, differences of the legs, duty and period."""
        return self._variables

    def period_of(self, x: FloatArray) -> float:
        """Return the gait cycle [s]."""
        return float(x[-1])

    def waveforms(self, x: FloatArray, time: ArrayLike) -> FloatArray:
        """Return the waveforms of the left leg without blending.

        Args:
            x: Values of the variables [SI].
            time: Instants [s], shape (k,).

        Returns:
            Angles [rad], shape (k, 4), columns as WAVEFORMS, inside their ranges.
        """
        phase = np.atleast_1d(np.asarray(time, dtype=float)) / self.period_of(x)
        roll = self._series(x, phase)[:, :1]
        return _held(np.hstack([roll, self._series(x, warped(phase, float(x[-2])), -1.0)[:, 1:]]))

    def _series(self, x: FloatArray, phase: FloatArray, side: float = 0.0) -> FloatArray:
        """Return the series at phases, shape (k, 4); side is 1 of the right leg, -1 of the left."""
        count = 1 + 2 * self.harmonics
        terms = np.array(x[: 4 * count]).reshape(4, count)
        if self.asymmetric:
            terms[1:] += side / 2.0 * np.reshape(x[4 * count : 7 * count], (3, count))
        angle = 2.0 * np.pi * phase[:, None] * np.arange(1, self.harmonics + 1)
        basis = np.ones((len(phase), count))
        basis[:, 1::2], basis[:, 2::2] = np.cos(angle), np.sin(angle)
        series: FloatArray = basis @ terms.T
        return series

    def like(self, gait: AnyGait) -> dict[str, float]:
        """Return values of variables with the waveforms of a gait of the paper's family."""
        if not isinstance(gait, Gait):
            return super().like(gait)
        found = {
            f"{name}_{term}": value
            for name, row in zip(WAVEFORMS, gait.coefficients.tolist(), strict=True)
            for term, value in zip(("mean", "cos1", "sin1", "cos2"), row, strict=True)
        }
        return {name: value for name, value in found.items() if name in self.names} | {
            "duty": 0.5,
            "period": gait.family.period,
        }

    def commands(self, x: FloatArray) -> FloatArray:
        """Return the commands: both legs half a cycle apart, grown and shrunk."""
        phase = self.times(x) / self.period_of(x)
        duty = float(x[-2])
        roll = self._series(x, phase)[:, 0]
        left = self._series(x, warped(phase, duty), -1.0)[:, 1:]
        right = self._series(x, warped(phase + 0.5, duty), 1.0)[:, 1:]
        held = [_held(np.column_stack([roll, leg])) for leg in (right, left)]
        of_roll, of_legs = self.factors(x)
        return joint_rows(
            of_roll * held[0][:, 0],
            of_legs[:, None] * held[0][:, 1:],
            of_legs[:, None] * held[1][:, 1:],
        )


def _held(angles: FloatArray) -> FloatArray:
    """Return waveforms held inside their ranges, as a servo's stops do, shape (k, 4)."""
    return np.clip(angles, ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])


def warped(phase: FloatArray, duty: float) -> FloatArray:
    """Return the phase of a leg whose stance takes the part `duty` of the cycle.

    The half turn of the waveforms that is stance, around the middle of it, is stretched by a
    Moebius map of the circle: it is smooth, leaves the middles of swing and stance where they are,
    and is the identity for duty 0.5.

    Args:
        phase: Parts of a cycle, shape (k,).
        duty: Share of the stance.
    """
    turn = np.pi * (np.asarray(phase, dtype=float) - MID_SWING)
    # Stance ends a quarter of a turn of the waveforms from its middle, at duty / 2 of the time.
    stretch = np.tan(np.pi * duty / 2.0)
    whole = np.round(turn / np.pi)
    rest = turn - np.pi * whole
    found: FloatArray = MID_SWING + whole + np.arctan(stretch * np.tan(rest)) / np.pi
    return found
