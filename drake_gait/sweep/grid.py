"""A grid of feet: given gaits walk on every foot, several times, each with its own small noise.

A grid is kept as a study: study.db has its walks as they finish, and one driver at a time writes
them. Any executor walks them. The same call again resumes a grid.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import GaitError, SettingsError, StudyError
from drake_gait.execution.base import Executor
from drake_gait.execution.machine import default_workers
from drake_gait.files.destination import make_folder
from drake_gait.files.strict_json import plain
from drake_gait.gait import Gait, plain_gait
from drake_gait.optimization import OnRobot, identity, to_its_end, workers_of
from drake_gait.problem import Candidate, Trial
from drake_gait.provenance import versions
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.search.runner import Planned, Progress, Runner
from drake_gait.search.seeding import Purpose, generator
from drake_gait.simulation.simulate import try_out
from drake_gait.study.robot import ROBOT, robot_of
from drake_gait.study.robot_section import check_foot
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import PROPOSER, Study
from drake_gait.sweep.grid_results import Place, Results, check_outputs, write_results
from drake_gait.sweep.settings import Grid
from drake_gait.walk import Walk

PROPOSED_BY = "grid of feet"
"""The proposer that a grid's study names: no search goes on with it."""

_GRID = "grid"
"""Key of a study under which its grid is."""

Tell = Callable[[Progress], None]
"""Hears how far a grid is, after every walk."""


def places(grid: Grid) -> list[Place]:
    """Return every walk of a grid; one replica of all comes before the next."""
    counts = [range(len(axis.levels)) for axis in grid.axes]
    return [
        (first, second, gait, replica)
        for replica, first, second, gait in product(
            range(grid.replicas), *counts, range(len(grid.gaits))
        )
    ]


def candidate(grid: Grid, place: Place) -> Candidate:
    """Return the foot and the noisy gait of one walk."""
    first, second, gait, _ = place
    rng = generator(grid.settings.seed, Purpose.GRID_NOISE, *place)
    walked = grid.gaits[gait]
    noise = np.radians(grid.noise_deg) * rng.uniform(-1.0, 1.0, len(walked.variables))
    return Candidate(gait=walked.moved(noise), foot=grid.feet[first][second])


def study_of(grid: Grid) -> StudySettings:
    """Return the settings of the study that keeps a grid: all its walks are on the base's ground.

    Its design of experiments is one replica; more replicas are a larger budget.
    """
    walks = len(places(grid))
    search = replace(
        grid.settings.search,
        samples=walks // grid.replicas,
        simulations=walks,
        replicas=1,
        grounds=False,
    )
    return replace(grid.settings, search=search)


def run_grid(
    grid: Grid,
    out: Path,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Tell | None = None,
) -> Results:
    """Walk what is missing of a grid, and write the walks, the analysis and the figure.

    Args:
        grid: The grid.
        out: Its folder.
        workers: Processes that walk on this machine; one for each core if None.
        executor: Walks instead of local processes; it stays open.
        progress: Hears how far the grid is, after every walk.

    Raises:
        SettingsError: both workers and an executor are given.
        StudyError: the folder holds another grid, or a file cannot be written.
        ModelError: the robot cannot be used.
        WorkerError: no worker is left; what was simulated is safe.
    """
    if workers is not None and executor is not None:
        raise SettingsError(f"got workers={workers} and an executor; give one of them")
    tell = progress or _ignore
    with open_grid(grid, out) as study:
        if executor is not None:
            walk_grid(grid, study, OnRobot(executor, robot_of(study).for_walks()), tell)
        elif not is_walked(study):
            count = workers or default_workers(len(places(grid)))
            with workers_of(study_of(grid), study, count) as own:
                walk_grid(grid, study, own, tell)
        return write_results(grid, walks_of(grid, study), out)


def is_walked(study: Study) -> bool:
    """Return whether all walks of an open grid are there."""
    return "finished" in study.description()


def walk_grid(grid: Grid, study: Study, executor: Executor, progress: Tell) -> None:
    """Walk what is missing of an open grid.

    Args:
        grid: What the study was opened with.
        study: Where every walk is kept, see `open_grid`.
        executor: Walks trials with the study's robot, see `optimization.workers_of`.
        progress: Hears how far the grid is, after every walk.

    Raises:
        WorkerError: no worker is left; what was simulated is safe.
    """
    settings = study_of(grid)
    with to_its_end(study, executor):
        runner = Runner(settings, study, executor.run, progress)
        runner.start(_planned(grid, settings))
        runner.finish()


def walks_of(grid: Grid, study: Study) -> dict[Place, Walk]:
    """Return all walks of an open grid that is walked."""
    walks = (entry.walk for entry in study.walks())
    return dict(zip(places(grid), walks, strict=True))


def open_grid(grid: Grid, folder: Path) -> Study:
    """Return the study of a grid, new or to be resumed, as its driver.

    Raises:
        ModelError: the robot cannot be used; found out before anything is written.
        StudyError: the folder holds another grid or study, or another driver has it.
    """
    path, settings = folder / "study.db", study_of(grid)
    model = read_model(settings.walk.model, settings.walk.robot)
    wanted = identity(settings, model)
    if not path.exists():
        _refuse_walks_without_study(folder)
        _try_feet(grid, model)
        make_folder(folder)
        check_outputs(folder)
        marks = {PROPOSER: PROPOSED_BY, _GRID: _described(grid)}
        return Study.create(path, {**wanted, ROBOT: model.plain(), "versions": versions(), **marks})
    study = Study.open(path, driver=True)
    try:
        _require(study, grid)
        study.require(wanted)
        check_outputs(folder)
        study.resize(settings.search.simulations)
    except GaitError:
        study.close()
        raise
    return study


def _described(grid: Grid) -> dict[str, Any]:
    """Return what makes a grid this one, beside the settings of its study and its replicas."""
    described: dict[str, Any] = plain(
        {
            "axes": [asdict(axis) for axis in grid.axes],
            "gaits_deg": [
                gait.degrees.tolist() if isinstance(gait, Gait) else plain_gait(gait)
                for gait in grid.gaits
            ],
            "noise_deg": grid.noise_deg,
        }
    )
    return described


def _require(study: Study, grid: Grid) -> None:
    """Refuse a study that is no grid, or another one, or one with more walks."""
    folder, wanted = study.path.parent, _described(grid)
    found = study.description().get(_GRID)
    if not isinstance(found, dict):
        raise StudyError(f"{folder} holds a study that is no grid; give --out for another folder")
    for key, value in wanted.items():
        if found.get(key) != value:
            raise StudyError(
                f"{folder} holds another grid, of other {key}; give --out for another folder"
            )
    walks = len(study.walks())
    if walks > len(places(grid)):
        raise StudyError(
            f"{folder} holds {walks} walks of this grid, more than grid.replicas = "
            f"{grid.replicas} has; give more replicas, or --out for another folder"
        )


def _refuse_walks_without_study(folder: Path) -> None:
    path = folder / "grid.csv"
    if path.exists():
        raise StudyError(
            f"{path} has walks of a grid whose study.db is missing, as in a folder of an earlier "
            "version; give --out for another folder, or remove the file to walk all again"
        )


def _try_feet(grid: Grid, model: RobotModel) -> None:
    """Walk the robot for a moment on every shape of foot of a grid."""
    walk = replace(grid.settings.walk, model=model)
    for foot in (foot for row in grid.feet for foot in row):
        check_foot(model.robot, foot, {})
    shapes = {(foot.body, foot.rigid_toes): foot for row in grid.feet for foot in row}
    for foot in shapes.values():
        try_out(replace(candidate(grid, (0, 0, 0, 0)), foot=foot), walk)


def _planned(grid: Grid, settings: StudySettings) -> Iterator[Planned]:
    for id_, place in enumerate(places(grid)):
        yield Planned(
            id=id_,
            stage="design",
            iteration=place[-1],
            trial=Trial(candidate=candidate(grid, place), settings=settings.walk),
        )


def _ignore(progress: Progress) -> None:
    pass
