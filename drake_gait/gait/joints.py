"""The ten leg joints, and the frames in which they are commanded."""

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

LEG_JOINTS = ("hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
"""Joints of one leg, from the hip down."""
JOINTS = tuple(f"{joint}_{side}" for side in ("r", "l") for joint in LEG_JOINTS)
"""The ten actuated joints, in the order of every array of joint values."""

WAVEFORMS = ("roll", "hip", "knee", "ankle")
"""What both legs do: phi_1 (hip and ankle roll), phi_2, phi_3, phi_4 (pitch)."""
ANGLE_LIMITS: FloatArray = np.radians([(-15.0, 15.0), (-50.0, 50.0), (0.0, 60.0), (-50.0, 50.0)])
"""Ranges of the waveforms [rad], shape (4, 2), rows as WAVEFORMS: the paper's Table I."""


def joint_rows(roll: FloatArray, right: FloatArray, left: FloatArray) -> FloatArray:
    """Order one roll (n,) and two legs' pitch angles (n, 3) as JOINTS, shape (n, 10)."""
    return np.column_stack([roll, right, roll, roll, left, roll])


def joint_commands(commands: ArrayLike, of: str = "commands") -> FloatArray:
    """Check commands that servos are to follow; returns them as an array.

    Args:
        commands: Joint angles [rad], shape (n + 1, 10), columns as JOINTS, one row a frame from 0
            to n, n at least 1.
        of: Their name, for messages.

    Raises:
        SettingsError: the shape is another, or an angle is not finite or beyond a servo's travel;
            the text names it, with its frame and joint.
    """
    found = numbers(of, commands)
    if found.ndim != 2 or found.shape[1] != len(JOINTS) or len(found) < 2:
        cure = "; transpose them" if found.ndim == 2 and len(found) == len(JOINTS) else ""
        raise SettingsError(
            f"{of} must be (frames + 1, {len(JOINTS)}) in shape, one row a frame from 0 and one "
            f"column a joint as gait.JOINTS, got {found.shape}{cure}"
        )
    wrong = ~(np.abs(found) <= TRAVEL)  # What is no number too.
    if wrong.any():
        frame, joint = np.argwhere(wrong)[0].tolist()
        raise SettingsError(
            f"{of}[{frame}, {joint}], of {JOINTS[joint]} in frame {frame}, is "
            f"{found[frame, joint]:g} rad; a servo turns {TRAVEL:.3f} rad to either side "
            f"({np.degrees(TRAVEL):g} degrees): give finite radians, as numpy.radians(degrees)"
        )
    return found
