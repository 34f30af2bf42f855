"""Search the gaits of a study: `python -m drake_gait.optimize [STUDY.toml]`.

Without arguments it runs the default study, studies/steady.toml. The same command again goes on
with an unfinished study, and a larger --simulations with a finished one. In the study's folder it
leaves study.db (every walk), report.html (what came out), result.json, walk.html (a recording)
and figures.
"""

import argparse
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drake_gait.cli._command import conduct
from drake_gait.cli.progress import display
from drake_gait.execution.machine import default_workers
from drake_gait.files.shipped import find
from drake_gait.optimization import open_study, run_study
from drake_gait.report.build import check_outputs, write_outputs
from drake_gait.report.result import (
    baselines_line,
    manner_in_words,
    r_squared_line,
    robust_table,
    table,
)
from drake_gait.search.loop import useful_workers
from drake_gait.study.reading import default_study, read_override, read_study
from drake_gait.study.robot import with_robot
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.surrogates.ensemble import FEWEST_SURVIVORS


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line says."""

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
        lambda: _search(parse(arguments)),
        stopped="stopped; what was simulated is safe, and the same command goes on",
        searches=True,
    )


def _search(options: Options) -> None:
    settings = options.settings()
    folder = options.folder(settings.name)
    workers = options.workers or default_workers(useful_workers(settings))
    _run(settings, folder, workers, options.dask)


def _run(settings: StudySettings, folder: Path, workers: int, dask: str | None) -> None:
    for note in settings.notes:
        print(note)
    with open_study(settings, folder) as study:
        check_outputs(folder)
        if "finished" in study.description():
            print(
                f"{folder} is finished; more --simulations go on with it, another seed or --out "
                "starts another study"
            )
        else:
            walks = sum(walk.is_search_walk for walk in study.walks())
            with display(settings, walks) as show:
                run_study(settings, study, workers, show, dask=dask)
        _write_results(settings, study, folder)


def _write_results(settings: StudySettings, study: Study, folder: Path) -> None:
    """Write what the study's folder is to hold, and print the table."""
    walks, wall_s = study.walks(), study.description().get("wall_s", 0.0)
    written = write_outputs(with_robot(settings, study), walks, folder, wall_s=wall_s)
    searched = sum(walk.is_search_walk for walk in walks)
    print(written.result["verdict"])
    if written.network is not None:
        print(f"network of all {searched} walks: {r_squared_line(written.network)}")
        print(baselines_line(written.result))
    else:
        print(
            f"no network: {written.result['survivors']} of {searched} walks survived, and it "
            f"needs {FEWEST_SURVIVORS}; move the box to gaits that walk, or let more be simulated"
        )
    print(f"\n{table(walks, settings.constraints)}\n")
    print(
        "walked again: T1 with noise and other friction, T2 with fresh noise at reference "
        f"fidelity, T3 with other servos:\n{robust_table(settings, walks)}\n"
    )
    if written.replayed is not None and written.replayed.measures is not None:
        print(f"how it walks: {manner_in_words(written.replayed.measures)}")
    print(f"{folder}: {', '.join(written.files)}")
