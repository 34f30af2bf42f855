"""One study in its folder: started or resumed, searched to its end, with its result.

result = run_study(settings, "runs/mine", workers=2)
result.best.candidate, result.verdict
"""

import functools
import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from drake_gait.errors import SettingsError, StudyError
from drake_gait.execution.base import Executor, Finished
from drake_gait.execution.dask import DaskCluster
from drake_gait.execution.local import LocalProcesses
from drake_gait.execution.machine import default_workers
from drake_gait.files.destination import check
from drake_gait.files.strict_json import plain
from drake_gait.foot import SIZES, FootDesign
from drake_gait.problem import Candidate, Quantity, Trial
from drake_gait.provenance import versions
from drake_gait.report.result import summary
from drake_gait.report.study_result import OF_THE_REPORT, RESULT, StudyResult
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.search import modes
from drake_gait.search.grounds import ENDS, on_ground
from drake_gait.search.loop import search, useful_workers
from drake_gait.search.proposer import Proposer
from drake_gait.search.runner import Progress
from drake_gait.simulation.simulate import try_out, walk_trial
from drake_gait.study.robot import ROBOT, robot_of
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import PROPOSER, QUANTITIES, VARIABLES, Study
from drake_gait.visualization.portraits import check_looks

STARTING_TIME = 60.0  # What a worker may need beside its walk, to import and to build [s].


def open_study(settings: StudySettings, folder: Path, proposer: Proposer | None = None) -> Study:
    """Return the folder's study, new or to be resumed, as its driver.

    A study whose budget has grown is unfinished again.

    Args:
        settings: What the study is.
        folder: Where it is, or is to be.
        proposer: What searches it, where that is not the proposer of its mode.

    Raises:
        ModelError: the robot cannot be used; found out before anything is written.
        StudyError: the folder holds another study, or another driver has it.
    """
    path = folder / "study.db"
    model = read_model(settings.walk.model, settings.walk.robot)
    wanted = _wanted(settings, model)
    if not path.exists():
        absent = [one.name for one in settings.quantities if not one.at_hand]
        if absent:
            raise SettingsError(
                f"the quantities {', '.join(absent)} are not at hand; "
                "run_study(..., quantities=[...]) takes them"
            )
        try_robot(settings, model)
        source = {} if settings.source is None else {"source": asdict(settings.source)}
        handed = {} if (name := _name(proposer, settings)) is None else {PROPOSER: name}
        known = {**wanted, ROBOT: model.plain(), "versions": versions(), **source, **handed}
        return Study.create(path, known)
    study = Study.open(path, driver=True)
    try:
        study.require(wanted)
        _require_proposer(study, _name(proposer, settings))
        study.resize(settings.search.simulations)
        study.adopt(wanted["settings"])
        known = study.description()
        if "finished" not in known:
            study.require_at_hand(settings.quantities)
        if settings.source is not None and "source" not in known:  # Of before.
            study.set("source", asdict(settings.source))
        if ROBOT not in known:
            study.set(ROBOT, model.plain())
    except StudyError:
        study.close()
        raise
    return study


def is_finished(settings: StudySettings, folder: Path) -> bool:
    """Return whether the folder holds this study, at its end.

    Raises:
        StudyError: it holds another one.
    """
    path = folder / "study.db"
    if not path.exists():
        return False
    with Study.open(path) as study:
        study.require(_wanted(settings, read_model(settings.walk.model, settings.walk.robot)))
        known = study.description()
    budget = known["settings"]["search.simulations"]
    return "finished" in known and budget == settings.search.simulations


def _name(proposer: Proposer | None, settings: StudySettings) -> str | None:
    """The name of a proposer that is not the one of the study's mode."""
    if proposer is None or proposer.name == modes.proposer(settings).name:
        return None
    return proposer.name


def _require_proposer(study: Study, name: str | None) -> None:
    """Refuse to resume a study with another proposer than it began with."""
    known = study.description().get(PROPOSER)
    if known != name:
        mode = "that of its mode"
        raise StudyError(
            f"{study.path.parent} is searched by the proposer {known or mode}, not by "
            f"{name or mode}; hand the same one over, run_study(..., proposer=...), or give "
            "another folder"
        )


def _wanted(settings: StudySettings, model: RobotModel) -> dict[str, Any]:
    """Return the settings that identify a study."""
    variables = settings.variables()
    return {
        "settings": settings.description(),
        "model_sha256": model.sha256,
        QUANTITIES: [one.plain() for one in settings.quantities],
        **({} if variables is None else {VARIABLES: variables}),
    }


def identity(settings: StudySettings, model: RobotModel) -> dict[str, Any]:
    """Return all that a study of these settings keeps from its beginning to its end."""
    return _wanted(settings, model)


def try_robot(settings: StudySettings, model: RobotModel) -> None:
    """Walk a robot for a moment, on feet from all ends of a study and on every ground.

    Raises:
        ModelError: it cannot be used.
    """
    space, walk = settings.space, replace(settings.walk, model=model)
    gait = space.middle.gait
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
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    proposer: Proposer | None = None,
    executor: Executor | None = None,
    quantities: Sequence[Quantity] = (),
) -> StudyResult:
    """Search a study to its end, confirm its winner, and return what came out.

    The folder keeps every walk. The same call again resumes a study that was stopped, and a larger
    budget extends a finished one. The walks depend on the settings and the proposer
    alone. `write_report` makes the report and figures. It works in any thread.

    Args:
        settings: What is searched, how, and with how many walks.
        folder: The study's folder; runs/<study> if None.
        workers: Processes that simulate on this machine; one for each core, as far as memory and
            work go, if None.
        progress: Told how far the search is, after every walk.
        proposer: Proposes the candidates; by default that of settings.search.mode.
        executor: Runs the walks instead of local processes; it stays open.
        quantities: Quantities of a user's own, kept for every walk and reported; a limit or an
            objective on them is a setting.

    Raises:
        SettingsError: an argument cannot be used.
        ModelError: the robot cannot be used; found out before anything is written.
        StudyError: the folder holds another study, or another process searches it.
        WorkerError: no worker is left; what was simulated is safe.
    """
    if workers is not None and executor is not None:
        raise SettingsError(f"got workers={workers} and an executor; give one of them")
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise SettingsError(f"workers must be a whole number >= 1, got {workers!r}")
    settings = settings.with_quantities(quantities) if quantities else settings
    folder = Path("runs") / settings.name if folder is None else Path(folder)
    tell = progress or _ignore
    with open_study(settings, folder, proposer) as study:
        check(folder / RESULT)
        if "finished" in study.description():
            pass
        elif executor is not None:
            bound = OnRobot(executor, robot_of(study).for_walks())
            search_study(settings, study, bound, tell, proposer=proposer)
        else:
            count = workers or default_workers(useful_workers(settings, proposer))
            with workers_of(settings, study, count) as own:
                search_study(settings, study, own, tell, proposer=proposer)
        return _result(settings, study, folder)


def search_study(
    settings: StudySettings,
    study: Study,
    executor: Executor,
    progress: Callable[[Progress], None],
    *,
    proposer: Proposer | None = None,
) -> None:
    """Search an open study to its end, from wherever it is, and mark it as finished.

    Its time on the clock and the deaths of its workers add up over all runs, the interrupted ones
    too.

    Args:
        settings: What the study was opened with.
        study: Where every walk is kept.
        executor: Walks trials with the study's robot, see `workers_of`.
        progress: Told how far it is, after every walk.
        proposer: What the study was opened with.

    Raises:
        WorkerError: no worker is left; what was simulated is safe.
    """
    with to_its_end(study, executor):
        search(settings, study, executor.run, progress, proposer=proposer)


@contextmanager
def to_its_end(study: Study, executor: Executor) -> Iterator[None]:
    """Add up a study's time on the clock and deaths of workers; mark it as finished at the end."""
    started, before = time.monotonic(), study.description()
    deaths, earlier = Counter(before.get("worker_deaths", {})), Counter(executor.deaths)
    try:
        yield
    finally:
        study.set("worker_deaths", deaths + (Counter(executor.deaths) - earlier))
        study.set("wall_s", before.get("wall_s", 0.0) + time.monotonic() - started)
    study.set("finished", True)


def workers_of(
    settings: StudySettings, study: Study, count: int, *, dask: str | None = None
) -> LocalProcesses | DaskCluster:
    """Return workers for the robot of an open study, each of which gets its content once.

    Args:
        settings: What the study was opened with.
        study: Holds the robot.
        count: Processes on this machine.
        dask: Simulate on this Dask cluster instead: its scheduler's address or file, or "local".

    Raises:
        SettingsError: Dask is not installed, or its address cannot be used.
        WorkerError: the cluster does not answer, has no workers, or other versions.
    """
    limit = settings.walk.time_limit + STARTING_TIME
    walk = functools.partial(walk_trial, model=robot_of(study).for_walks())
    if dask is None:
        return LocalProcesses(walk, count=count, time_limit=limit)
    return DaskCluster(walk, dask, count=count, time_limit=limit)


class OnRobot:
    """An executor whose trials carry the robot that a study keeps, whatever became of its file."""

    def __init__(self, executor: Executor, model: RobotModel) -> None:
        self._executor, self._model = executor, model

    @property
    def deaths(self) -> Mapping[str, int]:
        """Return how workers died, and how often."""
        return self._executor.deaths

    def run(self, trials: Sequence[Trial]) -> Iterator[Finished]:
        """Start to walk all trials; yield each as it finishes."""
        return self._executor.run(
            [
                replace(trial, settings=replace(trial.settings, model=self._model))
                for trial in trials
            ]
        )


def _result(settings: StudySettings, study: Study, folder: Path) -> StudyResult:
    """The result of a study's walks, in result.json; a report's further numbers stay there."""
    known = study.description()
    content = summary(
        settings,
        study.walks(),
        None,
        wall_s=known.get("wall_s", 0.0),
        proposer=known.get(PROPOSER),
    )
    found = StudyResult.from_plain(plain(content), folder)
    with suppress(StudyError):
        reported = StudyResult.read(folder)
        if _without_report(reported) == _without_report(found):
            return reported
    found.write()
    return found


def _without_report(result: StudyResult) -> dict[str, Any]:
    return {name: value for name, value in result.plain().items() if name not in OF_THE_REPORT}


def _ignore(progress: Progress) -> None:
    pass
