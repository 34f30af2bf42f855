"""Joint angles that were measured on a robot, beside the simulated ones."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.files.text import read_text
from drake_gait.gait import JOINTS, FloatArray
from drake_gait.robot.robot_file import RobotFile, default_robot

TIME = "time_s"
"""Name of the column of times."""
_LONGEST_DELAY = 0.2  # s


@dataclass(frozen=True, kw_only=True, eq=False)
class JointLog:
    """Measured joint angles."""

    times: FloatArray
    """Time of each row [s], shape (n,), rising."""
    angles: Mapping[str, FloatArray]
    """Angles by role [rad], shape (n,) each, counted as a gait counts them."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Agreement of a joint on the robot with the simulated one."""

    joint: str
    """The joint."""
    delay: float
    """Time by which the measured angle is behind [s]; the one that leaves the least difference."""
    rms: float
    """Root mean square of the difference, the delay included [rad]."""
    rms_aligned: float
    """The same once the delay is taken out [rad]."""


def read_joint_log(path: Path, robot: RobotFile | None = None) -> JointLog:
    """Read a CSV file: a column `time_s`, and angles in degrees in columns named as joints.

    A column is named as a role of `gait.JOINTS`, or as the joint of the robot's model that plays
    it; such angles are the model's, and are told in the signs of the roles. Columns of other names
    are left out.

    Args:
        path: The file.
        robot: The robot's file; that of the KHR-3HV by default.

    Raises:
        SettingsError: it cannot be read, has no such columns, or a cell is no number; names it.
    """
    rows, header = _rows(path)
    robot = robot or default_robot()
    there = [(role, joint) for role, joint in zip(JOINTS, robot.joints, strict=True) if joint]
    found = [(role, role if role in header else joint) for role, joint in there]
    found = [(role, name) for role, name in found if name in header]
    if TIME not in header or not found:
        known = dict.fromkeys(joint for _, joint in there)
        raise SettingsError(
            f"{path} has no column '{TIME}', or none of a joint; its first line must name "
            f"{TIME} and some of {', '.join(known)}"
        )
    columns = _columns(path, rows, header, [TIME, *(name for _, name in found)])
    standing = dict(robot.standing or ())
    angles = {}
    for (role, name), column in zip(found, np.radians(columns[1:]), strict=True):
        of_model = robot.signs[JOINTS.index(role)] * (column - standing.get(name, 0.0))
        angles[role] = column if name == role else of_model
    return JointLog(times=columns[0], angles=angles)


def read_columns(path: Path, names: Sequence[str]) -> FloatArray:
    """Read a column `time_s`, and others by their names, of a CSV file.

    Returns:
        The columns, the times first, shape (1 + len(names), n).

    Raises:
        SettingsError: it cannot be read, lacks a column, or a cell is no number; names it.
    """
    rows, header = _rows(path)
    wanted = [TIME, *names]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise SettingsError(
            f"{path} has no column '{missing[0]}'; its first line must name {', '.join(wanted)}"
        )
    return _columns(path, rows, header, wanted)


def _rows(path: Path) -> tuple[list[list[str]], list[str]]:
    """Return the rows of a file, and the names in the first of them."""
    rows = list(csv.reader(read_text(path, "the log").splitlines()))
    return rows, [name.strip() for name in rows[0]] if rows else []


def _columns(path: Path, rows: list[list[str]], header: list[str], names: list[str]) -> FloatArray:
    """Return named columns as numbers, the first one rising."""
    table = [
        [_cell(path, line, name, row, header.index(name)) for name in names]
        for line, row in enumerate(rows[1:], 2)
        if row
    ]
    if len(table) < 2:
        raise SettingsError(f"{path} has {len(table)} rows of numbers; at least 2 are needed")
    columns: FloatArray = np.array(table).T
    falling = np.flatnonzero(np.diff(columns[0]) <= 0.0)
    if len(falling):
        raise SettingsError(
            f"{path}: {TIME} must rise, but {columns[0][falling[0] + 1]:g} follows "
            f"{columns[0][falling[0]]:g}"
        )
    return columns


def _cell(path: Path, line: int, name: str, row: list[str], place: int) -> float:
    text = row[place].strip() if place < len(row) else ""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise SettingsError(
            f"{path}, line {line}: {name} must be a number with a decimal point, got '{text}'"
        )
    return value


def agreement(log: JointLog, times: FloatArray, angles: FloatArray) -> list[Agreement]:
    """Return how each measured joint follows the simulated one.

    Args:
        log: Measured angles; their time 0 is that of the simulated ones.
        times: Times of the simulated angles [s], shape (n,).
        angles: Simulated angles [rad], shape (n, 10), columns as gait.JOINTS.

    Raises:
        SettingsError: the two do not overlap in time by at least a second.
    """
    inside = (log.times >= times[0]) & (log.times <= times[-1])
    if not inside.any() or np.ptp(log.times[inside]) < 1.0:
        raise SettingsError(
            f"the log spans {log.times[0]:g} to {log.times[-1]:g} s and the walk {times[0]:g} to "
            f"{times[-1]:g} s; they must overlap by at least 1 s: shift its times"
        )
    found = []
    delays = np.arange(-_LONGEST_DELAY, _LONGEST_DELAY + 1e-9, 0.001)
    for name, measured in log.angles.items():
        simulated = angles[:, JOINTS.index(name)]

        def rms(
            delay: float, simulated: FloatArray = simulated, measured: FloatArray = measured
        ) -> float:
            expected = np.interp(log.times[inside] - delay, times, simulated)
            return float(np.sqrt(np.mean((measured[inside] - expected) ** 2)))

        best = min(delays.tolist(), key=rms)
        found.append(Agreement(joint=name, delay=best, rms=rms(0.0), rms_aligned=rms(best)))
    return found
