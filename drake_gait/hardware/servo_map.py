"""The servos of a real robot: ids, signs, trims and ranges, from a file that its owner edits."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.files.text import read_text
from drake_gait.gait import JOINTS, FloatArray
from drake_gait.robot.description import models_folder
from drake_gait.study._toml import known, number, parse_toml

SHIPPED = "khr3hv_servos.toml"
"""The shipped file, in `models/`: ids, signs and ranges of the KHR-3HV's legs."""

_CONTROLLER = ("centre", "units_per_degree", "lowest", "highest", "frame_times_ms")
_JOINT = ("id", "sign", "trim_deg", "range_deg")
_IDS = 36  # The RCB-4 numbers its servos from 0 to 35.


@dataclass(frozen=True, kw_only=True)
class ServoMap:
    """Ten servos and their controller; columns are ordered as gait.JOINTS."""

    ids: tuple[int, ...]
    """Number of each servo on its controller: for the RCB-4 twice the id, plus its port."""
    signs: tuple[int, ...]
    """1 where the servo turns like the joint of the model, -1 where against it."""
    trims: tuple[float, ...]
    """Angle of each servo where its joint is at 0 [rad]."""
    ranges: tuple[tuple[float, float], ...]
    """Smallest and largest angle of each servo [rad], as it is mounted."""
    centre: int = 7500
    """Position of a servo in its middle."""
    units_per_degree: float = 4000.0 / 135.0
    """Positions in one degree."""
    lowest: int = 3500
    """Smallest position."""
    highest: int = 11500
    """Largest position."""
    frame_times: tuple[float, ...] = (0.010, 0.015, 0.020, 0.025)
    """Times between two frames that the controller can keep [s]."""

    def servo_angles(self, angles: FloatArray) -> FloatArray:
        """Return the servos' own angles [rad] for joint angles [rad], shape (n, 10)."""
        found: FloatArray = angles * np.array(self.signs) + np.array(self.trims)
        return found

    def positions(self, angles: FloatArray) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Return the servos' positions for joint angles [rad], shape (n, 10), whole numbers."""
        degrees = np.degrees(self.servo_angles(angles))
        return np.rint(self.centre + self.units_per_degree * degrees).astype(np.int64)

    def joint_angles(self, positions: FloatArray) -> FloatArray:
        """Return joint angles [rad] for positions of the servos, shape (n, 10)."""
        angles = np.radians((np.asarray(positions) - self.centre) / self.units_per_degree)
        found: FloatArray = (angles - np.array(self.trims)) * np.array(self.signs)
        return found


def read_servo_map(path: Path | None = None) -> ServoMap:
    """Return the servos that a file names, by default those of the shipped robot.

    Raises:
        SettingsError: the file cannot be read, or a value in it cannot be used; the text names it.
    """
    path = path or models_folder() / SHIPPED
    text = read_text(path, "the robot's servos")
    try:
        content = parse_toml(text)
    except ValueError as error:
        raise SettingsError(f"{path} is not TOML: {error}") from None
    try:
        return _servo_map(content)
    except SettingsError as error:
        raise SettingsError(f"{path}: {error}") from None


def _servo_map(content: Mapping[str, Any]) -> ServoMap:
    known("section", content, ("controller", "joints"))
    controller = _table("controller", content.get("controller", {}))
    known("key of [controller]", controller, _CONTROLLER)
    joints = _table("joints", content.get("joints", {}))
    known("joint", joints, JOINTS)
    missing = [name for name in JOINTS if name not in joints]
    if missing:
        raise SettingsError(
            f"[joints.{missing[0]}] is missing; each of {', '.join(JOINTS)} needs one"
        )
    rows = [_joint(name, _table(f"joints.{name}", joints[name])) for name in JOINTS]
    ids = tuple(row[0] for row in rows)
    for place, own in enumerate(ids):
        if own in ids[:place]:
            raise SettingsError(
                f"joints.{JOINTS[place]}.id = {own} is that of {JOINTS[ids.index(own)]} too; "
                "every servo has its own"
            )
    given: dict[str, Any] = dict(controller)
    times = given.pop("frame_times_ms", None)
    if times is not None:
        given["frame_times"] = tuple(_times(times))
    for key in ("centre", "lowest", "highest"):
        if key in given:
            given[key] = _whole(f"controller.{key}", given[key], 0, 65535)
    if "units_per_degree" in given:
        units = number("controller.units_per_degree", given["units_per_degree"])
        if not units > 0.0:
            raise SettingsError(f"controller.units_per_degree must be > 0, got {units}")
        given["units_per_degree"] = units
    found = ServoMap(
        ids=ids,
        signs=tuple(row[1] for row in rows),
        trims=tuple(row[2] for row in rows),
        ranges=tuple(row[3] for row in rows),
        **given,
    )
    if not found.lowest < found.centre < found.highest:
        raise SettingsError(
            f"controller.lowest, centre and highest must rise, got {found.lowest}, {found.centre} "
            f"and {found.highest}"
        )
    return found


def _joint(name: str, values: Mapping[str, Any]) -> tuple[int, int, float, tuple[float, float]]:
    known(f"key of [joints.{name}]", values, _JOINT)
    place = f"joints.{name}"
    for key in ("id", "sign", "range_deg"):
        if key not in values:
            raise SettingsError(f"{place}.{key} is missing")
    own = _whole(f"{place}.id", values["id"], 0, _IDS - 1)
    sign = values["sign"]
    if isinstance(sign, bool) or sign not in (1, -1):
        raise SettingsError(f"{place}.sign must be 1 or -1, got {sign!r}")
    trim = number(f"{place}.trim_deg", values.get("trim_deg", 0.0))
    ends = values["range_deg"]
    if not isinstance(ends, list) or len(ends) != 2:
        raise SettingsError(f"{place}.range_deg must be two angles, got {ends!r}")
    low, high = (number(f"{place}.range_deg", end) for end in ends)
    if not -135.0 <= low < high <= 135.0:
        raise SettingsError(
            f"{place}.range_deg must rise within -135 and 135 degrees, got [{low:g}, {high:g}]"
        )
    radians = np.radians([trim, low, high]).tolist()
    return own, int(sign), radians[0], (radians[1], radians[2])


def _times(values: Any) -> list[float]:
    if not isinstance(values, list) or not values:
        raise SettingsError(
            f"controller.frame_times_ms must be a list such as [10, 15, 20, 25], got {values!r}"
        )
    found = [number("controller.frame_times_ms", value) / 1e3 for value in values]
    if not all(0.0 < time <= 0.1 for time in found):
        raise SettingsError(f"controller.frame_times_ms must be > 0 and <= 100, got {values!r}")
    return found


def _table(name: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise SettingsError(f"{name} must be a table, got {value!r}")
    return value


def _whole(name: str, value: Any, lowest: int, highest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= highest:
        raise SettingsError(
            f"{name} must be a whole number from {lowest} to {highest}, got {value!r}"
        )
    return value
