"""Play a walk on the robot: `python -m drake_gait play RUN --port DEVICE`.

The winner, or --walk, is checked as by `export --motion`. The robot moves to the first posture in
three seconds, you are asked, and the frames follow. Ctrl-C stops them, and the servos hold.
--dry-run prints what would be sent. It has been tried against a simulated controller only.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli._motion_options import add_motion_options
from drake_gait.cli._signals import importing

_BAUD_RATE = 1_250_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(
        lambda: _play(_parse(arguments)), stopped="stopped; the servos hold where they are"
    )


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait play",
        description=summary.partition(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a study's folder")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--port", metavar="DEVICE", help="the controller, such as /dev/ttyUSB0")
    where.add_argument("--dry-run", action="store_true", help="print what would be sent")
    parser.add_argument(
        "--baud-rate", type=int, metavar="N", default=_BAUD_RATE, help=f"({_BAUD_RATE})"
    )
    parser.add_argument("--yes", action="store_true", help="do not ask before the first frame")
    add_motion_options(parser)
    return parser.parse_args(arguments)


def _play(options: argparse.Namespace) -> None:
    with importing():
        from drake_gait.cli._motion import prepare_motion
        from drake_gait.hardware.player import open_board, play
    prepared = prepare_motion(options, sys.stderr)
    motion, servos = prepared.motion, prepared.servos
    if options.dry_run:
        print(f"time [ms], position of servos {', '.join(map(str, servos.ids))}")
        positions = servos.positions(motion.angles)
        for time, row in zip(1e3 * motion.times, positions.tolist(), strict=True):
            print(f"{time:6.0f}  {' '.join(f'{value:5d}' for value in row)}")
        return
    board = open_board(options.port, options.baud_rate, log=sys.stderr)
    try:
        agreed = (lambda: True) if options.yes else _ask
        played = play(motion, servos, board, agreed=agreed, log=sys.stderr)
    finally:
        board.close()
    if played is None:
        print("not played; the robot holds its first posture")
        return
    print(
        f"{prepared.caption}: {played.frames} frames played, {played.late} of them late, at worst "
        f"by {1e3 * played.worst:.0f} ms; the robot holds its last posture"
    )


def _ask() -> bool:
    print("The robot has its first posture. Play the walk? [y/N] ", end="", file=sys.stderr)
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")
