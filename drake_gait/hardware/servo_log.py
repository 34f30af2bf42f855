"""A log of one servo's commands and angles, and the load that it moved."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.hardware.joint_log import read_columns
from drake_gait.ranges import Range, Unit, check
from drake_gait.servo import Servo

ROTOR_INERTIA = 1e-3
"""Of the motor, seen from the joint [kg·m²]: that of the shipped robots."""
STALL_TORQUE = 1.373
"""Largest torque of the controller [N·m]: 14.0 kgf·cm, KRS-2552 data."""

_LONGEST_GAP = 0.05  # s, between two rows
_SHORTEST = 2.0  # s
_LEAST_MOTION = math.radians(3.0)


@dataclass(frozen=True, kw_only=True)
class Load:
    """The load that a servo moves, and the known numbers of the servo."""

    inertia: float
    """Inertia of the load about the joint's axis [kg·m²]."""
    gravity_torque: float = 0.0
    """Mass x gravity x distance of the centre of mass from the axis [N·m]; 0: axis upright."""
    hanging: float = 0.0
    """Angle of the joint at which the load hangs straight down [rad]."""
    rotor_inertia: float = ROTOR_INERTIA
    """Inertia of the motor's rotor, seen from the joint [kg·m²]."""
    stall_torque: float = STALL_TORQUE
    """Largest torque of the controller [N·m]."""
    no_load_speed: float = Servo.no_load_speed
    """Speed at which the motor has no torque left [rad/s]."""

    def __post_init__(self) -> None:
        inertia, torque = Unit(name="kg·m²"), Unit(name="N·m")
        # A load of 10 kg at 1 m is beyond any servo of these robots.
        check("inertia", self.inertia, Range(lower=0.0, upper=10.0, open=True), inertia)
        check("gravity_torque", self.gravity_torque, Range(lower=0.0, upper=100.0), torque)
        check("hanging", self.hanging, Range(lower=-math.pi, upper=math.pi), Unit(name="rad"))
        check("rotor_inertia", self.rotor_inertia, Range(lower=0.0, upper=1.0), inertia)
        above = Range(lower=0.0, upper=1e3, open=True)
        check("stall_torque", self.stall_torque, above, torque)
        check("no_load_speed", self.no_load_speed, above, Unit(name="rad/s"))


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoLog:
    """Commands and measured angles of one servo."""

    times: FloatArray
    """Time of each row [s], shape (n,), rising."""
    commands: FloatArray
    """Angles that it was sent [rad], shape (n,); between rows the line between them counts."""
    angles: FloatArray
    """Angles that were measured [rad], shape (n,)."""


def read_servo_log(path: Path) -> ServoLog:
    """Read a CSV file with columns time_s, command_deg and angle_deg.

    Raises:
        SettingsError: it cannot be read, or is too short, too coarse or too still to say anything.
    """
    times, commands, angles = read_columns(path, ["command_deg", "angle_deg"])
    gap = int(np.diff(times).argmax())
    spans = float(np.ptp(times)), float(np.diff(times)[gap])
    if spans[0] < _SHORTEST:
        raise SettingsError(f"{path} spans {spans[0]:g} s; at least {_SHORTEST:g} s are needed")
    if spans[1] > _LONGEST_GAP:
        raise SettingsError(
            f"{path} has no row between {times[gap]:g} and {times[gap + 1]:g} s; rows must be "
            f"{1e3 * _LONGEST_GAP:g} ms apart at most"
        )
    for name, column in (("command_deg", commands), ("angle_deg", angles)):
        motion = float(np.ptp(column))
        if motion < math.degrees(_LEAST_MOTION):
            raise SettingsError(
                f"{path}: {name} moves by {motion:.2g} degrees only; move by at least "
                f"{math.degrees(_LEAST_MOTION):.0f}, in steps and in sines"
            )
    furthest = float(np.abs([commands, angles]).max())
    if furthest > 180.0:
        raise SettingsError(
            f"{path} has an angle of {furthest:g}; angles must be degrees, -180 to 180"
        )
    return ServoLog(times=times, commands=np.radians(commands), angles=np.radians(angles))
