"""Write a study's page again, or compare studies: `python -m drake_gait report RUN [RUN...]`.

One run: its figures, recording, result.json and report.html are made anew from its walks; a study
that is still running is shown as far as it is. Several runs: one page with them side by side.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from drake_gait.errors import GaitError
from drake_gait.report.build import write_outputs
from drake_gait.report.page import Run, read_result, write_comparison_page
from drake_gait.study.store import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait report", description=summary.partition(":")[0], epilog=rest
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="RUN", help="a study's folder")
    parser.add_argument("--out", type=Path, help="where a comparison goes (comparison.html)")
    options = parser.parse_args(arguments)
    try:
        if len(options.folders) == 1:
            if options.out is not None:
                parser.error("argument --out: a single run's page is RUN/report.html")
            _remake(options.folders[0])
        else:
            _compare(options.folders, options.out or Path("comparison.html"))
    except GaitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _remake(folder: Path) -> None:
    with Study.open(folder / "study.db") as study:
        description, settings, walks = study.description(), study.settings(), study.walks()
    write_outputs(settings, walks, folder, wall_s=description.get("wall_s", 0.0))
    print(folder / "report.html")


def _compare(folders: Sequence[Path], out: Path) -> None:
    write_comparison_page([_run(folder) for folder in folders], out)
    print(out)


def _run(folder: Path) -> Run:
    with Study.open(folder / "study.db") as study:
        settings, walks = study.settings(), study.walks()
    return Run(
        folder=folder,
        settings=settings,
        result=read_result(folder),
        walks=walks,
    )


if __name__ == "__main__":
    sys.exit(main())
