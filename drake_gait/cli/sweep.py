"""Run many studies, or a grid of feet, by one command: `python -m drake_gait sweep SWEEP.toml`.

The same command again goes on with an unfinished sweep. Every study is an ordinary one, in
<folder>/<variant>/seed-<n>; they run beside each other, one on each core. The sweep's folder then
holds sweep.csv and sweep.json, a row for each study, and a figure; a grid's holds grid.csv, a row
for each walk, anova.json and a figure.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from drake_gait.cli._signals import ctrl_c_ends_at_once, exit_status, leave, sigterm_interrupts

if __name__ == "__main__":
    ctrl_c_ends_at_once()  # Before the slow imports.

from drake_gait.errors import GaitError, StudyError
from drake_gait.optimization import is_finished
from drake_gait.sweep.grid import run_grid
from drake_gait.sweep.results import (
    COST,
    FURTHEST,
    ROBUST,
    read_row,
    summaries,
    table,
    write_results,
)
from drake_gait.sweep.settings import PlannedStudy, Sweep, read_sweep
from drake_gait.visualization import study as study_figures
from drake_gait.visualization import sweep as sweep_figures

_POLLING = 0.2  # Time between two looks at the studies that run [s].
_STOPPING = 60.0  # What a study may take to stop [s].

# Studies beside each other are faster than one whose libraries want all cores.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass(frozen=True, kw_only=True)
class Options:
    """What the command line says."""

    sweep: Path
    """The sweep's TOML file."""
    workers: int
    """Studies beside each other, or processes that walk a grid."""
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
    parser.add_argument("--workers", type=int, help="studies beside each other (one per core)")
    parser.add_argument("--out", type=Path, help="the sweep's folder (runs/<sweep>)")
    found = parser.parse_args(arguments)
    if found.workers is not None and found.workers < 1:
        parser.error(f"argument --workers: must be >= 1, got {found.workers}")
    found.workers = found.workers or len(os.sched_getaffinity(0))
    return Options(**vars(found))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    options = parse(arguments)
    try:
        with sigterm_interrupts():
            sweep = read_sweep(options.sweep)
            out = options.out or Path("runs") / sweep.name
            if sweep.grid is not None:
                print(run_grid(sweep.grid, out, options.workers))
            else:
                _run_studies(sweep, out, options.workers)
                _write_results(sweep, out)
    except GaitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interruption:
        print("\nstopped; what was simulated is safe, and the same command goes on", flush=True)
        return exit_status(interruption)
    return 0


def _run_studies(sweep: Sweep, out: Path, workers: int) -> None:
    """Bring every study to its end, `workers` of them beside each other."""
    waiting = deque(study for study in sweep.studies if not _has_result(study, out))
    total = len(sweep.studies)
    print(f"sweep {sweep.name}: {total} studies, {total - len(waiting)} of them finished before",
          flush=True)  # fmt: skip
    running: dict[subprocess.Popen[bytes], PlannedStudy] = {}
    done = total - len(waiting)
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                study = waiting.popleft()
                running[_start(sweep, study, out)] = study
            time.sleep(_POLLING)
            for process in [process for process in running if process.poll() is not None]:
                study = running.pop(process)
                if process.returncode:
                    raise StudyError(_why_it_stopped(study, out, process.returncode))
                done += 1
                print(f"{done}/{total} {_in_words(study, out)}", flush=True)
    finally:
        _stop(list(running))


def _has_result(study: PlannedStudy, out: Path) -> bool:
    folder = study.folder(out)
    return is_finished(study.settings, folder) and (folder / "result.json").exists()


def _start(sweep: Sweep, study: PlannedStudy, out: Path) -> subprocess.Popen[bytes]:
    """A process that runs one study with one worker, its output in log.txt."""
    folder = study.folder(out)
    settings = [
        f"{section}.{key}={json.dumps(value)}" for (section, key), value in study.overrides.items()
    ]
    command = [sys.executable, "-m", "drake_gait.optimize", str(sweep.base), "--workers", "1"]
    command += ["--out", str(folder), *(word for text in settings for word in ("--set", text))]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log.txt").open("wb") as log:
            # A session of its own: Ctrl-C reaches this process alone, which passes it on once.
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **_ONE_THREAD},
                start_new_session=True,
            )
    except OSError as error:
        raise StudyError(f"cannot start a study in {folder}: {error.strerror}") from None


def _stop(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Interrupt studies, as Ctrl-C does, and wait until they have stopped."""
    for process in processes:
        process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(_STOPPING)
        except subprocess.TimeoutExpired:
            process.kill()


def _why_it_stopped(study: PlannedStudy, out: Path, status: int) -> str:
    folder = study.folder(out)
    lines = (folder / "log.txt").read_text(encoding="utf-8", errors="replace").split("\n")
    said = next((line for line in reversed(lines) if line.strip()), "nothing")
    return (
        f"the study in {folder} ended with status {status} and said "
        f"'{said.removeprefix('error: ')}'; the same command goes on"
    )


def _in_words(study: PlannedStudy, out: Path) -> str:
    row = read_row(study, out)
    furthest, robust = (
        "none" if row[key] is None else f"{row[key]:.1f} mm" for key in (FURTHEST, ROBUST)
    )
    return f"{study.variant}, seed {study.seed}: furthest feasible {furthest}, robust {robust}"


def _write_results(sweep: Sweep, out: Path) -> None:
    rows = [read_row(study, out) for study in sweep.studies]
    write_results(sweep, rows, out)
    feasible = [row for row in rows if row[FURTHEST] is not None]
    sweep_figures.variants(
        {
            name: [row[FURTHEST] for row in feasible if row["variant"] == name]
            for name in sweep.variants
        },
        out / "sweep.png",
    )
    costs = [(row["forward_mm"], row[COST]) for row in rows if row["feasible"] and COST in row]
    if costs:
        forward, cost = zip(*costs, strict=True)
        study_figures.pareto(forward, cost, [True] * len(costs), out / "pareto.png")
    print(f"\n{table(summaries(rows, sweep.variants))}\n")
    print("median over the seeds (lowest to highest); p against the first variant")
    print(f"{out}: sweep.csv, sweep.json, sweep.png, pareto.png, and a folder for each study")


if __name__ == "__main__":
    leave(main())
