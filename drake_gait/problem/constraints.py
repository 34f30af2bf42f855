"""Limits on a walk, and what a walk is worth under them.

Paper, section III.C (Eqs. 10-17), as a maximisation of the distance walked under four constraints.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.problem.quantities import (
    BUILT_IN,
    OUTPUTS,
    Objective,
    Quantity,
    Side,
    named,
    quantity,
)
from drake_gait.ranges import POSITIVE, check
from drake_gait.walk import Walk

PENALTY = 1000.0
"""The paper's gamma, Eq. 17 [mm per unit of scaled violation]."""


@dataclass(frozen=True, init=False)
class Limit:
    """The range that a constraint leaves to one quantity of a walk."""

    quantity: Quantity
    """The quantity."""
    lower: float
    """Smallest value [SI]."""
    upper: float
    """Largest value [SI]."""

    def __init__(self, quantity: str, *, lower: float = -np.inf, upper: float = np.inf) -> None:
        """Take a quantity, or the name of one of the package.

        Args:
            quantity: The quantity.
            lower: Smallest value [SI].
            upper: Largest value [SI].

        Raises:
            SettingsError: there is no such quantity, or nothing between the ends.
        """
        object.__setattr__(self, "quantity", named(quantity))
        object.__setattr__(self, "lower", float(lower))
        object.__setattr__(self, "upper", float(upper))
        ends = [end for end in (self.lower, self.upper) if not math.isinf(end)]
        if not ends or not any(ends) or not self.lower < self.upper:
            raise SettingsError(
                f"a limit of {self.quantity.name} must have lower < upper, one of them finite and "
                f"not 0, as violations are parts of it; got {lower:g} to {upper:g}"
            )

    @classmethod
    def at(cls, quantity: Quantity, value: float | Sequence[float]) -> "Limit":
        """Return the limit that a file's value [SI] means: one number, or smallest and largest."""
        if isinstance(value, Sequence):
            lower, upper = value
            return cls(quantity, lower=lower, upper=upper)
        check(f"constraint {quantity.name}", value, POSITIVE)
        lower = {Side.UPPER: -np.inf, Side.LOWER: value, Side.BOTH: -value}[quantity.side]
        return cls(quantity, lower=lower, upper=np.inf if quantity.side is Side.LOWER else value)

    @property
    def value(self) -> float | list[float]:
        """The value that a file has [SI]: one number where that says it, or both ends."""
        single = self.lower if self.quantity.side is Side.LOWER else self.upper
        same = single > 0.0 and not math.isinf(single) and Limit.at(self.quantity, single) == self
        return single if same else [self.lower, self.upper]

    def scaled(self) -> "Limit":
        """Return the same limit on what networks take in the quantity's stead."""
        scale = self.quantity.scale
        if scale is None:
            return self
        ends = [end if math.isinf(end) else scale.function(end) for end in (self.lower, self.upper)]
        lower, upper = (
            (-end if math.isinf(end) else end for end in ends[::-1]) if scale.falls else ends
        )
        return Limit(self.quantity.scaled(), lower=lower, upper=upper)

    def excess(self, value: ArrayLike) -> FloatArray:
        """Return how far values, shape (...), are outside, in parts of the limit; inside < 0."""
        value = np.asarray(value)
        finite = [end for end in (self.lower, self.upper) if not math.isinf(end)]
        # A limit at 0 has no size of its own.
        sizes = {end: abs(end) or max(map(abs, finite)) for end in finite}
        sides = []
        if self.upper in sizes:
            sides.append((value - self.upper) / sizes[self.upper])
        if self.lower in sizes:
            sides.append((self.lower - value) / sizes[self.lower])
        excess: FloatArray = np.max(sides, axis=0)
        return excess


class Constraints:
    """Limits that make a walk feasible: Eqs. 11-14, and any quantity that a study adds.

    Of a quantity of both feet or of four toes, the worst counts.

        Constraints(slip=0.05, duty_factor=(0.5, 0.7))
        Constraints(Limit(SWAY, upper=0.003), yaw=0.1)
    """

    def __init__(self, *limits: Limit, **values: float | Sequence[float] | None) -> None:
        """Take limits, and values [SI] of the package's quantities by their names.

        Args:
            limits: Limits of any quantity.
            values: One number, on the side that the quantity declares, or smallest and largest
                value; None: no limit, or the paper's. Eqs. 11-13 are there unless given otherwise.

        Raises:
            SettingsError: there is no such quantity or limit.
        """
        found = {
            one.name: Limit.at(one, one.limit) for one in BUILT_IN.values() if one.limit is not None
        }
        for name, value in values.items():
            if value is not None:
                found[name] = Limit.at(named(name), value)
        for limit in limits:
            found[limit.quantity.name] = limit
        order = {name: place for place, name in enumerate([*_PAPER, *BUILT_IN])}
        ranked = sorted(found, key=lambda name: min(order.get(name, len(order)), len(order)))
        ranked = [*_PAPER, *(name for name in ranked if name not in _PAPER)]
        self._limits = {name: found[name] for name in ranked}
        self._scaled = tuple(limit.scaled() for limit in self._limits.values())

    @property
    def given(self) -> tuple[Limit, ...]:
        """Every limit, on its own quantity."""
        return tuple(self._limits.values())

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Eqs. 11-13, then the others, on what networks predict."""
        return self._scaled

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities of `Assessment.violations`, in their order."""
        return (*(limit.quantity.name for limit in self.limits), "frames")

    def but(self, **values: float | Sequence[float] | None) -> "Constraints":
        """Return the same limits with some others; None for none."""
        kept = (limit for name, limit in self._limits.items() if name not in values)
        return Constraints(*kept, **values)

    def plain(self) -> dict[str, Any]:
        """Return the value [SI] of each limit by name; None of the package's without one."""
        names = {**dict.fromkeys(BUILT_IN), **dict.fromkeys(self._limits)}
        return {name: self._limits[name].value if name in self._limits else None for name in names}

    def __getattr__(self, name: str) -> Any:
        """The value [SI] of the limit of a quantity, as `Limit.value`; None without one."""
        if name.startswith("_") or (name not in BUILT_IN and name not in self._limits):
            raise AttributeError(f"'Constraints' object has no attribute '{name}'")
        return self._limits[name].value if name in self._limits else None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Constraints) and self.given == other.given

    def __hash__(self) -> int:
        return hash(self.given)

    def __repr__(self) -> str:
        told = (f"{name}={limit.value}" for name, limit in self._limits.items())
        return f"Constraints({', '.join(told)})"


_PAPER = tuple(one.name for one in BUILT_IN.values() if one.limit is not None)
"""The quantities of Eqs. 11-13."""


def quantities(
    limits: Constraints, objective: Objective = Objective.DISTANCE
) -> tuple[Quantity, ...]:
    """Return OUTPUTS, then whatever else the objective and the constraints need of a walk."""
    names = (
        *(BUILT_IN[name] for name in OUTPUTS),
        objective.quantity,
        *(limit.quantity for limit in limits.limits),
    )
    return tuple({one.name: one for one in names}.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """A walk measured against the problem."""

    objective: float
    """What is minimised: -Z_f [m], Eq. 15, or minus `Objective.quantity`."""
    violations: FloatArray
    """Each violation divided by its limit, 0 when satisfied; shape (3 + m + 1,).

    In the order of `Constraints.names`; the last are the frames that are missing, Eq. 14.
    """

    @property
    def feasible(self) -> bool:
        """Return whether all constraints hold."""
        return not self.violations.any()

    @property
    def fitness(self) -> float:
        """The paper's F(x) with scaled violations [mm], Eqs. 16-17."""
        return 1e3 * self.objective + PENALTY * float(self.violations.sum())


def assess(
    walk: Walk, limits: Constraints, objective: Objective = Objective.DISTANCE
) -> Assessment:
    """Objective and violations of one simulated walk."""
    missing = (walk.planned - walk.frames) / walk.planned  # Eq. 14
    if not walk.survived:
        missing = max(missing, 1.0 / walk.planned)
    excess = [float(limit.excess(quantity(walk, limit.quantity))) for limit in limits.limits]
    gained = quantity(walk, objective.quantity)
    return Assessment(
        objective=-gained if math.isfinite(gained) else 0.0,
        # What cannot be said of a walk counts as broken by the limit's own size.
        violations=np.nan_to_num(np.maximum([*excess, missing], 0.0), nan=1.0),
    )
