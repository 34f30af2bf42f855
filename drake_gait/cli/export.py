"""Take a study elsewhere: `python -m drake_gait export RUN --csv|--optuna|--motion WHERE`.

--csv writes all walks with all columns and every digit. --optuna makes an Optuna study of them in a
database such as sqlite:///optuna.db, or adds the walks that it lacks. Running studies can be
exported as well.

--motion writes the winner, or --walk, as a robot plays it, one row a frame. The joint angles are in
degrees; with --units rcb4 they are positions of the servos. Ranges, speeds and the gap between the
legs are checked before anything is written. --soften closes the jumps of the command.
"""

import argparse
import csv
import io
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli._motion_options import MOTION_OPTIONS, add_motion_options
from drake_gait.cli._signals import importing
from drake_gait.errors import StudyError
from drake_gait.files.destination import STANDARD_OUTPUT, check, messages, write
from drake_gait.files.shipped import find
from drake_gait.study.store import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _export(_parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait export", description=summary.split(":")[0], epilog=rest
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a study's folder")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--csv", type=Path, metavar="FILE", help="the file to write; - for stdout")
    where.add_argument("--optuna", metavar="URL", help="the database of the Optuna study")
    where.add_argument(
        "--motion", type=Path, metavar="FILE", help="the motion to write; - for stdout"
    )
    parser.add_argument("--name", help="name of the Optuna study (that of the folder)")
    add_motion_options(parser)
    parser.add_argument(
        "--units", choices=("degrees", "rcb4"), help="of a motion: joint angles, or positions"
    )
    found = parser.parse_args(arguments)
    given = [f"--{name}" for name in (*MOTION_OPTIONS, "units") if getattr(found, name)]
    if found.motion is None and given:
        parser.error(f"argument {given[0]}: is for --motion FILE")
    return found


def _export(options: argparse.Namespace) -> None:
    if options.motion is not None:
        with importing():
            from drake_gait.cli import _motion
        _motion.write_motion(options)
        return
    with Study.open(find(options.run)) as study:
        if options.csv is not None:
            _to_csv(study, options.csv)
        else:
            _to_optuna(study, options.optuna, options.name)


def _to_csv(study: Study, path: Path) -> None:
    """All walks; numbers as Python writes them, which is every digit."""
    check(path)
    names, rows = study.rows()
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    write(path, text.getvalue())
    if path != STANDARD_OUTPUT:
        print(f"{path}: {len(rows)} walks", file=messages(path))


def _to_optuna(study: Study, url: str, name: str | None) -> None:
    try:
        from drake_gait.report.optuna import export_to_optuna, shown
    except ImportError as error:
        raise StudyError(
            f"--optuna needs the extra of this name ({error}): pip install 'drake-gait[optuna]'"
        ) from None
    name = name or study.path.resolve().parent.name
    added, there = export_to_optuna(study, url, name)
    print(f"{shown(url)}, study {name}: {added} walks added, {there} were there")
