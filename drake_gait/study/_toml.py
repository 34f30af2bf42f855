"""What stands in a TOML file, checked: names, numbers, texts and tables of coefficients."""

import difflib
import json
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray


def known(what: str, given: Mapping[str, Any], names: Collection[str]) -> None:
    """Refuse a name that is none of `names`, with the nearest one.

    Raises:
        SettingsError: there is such a name.
    """
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(name, list(names), n=1, cutoff=0.0)[0]
            raise SettingsError(
                f"no {what} is called '{name}'; the nearest is '{near}' of {', '.join(names)}"
            )


def number(name: str, value: Any) -> float:
    """A finite number.

    Raises:
        SettingsError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise SettingsError(f"{name} must be a finite number, got {value!r}")
    return float(value)


def texts(section: str, values: Mapping[str, Any], keys: tuple[str, ...]) -> None:
    """Refuse what should be text and is not.

    Raises:
        SettingsError: there is such a value.
    """
    for key in keys:
        if not isinstance(values.get(key, ""), str):
            raise SettingsError(f"{section}.{key} must be text, got {values[key]!r}")


def coefficients(name: str, rows: Any) -> FloatArray:
    """Four rows (roll, hip, knee, ankle) of four degrees (a, b, c, d) in radians, shape (4, 4).

    Raises:
        SettingsError: they are something else.
    """
    lists = isinstance(rows, list) and all(isinstance(row, list) for row in rows)
    if not lists or [len(row) for row in rows] != [4, 4, 4, 4]:
        raise SettingsError(f"{name} must be 4 rows of 4 numbers, got {rows!r}")
    values = [[number(name, value) for value in row] for row in rows]
    radians: FloatArray = np.radians(values)
    return radians


def coefficients_of_result(path: Path) -> Any:
    """The coefficients of a study's winner, from its result.json: rows of degrees.

    Raises:
        SettingsError: the file cannot be read, or is no result.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))["coefficients_deg"]
    except OSError as error:
        raise SettingsError(f"cannot read the result {path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise SettingsError(f"{path} is no result.json of a study") from None
