"""The posture of a torso: where it heads, how it leans, and whether the robot has fallen."""

import math
from collections.abc import Sequence

import numpy as np

from drake_gait.errors import ModelError
from drake_gait.gait import FRAME_TIME, FloatArray
from drake_gait.robot.description import RobotModel
from drake_gait.robot.robot_file import RobotFile
from drake_gait.walk import Outcome, Walk

Posture = tuple[float, float, float]
"""Heading [rad], cosine of the lean from upright, and height [m] of the torso."""

SETTLING_TIME = 1.0
"""How long the robot stands before its walk, to come to rest on its soles [s]."""

_UNMOVED = math.radians(10.0)
"""What stands turns and leans by less than this [rad]."""


def torso_posture(pose: FloatArray) -> Posture:
    """Return the posture of the torso.

    Args:
        pose: Quaternion (w, x, y, z) and position [m] of the torso in the world, shape (7,).
    """
    w, x, y, z, _, _, height = pose.tolist()
    heading = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return heading, 1.0 - 2.0 * (x * x + y * y), height


def first_fall(postures: Sequence[Posture], seen: int, robot: RobotFile) -> int | None:
    """Return the frame by which the robot has fallen, if it has.

    Args:
        postures: Of the torso, one a frame.
        seen: How many of them stand, as is known.
        robot: The robot's file, which says when it has fallen.
    """
    lowest, least = robot.fall_height * postures[0][2], math.cos(robot.fall_lean)
    for frame, (_, upright, height) in enumerate(postures[seen:], seen):
        # Written so that a state that is not a number counts as a fall.
        if not (upright > least and height > lowest):
            return frame
    return None


def walk_of(
    postures: Sequence[Posture], centres: Sequence[FloatArray], fall: int | None, frames: int
) -> Walk:
    """Return what a walk has left behind.

    Args:
        postures: Of the torso, one a frame from the first on.
        centres: Of mass p_WC [m], shape (3,), in the first frame and in the last one.
        fall: The frame by which the robot had fallen; None if it had not.
        frames: How many it was to walk.
    """
    end, completed = (frames, frames) if fall is None else (fall, fall - 1)
    com_start, com_end = centres
    if not np.isfinite(com_end).all():
        return Walk.diverged("the state is not finite", frames=completed)
    forward, lateral, _ = (com_end - com_start).tolist()
    headings = np.unwrap([heading for heading, _, _ in postures[: end + 1]])
    return Walk(
        outcome=Outcome.WALKED if fall is None else Outcome.FELL,
        frames=completed,
        forward=forward,
        lateral=lateral,
        yaw=float(headings[-1] - headings[0]),
        com_height=float(com_end[2]),
        yaw_swing=float(np.ptp(headings)),
        reason="" if fall is None else f"fell at {fall * FRAME_TIME:.2f} s",
    )


def check_stands(before: Posture, after: Posture, model: RobotModel) -> None:
    """Refuse a robot that does not stay where its file puts it.

    Raises:
        ModelError: it does not.
    """
    turn, lean = abs(after[0] - before[0]), math.acos(min(max(after[1], -1.0), 1.0))
    stays = turn < _UNMOVED and lean < _UNMOVED and after[2] > model.robot.fall_height * before[2]
    if not stays:  # Written so that what is not a number does not.
        raise ModelError(
            f"{model}: the robot does not stand: in {SETTLING_TIME:g} s its torso turns by "
            f"{math.degrees(turn):.0f} and leans by {math.degrees(lean):.0f} degrees, from "
            f"{before[2]:.3g} to {after[2]:.3g} m; put its centre of mass over its soles"
        )
