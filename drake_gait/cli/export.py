"""Take a study elsewhere: `python -m drake_gait export RUN --csv FILE | --optuna URL`.

--csv writes all walks with all columns and every digit. --optuna makes an Optuna study of them, or
adds the walks that it lacks, in a database such as sqlite:///optuna.db. Running studies can be
exported as well.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from drake_gait.cli._signals import forget_pipe
from drake_gait.errors import GaitError, StudyError
from drake_gait.study.store import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait export", description=summary.split(":")[0], epilog=rest
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a study's folder")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--csv", type=Path, metavar="FILE", help="the file to write; - for stdout")
    where.add_argument("--optuna", metavar="URL", help="the database of the Optuna study")
    parser.add_argument("--name", help="name of the Optuna study (that of the folder)")
    options = parser.parse_args(arguments)
    try:
        with Study.open(options.run) as study:
            if options.csv is not None:
                _to_csv(study, options.csv)
            else:
                _to_optuna(study, options.optuna, options.name)
    except GaitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        forget_pipe()
    return 0


def _to_csv(study: Study, path: Path) -> None:
    if str(path) == "-":
        _write_csv(study, sys.stdout)
        sys.stdout.flush()
        return
    beginning = path.with_name(f"{path.name}.new")
    try:
        with beginning.open("w", newline="", encoding="utf-8") as file:
            count = _write_csv(study, file)
        beginning.replace(path)  # Nobody reads half a file.
    except OSError as error:
        beginning.unlink(missing_ok=True)
        raise StudyError(f"cannot write {path}: {error.strerror}") from None
    print(f"{path}: {count} walks")


def _write_csv(study: Study, file: IO[str]) -> int:
    """All walks; numbers as Python writes them, which is every digit. Returns their number."""
    names, rows = study.rows()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return len(rows)


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


if __name__ == "__main__":
    sys.exit(main())
