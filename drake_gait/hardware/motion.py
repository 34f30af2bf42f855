"""Joint angles as a robot's controller plays them, frame by frame."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_gait.arrays import numbers
from drake_gait.errors import SettingsError
from drake_gait.gait import FRAME_TIME, JOINTS, FloatArray

LONGEST_FRAME = 0.1
"""Longest time between two frames [s]: a slower motion is no walk."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Joint angles that ten servos are sent, one row a frame."""

    angles: FloatArray
    """Joint angles [rad], shape (n, 10), columns as gait.JOINTS, n at least 2."""
    frame_time: float = FRAME_TIME
    """Time between two frames [s]."""

    def __post_init__(self) -> None:
        angles = numbers("angles", self.angles)
        if angles.ndim != 2 or angles.shape[1] != len(JOINTS) or len(angles) < 2:
            raise SettingsError(
                f"angles of a motion must be (n, {len(JOINTS)}) in shape, n at least 2, one column "
                f"a joint as gait.JOINTS, got {angles.shape}"
            )
        if not 0.0 < self.frame_time <= LONGEST_FRAME:
            raise SettingsError(
                f"frame_time must be > 0 and <= {LONGEST_FRAME} s, got {self.frame_time}"
            )
        angles.setflags(write=False)
        object.__setattr__(self, "angles", angles)

    @property
    def times(self) -> FloatArray:
        """Time of each frame [s], shape (n,)."""
        times: FloatArray = np.arange(len(self.angles), dtype=float) * self.frame_time
        return times

    @property
    def speeds(self) -> FloatArray:
        """Speed from each frame to the next [rad/s], shape (n - 1, 10)."""
        return (self.angles[1:] - self.angles[:-1]) / self.frame_time

    def resampled(self, frame_time: float) -> "Motion":
        """Return the motion in frames of another length [s], linear between those there are.

        The last frame is kept: where it falls between two, the motion ends one frame later.
        """
        duration = (len(self.angles) - 1) * self.frame_time
        count = int(np.ceil(duration / frame_time - 1e-9)) + 1
        times = np.arange(count) * frame_time
        columns = [np.interp(times, self.times, column) for column in self.angles.T]
        return Motion(angles=np.column_stack(columns), frame_time=frame_time)

    def softened(self, speed: float) -> "Motion":
        """Return the motion with no joint faster than a speed [rad/s].

        Each angle is the mean of two others: one follows the motion as fast as it may, the other
        does so backwards in time. Both keep the speed, so their mean does; what is slower anyway
        stays as it is.

        Raises:
            SettingsError: the speed is not > 0.
        """
        if not speed > 0.0:
            raise SettingsError(f"speed of a softened motion must be > 0 rad/s, got {speed}")
        step = speed * self.frame_time
        late = _following(self.angles, step)
        early = _following(self.angles[::-1], step)[::-1]
        return Motion(angles=0.5 * (late + early), frame_time=self.frame_time)


def _following(angles: FloatArray, step: float) -> FloatArray:
    """Return angles that follow others with at most `step` a frame [rad], shape (n, 10)."""
    found = np.array(angles)
    for frame in range(1, len(found)):
        change = np.clip(angles[frame] - found[frame - 1], -step, step)
        found[frame] = found[frame - 1] + change
    return found


def to_csv(motion: Motion) -> str:
    """Return a motion as CSV: the time [s], then one column a joint, angles in degrees."""
    rows = [
        [f"{time:.4f}", *(f"{angle + 0.0:.4f}" for angle in angles)]
        for time, angles in zip(motion.times, np.degrees(motion.angles).round(4), strict=True)
    ]
    return table_as_csv(["time_s", *JOINTS], rows)


def table_as_csv(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table as the text of a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
