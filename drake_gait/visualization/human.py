"""Joint angles of people over a gait cycle, to be drawn beside the robot's.

The data are by C. A. Fukuchi, R. K. Fukuchi and M. Duarte, version 5,
doi:10.6084/m9.figshare.5722711.v5. They are described in A public data set of overground and
treadmill walking kinematics and kinetics of healthy individuals, PeerJ 6:e4640 (2018).
Its licence is CC BY 4.0, https://creativecommons.org/licenses/by/4.0/. Changed: the 24 young
adults walk on a treadmill at a comfortable speed, 1.24 m/s in the mean. Each person's legs are
averaged. Mean and standard deviation are over the persons, in steps of 0.1 degrees, at every 4 % of
the cycle. The raw files were reduced so by the
public repository VIONWILLIAMS/EXO-Forge-Studio; its means were compared with another reduction.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from drake_gait.gait import FloatArray


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split()))


# Mean and standard deviation [deg], from a foot's contact to its next, which is the first again.
_ANGLES = {
    "hip": (
        _numbers(
            "29.9 29.2 28.5 26.5 22.2 17.9 13.9 9.6 5.5 2.1 -0.9 -3.8 -6.2 "
            "-7.8 -7.8 -4.6 1.5 9.1 16.9 23.1 27.6 30.8 32.3 31.9 30.5"
        ),
        _numbers(
            "6.4 6.7 7.0 7.3 7.2 7.1 7.0 6.8 6.6 6.7 6.8 6.7 6.6 "
            "6.6 6.9 7.2 7.3 7.2 6.9 6.7 6.6 6.6 6.6 6.5 6.4"
        ),
    ),
    "knee": (
        _numbers(
            "0.7 5.7 11.5 15.8 15.2 13.4 11.1 8.5 6.1 4.4 3.4 3.5 5.4 "
            "9.6 16.9 28.9 43.4 55.4 61.5 61.5 55.9 45.6 31.2 14.7 2.2"
        ),
        _numbers(
            "3.3 3.3 4.0 4.2 4.0 4.0 3.9 3.8 3.8 3.9 3.9 3.9 3.8 "
            "3.9 4.3 4.9 5.0 4.5 3.8 3.7 4.3 5.1 5.6 5.1 3.8"
        ),
    ),
    "ankle": (
        _numbers(
            "1.5 -2.2 -3.5 0.7 3.9 6.0 7.5 8.5 9.3 10.2 11.1 11.7 11.6 "
            "9.8 4.4 -5.5 -13.2 -11.3 -5.1 0.0 3.7 5.5 5.1 2.8 1.3"
        ),
        _numbers(
            "2.4 2.4 2.2 2.2 2.2 2.2 2.1 2.1 2.3 2.8 3.4 3.9 4.2 "
            "4.4 4.9 5.4 5.5 6.4 5.1 3.9 2.9 2.3 1.8 1.9 2.4"
        ),
    ),
}

JOINTS = tuple(_ANGLES)
"""The waveforms that there is a human's angle for: flexion of hip and knee, dorsiflexion."""


def angles(joint: str, phase: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation of a human's joint angle.

    Args:
        joint: One of JOINTS.
        phase: Parts of the gait cycle since the foot's contact, shape (n,).

    Returns:
        Mean and standard deviation [deg], shape (n,) each.
    """
    cycle = np.asarray(phase, dtype=float)
    mean, deviation = (
        CubicSpline(
            np.linspace(0.0, 1.0, len(values) + 1), (*values, values[0]), bc_type="periodic"
        )(cycle)
        for values in _ANGLES[joint]
    )
    return mean, deviation
