"""Ranges of settings: checked in SI units, told in whatever unit a person wrote the value."""

import math
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

from drake_gait.errors import SettingsError


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit that people write."""

    name: str
    """Its name as text; empty for a number without one."""
    si: float = 1.0
    """One of it in SI units."""

    @property
    def short(self) -> str:
        """Its name in a table."""
        return "deg" if self.name == "degrees" else self.name

    @property
    def suffix(self) -> str:
        """Ending of a key in a file: mm, n_m or rad_per_s."""
        text = self.short.lower().replace("/", "_per_").replace("·", "_")
        return re.sub(r"[^a-z0-9_]", "", text)


NONE = Unit(name="")
"""The unit of a plain number."""
RAD = Unit(name="rad")
DEGREES = Unit(name="degrees", si=math.pi / 180.0)
MM, MS = Unit(name="mm", si=1e-3), Unit(name="ms", si=1e-3)
N_M, JOULES, SECONDS = Unit(name="N·m"), Unit(name="J"), Unit(name="s")
RAD_PER_S = Unit(name="rad/s")


@dataclass(frozen=True, kw_only=True)
class Range:
    """Numbers from `lower` to `upper`, in SI units."""

    lower: float = -math.inf
    """Smallest number."""
    upper: float = math.inf
    """Largest number; infinity itself is never within."""
    open: bool = False
    """Whether the ends themselves are outside."""

    def __contains__(self, value: float) -> bool:
        """Return whether a number is within; NaN never is."""
        if not math.isfinite(value):
            return False
        if self.open:
            return self.lower < value < self.upper
        return self.lower <= value <= self.upper

    def in_words(self, unit: Unit) -> str:
        """Return the range as text, its ends in a unit."""
        low, high = (f"{end / unit.si:.6g}" for end in (self.lower, self.upper))
        name = f" {unit.name}" if unit.name else ""
        if not self.open:
            return f"{low} to {high}{name}"
        if math.isinf(self.upper):
            return f"> {low}{name} and finite"
        return f"> {low} and < {high}{name}"


POSITIVE = Range(lower=0.0, open=True)
"""Every finite number above 0."""


class OutOfRangeError(SettingsError):
    """A number outside its range, which a reader of files tells as the person wrote it."""

    def __init__(
        self,
        name: str,
        field: str,
        value: Any,
        allowed: Range,
        unit: Unit = NONE,
        *,
        demand: str = "must be",
        place: tuple[int, int] | None = None,
    ) -> None:
        self.field, self.place = field, place
        self.allowed, self._demand = allowed, demand
        super().__init__(self.told(name, value, unit))

    def told(self, name: str, value: Any, unit: Unit) -> str:
        """Return the message for a name and a value, with the range in a unit."""
        return f"{name} {self._demand} {self.allowed.in_words(unit)}, got {value}"


_Choice = TypeVar("_Choice", bound=StrEnum)


def choice(kind: type[_Choice], name: str, value: Any) -> _Choice:
    """Return the member of an enumeration that is meant.

    Args:
        kind: The enumeration.
        name: What is chosen, for the message.
        value: A member or its value.

    Raises:
        SettingsError: there is none.
    """
    try:
        return kind(value)
    except ValueError:
        raise SettingsError(f"{name} must be one of {', '.join(kind)}, got {value!r}") from None


def check(name: str, value: float, allowed: Range, unit: Unit = NONE) -> None:
    """Refuse a number that is outside its range.

    Args:
        name: Its name as text; the last word is its field.
        value: The number, in SI units.
        allowed: The range.
        unit: The SI unit, for the message.

    Raises:
        OutOfRangeError: it is outside.
    """
    if value not in allowed:
        raise OutOfRangeError(name, name.replace(".", " ").split()[-1], value, allowed, unit)
