"""Lay measured joint angles over simulated ones: `python -m drake_gait overlay RUN LOG.csv`.

LOG.csv has a column time_s, and angles in degrees in columns named as joints (hip_roll_r, knee_l
and so on, or as in the robot's model). Its time 0 is the walk's; --shift moves it. For each joint
the delay and the root mean square of the difference are told. --out draws the angles over each
other.
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
        prog="python -m drake_gait overlay",
        description=summary.partition(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a study's folder")
    parser.add_argument("log", type=Path, metavar="LOG.csv", help="measured joint angles")
    parser.add_argument("--walk", type=int, metavar="ID", help="number of the walk (the winner)")
    parser.add_argument(
        "--shift", type=float, default=0.0, metavar="S", help="added to the log's times (0)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="the figure, .png or .svg")
    return parser.parse_args(arguments)


def _work(options: argparse.Namespace) -> None:
    with importing():
        from drake_gait.cli import _overlay
    _overlay.work(options)
