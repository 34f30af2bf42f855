"""The measures of a walk, from arrays: they know no engine.

An engine gives a `Record` of the instants at which its steps end. Every measure is a sum, a peak
or a share over them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drake_gait.gait import FRAME_TIME, STANDING, FloatArray, Schedule
from drake_gait.walk import Measures

_SATURATED = 1.0 - 1e-6  # of the stall torque
_SHORTEST_SWING = 4  # frames; a foot that is let go bounces for three at most
_RIPPLE = 0.0003  # Changes of height that are the contact's, not the leg's [m].


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """What is known of a walk at n instants, and at m frames, which are some of them.

    Instants are those at which steps end, or any others that are near enough to each other.
    """

    time: FloatArray
    """Time of each instant [s], shape (n,)."""
    frames: np.ndarray
    """Which instants are frames, from frame 0 on, shape (m,)."""
    speeds: FloatArray
    """Speeds of the m servos [rad/s], shape (m, n)."""
    controllers: FloatArray
    """Torques of their controllers, before the back-EMF [N·m], shape (m, n)."""
    torques: FloatArray
    """Torques on their joints [N·m], shape (m, n)."""
    stall: FloatArray
    """Largest torque of each controller [N·m], shape (m,)."""
    loads: FloatArray
    """Vertical force of the ground on each of k plates of the right, then the left foot [N].

    Shape (2 k, n), rows ordered as `RobotFile.plates`.
    """
    sliding: FloatArray
    """Horizontal speed of each plate at the centre of its load [m/s], shape (2 k, n)."""
    toes: FloatArray
    """Angles of the toes at the frames [rad], shape (4, m), rows ordered as `RobotFile.hinges`."""
    sole_height: FloatArray
    """Height of the lowest point of either foot at the frames [m], shape (2, m)."""
    rising: FloatArray
    """Vertical speed of the centre of mass at the frames [m/s], shape (m,)."""
    upright: FloatArray
    """Cosine of the torso's lean at the frames, shape (m,)."""
    mass: float
    """Of the robot [kg]."""
    gravity: float
    """Its acceleration [m/s²]."""
    load: float
    """Vertical force from which a foot counts as carrying load [N]."""
    schedule: Schedule = STANDING.schedule
    """The gait's cycle and frames; the paper's by default."""


def measures_of(record: Record, *, forward: float) -> Measures:
    """Return the measures of a walk.

    Args:
        record: What is known of it.
        forward: How far it went [m].
    """
    time = record.time
    power = record.torques * record.speeds
    driving = np.maximum(power, 0.0).sum(axis=0)
    absolute = np.abs(power).sum(axis=0)
    positive = float(np.trapezoid(driving, time))
    shares = np.abs(record.controllers) / record.stall[:, None]
    asked = np.abs(record.controllers) > _SATURATED * record.stall[:, None]
    spans = np.diff(time)
    right, left = (_sliding(record, foot) for foot in (0, 1))
    frame_loads = record.loads[:, record.frames]
    loaded = np.array([foot.sum(axis=0) for foot in np.split(frame_loads, 2)]) > record.load
    frame_times = time[record.frames]
    begin, end = record.schedule.second_cycle
    cycle = (frame_times >= begin) & (frame_times < end)
    duty = loaded[:, cycle].mean(axis=1) if cycle.any() else np.full(2, np.nan)
    weight = record.mass * record.gravity
    # By momentum: forces read from a state that ends a step are not those of the step.
    growth = float(np.diff(record.rising).max(initial=0.0)) / (record.gravity * FRAME_TIME)
    torques, speeds, drives = np.abs(record.torques), np.abs(record.speeds), power >= 0.0
    return Measures(
        energy=float(np.trapezoid(absolute, time)),
        positive_energy=positive,
        cost_of_transport=positive / (weight * forward) if forward > 0 else np.inf,
        peak_torque=float(torques.max()),
        peak_speed=float(speeds.max()),
        driving_torque=_peak(torques, drives),
        braking_torque=_peak(torques, ~drives),
        driving_speed=_peak(speeds, drives),
        braking_speed=_peak(speeds, ~drives),
        # On the line, where the controller asks for the stall torque, it is 1.
        line_share=_peak(shares, drives),
        saturated_fraction=float(asked.mean(axis=0)[1:] @ spans) / max(float(time[-1]), FRAME_TIME),
        slip=(float(np.trapezoid(right, time)), float(np.trapezoid(left, time))),
        clearance=(
            swing_clearance(record.sole_height[0], record.schedule),
            swing_clearance(record.sole_height[1], record.schedule),
        ),
        duty_factor=(float(duty[0]), float(duty[1])),
        peak_ground_reaction=1.0 + growth,
        toe_range=tuple(record.toes.max(axis=1).tolist()),
        torso_tilt=float(np.arccos(np.clip(record.upright.min(), -1.0, 1.0))),
    )


def _peak(values: FloatArray, where: np.ndarray) -> float:
    """Return the largest of some values; 0 of none."""
    return float(values.max(initial=0.0, where=where))


def _sliding(record: Record, foot: int) -> FloatArray:
    """Return how fast the most loaded plate of a foot slides [m/s], shape (n,); 0 in the air."""
    loads, speeds = (np.split(array, 2)[foot] for array in (record.loads, record.sliding))
    plate = loads.argmax(axis=0)
    instants = np.arange(len(plate))
    found: FloatArray = np.where(loads[plate, instants] > record.load, speeds[plate, instants], 0.0)
    return found


def swing_clearance(height: FloatArray, schedule: Schedule = STANDING.schedule) -> float:
    """Return the minimum toe clearance of a foot in the lowest of its swings [m].

    A swing lasts from lift-off to touch-down, while the gait walks: no point of foot and toes
    touches the ground. Its clearance is the least height from its first to its last maximum. That
    is the local minimum in mid-swing (Winter 1992; Begg et al. 2007), or the top of a swing with
    one maximum. Lift-off and touch-down, where every toe is at the ground, do not count.

    Args:
        height: Height of the foot's lowest point at each frame from time 0 [m], shape (n,).
        schedule: The gait's frames.

    Returns:
        0 for a foot without a whole swing: it stands, drags its toe, or stays in the air.
    """
    frames = height[max(schedule.begin - 1, 0) : schedule.end + 1]
    aloft = np.concatenate([[0], frames > 0.0, [0]])
    swings = np.flatnonzero(np.diff(aloft)).reshape(-1, 2)
    whole = [
        frames[begin:end]
        for begin, end in swings
        if begin > 0 and end < len(frames) and end - begin >= _SHORTEST_SWING
    ]
    found = (_mid_swing(swing.tolist()) for swing in whole if swing.max() > _RIPPLE)
    return min(found, default=0.0)


def _mid_swing(height: Sequence[float]) -> float:
    """Return the least height from the first to the last maximum of one swing [m]."""
    maxima = _maxima(height)
    return min(height[maxima[0] : maxima[-1] + 1])


def _maxima(height: Sequence[float]) -> list[int]:
    """Return where local maxima stand out by _RIPPLE from the ground or from higher maxima.

    Their prominence, as scipy.signal.find_peaks has it; its import is the size of a robot.
    """
    found = []
    for place, top in enumerate(height):
        # A plateau is one maximum, at its beginning.
        if place and height[place - 1] == top:
            continue
        feet = []
        for side in (height[place + 1 :], height[:place][::-1]):
            lowest = top
            for one in side:
                if one > top:
                    break
                lowest = min(lowest, one)
            else:
                lowest = 0.0  # Down to the ground.
            feet.append(lowest)
        if top - max(feet) >= _RIPPLE:
            found.append(place)
    return found
