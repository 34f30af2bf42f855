"""The work of `identify`: read, fit, print."""

import argparse
import math
import sys

from drake_gait.cli._signals import importing
from drake_gait.errors import SettingsError
from drake_gait.hardware.servo_log import Load, read_servo_log
from drake_gait.ranges import DEGREES, OutOfRangeError, Unit

_OPTIONS = {
    "inertia": ("inertia", Unit(name="kg·m²")),
    "gravity_torque": ("gravity_torque", Unit(name="N·m")),
    "hanging": ("hanging_deg", DEGREES),
    "rotor_inertia": ("rotor_inertia", Unit(name="kg·m²")),
    "stall_torque": ("stall_torque", Unit(name="N·m")),
    "no_load_speed": ("no_load_speed", Unit(name="rad/s")),
}
"""Fields of Load, with the options that set them and their units."""


def _load(options: argparse.Namespace) -> Load:
    """Return the load that the options tell."""
    given = {field: (getattr(options, name), unit) for field, (name, unit) in _OPTIONS.items()}
    told = {field: value * unit.si for field, (value, unit) in given.items() if value is not None}
    try:
        return Load(**told)
    except OutOfRangeError as error:
        option = f"--{_OPTIONS[error.field][0].replace('_', '-')}"
        raise SettingsError(error.told(option, *given[error.field])) from None


def work(options: argparse.Namespace) -> None:
    """Do what the command line says."""
    load, log = _load(options), read_servo_log(options.log)
    with importing():  # scipy, once there is something to fit.
        from drake_gait.hardware.identification import identify
    found = identify(log, load, str(options.log))
    print(found.section())
    print(
        f"{options.log}: the model is off by {math.degrees(found.rms):.2g} degrees (rms), the zero "
        f"by {math.degrees(found.zero):.2g}; play and friction by load are not fitted",
        file=sys.stderr,
    )
