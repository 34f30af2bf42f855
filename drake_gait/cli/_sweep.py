"""The work of `sweep`: run studies beside each other, or a grid, and sum them up."""

import os
import shlex
import signal
import subprocess
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from drake_gait.cli._table import show
from drake_gait.cli.progress import display
from drake_gait.errors import SettingsError, StudyError
from drake_gait.execution.machine import DRIVER_MEMORY, ONE_THREAD, WORKER_MEMORY, default_workers
from drake_gait.execution.parent import GRACE, Lifeline
from drake_gait.optimization import is_finished, workers_of
from drake_gait.study._lock import driver_lock, is_driven
from drake_gait.study._toml import as_toml
from drake_gait.sweep.grid import (
    is_walked,
    open_grid,
    places,
    study_of,
    walk_grid,
    walks_of,
)
from drake_gait.sweep.grid_results import OUTPUTS, effects_table, means_table
from drake_gait.sweep.grid_results import write_results as write_grid_results
from drake_gait.sweep.results import (
    COST,
    FURTHEST,
    ROBUST,
    read_row,
    summaries,
    table,
    write_results,
)
from drake_gait.sweep.settings import Grid, PlannedStudy, Sweep
from drake_gait.visualization import study as study_figures
from drake_gait.visualization import sweep as sweep_figures

if TYPE_CHECKING:
    from drake_gait.cli.sweep import Options


_POLLING = 0.2  # Time between two looks at the studies that run [s].
_STOPPING = 60.0  # What a study may take to stop [s].
_LONGEST_WORD = 300  # Of the last line that a study said, so much is repeated.


def work(sweep: Sweep, out: Path, options: "Options") -> None:
    """Run a sweep in a folder, as the command line says."""
    with driver_lock(out / "sweep"):
        if sweep.grid is not None:
            _run_grid(sweep.grid, out, options)
            return
        if options.dask is not None:
            raise SettingsError(
                f"--dask {options.dask} is for a sweep with a [grid]; the studies of variants run "
                "on this machine, or one by one with `optimize --dask`"
            )
        room = default_workers(len(sweep.studies), memory=DRIVER_MEMORY + WORKER_MEMORY)
        _run_studies(sweep, out, options.workers or room)
        _write_results(sweep, out)


def _run_grid(grid: Grid, out: Path, options: "Options") -> None:
    """Walk a grid to its end, write its results, and print its tables."""
    settings = study_of(grid)
    workers = options.workers or default_workers(len(places(grid)))
    with open_grid(grid, out) as study:
        if is_walked(study):
            print(f"{out} is finished; more grid.replicas extend it")
        else:
            with (
                display(settings, len(study.walks())) as progress,
                workers_of(settings, study, workers, dask=options.dask) as executor,
            ):
                walk_grid(grid, study, executor, progress)
        found = write_grid_results(grid, walks_of(grid, study), out)
    print()
    if found.obstacle:
        print(found.obstacle)
    else:
        show(effects_table(found))
    print()
    show(means_table(found))
    print(f"\n{found.best_in_words()}\n{out}: study.db, {', '.join(OUTPUTS)}")


def _run_studies(sweep: Sweep, out: Path, workers: int) -> None:
    """Bring every study to its end, `workers` of them beside each other."""
    waiting = deque(study for study in sweep.studies if not _has_result(study, out))
    total = len(sweep.studies)
    before = total - len(waiting)
    print(f"sweep {sweep.name}: {total} studies, {before} of them finished before", flush=True)
    running: dict[subprocess.Popen[bytes], PlannedStudy] = {}
    done = total - len(waiting)
    with Lifeline() as lifeline:
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    study = waiting.popleft()
                    _wait_for_another(study.folder(out))
                    running[_start(sweep, study, out, lifeline)] = study
                time.sleep(_POLLING)
                for process in [process for process in running if process.poll() is not None]:
                    study = running.pop(process)
                    if process.returncode:
                        raise StudyError(_why_it_stopped(sweep, study, out, process.returncode))
                    done += 1
                    print(f"{done}/{total} {_in_words(study, out)}", flush=True)
        finally:
            _stop(list(running))


def _has_result(study: PlannedStudy, out: Path) -> bool:
    """Return whether a study is at its end and its report is written."""
    folder = study.folder(out)
    if not is_finished(study.settings, folder) or not (folder / "report.html").exists():
        return False
    try:
        read_row(study, out)
    except StudyError:  # Damaged or missing: the study writes it anew from its walks.
        return False
    return True


def _wait_for_another(folder: Path) -> None:
    """Wait for a study that is about to end, because the sweep that started it was killed."""
    for _ in range(round(GRACE / _POLLING)):
        if not is_driven(folder / "study.db"):
            return
        time.sleep(_POLLING)


def _start(
    sweep: Sweep, study: PlannedStudy, out: Path, lifeline: Lifeline
) -> subprocess.Popen[bytes]:
    """Start a process that runs one study with one worker, its output in log.txt."""
    folder = study.folder(out)
    command = lifeline.command("drake_gait.optimize", _arguments(sweep, study, out))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log.txt").open("wb") as log:
            # A session of its own: Ctrl-C reaches this process alone, which passes it on once.
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **ONE_THREAD},
                pass_fds=[lifeline.descriptor],
                start_new_session=True,
            )
    except OSError as error:
        raise StudyError(f"cannot start a study in {folder}: {error.strerror}") from None


def _arguments(sweep: Sweep, study: PlannedStudy, out: Path) -> list[str]:
    """Return the arguments of `optimize` that run a study."""
    folder = study.folder(out)
    settings = [
        f"{section}.{key}={as_toml(value)}" for (section, key), value in study.overrides.items()
    ]
    command = [str(sweep.base), "--workers", "1", "--out", str(folder)]
    return command + [word for text in settings for word in ("--set", text)]


def _stop(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Interrupt studies, as Ctrl-C does, and wait until they have stopped."""
    for process in processes:
        process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(_STOPPING)
        except subprocess.TimeoutExpired:
            process.kill()


def _why_it_stopped(sweep: Sweep, study: PlannedStudy, out: Path, status: int) -> str:
    """Say how a study ended, its last words, and the command that runs it alone."""
    folder = study.folder(out)
    alone = shlex.join(["python", "-m", "drake_gait.optimize", *_arguments(sweep, study, out)])
    how = f"ended with status {status}"
    if status < 0:
        names = [one.name for one in signal.Signals if one == -status]
        how = f"was ended by {names[0] if names else f'signal {-status}'}"
    if status == -signal.SIGKILL:
        how += ", as the system does where memory is short"
    return (
        f"the study in {folder} {how}, and {_last_words(folder / 'log.txt')}; the same command "
        f"goes on, and this runs the study alone: {alone}"
    )


def _last_words(log: Path) -> str:
    """Return the end of a sentence that quotes the last line of a log."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        return f"its log.txt cannot be read: {error.strerror}"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines:
        return "said nothing"
    return f"said '{lines[-1].removeprefix('error: ')[:_LONGEST_WORD]}'"


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
    costs = [(row["forward_mm"], row[COST]) for row in rows if row["feasible"] and row.get(COST)]
    if costs:
        forward, cost = zip(*costs, strict=True)
        study_figures.pareto(forward, cost, [True] * len(costs), out / "pareto.png")
    else:
        (out / "pareto.png").unlink(missing_ok=True)  # Of an earlier run.
    print()
    show(table(summaries(rows, sweep.variants)))
    print()
    drawn = [name for name in ("sweep.png", "pareto.png") if (out / name).is_file()]
    print(f"{out}: {', '.join(['sweep.csv', 'sweep.json', *drawn])}, and a folder for each study")
