"""Values of a TOML file, checked as they are read: names, numbers, texts, tables; and written."""

import difflib
import math
import tomllib
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from datetime import date, time
from typing import Any, TypeVar

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.gait import TERMS, WAVEFORMS, FloatArray
from drake_gait.ranges import NONE, OutOfRangeError, Unit
from drake_gait.study.keys import Table

_Made = TypeVar("_Made")


MOST_BITS = 13_000
"""Python writes no longer whole number as text: 3914 digits."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises:
        ValueError: it is not TOML, or has a number or a nesting that cannot be told of.
    """
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    _refuse_long_numbers(content)
    return content


def _refuse_long_numbers(value: Any) -> None:
    if isinstance(value, int) and value.bit_length() > MOST_BITS:
        raise ValueError("a whole number in it has more than 3900 digits")
    if isinstance(value, Mapping | list):
        for one in value.values() if isinstance(value, Mapping) else value:
            _refuse_long_numbers(one)


def known(what: str, given: Mapping[str, Any], names: Collection[str]) -> None:
    """Refuse a name that is not one of `names`, with the nearest one.

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
        text(f"{section}.{key}", values.get(key, ""))


_LONGEST_NAME = 255
"""What common file systems allow for a name [bytes]."""


def text(name: str, value: Any) -> str:
    """A text that every file, page and stream can hold; its lines may have ends and tabulators.

    Raises:
        SettingsError: it is none, or has other control characters or halves of characters.
    """
    if not isinstance(value, str):
        raise SettingsError(f"{name} must be text, got {value!r}")
    for character in value:
        kind = unicodedata.category(character)
        if kind == "Cs" or (kind == "Cc" and character not in "\n\r\t"):
            raise SettingsError(
                f"{name} must be text that can be printed, got {value!r} with "
                f"U+{ord(character):04X}"
            )
    return value


def folder_name(name: str, value: Any) -> str:
    """A text that does as the name of a folder.

    Raises:
        SettingsError: it is empty, too long, has a slash or a line's end, or begins with a dot.
    """
    found = text(name, value)
    size = len(found.encode())
    if not found or found.startswith(".") or any(one in found for one in "/\n\r\t"):
        raise SettingsError(f"{name} must do as a folder's name, got {_short(found)}")
    if size > _LONGEST_NAME:
        raise SettingsError(
            f"{name} must do as a folder's name, of {_LONGEST_NAME} bytes at most; "
            f"{_short(found)} has {size}"
        )
    return found


def _short(value: str) -> str:
    return repr(value) if len(value) <= 40 else repr(f"{value[:37]}...")


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


def made(
    kind: Callable[..., _Made],
    section: str,
    content: Mapping[str, Any],
    table: Table,
    **others: Any,
) -> _Made:
    """Return an object of settings from a section of numbers with units, and other arguments.

    Raises:
        SettingsError: a number is none, or is outside its range: told as it was written.
    """
    written = content.get(section, {})
    values = {
        table[key][0]: number(f"{section}.{key}", value) * table[key][1].si
        for key, value in written.items()
    }
    with told_as_written(section, written, table):
        return kind(**values, **others)


@contextmanager
def told_as_written(section: str, written: Mapping[str, Any], table: Table) -> Iterator[None]:
    """Tell of a number outside its range with the key, the value and the unit of the file."""
    try:
        yield
    except OutOfRangeError as error:
        for key, (field_name, unit) in table.items():
            if field_name == error.field and key in written:
                name, value = f"{section}.{key}", written[key]
                if error.place is not None:
                    row, column = error.place
                    name = f"{WAVEFORMS[row]}_{TERMS[column]} of {name}"
                    value = value[row][column]
                raise SettingsError(error.told(name, repr(value), unit)) from None
        raise


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
        return _quoted(value)
    if isinstance(value, float):
        return _number_as_toml(value, unit.si)
    if isinstance(value, int | date | time):  # A datetime is a date.
        return str(value)
    raise SettingsError(f"TOML has no value {value!r}")


def _number_as_toml(value: float, si: float) -> str:
    if si == 1.0 or not math.isfinite(value):
        return repr(value)
    # The fewest digits give back what somebody has written, and not what rounding made of it.
    guess = value / si
    near = [guess, math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf)]
    texts = [f"{guess:.{digits}g}" for digits in (12, 15, 16)] + [repr(one) for one in near]
    return next((text for text in texts if float(text) * si == value), repr(guess))


def _quoted(text: str) -> str:
    """Return a text in quotes and in ASCII, so that every locale passes it on."""
    # TOML has no halves of a character, which a command line can hold.
    whole = text.encode("utf-8", "replace").decode("utf-8")
    return f'"{"".join(map(_escaped, whole))}"'


def _escaped(character: str) -> str:
    if character in '"\\':
        return f"\\{character}"
    if " " <= character <= "~":
        return character
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
