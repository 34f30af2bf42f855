"""Run many studies, or a grid of feet, by one command: `python -m drake_gait sweep SWEEP.toml`.

The same command again resumes an unfinished sweep. Every study is an ordinary one, in
<folder>/<variant>/seed-<n>; they run beside each other, one on each core. The sweep's folder then
holds a figure, and sweep.csv and sweep.json with a row for each study. A grid's folder is a study:
it holds study.db, grid.csv with a row for each walk, anova.json and a figure.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli._signals import importing
from drake_gait.files.shipped import find
from drake_gait.sweep.settings import read_sweep


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of the command line."""

    sweep: Path
    """The sweep's TOML file."""
    workers: int | None
    """Studies beside each other, or processes that walk a grid; as many as there is room and work
    for if None."""
    dask: str | None
    """A Dask cluster that walks a grid: its scheduler's address or file, or "local"."""
    out: Path | None
    """The sweep's folder; runs/<sweep> if None."""


def parse(arguments: Sequence[str] | None = None) -> Options:
    """Read the command line; exits with status 2 where it cannot."""
    summary_line, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait sweep",
        description=summary_line.split(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument("sweep", type=Path, metavar="SWEEP.toml", help="what is to be run")
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="studies beside each other (one per core, as far as memory and work go)",
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="walk a grid on a Dask cluster: tcp://HOST:8786, its scheduler file, or local",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="the sweep's folder (runs/<sweep>)")
    found = parser.parse_args(arguments)
    if found.workers is not None and found.workers < 1:
        parser.error(f"argument --workers: must be >= 1, got {found.workers}")
    return Options(**vars(found))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(
        lambda: _work(parse(arguments)),
        stopped="stopped; what was simulated is safe, and the same command goes on",
        searches=True,
    )


def _work(options: Options) -> None:
    sweep = read_sweep(find(options.sweep), options.out)
    with importing():  # What a wrong input needs not wait for.
        from drake_gait.cli import _sweep
    _sweep.work(sweep, options.out or Path("runs") / sweep.name, options)
