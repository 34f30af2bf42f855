"""One study in its folder: opened or gone on with, and searched to its end."""

import functools
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drake_gait.errors import StudyError
from drake_gait.execution.dask import DaskCluster, identity
from drake_gait.execution.local import LocalProcesses
from drake_gait.provenance import file_sha256, versions
from drake_gait.search.loop import search
from drake_gait.search.runner import Progress
from drake_gait.simulation.plant import build_robot, model_path
from drake_gait.simulation.simulate import walk_trial
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.walk import WalkSettings

STARTING_TIME = 60.0  # What a worker may need beside its walk, to import and to build [s].


def open_study(settings: StudySettings, folder: Path) -> Study:
    """The folder's study, to start or to go on with, as its driver.

    A study whose budget has grown is unfinished again.

    Raises:
        ModelError: the robot cannot be used; found out before anything is written.
        StudyError: the folder holds another study, or another driver has it.
    """
    build_robot(settings.walk.model, settings.space.foot, settings.walk.servo)
    path = folder / "study.db"
    wanted = _wanted(settings)
    if not path.exists():
        source = {} if settings.source is None else {"source": asdict(settings.source)}
        return Study.create(path, {**wanted, "versions": versions(), **source})
    study = Study.open(path, driver=True)
    try:
        study.require(wanted)
        study.resize(settings.search.simulations)
        if settings.source is not None and "source" not in study.description():  # Of before.
            study.set("source", asdict(settings.source))
    except StudyError:
        study.close()
        raise
    return study


def is_finished(settings: StudySettings, folder: Path) -> bool:
    """Whether the folder holds this study, at its end.

    Raises:
        StudyError: it holds another one.
    """
    path = folder / "study.db"
    if not path.exists():
        return False
    with Study.open(path) as study:
        study.require(_wanted(settings))
        known = study.description()
    budget = known["settings"]["search.simulations"]
    return "finished" in known and budget == settings.search.simulations


def _wanted(settings: StudySettings) -> dict[str, Any]:
    """What a study must have begun with, to be this one."""
    return {
        "settings": settings.description(),
        "model_sha256": file_sha256(model_path(settings.walk.model)),
    }


def run_study(
    settings: StudySettings,
    study: Study,
    workers: int,
    report: Callable[[Progress], None],
    *,
    dask: str | None = None,
) -> None:
    """Search an open study to its end, from wherever it stands, and mark it as finished.

    Its time on the clock and the deaths of its workers add up over all runs, the interrupted ones
    too.

    Args:
        settings: What the study was opened with.
        study: Where every walk is kept.
        workers: Processes that simulate on this machine.
        report: Told how far it is, after every walk.
        dask: Simulate on this Dask cluster instead: its scheduler's address or file, or "local".

    Raises:
        WorkerError: there are no workers, or none is left; what was simulated is safe.
    """
    started, before = time.monotonic(), study.description()
    deaths = Counter(before.get("worker_deaths", {}))
    try:
        with _workers(settings.walk, workers, dask) as running:
            try:
                search(settings, study, running.run, report)
            finally:
                study.set("worker_deaths", deaths + running.deaths)
    finally:
        study.set("wall_s", before.get("wall_s", 0.0) + time.monotonic() - started)
    study.set("finished", True)


def _workers(settings: WalkSettings, count: int, dask: str | None) -> LocalProcesses | DaskCluster:
    """What simulates."""
    limit = settings.time_limit + STARTING_TIME
    if dask is None:
        return LocalProcesses(walk_trial, count=count, time_limit=limit)
    same = functools.partial(identity, settings.model)
    return DaskCluster(walk_trial, dask, count=count, time_limit=limit, identity=same)
