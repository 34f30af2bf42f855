"""Write a study's page again, or compare studies: `python -m drake_gait report RUN [RUN...]`.

One run: result.json and report.html are written anew from its walks. So are those of its
figures, recording and network that would come out otherwise. The report of a running study has
the walks so far. Several runs: one page with them side by side.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from drake_gait.cli._command import conduct, require_studies
from drake_gait.cli._signals import importing
from drake_gait.files.destination import check
from drake_gait.files.shipped import find


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _work(*_parse(arguments)))


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


def _work(folders: Sequence[Path], out: Path | None) -> None:
    if len(folders) == 1:
        require_studies(folders)
        with importing():  # What a wrong input needs not wait for.
            from drake_gait.cli import _report
        _report.remake(folders[0])
        return
    out = out or Path("comparison.html")
    check(out, what="the report ")
    found = [find(folder) for folder in folders]
    require_studies(found)
    with importing():
        from drake_gait.cli import _report
    _report.compare(found, out)
