"""Options of the commands that hand a gait to a robot."""

import argparse
from pathlib import Path

MOTION_OPTIONS = ("walk", "robot", "frame_ms", "soften", "allow")
"""Names of these options."""

SOFT_SHARE = 0.5
"""Share of the servo's no-load speed that --soften allows where it names none."""


def add_motion_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which motion, for which robot, and how it is checked."""
    parser.add_argument("--walk", type=int, metavar="ID", help="number of the walk (the winner)")
    parser.add_argument(
        "--robot", type=Path, metavar="FILE", help="servos of the robot (models/khr3hv_servos.toml)"
    )
    parser.add_argument("--frame-ms", type=float, metavar="MS", help="time between two frames (20)")
    parser.add_argument(
        "--soften",
        nargs="?",
        type=float,
        const=SOFT_SHARE,
        metavar="SHARE",
        help=f"let no joint be faster than this share of its no-load speed ({SOFT_SHARE:g})",
    )
    parser.add_argument(
        "--allow",
        action="append",
        choices=("range", "speed", "collision"),
        help="take a motion with such violations",
    )
