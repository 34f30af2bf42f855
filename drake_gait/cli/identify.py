"""Find a servo's numbers in a log of its motion: `python -m drake_gait identify LOG.csv`.

LOG.csv has columns time_s, command_deg and angle_deg of one joint that moves a known load. Its
stiffness, damping, friction and delay are fitted, and printed as a section [servo] of a study, with
intervals of 95 %.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli._signals import importing


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _work(_parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait identify",
        description=summary.partition(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument("log", type=Path, metavar="LOG.csv", help="commands and measured angles")
    parser.add_argument(
        "--inertia", type=float, required=True, metavar="KG_M2", help="of the load about the axis"
    )
    for name, metavar, meaning in (
        ("--gravity-torque", "N_M", "mass x gravity x distance from the axis (0: axis upright)"),
        ("--hanging-deg", "DEG", "angle at which the load hangs straight down (0)"),
        ("--rotor-inertia", "KG_M2", "of the motor, seen from the joint (0.001)"),
        ("--stall-torque", "N_M", "largest torque of the servo (1.373)"),
        ("--no-load-speed", "RAD_PER_S", "largest speed of the servo (7.48)"),
    ):
        parser.add_argument(name, type=float, metavar=metavar, help=meaning)
    return parser.parse_args(arguments)


def _work(options: argparse.Namespace) -> None:
    with importing():
        from drake_gait.cli import _identify
    _identify.work(options)
