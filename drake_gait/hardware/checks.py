"""Checks of a motion before a robot plays it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drake_gait.gait import JOINTS, FloatArray
from drake_gait.hardware.motion import Motion
from drake_gait.hardware.servo_map import ServoMap


class Kind(StrEnum):
    """Kinds of violations."""

    RANGE = "range"
    """A servo would turn past its range."""
    SPEED = "speed"
    """A joint would have to be faster than its servo without load."""
    COLLISION = "collision"
    """The legs would meet."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """A frame of a motion that the robot cannot play."""

    kind: Kind
    """Kind of it."""
    frame: int
    """Frame, counted from 0; the worst one of its joint."""
    frames: int
    """Frames in which the same is violated."""
    where: str
    """The joint, or the two links."""
    text: str
    """The value and what is allowed."""

    def __str__(self) -> str:
        """Return the violation in one line."""
        more = f", and in {self.frames - 1} more frames" if self.frames > 1 else ""
        return f"frame {self.frame}, {self.where}: {self.text}{more}"


def violations(
    motion: Motion,
    servos: ServoMap,
    no_load_speed: float,
    gaps: tuple[FloatArray, Sequence[tuple[str, str]]] | None = None,
) -> list[Violation]:
    """Return everything about a motion that a robot cannot play, one of each kind and joint.

    Args:
        motion: Joint angles by frame.
        servos: The robot's servos, with their ranges.
        no_load_speed: Speed that a servo reaches without load [rad/s].
        gaps: Distance between the legs in each frame [m], and the two links, see
            `simulation.self_collision.leg_gaps`.
    """
    return [
        *_out_of_range(motion, servos),
        *_too_fast(motion, no_load_speed),
        *(_meeting(*gaps) if gaps else ()),
    ]


def _out_of_range(motion: Motion, servos: ServoMap) -> Iterator[Violation]:
    angles = servos.servo_angles(motion.angles)
    steps = np.radians(np.array([servos.lowest, servos.highest]) - servos.centre)
    lowest, highest = steps / servos.units_per_degree
    for column, (low, high) in enumerate(servos.ranges):
        low, high = max(low, lowest), min(high, highest)
        excess = np.maximum(angles[:, column] - high, low - angles[:, column])
        if (excess > 1e-9).any():
            frame = int(excess.argmax())
            yield Violation(
                kind=Kind.RANGE,
                frame=frame,
                frames=int((excess > 1e-9).sum()),
                where=f"{JOINTS[column]} (servo {servos.ids[column]})",
                text=f"the servo would be at {np.degrees(angles[frame, column]):.1f} degrees, "
                f"its range is {np.degrees(low):.1f} to {np.degrees(high):.1f}",
            )


def _too_fast(motion: Motion, no_load_speed: float) -> Iterator[Violation]:
    speeds = np.abs(motion.speeds)
    for column, name in enumerate(JOINTS):
        fast = speeds[:, column] > no_load_speed * (1.0 + 1e-9)
        if fast.any():
            frame = int(speeds[:, column].argmax())
            change = np.degrees(motion.angles[frame + 1, column] - motion.angles[frame, column])
            yield Violation(
                kind=Kind.SPEED,
                frame=frame + 1,
                frames=int(fast.sum()),
                where=name,
                text=f"it would turn by {change:.1f} degrees in one frame, "
                f"{speeds[frame, column]:.1f} rad/s; without load the servo reaches "
                f"{no_load_speed:.1f}",
            )


def _meeting(gaps: FloatArray, links: Sequence[tuple[str, str]]) -> Iterator[Violation]:
    meeting: list[int] = np.flatnonzero(gaps < 0.0).tolist()
    for pair in sorted({links[frame] for frame in meeting}):
        frames = [frame for frame in meeting if links[frame] == pair]
        worst = min(frames, key=lambda frame: float(gaps[frame]))
        yield Violation(
            kind=Kind.COLLISION,
            frame=worst,
            frames=len(frames),
            where=" and ".join(pair),
            text=f"they would overlap by {-1e3 * gaps[worst]:.1f} mm",
        )
