"""Measure how a search grows with its walks: `python tools/bench_growth.py [--walks 1000 20000]`.

For each number of walks a study of the default settings is filled with walks that are computed in
no time (stand_in.py), but for the last batches, which the search then proposes and makes. The table
has what one batch takes, what the process holds at most, the size of the file, and what the study
takes to be read. Each number has a process of its own.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from markdown_table import heading, row
from stand_in import StandIn

from drake_gait.execution.base import Serial
from drake_gait.optimization import identity
from drake_gait.problem import Trial
from drake_gait.robot.description import read_model
from drake_gait.search.grounds import end_of_proposal, on_ground
from drake_gait.search.loop import search
from drake_gait.search.runner import Progress
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study

WALKS = (1000, 20000)
BATCHES = 3
"""Batches that are proposed."""
MEGABYTE = 1e6


def filled(settings: StudySettings, study: Study) -> None:
    """Fill a study with the walks of all batches but the last ones."""
    plan, walk = settings.search, StandIn(settings)
    rng = np.random.default_rng(0)
    batches = -(-(plan.simulations - plan.samples) // plan.batch)
    for number in range(plan.samples + (batches - BATCHES) * plan.batch):
        iteration = max(0, 1 + (number - plan.samples) // plan.batch)
        x = rng.uniform(-1.0, 1.0, settings.space.dimension) * (1.0 if iteration == 0 else 0.5)
        trial = Trial(
            candidate=settings.space.decode(x),
            settings=on_ground(
                settings.trial_settings, settings, end_of_proposal(settings, iteration, number)
            ),
        )
        study.add(
            StudyWalk(
                id=number,
                stage="infill" if iteration else "design",
                iteration=iteration,
                candidate=trial.candidate,
                walk=walk(trial),
            )
        )


def memory() -> float:
    """Return what this process holds just now [bytes]; its most where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0


def measured(walks: int) -> list[str]:
    """Return the row of a number of walks."""
    settings = read_study(default_study(), {("search", "simulations"): walks})
    settings = replace(settings, confirmation=replace(settings.confirmation, walks=0))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.db"
        with Study.create(path, identity(settings, read_model(settings.walk.model))) as study:
            start = time.process_time()
            filled(settings, study)
            adding = (time.process_time() - start) / walks
        with Study.open(path, driver=True) as study:
            before, start = memory(), time.process_time()
            study.walks()
            reading = time.process_time() - start
            ends: list[float] = []

            def note(progress: Progress, ends: list[float] = ends) -> None:
                ends.append(time.process_time())

            search(settings, study, Serial(StandIn(settings)).run, note)
            # The first of the batches pays for what a study that goes on knows.
            batch = settings.search.batch
            proposing = (ends[-1] - ends[-1 - (BATCHES - 1) * batch]) / (BATCHES - 1)
            held = memory() - before
        size = path.stat().st_size
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
    return [
        str(walks),
        f"{proposing:.2f}",
        f"{1e3 * adding:.2f}",
        f"{reading:.2f}",
        f"{held / MEGABYTE:.0f}",
        f"{most / MEGABYTE:.0f}",
        f"{size / MEGABYTE:.2f}",
        f"{size / walks:.0f}",
    ]


COLUMNS = (
    "walks",
    "proposal of a batch [CPU s]",
    "storing a walk [CPU ms]",
    "reading the study [CPU s]",
    "memory beside the imports [MB]",
    "most memory [MB]",
    "file [MB]",
    "file, a walk [bytes]",
)


def in_a_process(walks: int) -> list[str]:
    """Return the row of a number of walks, measured in a process of its own."""
    command = [sys.executable, __file__, "--one", str(walks)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return [cell.strip() for cell in printed.strip().strip("|").split("|")]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--walks", type=int, nargs="+", default=WALKS, metavar="N")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        print(row(measured(options.one)))
        return
    print(heading(COLUMNS))
    for walks in options.walks:
        print(row(in_a_process(walks)), flush=True)


if __name__ == "__main__":
    main()
