"""The work of `identify`: read, fit, print."""

import argparse
import math
import sys

from drake_gait.cli._signals import importing
from drake_gait.hardware.servo_log import Load, read_servo_log


def work(options: argparse.Namespace) -> None:
    """Do what the command line says."""
    given = {
        "gravity_torque": options.gravity_torque,
        "hanging": None if options.hanging_deg is None else math.radians(options.hanging_deg),
        "rotor_inertia": options.rotor_inertia,
        "stall_torque": options.stall_torque,
        "no_load_speed": options.no_load_speed,
    }
    known = {name: value for name, value in given.items() if value is not None}
    load, log = Load(inertia=options.inertia, **known), read_servo_log(options.log)
    with importing():  # scipy, when it is known that there is something to fit.
        from drake_gait.hardware.identification import identify
    found = identify(log, load, str(options.log))
    print(found.section())
    print(
        f"{options.log}: the model is off by {math.degrees(found.rms):.2g} degrees (rms), the zero "
        f"by {math.degrees(found.zero):.2g}; play and friction by load are not fitted",
        file=sys.stderr,
    )
