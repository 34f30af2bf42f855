"""Write a study's page again, or compare studies: `python -m drake_gait report RUN [RUN...]`.

One run: its figures, recording, result.json and report.html are made anew from its walks; a study
that is still running is shown as far as it is. Several runs: one page with them side by side.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.files.destination import check, messages
from drake_gait.files.shipped import find
from drake_gait.report.build import write_outputs
from drake_gait.report.page import Run, read_result, write_comparison_page
from drake_gait.study.robot import settings_with_robot
from drake_gait.study.store import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _report(*_parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> tuple[list[Path], Path | None]:
    """Folders of studies, and where a comparison goes."""
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait report", description=summary.partition(":")[0], epilog=rest
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="RUN", help="a study's folder")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="where a comparison goes (comparison.html); - for stdout",
    )
    options = parser.parse_args(arguments)
    if len(options.folders) == 1 and options.out is not None:
        parser.error("argument --out: a single run's page is RUN/report.html")
    return options.folders, options.out


def _report(folders: Sequence[Path], out: Path | None) -> None:
    if len(folders) == 1:
        _remake(folders[0])
    else:
        _compare(folders, out or Path("comparison.html"))


def _remake(folder: Path) -> None:
    with Study.open(folder / "study.db") as study:
        description, settings = study.description(), settings_with_robot(study)
        walks = study.walks()
    write_outputs(settings, walks, folder, wall_s=description.get("wall_s", 0.0))
    print(folder / "report.html")


def _compare(folders: Sequence[Path], out: Path) -> None:
    check(out, what="the report ")
    write_comparison_page([_run(find(folder)) for folder in folders], out)
    print(out, file=messages(out))


def _run(folder: Path) -> Run:
    with Study.open(folder / "study.db") as study:
        settings, walks = study.settings(), study.walks()
    return Run(
        folder=folder,
        settings=settings,
        result=read_result(folder),
        walks=walks,
    )
