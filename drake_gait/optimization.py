"""One study in its folder: opened or gone on with, and searched to its end."""

import functools
import itertools
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import StudyError
from drake_gait.execution.dask import DaskCluster, identity
from drake_gait.execution.local import LocalProcesses
from drake_gait.foot import SIZES, FootDesign
from drake_gait.problem.problem import Candidate
from drake_gait.provenance import versions
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.search.grounds import ENDS, on_ground
from drake_gait.search.loop import search
from drake_gait.search.runner import Progress
from drake_gait.simulation.simulate import try_out, walk_trial
from drake_gait.study.robot import ROBOT, robot_of
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.visualization.portraits import check_looks
from drake_gait.walk import WalkSettings

STARTING_TIME = 60.0  # What a worker may need beside its walk, to import and to build [s].


def open_study(settings: StudySettings, folder: Path) -> Study:
    """The folder's study, to start or to go on with, as its driver.

    A study whose budget has grown is unfinished again.

    Raises:
        ModelError: the robot cannot be used; found out before anything is written.
        StudyError: the folder holds another study, or another driver has it.
    """
    path = folder / "study.db"
    model = read_model(settings.walk.model)
    wanted = _wanted(settings, model)
    if not path.exists():
        try_robot(settings, model)
        source = {} if settings.source is None else {"source": asdict(settings.source)}
        known = {**wanted, ROBOT: model.plain(), "versions": versions(), **source}
        return Study.create(path, known)
    study = Study.open(path, driver=True)
    try:
        study.require(wanted)
        study.resize(settings.search.simulations)
        known = study.description()
        if settings.source is not None and "source" not in known:  # Of before.
            study.set("source", asdict(settings.source))
        if ROBOT not in known:
            study.set(ROBOT, model.plain())
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
        study.require(_wanted(settings, read_model(settings.walk.model)))
        known = study.description()
    budget = known["settings"]["search.simulations"]
    return "finished" in known and budget == settings.search.simulations


def _wanted(settings: StudySettings, model: RobotModel) -> dict[str, Any]:
    """What a study must have begun with, to be this one."""
    return {"settings": settings.description(), "model_sha256": model.sha256}


def try_robot(settings: StudySettings, model: RobotModel) -> None:
    """Walk a robot for a moment, on feet from all ends of a study and on every ground.

    Raises:
        ModelError: it cannot be used.
    """
    space, walk = settings.space, replace(settings.walk, model=model)
    gait = space.decode(np.zeros(space.dimension)).gait
    sizes = [one for one in space.foot_ranges if one[0] in SIZES]
    ends = itertools.product(*([(name, low), (name, high)] for name, low, high in sizes))
    for end in ends:
        try_out(Candidate(gait=gait, foot=_resized(space.foot, dict(end))), walk)
    for slipperiness in ENDS:
        ground = on_ground(walk, settings, slipperiness)
        try_out(Candidate(gait=gait, foot=space.foot), ground)
    check_looks(model, space.foot)


def _resized(foot: FootDesign, sizes: dict[str, float]) -> FootDesign:
    return FootDesign(**{**asdict(foot), **sizes})


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
        with _workers(settings.walk, robot_of(study), workers, dask) as running:
            try:
                search(settings, study, running.run, report)
            finally:
                study.set("worker_deaths", deaths + running.deaths)
    finally:
        study.set("wall_s", before.get("wall_s", 0.0) + time.monotonic() - started)
    study.set("finished", True)


def _workers(
    settings: WalkSettings, model: RobotModel, count: int, dask: str | None
) -> LocalProcesses | DaskCluster:
    """What simulates one robot, of which every worker gets the content."""
    limit = settings.time_limit + STARTING_TIME
    walk = functools.partial(walk_trial, model=model.for_walks())
    if dask is None:
        return LocalProcesses(walk, count=count, time_limit=limit)
    return DaskCluster(walk, dask, count=count, time_limit=limit, identity=identity)
