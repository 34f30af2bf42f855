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
from drake_gait.ranges import NONE, Unit


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
    if not isinstance(value, bool) and isinstance(value, int | float):
        try:
            found = float(value)
        except OverflowError:
            raise SettingsError(f"{name} must be a finite number, got one beyond 1e308") from None
        if math.isfinite(found):
            return found
    raise SettingsError(f"{name} must be a finite number, got {value!r}")


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


def as_toml(value: Any, unit: Unit = NONE) -> str:
    """Return a value as TOML has it: `tomllib.loads(f"x = {as_toml(value)}")["x"]` is the value.

    Args:
        value: Text, a number, a truth value, or lists of them.
        unit: What numbers are written in; they are given in SI units. Read again and multiplied by
            the unit they are what they were, to the last digit wherever there is such a number.
    """
    if isinstance(value, list | tuple):
        return f"[{', '.join(as_toml(one, unit) for one in value)}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{as_toml(key)} = {as_toml(one)}' for key, one in value.items())}}}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # TOML has no halves of a character, which a command line can hold, and no bare delete.
        whole = value.encode("utf-8", "replace").decode("utf-8")
        return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, float):
        return _number_as_toml(value, unit.si)
    return str(value)


def _number_as_toml(value: float, si: float) -> str:
    if si == 1.0 or not math.isfinite(value):
        return repr(value)
    # The fewest digits give back what somebody has written, and not what rounding made of it.
    guess = value / si
    near = [guess, math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf)]
    texts = [f"{guess:.{digits}g}" for digits in (12, 15, 16)] + [repr(one) for one in near]
    return next((text for text in texts if float(text) * si == value), repr(guess))
