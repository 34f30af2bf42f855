"""Search the gaits of a study: `python -m drake_gait.optimize [STUDY.toml]`.

Without arguments it runs the default study, studies/steady.toml. The same command again resumes an
unfinished study, and a larger --simulations extends a finished one. In the study's folder it
leaves study.db (every walk), report.html, result.json, walk.html (a recording) and figures.
"""

import argparse
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli._signals import importing
from drake_gait.files.shipped import find
from drake_gait.study.reading import default_study, read_override, read_study
from drake_gait.study.settings import StudySettings


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of the command line."""

    study: Path
    """The study's TOML file."""
    overrides: tuple[str, ...]
    """Settings that take the place of the file's, each section.key=value; the last one counts."""
    workers: int | None
    """Processes that simulate; as many as there is room and work for if None."""
    dask: str | None
    """A Dask cluster that simulates instead of processes: its address or file, or "local"."""
    out: Path | None
    """The study's folder; runs/<study> if None."""

    def settings(self) -> StudySettings:
        """The study's settings, with what the command line overrides."""
        overrides = dict(read_override(text) for text in self.overrides)
        return read_study(find(self.study), overrides, begun=self.folder)

    def folder(self, name: str) -> Path:
        """Return the folder of a study of this name."""
        return self.out or Path("runs") / name


def parse(arguments: Sequence[str] | None = None) -> Options:
    """Read the command line; exits with status 2 where it cannot."""
    summary_line, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait.optimize",
        description=summary_line.split(":")[0],
        epilog=rest,
        allow_abbrev=False,
    )
    parser.add_argument(
        "study",
        nargs="?",
        type=Path,
        metavar="STUDY.toml",
        help="a study's settings (studies/steady.toml)",
    )
    set_by = functools.partial(parser.add_argument, action="append", dest="overrides", default=[])
    set_by("--set", metavar="SECTION.KEY=VALUE", help="override a setting of the file; repeatable")
    for option, name, what in (
        ("--samples", "search.samples", "walks of the design of experiments"),
        ("--simulations", "search.simulations", "walks in all, samples included"),
        ("--seed", "study.seed", "seed of every random number"),
    ):
        set_by(option, metavar="N", type=_sets(name), help=what)
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes that simulate (one per core, as far as memory and work go)",
    )
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="simulate on a Dask cluster: tcp://HOST:8786, its scheduler file, or local",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="the study's folder (runs/<study>)")
    found = parser.parse_args(arguments)
    if found.workers is not None and found.workers < 1:
        parser.error(f"argument --workers: must be >= 1, got {found.workers}")
    found.study, found.overrides = found.study or default_study(), tuple(found.overrides)
    return Options(**vars(found))


def _sets(name: str) -> Callable[[str], str]:
    """Reads an option that is short for `--set name=VALUE`."""
    return f"{name}={{}}".format


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(
        lambda: _work(parse(arguments)),
        stopped="stopped; what was simulated is safe, and the same command goes on",
        searches=True,
    )


def _work(options: Options) -> None:
    settings = options.settings()
    with importing():  # What a usage error needs not wait for.
        from drake_gait.cli import _optimize
    _optimize.work(settings, options.folder(settings.name), options.workers, options.dask)
