"""Changes: what a confirmation alters of a walk, to see whether its gait holds.

Those of the package are numbers of `[confirmation]`, each with its range, its unit and its tier. A
user's own is an object that is handed over.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.problem import Trial
from drake_gait.ranges import NONE, Range, Unit

TIERS = (1, 2, 3)
"""Tiers that a change may belong to; one of tier 1 is made in tier 2 too."""


@dataclass(frozen=True, kw_only=True)
class Varied:
    """A number of `[confirmation]` by which walks are changed."""

    tier: int
    """Tier that it belongs to, unless `confirmation.tiers` says otherwise."""
    allowed: Range
    """What it may be, in SI units."""
    key: str
    """Its key in a study's file."""
    unit: Unit = NONE
    """Its SI unit."""
    written: Unit = NONE
    """The unit of its key."""


@runtime_checkable
class Change(Protocol):
    """A change of a user's own: an object with a name and a tier that is called with a walk."""

    @property
    def name(self) -> str:
        """The name and the numbers of the change; a study is not resumed with another one."""
        ...

    @property
    def tier(self) -> int:
        """The tier whose walks are changed, see `TIERS`."""
        ...

    def __call__(self, trial: Trial, rng: np.random.Generator) -> Trial:
        """Return a trial with other settings, or another candidate.

        Args:
            trial: What would be walked without it; its settings must not decide on its candidate.
            rng: Random numbers of this walk alone, the same whenever it is asked for.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Remembered:
    """A user's change as a study's file has it: its name and its tier, not what it does."""

    name: str
    """Its name."""
    tier: int
    """Its tier."""

    def __call__(self, trial: Trial, rng: np.random.Generator) -> Trial:
        """Refuse to change a walk."""
        raise SettingsError(
            f"confirmation.own has '{self.name}', which the study's file knows by its name only; "
            "hand it over: ConfirmationSettings(own=(...,))"
        )


def own_changes(given: Sequence[Any], shipped: Sequence[str]) -> tuple[Change, ...]:
    """Return a user's changes, checked.

    Args:
        given: Changes, or what a study's file remembers of them.
        shipped: Names of the package's own.

    Raises:
        SettingsError: one has no name of its own, no tier, or cannot be called.
    """
    found = tuple(Remembered(**one) if isinstance(one, dict) else one for one in given)
    names = list(shipped)
    for one in found:
        name, tier = getattr(one, "name", None), getattr(one, "tier", None)
        if not isinstance(name, str) or not name or name in names:
            raise SettingsError(
                f"confirmation.own needs changes with names of their own, got {name!r}; "
                f"there are {', '.join(names)}"
            )
        check_tier(f"the tier of '{name}' in confirmation.own", tier)
        if not callable(one):
            raise SettingsError(
                f"'{name}' in confirmation.own must be called with a trial and random numbers, "
                f"got {one!r}"
            )
        names.append(name)
    return found


def check_tier(name: str, tier: Any) -> None:
    """Refuse a tier that no change can belong to.

    Raises:
        SettingsError: it is none of `TIERS`.
    """
    if isinstance(tier, bool) or tier not in TIERS:
        told = ", ".join(map(str, TIERS))
        raise SettingsError(f"{name} must be one of {told}, got {tier!r}")
