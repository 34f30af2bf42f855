"""The work of `report`: write one study's page again, or compare several."""

from collections.abc import Sequence
from pathlib import Path

from drake_gait.files.destination import messages
from drake_gait.report.build import write_report
from drake_gait.report.page import Run, write_comparison_page
from drake_gait.report.study_result import read_result
from drake_gait.study.store import Study


def remake(folder: Path) -> None:
    """Remake the page of one study."""
    write_report(folder)
    print(folder / "report.html")


def compare(folders: Sequence[Path], out: Path) -> None:
    """Write a page with several studies side by side."""
    write_comparison_page([_run(folder) for folder in folders], out)
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
