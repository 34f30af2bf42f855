"""The work of `report`: write one study's page again, or compare several."""

from collections.abc import Sequence
from pathlib import Path

from drake_gait.files.destination import check, messages
from drake_gait.files.shipped import find
from drake_gait.report.build import write_report
from drake_gait.report.page import Run, write_comparison_page
from drake_gait.report.study_result import read_result
from drake_gait.study.store import Study


def work(folders: Sequence[Path], out: Path | None) -> None:
    """Remake the page of one study, or compare several."""
    if len(folders) == 1:
        _remake(folders[0])
    else:
        _compare(folders, out or Path("comparison.html"))


def _remake(folder: Path) -> None:
    write_report(folder)
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
