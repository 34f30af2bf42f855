"""A study as an Optuna study: for its dashboard, its plots and its importances.

A trial is a walk. Its parameters are the open design variables. Its value is what the study
maximises: the distance walked forward. Its constraints are the scaled violations of Eqs. 11-14, in
this order (Optuna: feasible at or below 0). Every other column of the study file is a user
attribute, in SI units, with its name in the study file. A fall is a pruned trial, which reports its
value at the frame where it ended; what could not be simulated is a failed one.
"""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta
from typing import Any

import optuna
from optuna.distributions import FloatDistribution
from optuna.storages import BaseStorage
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, TrialState, create_trial
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from drake_gait.errors import StudyError
from drake_gait.foot import SEARCHED_IN_LOG
from drake_gait.study.ranking import search_walks
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.walk import Outcome

_STATES = {
    Outcome.WALKED: TrialState.COMPLETE,
    Outcome.FELL: TrialState.PRUNED,
    Outcome.DIVERGED: TrialState.FAIL,
}

_CONSTRAINTS = "constraints"
"""Where Optuna's samplers and its dashboard look for a trial's constraints."""

_MADE_WITH, _MODEL = "drake_gait.study.settings", "drake_gait.model_sha256"

_NOISE = 6.0
"""Standard deviations of the noise that ranges have room for: one draw in 5e8 is larger."""

_ROUNDING = 1e-9
"""Part of a range by which a value at its end may lie outside, from its way through x."""


def export_to_optuna(study: Study, url: str | BaseStorage, name: str) -> tuple[int, int]:
    """Make an Optuna study of a study's walks, or add the walks that it lacks.

    Trials that the user has added, or that run or wait there, are left as they are.

    Args:
        study: What is exported.
        url: The database, as SQLAlchemy writes it, or an Optuna storage such as a journal.
        name: The Optuna study's name.

    Returns:
        How many walks were added, and how many were there.

    Raises:
        StudyError: the database cannot be used, or has another study of this name; nothing is
            added then.
    """
    description = study.description()
    walks = search_walks(study.walks())
    settings = study.settings()
    names, rows = study.rows()
    columns = {row[names.index("id")]: dict(zip(names, row, strict=True)) for row in rows}
    ranges = _ranges(settings, [columns[walk.id] for walk in walks])
    trials = {walk.id: _trial(walk, columns[walk.id], ranges, settings) for walk in walks}
    place = shown(url) if isinstance(url, str) else type(url).__name__
    with _quiet(), _reporting(place):
        goal = optuna.create_study(
            storage=_kept(url), study_name=name, direction="maximize", load_if_exists=True
        )
        found = goal.get_trials(deepcopy=False)
        _require_direction(goal, place)
        _require_ranges(goal, found, ranges, place)
        _claim(goal, found, description, place)
        there = {id_ for trial in found if (id_ := _walk_of(trial)) is not None}
        missing = [trial for id_, trial in trials.items() if id_ not in there]
        goal.add_trials(missing)
    return len(missing), len(there)


def shown(url: str) -> str:
    """Return a database's URL as it may be printed: without its password."""
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError):
        return url
    return url if parsed.password is None else parsed.render_as_string(hide_password=True)


def _kept(url: str | BaseStorage) -> str | BaseStorage:
    """The database, if it outlives this process."""
    if isinstance(url, str):
        parsed = make_url(url)
        name = parsed.database or ":memory:"
        memory = any(word in name for word in (":memory:", "mode=memory", "vfs=memdb"))
        memory = memory or bool({"memory", "memdb"}.intersection(parsed.query.values()))
        if parsed.get_backend_name() == "sqlite" and memory:
            raise ValueError("it is in memory, and nothing of it would be kept")
    return url


def _walk_of(trial: FrozenTrial) -> int | None:
    """Id of the walk that a trial was made of; None if it is the user's own."""
    attributes = trial.user_attrs
    id_ = attributes.get("id")
    ours = trial.state.is_finished() and "finished" in attributes and "stage" in attributes
    return id_ if ours and isinstance(id_, int) else None


def _require_direction(goal: optuna.Study, place: str) -> None:
    if goal.directions != [StudyDirection.MAXIMIZE]:
        found = ", ".join(direction.name.lower() for direction in goal.directions)
        raise StudyError(
            f"{place} has another study called {goal.study_name}, whose directions are: {found}; a "
            "walk has one value to maximize: give this one another --name"
        )


def _require_ranges(
    goal: optuna.Study,
    found: Sequence[FrozenTrial],
    ranges: Mapping[str, FloatDistribution],
    place: str,
) -> None:
    """Refuse a study whose trials have another kind of parameter of the same name."""
    for trial in found:
        for name in ranges.keys() & trial.distributions.keys():
            other = trial.distributions[name]
            if not isinstance(other, FloatDistribution) or other.log != ranges[name].log:
                raise StudyError(
                    f"{place}: trial {trial.number} of the study {goal.study_name} has {name} as "
                    f"{other}, a walk as {ranges[name]}; give this one another --name"
                )


def _claim(
    goal: optuna.Study, found: Sequence[FrozenTrial], description: Mapping[str, Any], place: str
) -> None:
    """Write into an Optuna study whose it is; refuse it if it is another's."""
    # The number of walks may grow, and the walks there are stay the same.
    made_with = {
        key: value for key, value in description["settings"].items() if key != "search.simulations"
    }
    ours = {_MADE_WITH: made_with, _MODEL: description["model_sha256"]}
    known = {key: goal.user_attrs[key] for key in ours.keys() & goal.user_attrs.keys()}
    if known == ours:
        return
    # A study without trials may be one that was broken off here.
    if found or any(ours[key] != value for key, value in known.items()):
        raise StudyError(
            f"{place} has another study called {goal.study_name}; give this one another --name"
        )
    for key, value in ours.items():
        goal.set_user_attr(key, value)
    goal.set_user_attr("versions", description.get("versions"))


def _ranges(
    settings: StudySettings, walks: Sequence[Mapping[str, Any]]
) -> dict[str, FloatDistribution]:
    """Return the range of each design variable in the search, in SI units.

    Replicas walk with noise, which leaves the ranges of the search: theirs are wider. All trials
    have the same, or Optuna's importances would leave a parameter out.

    Args:
        settings: The study's.
        walks: Columns of all walks.
    """
    space, noise = settings.space, settings.confirmation.noise
    beyond = _NOISE * noise if settings.search.replicas > 1 else 0.0
    place = list(space.open_variables)
    variables = zip(
        (space.family.variables[one] for one in place),
        space.centre.ravel()[place].tolist(),
        space.half_width.ravel()[place].tolist(),
        space.limits[: len(place)].tolist(),
        strict=True,
    )
    ends = {}
    for one, centre, half_width, (low, high) in variables:
        wider = beyond if one.is_angle else 0.0
        ends[one.name] = (
            centre + half_width * low - wider,
            centre + half_width * high + wider,
            False,
        )
    for name, low, high in space.foot_ranges:
        ends[name] = (low, high, name in SEARCHED_IN_LOG)
    return {
        name: _range(low, high, [walk[name] for walk in walks], log=log)
        for name, (low, high, log) in ends.items()
    }


def _range(low: float, high: float, values: Sequence[float], *, log: bool) -> FloatDistribution:
    margin = _ROUNDING * (high - low)
    return FloatDistribution(
        min(low - margin, *values, math.inf), max(high + margin, *values, -math.inf), log=log
    )


def _trial(
    walk: StudyWalk,
    columns: Mapping[str, Any],
    ranges: Mapping[str, FloatDistribution],
    settings: StudySettings,
) -> FrozenTrial:
    state = _STATES[walk.walk.outcome]
    simulated = state is not TrialState.FAIL
    assessment = settings.assess(walk.walk)
    trial = create_trial(
        state=state,
        value=-assessment.objective if state is TrialState.COMPLETE else None,
        params={name: columns[name] for name in ranges},
        distributions=dict(ranges),
        intermediate_values={walk.walk.frames: -assessment.objective} if simulated else {},
        user_attrs={
            name: _readable(value)
            for name, value in columns.items()
            if name not in ranges and value is not None
        },
        system_attrs={_CONSTRAINTS: assessment.violations.tolist()} if simulated else {},
    )
    # Optuna's times are local ones without a zone.
    finished = datetime.fromisoformat(columns["finished"]).astimezone().replace(tzinfo=None)
    trial.datetime_start = finished - timedelta(seconds=walk.seconds)
    trial.datetime_complete = finished
    return trial


def _readable(value: Any) -> Any:
    """The value, or its name where JSON has no number for it."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


_verbosity = threading.Lock()


@contextmanager
def _quiet() -> Iterator[None]:
    """Inside, Optuna logs nothing: what goes wrong is said once, by who calls."""
    with _verbosity:  # It is the process's: two threads would leave each other's.
        before = optuna.logging.get_verbosity()
        optuna.logging.set_verbosity(optuna.logging.CRITICAL)
        try:
            yield
        finally:
            optuna.logging.set_verbosity(before)


@contextmanager
def _reporting(place: str) -> Iterator[None]:
    """Turns what a database, its driver or Optuna says into one line for the user."""
    try:
        yield
    except StudyError:
        raise
    except Exception as error:  # Every driver has its own.
        said = str(error.__cause__ or error).strip().splitlines() or [type(error).__name__]
        missing = isinstance(error, ImportError)
        cure = "install what it needs, or give" if missing else "give"
        raise StudyError(
            f"cannot use the database {place}: {said[0]}; {cure} one such as sqlite:///optuna.db"
        ) from None
