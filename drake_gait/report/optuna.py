"""A study as an Optuna study: for its dashboard, its plots and its importances.

A trial is a walk. Its parameters are the open design variables, its value is what the study
maximises (the distance walked forward), its constraints are the scaled violations of Eqs. 11-14,
in this order (Optuna: feasible at or below 0), and every other column of the study file is a user
attribute; SI units, names as in the study file. A fall is a pruned trial, which reports its value
at the frame where it ended; what could not be simulated is a failed one.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime, timedelta
from typing import Any

import optuna
from optuna.distributions import FloatDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial
from sqlalchemy.exc import SQLAlchemyError

from drake_gait.errors import StudyError
from drake_gait.foot import SEARCHED_IN_LOG
from drake_gait.problem.problem import COEFFICIENTS, DesignSpace
from drake_gait.study.records import CONFIRMATIONS, StudyWalk
from drake_gait.study.settings import StudySettings, study_settings
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

_ROUNDING = 1e-9
"""Part of a range by which a value at its end may lie outside, from its way through x."""


def export_to_optuna(study: Study, url: str, name: str) -> tuple[int, int]:
    """Make an Optuna study of a study's walks, or add the walks that it lacks.

    Args:
        study: What is exported.
        url: The database, as SQLAlchemy writes it.
        name: The Optuna study's name.

    Returns:
        How many walks were added, and how many were there.

    Raises:
        StudyError: the database cannot be used, or has another study of this name.
    """
    description = study.description()
    walks = [walk for walk in study.walks() if walk.id < CONFIRMATIONS]
    settings = study_settings(description["settings"])
    names, rows = study.rows()
    columns = {row[names.index("id")]: dict(zip(names, row, strict=True)) for row in rows}
    verbosity = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        with _reporting(url):
            goal = optuna.create_study(
                storage=url, study_name=name, direction="maximize", load_if_exists=True
            )
            _claim(goal, description, url)
            there = {trial.user_attrs["id"] for trial in goal.get_trials(deepcopy=False)}
            missing = [walk for walk in walks if walk.id not in there]
            ranges = _ranges(settings.space)
            goal.add_trials(_trial(walk, columns[walk.id], ranges, settings) for walk in missing)
    finally:
        optuna.logging.set_verbosity(verbosity)
    return len(missing), len(there)


def _claim(goal: optuna.Study, description: Mapping[str, Any], url: str) -> None:
    """Write into an Optuna study whose it is; refuse it if it is another's."""
    # The number of walks may grow, and the walks there are stay the same.
    made_with = {key: value for key, value in description["settings"].items()
                 if key != "search.simulations"}  # fmt: skip
    ours = {_MADE_WITH: made_with, _MODEL: description["model_sha256"]}
    found = goal.user_attrs
    if not found and not goal.get_trials(deepcopy=False):
        for key, value in ours.items():
            goal.set_user_attr(key, value)
        goal.set_user_attr("versions", description.get("versions"))
        return
    if any(found.get(key) != value for key, value in ours.items()):
        raise StudyError(
            f"{url} has another study called {goal.study_name}; give this one another --name"
        )


def _ranges(space: DesignSpace) -> dict[str, FloatDistribution]:
    """How far the search may go, by design variable, in SI units."""
    coefficients = zip(
        COEFFICIENTS,
        space.centre.ravel().tolist(),
        space.half_width.ravel().tolist(),
        space.limits[:16].tolist(),
        strict=True,
    )
    found = {
        name: _range(centre + half_width * low, centre + half_width * high)
        for name, centre, half_width, (low, high) in coefficients
    }
    for name, low, high in space.foot_ranges:
        found[name] = _range(low, high, log=name in SEARCHED_IN_LOG)
    return found


def _range(low: float, high: float, *, log: bool = False) -> FloatDistribution:
    margin = _ROUNDING * (high - low)
    return FloatDistribution(low - margin, high + margin, log=log)


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
        intermediate_values={walk.walk.steps: -assessment.objective} if simulated else {},
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


@contextmanager
def _reporting(url: str) -> Iterator[None]:
    """Turns what a database says into one line for the user."""
    try:
        yield
    except (SQLAlchemyError, optuna.exceptions.OptunaError, ImportError) as error:
        cause = str(error.__cause__ or error).strip().splitlines()[0]
        raise StudyError(
            f"cannot use the database {url}: {cause}; give one such as sqlite:///optuna.db"
        ) from None
