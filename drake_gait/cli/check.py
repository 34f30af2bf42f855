"""Stand a robot up and tell what a search needs: `python -m drake_gait check ROBOT.toml`.

ROBOT.toml is a robot's file; a model alone (SDFormat, URDF, MJCF) is taken for an edited KHR-3HV.
Told are mass, height, centre of mass, the room between the feet, shapes that touch, and what
standing needs of every servo. check.html shows it. --study writes a study to begin with.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli._signals import importing
from drake_gait.files.destination import check
from drake_gait.robot.description import read_model
from drake_gait.robot.robot_file import robot_path


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _work(_parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait check",
        description=summary.partition(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument("robot", metavar="ROBOT.toml", help="a robot's file, or a model")
    parser.add_argument("--model", default="", metavar="FILE", help="another model of this robot")
    parser.add_argument(
        "--out", type=Path, default=Path("check.html"), metavar="FILE", help="where it is shown "
        "(check.html)",
    )  # fmt: skip
    parser.add_argument("--study", type=Path, metavar="FILE", help="a study's file to write")
    return parser.parse_args(arguments)


def _work(options: argparse.Namespace) -> None:
    named = (options.model, options.robot) if options.model else (options.robot, "")
    model = read_model(*named)
    if options.model:
        robot_path(options.robot)
    check(options.out, what="the recording ")
    if options.study is not None:
        check(options.study, what="the study ")
    with importing():
        from drake_gait.cli import _check
    _check.work(options, model)
