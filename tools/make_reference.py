"""Write the tables of docs/reference/study.md from the code: `python tools/make_reference.py`.

Keys, units, defaults and ranges are those of the settings' classes, sentences those of their
docstrings, quantities and columns their declarations. The site's build makes the tables anew.
"""

import argparse
import ast
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import GaitFamily, PaperFamily
from drake_gait.gait.families import SHIPPED
from drake_gait.problem import BUILT_IN, DesignSpace, Needs, Quantity, Side
from drake_gait.ranges import NONE, OutOfRangeError, Range, Unit
from drake_gait.servo import Servo
from drake_gait.study import keys
from drake_gait.study.records import StudyWalk
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.study.settings import FRICTION, StudySettings
from drake_gait.walk import Walk, WalkSettings

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "study.md"

_KINDS = {
    "study": StudySettings,
    "search": SearchSettings,
    "confirmation": ConfirmationSettings,
    "box": DesignSpace,
    "gait": GaitFamily,
    "robot": WalkSettings,
    "walk": WalkSettings,
    "servo": Servo,
    "foot": FootDesign,
}
"""The class that has the fields of a section."""
_TABLES = {
    "confirmation": keys.CONFIRMATION,
    "box": keys.BOX,
    "gait": keys.GAIT,
    "walk": keys.WALK,
    "servo": keys.SERVO,
    "foot": keys.FOOT,
}
_EARLIER = (
    "Instead of the centre, the winner of [an earlier study](#around-an-earlier-winner): folder, "
    "`study.db` or `result.json`."
)
_OWN = (
    "Python file of [quantities of your own](../howto/own_quantity.md), from the folder of this "
    "file."
)
_CENTRE = (
    "A section: middle of the box of another family than the paper's, by the keys of its variables."
)
_HALF_WIDTH = "A section: half the width, likewise; a variable without one stays at its centre."
_FAMILY = "Kind of gait, or the file and the class of [your own](../howto/own_gait.md)."
_ROBOT = "The robot's file, by path or by a shipped name."
_MODEL = "A model: an edit of the robot in `robot.file`, or of the KHR-3HV."
_TOLD = {
    # What no class tells of a file's key: default, range and, where there is no field, sentence.
    "study.name": ("required", "a folder's name"),
    "study.question": ("empty", ""),
    "study.quantities": ("none", "a path", _OWN),
    "search.objective": ("distance", "[a quantity](#quantities)"),
    "confirmation.tiers": ("empty", "1, 2 or 3, as `{joint_zero = 2}`"),
    "box.chosen": ("empty", "", "How the box was chosen."),
    "box.centre_deg": ("required", "Table I"),
    "box.centre_from": ("none", "a path", _EARLIER),
    "box.half_width_deg": ("required", "each > 0"),
    "box.centre": ("none", "limits of the variables", _CENTRE),
    "box.half_width": ("none", "≥ 0", _HALF_WIDTH),
    "gait.family": ("paper", "[a family](#gait-families)", _FAMILY),
    "gait.start": ("ramp", "shift, ramp, paper", "How a gait of the paper's family begins."),
    "gait.stop": ("paper", "paper, settle", "How a gait of the paper's family ends."),
    "robot.file": ("none", "[a path or name](#the-robot-of-a-study)", _ROBOT),
    "robot.model": ("none", "[a path or name](#the-robot-of-a-study)", _MODEL),
    "walk.model": ("khr3hv.sdf", "[a path or name](#the-robot-of-a-study)"),
}
_PER_SIDE = {Side.UPPER: "at most", Side.LOWER: "at least", Side.BOTH: "size at most"}
_NEEDS = {
    Needs.CANDIDATE: "the gait",
    Needs.WALK: "any walk",
    Needs.MEASURES: "measures",
    Needs.HISTORY: "a history",
}


def written(page: str) -> str:
    """Return a page with its tables made anew, each between two comments with its name."""
    for name, table in _BLOCKS.items():
        begin, end = f"<!-- made: {name} -->", f"<!-- end: {name} -->"
        block = f"{begin}\n\n{table()}\n\n{end}"
        page = re.sub(f"{begin}.*?{end}", lambda _, new=block: new, page, flags=re.DOTALL)
    return page


def settings_table() -> str:
    """Return a row for every key of a study's file."""
    rows = []
    for section, names in keys.KEYS.items():
        if section == "design":
            continue  # As [foot], each with two ends.
        if section == "constraints":
            rows += [_constraint(one) for one in BUILT_IN.values()]
            continue
        table = _TABLES.get(section, {})
        for key in names:
            name, unit = table.get(key, (key, NONE))
            rows.append(_setting(f"{section}.{key}", _KINDS[section], name, unit))
    return _table(("setting", "unit", "default", "range", "what it is"), rows)


def families_table() -> str:
    """Return a row for every shipped gait family, and one for each of its own settings."""
    rows = []
    base = {one.name for one in fields(GaitFamily)}
    for name, kind in SHIPPED.items():
        sentence = (inspect.getdoc(kind) or "").partition("\n")[0]
        rows.append((f"`{name}`", "", "", sentence))
        for key, (field, unit) in keys.setting_keys(kind).items():
            if field not in base:
                owner = next(one for one in kind.__mro__ if field in vars(one)["__annotations__"])
                told = re.sub(r" \[[^]]+\]", "", _sentences(owner)[field])
                value = _value(kind, field)
                shown = (
                    str(list(value)) if isinstance(value, tuple) else _default(kind, field, unit)
                )
                rows.append(("", f"`{key}`", shown, told))
    return _table(("family", "setting of [gait]", "default", "what it is"), rows)


def quantities_table() -> str:
    """Return a row for every quantity of the package."""
    rows = [
        (
            f"`{one.name}`",
            one.symbol,
            one.unit.name,
            _PER_SIDE[one.side],
            "more" if one.maximise else "less",
            _NEEDS[one.needs],
            one.label,
        )
        for one in BUILT_IN.values()
    ]
    header = ("quantity", "symbol", "unit", "one number limits", "objective", "needs", "what it is")
    return _table(header, rows)


def columns_table() -> str:
    """Return a row for the columns of the table `walks`, in their order."""
    walk, own, foot = _sentences(Walk), _sentences(StudyWalk), _sentences(FootDesign)
    rows = [
        *((f"`{name}`", own[name]) for name in ("id", "stage", "iteration")),
        *((f"`{name}`", own[name]) for name in ("nominal", "variation")),
        (
            "`roll_a` … `ankle_d`",
            "The sixteen coefficients [rad], or the variables of another family.",
        ),
        *((f"`{one.name}`", foot[one.name]) for one in fields(FootDesign)),
        *((f"`{name}`", walk[name]) for name in ("outcome", "reason", "frames")),
        *(
            (", ".join(f"`{name}`" for name in one.columns), _told(one))
            for one in BUILT_IN.values()
        ),
        ("`predicted_…`", own["predicted"]),
        ("`seconds`", own["seconds"]),
        ("`finished`", "When the walk was kept, in UTC."),
    ]
    return _table(("columns", "what they hold"), rows)


_BLOCKS: Mapping[str, Callable[[], str]] = {
    "settings": settings_table,
    "quantities": quantities_table,
    "families": families_table,
    "columns": columns_table,
}


def _told(one: Quantity) -> str:
    unit = {"mm": "m", "degrees": "rad"}.get(one.unit.name, one.unit.name)
    where = "" if one.needs is not Needs.MEASURES else "; where measures were taken"
    return f"{one.label}{f' [{unit}]' if unit else ''}{where}."


def _constraint(one: Quantity) -> Sequence[str]:
    default = "none" if one.limit is None else _number(one.limit / one.unit.si)
    sentence = f"{_PER_SIDE[one.side]}: {one.label}."
    return f"`constraints.{one.key}`", one.unit.name, default, "> 0", sentence


def _setting(key: str, kind: type, name: str, unit: Unit) -> Sequence[str]:
    told = _TOLD.get(key, ())
    # The column beside it has the unit of the file.
    sentence = told[2] if len(told) > 2 else re.sub(r" \[[^]]+\]", "", _sentences(kind)[name])
    if told:
        default, extent = told[:2]
    else:
        default, extent = _default(kind, name, unit), _range(key, kind, name, unit)
    shown = unit.name or ("text" if isinstance(_value(kind, name), str) else "")
    return f"`{key}`", shown, default, extent, sentence


def _value(kind: type, name: str) -> Any:
    return next((one.default for one in fields(kind) if one.name == name), "")


def _default(kind: type, name: str, unit: Unit) -> str:
    value = _value(kind, name)
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "none"}[value]
    return _number(value / unit.si) if isinstance(value, int | float) else str(value)


def _range(key: str, kind: type, name: str, unit: Unit) -> str:
    """Return the range of a field, as its class tells who gives what is not in it."""
    value = _value(kind, name)
    if isinstance(value, StrEnum):
        return ", ".join(type(value))
    if isinstance(value, bool):
        return "true, false"
    if key == "walk.friction":
        return _extent(FRICTION, unit)
    required = {"name": "x", "space": None} if kind is StudySettings else {}
    try:
        made = PaperFamily if kind is GaitFamily else kind
        made(**required, **{name: -math.inf})
    except OutOfRangeError as error:
        return _extent(error.allowed, unit)
    except SettingsError as error:
        found = re.search(r"whole number >= (\d+)", str(error))
        return f"≥ {found[1]}" if found else ""
    return ""


def _extent(allowed: Range, unit: Unit) -> str:
    if allowed.open:
        return f"> {_number(allowed.lower / unit.si)}"
    return f"{_number(allowed.lower / unit.si)} to {_number(allowed.upper / unit.si)}"


def _number(value: float) -> str:
    """Return a number in five digits, cut off so that the end of a range lies within it."""
    value = round(value, 12)
    digits = 5 - (math.floor(math.log10(abs(value))) + 1 if value else 0)
    cut = math.trunc(value * 10.0**digits + math.copysign(1e-6, value)) / 10.0**digits
    return str(np.format_float_positional(cut, trim="-"))


@cache
def _sentences(kind: type) -> Mapping[str, str]:
    """Return the first paragraph of the docstring below each field of a class."""
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(body, ast.ClassDef)
    found = {}
    for field, text in zip(body.body, body.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
            paragraph = str(ast.literal_eval(text.value)).split("\n\n")[0]
            found[ast.unparse(field.target)] = " ".join(paragraph.split())
    return found


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(_lines(header, rows))


def _lines(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield f"|{'---|' * len(header)}"
    for row in rows:
        yield "|" + "".join(f" {cell} |" if cell else " |" for cell in row)


if __name__ == "__main__":
    argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0]).parse_args()
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
