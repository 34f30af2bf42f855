"""One walk of a study, and its row in the study file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from typing import Any

import numpy as np

from drake_gait.errors import GaitError, StudyError
from drake_gait.foot import FootDesign
from drake_gait.gait import PAPER, GaitFamily
from drake_gait.problem import BUILT_IN, COEFFICIENTS, Candidate, Quantity
from drake_gait.problem.quantities import JUMP
from drake_gait.study.search_settings import MOST_SIMULATIONS
from drake_gait.walk import Measures, Outcome, Walk

CONFIRMATIONS = MOST_SIMULATIONS
"""Walks that confirm others have ids from here on, so that a study's budget can grow."""

CONFIRMATION = "confirmation"
"""Stage of a walk that confirms another one."""

_FOOT = tuple(field.name for field in fields(FootDesign))
_WALK = ("frames", "forward", "lateral", "yaw", "com_height")
_PREDICTED = ("forward", "lateral", "yaw", "survival")

_MEASURES = {field.name: BUILT_IN[field.name].columns for field in fields(Measures)}
"""Fields of Measures, and their columns."""
_QUANTITIES = tuple(one for one in BUILT_IN.values() if one.name not in _WALK)
"""Quantities that a walk may lack."""


def columns(variables: Sequence[str] = COEFFICIENTS) -> list[str]:
    """Return the columns of a study file as SQL declares them.

    Args:
        variables: Names of the variables of its gait family.
    """
    return (
        ["id integer primary key", "stage text not null", "iteration integer not null"]
        + ["nominal integer", "variation integer not null"]
        + [f"{name} real not null" for name in (*variables, *_FOOT)]
        + ["outcome text not null", "reason text not null", "frames integer not null"]
        + [f"{name} real not null" for name in _WALK[1:]]
        + [f"{name} real" for one in _QUANTITIES for name in one.columns]
        + [f"predicted_{name} real" for name in _PREDICTED]
        + ["seconds real not null", "finished text not null"]
    )


def names_of(variables: Sequence[str]) -> list[str]:
    """Return the names of `columns`."""
    return [column.split()[0] for column in columns(variables)]


COLUMNS = columns()
"""Columns of a study of the paper's family."""
NAMES = names_of(COEFFICIENTS)
"""Their names."""
_TYPES: dict[str, tuple[str, tuple[type, ...]]] = {
    "integer": ("whole number", (int,)),
    "real": ("number", (int, float)),
    "text": ("text", (str,)),
}


def _contents(variables: Sequence[str]) -> dict[str, tuple[str, tuple[type, ...], bool]]:
    """Return what a column holds: its kind, types of its values, whether every row has one."""
    return {
        name: (*_TYPES[kind], bool(constraints))
        for name, kind, *constraints in map(str.split, columns(variables))
    }


_CONTENTS = _contents(COEFFICIENTS)


@dataclass(frozen=True, kw_only=True)
class StudyWalk:
    """One walk of a study."""

    id: int
    """Its place in the study, from 0."""
    stage: str
    """What it was simulated for: "design" (of experiments), "infill" or "confirmation"."""
    iteration: int
    """0 for the design of experiments, then the number of the batch after it."""
    nominal: int | None = None
    """The walk that it is a variation of."""
    variation: int = 0
    """Which variation: 0 as it is, 1 and up perturbed, -1 and below at reference fidelity.

    Those that confirm are numbered through the tiers, see `study.finalists.Tier`.
    """
    candidate: Candidate
    """What walked."""
    walk: Walk
    """What it did; without a history."""
    predicted: Mapping[str, float] | None = None
    """forward, lateral [m], yaw [rad] and survival, as the network expected them."""
    seconds: float = 0.0
    """Time that the simulation took [s]."""

    @property
    def is_search_walk(self) -> bool:
        """Return whether the search asked for it, replicas included; other walks confirm."""
        return self.stage != CONFIRMATION

    @property
    def is_nominal(self) -> bool:
        """Return whether its candidate walked as proposed: no replica, no confirmation."""
        return self.nominal is None and self.is_search_walk

    @property
    def confirms(self) -> int | None:
        """Return the id of the walk that it confirms; None of one that stands for itself."""
        return None if self.is_search_walk else self.nominal

    @property
    def is_mean(self) -> bool:
        """Return whether its candidate is a mean of neighbours, first walked to confirm."""
        return self.nominal is None and not self.is_search_walk


def own_names(own: Sequence[Quantity]) -> list[str]:
    """Return the columns of quantities of a study's own, which follow NAMES."""
    return [name for one in own for name in one.columns]


def to_row(entry: StudyWalk, own: Sequence[Quantity] = ()) -> list[Any]:
    """The values of a walk's row, in the order of NAMES and `own_names`."""
    walk, predicted = entry.walk, entry.predicted or {}
    return (
        [int(entry.id), entry.stage, int(entry.iteration), entry.nominal, int(entry.variation)]
        + [float(value) for value in entry.candidate.gait.variables]
        + [getattr(entry.candidate.foot, name) for name in _FOOT]
        + [walk.outcome.value, walk.reason, int(walk.frames)]
        + [float(getattr(walk, name)) for name in _WALK[1:]]
        + _values(walk, _QUANTITIES)
        + [predicted.get(name) for name in _PREDICTED]
        + [float(entry.seconds), datetime.now(UTC).isoformat(timespec="milliseconds")]
        + _values(walk, own)
    )


def require_types(
    row: Mapping[str, Any],
    own: Sequence[Quantity] = (),
    variables: Sequence[str] = COEFFICIENTS,
) -> None:
    """Refuse a row that a column's value does not fit; SQLite itself takes anything anywhere.

    Raises:
        StudyError: names the walk, the column and the value.
    """
    others = dict.fromkeys(own_names(own), (*_TYPES["real"], False))
    contents = _CONTENTS if variables == COEFFICIENTS else _contents(variables)
    for name, (kind, types, needed) in {**contents, **others}.items():
        value = row[name]
        if not isinstance(value, types) and (needed or value is not None):
            raise StudyError(f"walk {row['id']} has {name} = {_short(value)}, which is no {kind}")


def from_row(
    row: Mapping[str, Any], own: Sequence[Quantity] = (), family: GaitFamily = PAPER
) -> StudyWalk:
    """The walk of a row, given by its columns' names.

    Raises:
        StudyError: a value is not one that a walk can have; names the walk.
    """
    try:
        return _walk_of(row, own, family)
    except GaitError as error:
        raise StudyError(f"walk {row['id']}: {error}") from None


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:39]}…"


def _outcome(text: str) -> Outcome:
    try:
        return Outcome(text)
    except ValueError:
        raise StudyError(f"outcome {_short(text)} is none of {', '.join(Outcome)}") from None


def _walk_of(row: Mapping[str, Any], own: Sequence[Quantity], family: GaitFamily) -> StudyWalk:
    gait = family.gait(np.array([row[name] for name in family.names]))
    predicted = {name: row[f"predicted_{name}"] for name in _PREDICTED}
    return StudyWalk(
        id=row["id"],
        stage=row["stage"],
        iteration=row["iteration"],
        nominal=row["nominal"],
        variation=row["variation"],
        candidate=Candidate(
            gait=gait,
            foot=_foot(row),
        ),
        walk=Walk(
            outcome=_outcome(row["outcome"]),
            reason=row["reason"],
            **{name: row[name] for name in _WALK},
            yaw_swing=row["yaw_swing"],
            measures=_measures(row),
            values={
                one.name: tuple(_number(row, name) for name in one.columns)
                for one in (JUMP, *own)
                if any(row[name] is not None for name in one.columns)
            },
            planned=gait.frames,
        ),
        predicted=None if predicted["forward"] is None else predicted,
        seconds=row["seconds"],
    )


def _foot(row: Mapping[str, Any]) -> FootDesign:
    values = {name: row[name] for name in _FOOT}
    values["rigid_toes"] = bool(values["rigid_toes"])  # SQLite has no truth values.
    return FootDesign(**values)


def _values(walk: Walk, wanted: Sequence[Quantity]) -> list[float | None]:
    """Return the values of quantities, one for each column; None where a walk does not tell it."""
    return [
        None if value is None else float(value)
        for one in wanted
        for value in one.values(walk) or [None] * len(one.columns)
    ]


def _number(row: Mapping[str, Any], name: str) -> float:
    return math.nan if row[name] is None else float(row[name])  # SQLite has no NaN.


def _measures(row: Mapping[str, Any]) -> Measures | None:
    if row["energy"] is None:
        return None
    values: dict[str, Any] = {
        field: tuple(_number(row, name) for name in columns)
        if BUILT_IN[field].parts
        else _number(row, field)
        for field, columns in _MEASURES.items()
    }
    return Measures(**values)
