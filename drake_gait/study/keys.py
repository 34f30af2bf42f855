"""Sections and keys of a study's file, with the fields that they set and the units they are in.

A key is declared here, once: reading, messages, and writing a file again follow.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

from drake_gait import servo
from drake_gait.foot import N_MM_PER_DEG
from drake_gait.gait import PAPER, TERMS, WAVEFORMS, GaitFamily, PaperFamily
from drake_gait.gait.families import SHIPPED
from drake_gait.problem import BUILT_IN, Quantity
from drake_gait.ranges import DEGREES, MM, MS, NONE, SECONDS, Unit
from drake_gait.study.search_settings import CHANGES, SearchSettings

N_MM_DEG = Unit(name="N·mm/deg", si=N_MM_PER_DEG)
N_M_S_PER_RAD = Unit(name="N·m·s/rad")

Table = Mapping[str, tuple[str, Unit]]
"""Keys of a section, with the field that each sets and the unit that it is in."""

SERVO: Table = servo.KEYS
CONSTRAINTS: Table = {one.key: (one.name, one.unit) for one in BUILT_IN.values()}
CONFIRMATION: Table = {
    "walks": ("walks", NONE),
    "reference_walks": ("reference_walks", NONE),
    "servo_walks": ("servo_walks", NONE),
    "winners": ("winners", NONE),
    "replicas": ("replicas", NONE),
    "feasible": ("feasible", NONE),
    **{one.key: (name, one.written) for name, one in CHANGES.items()},
    "tiers": ("tiers", NONE),
    "means": ("means", NONE),
    "transfer": ("transfer", NONE),
    "transfer_distance": ("transfer_distance", NONE),
}
MEASURED_CONFIRMATION = (*(one.key for one in CHANGES.values()), "transfer_distance")
"""Keys of [confirmation] that are numbers with a range."""
FOOT: Table = {
    "big_toe_stiffness_n_mm_per_deg": ("big_toe_stiffness", N_MM_DEG),
    "lesser_toes_stiffness_n_mm_per_deg": ("lesser_toes_stiffness", N_MM_DEG),
    "toe_damping_n_m_s_per_rad": ("toe_damping", N_M_S_PER_RAD),
    "big_toe_width_mm": ("big_toe_width", MM),
    "toe_length_mm": ("toe_length", MM),
}
WALK: Table = {
    "step_ms": ("step", MS),
    "time_limit_s": ("time_limit", SECONDS),
    "friction": ("friction", NONE),
}


def setting_keys(family: type[GaitFamily]) -> Table:
    """Return the keys of [gait] that are settings of a family."""
    return {
        f"{name}_{unit.suffix}" if unit.suffix else name: (name, unit)
        for name, unit in family.setting_units().items()
    }


def box_keys(family: GaitFamily, corner: str) -> Table:
    """Return the keys of [box.centre] or [box.half_width], with the fields of a DesignSpace."""
    return {one.key: (f"{corner}.{one.name}", one.unit) for one in family.variables}


BOX: Table = {"centre_deg": ("centre", DEGREES), "half_width_deg": ("half_width", DEGREES)}

GAIT: Table = setting_keys(PaperFamily)
"""Settings of every gait family."""

KEYS = {
    "study": ("name", "question", "seed", "quantities"),
    "search": tuple(field.name for field in fields(SearchSettings)),
    "confirmation": tuple(CONFIRMATION),
    "box": ("chosen", "centre_deg", "centre_from", "half_width_deg", "centre", "half_width"),
    "constraints": tuple(CONSTRAINTS),
    "gait": ("family", "start", *GAIT),
    "robot": ("file", "model"),
    "walk": ("model", "engine", "sole", "fidelity", *WALK),
    "servo": tuple(SERVO),
    "foot": (*FOOT, "rigid_toes"),
    "design": tuple(FOOT),
}
"""Every section of a study's file, and its keys."""

OLDER = {
    "confirmation.command_delay": 0.0,
    "confirmation.integrator_step": 0.0,
    "confirmation.joint_zero": math.radians(0.5),
    "confirmation.mass": 0.03,
    "confirmation.means": False,
    "confirmation.reference_walks": 0,
    "confirmation.servo_stiffness": 0.1,
    "confirmation.servo_walks": 0,
    "confirmation.supply_voltage": 0.1,
    "confirmation.transfer": False,
    "confirmation.transfer_distance": 0.1,
    "gait.cycles": PAPER.cycles,
    "gait.family": PAPER.name,
    "gait.period": PAPER.period,
    "gait.standing": PAPER.standing,
    "gait.start": "paper",
    "robot.file": "",
    "search.grounds": False,
    "search.risk": "chance",
    "servo.backlash": 0.0,
    "servo.coulomb_friction": 0.0,
    "servo.delay": 0.0,
    "servo.load_friction": 0.0,
    "servo.voltage": 1.0,
    "study.quantities": "",
    "walk.engine": "drake",
    "walk.friction": 1.0,
    "walk.sole": "boxes",
    "walk.step": 0.004,
}
"""Settings that a description of an older study lacks, with what it walked with."""

DROPPED = {("walk", "measures"): "every walk has its measures"}
"""Settings of older versions that are without effect, by section and key, and the reason."""

_IN_FILE = {
    f"{section}.{field}": (f"{section}.{key}", unit)
    for section, table in {
        "servo": SERVO,
        "constraints": CONSTRAINTS,
        "confirmation": CONFIRMATION,
        "foot": FOOT,
        "design": FOOT,
        "walk": WALK,
        "box": BOX,
        "gait": {key: one for kind in SHIPPED.values() for key, one in setting_keys(kind).items()},
    }.items()
    for key, (field, unit) in table.items()
}


def keys(
    own: Iterable[Quantity] = (), family: type[GaitFamily] = PaperFamily
) -> dict[str, tuple[str, ...]]:
    """Return every section of a study's file and its keys, of own quantities and a family too."""
    start = ("start",) if family is PaperFamily else ()
    return {
        **KEYS,
        "constraints": (*CONSTRAINTS, *(one.key for one in own)),
        "gait": ("family", *start, *setting_keys(family)),
    }


def in_file(
    name: str, own: Iterable[Quantity] = (), family: type[GaitFamily] = PaperFamily
) -> tuple[str, Unit]:
    """Return the key and the unit in a file of a setting that is named as in a description."""
    for key, (field, unit) in setting_keys(family).items():
        if name == f"gait.{field}":
            return f"gait.{key}", unit
    for one in own:
        if name == f"constraints.{one.name}":
            return f"constraints.{one.key}", one.unit
    return _IN_FILE.get(name, (name, NONE))


def difference(name: str, was: Any, now: Any, own: Iterable[Quantity] = ()) -> str:
    """Return how two values of a setting differ, as a file has them: "key = was, not now".

    Args:
        name: The setting, as a description names it.
        was: Its value in a study, in SI units.
        now: Its value now; of a table of coefficients, or of values by their names, the first that
            differs is told.
        own: Quantities of the study's own.
    """
    key, unit = in_file(name, own)
    if name in ("box.centre", "box.half_width") and isinstance(was, dict) and isinstance(now, dict):
        names = [one for one in {**was, **now} if was.get(one) != now.get(one)]
        others = f" ({len(names) - 1} more differ)" if len(names) > 1 else ""
        return f"{name}.{names[0]} = {_pair(was.get(names[0]), now.get(names[0]), NONE)}{others}"
    tables = [isinstance(value, list) and len(value) == len(WAVEFORMS) for value in (was, now)]
    if name in ("box.centre", "box.half_width") and all(tables):
        places = [
            (row, column)
            for row in range(len(WAVEFORMS))
            for column in range(len(TERMS))
            if was[row][column] != now[row][column]
        ]
        row, column = places[0]
        others = f" ({len(places) - 1} more differ)" if len(places) > 1 else ""
        key = f"{WAVEFORMS[row]}_{TERMS[column]} of {key}"
        return f"{key} = {_pair(was[row][column], now[row][column], unit)}{others}"
    return f"{key} = {_pair(was, now, unit)}"


def _pair(was: Any, now: Any, unit: Unit) -> str:
    """Return two values in as many digits as tell them apart."""
    for digits in (6, 12, 17):
        texts = [_text(value, unit, digits) for value in (was, now)]
        if texts[0] != texts[1]:
            break
    return ", not ".join(texts)


def _text(value: Any, unit: Unit, digits: int) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_text(one, unit, digits) for one in value)}]"
    if isinstance(value, float):
        return f"{value / unit.si:.{digits}g}"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {_text(one, unit, digits)}" for key, one in value.items())
        return f"{{{inner}}}"
    if value is None:
        return "none"
    return str(value).lower() if isinstance(value, bool) else str(value)
