"""Limits on a walk, and what a walk is worth under them.

Paper, section III.C (Eqs. 10-17), as a maximisation of the distance walked under four constraints.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.gait import FRAMES, FloatArray
from drake_gait.problem.quantities import OUTPUTS, Objective, quantity
from drake_gait.ranges import POSITIVE, check
from drake_gait.walk import Walk

PENALTY = 1000.0
"""The paper's gamma, Eq. 17 [mm per unit of scaled violation]."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """The range that a constraint leaves to one quantity of a walk."""

    quantity: str
    """Its name, see `quantity`."""
    lower: float = -np.inf
    """Smallest value."""
    upper: float = np.inf
    """Largest value."""

    def excess(self, value: ArrayLike) -> FloatArray:
        """How far values, shape (...), are outside, in parts of the limit; below 0 inside."""
        above = (np.asarray(value) - self.upper) / abs(self.upper) if self.upper < np.inf else None
        below = (self.lower - np.asarray(value)) / abs(self.lower) if self.lower > -np.inf else None
        sides = [side for side in (above, below) if side is not None]
        excess: FloatArray = np.max(sides, axis=0)
        return excess


@dataclass(frozen=True, kw_only=True)
class Constraints:
    """Limits that make a walk feasible: Eqs. 11-14, and any measure of a walk that a study adds.

    Of a measure of both feet or of four toes, the worst counts.
    """

    lateral: float = 0.020
    """Largest |X_f| [m], Eq. 11."""
    yaw: float = np.radians(5.0)
    """Largest |R_f| [rad], Eq. 12."""
    com_height: float = 0.24353
    """Smallest Y_f [m], Eq. 13."""
    energy: float | None = None
    """Largest work of the servos, driving and braking [J]."""
    positive_energy: float | None = None
    """Largest driving work of the servos [J]."""
    cost_of_transport: float | None = None
    """Largest driving work / (weight x distance)."""
    peak_torque: float | None = None
    """Largest torque of a servo [N·m]."""
    peak_speed: float | None = None
    """Largest speed of a servo [rad/s]."""
    saturated_fraction: float | None = None
    """Largest share of servo-time at the stall torque."""
    slip: float | None = None
    """Largest distance that a loaded sole slides [m]."""
    clearance: float | None = None
    """Smallest minimum toe clearance of either foot [m]."""
    duty_factor: float | None = None
    """Largest share of a cycle in which a foot carries load."""
    peak_ground_reaction: float | None = None
    """Largest vertical force of the ground over a frame / weight."""
    toe_range: float | None = None
    """Largest angle of a toe [rad]."""
    yaw_swing: float | None = None
    """Largest range of the torso's heading [rad]."""
    torso_tilt: float | None = None
    """Largest lean of the torso [rad]."""

    def __post_init__(self) -> None:
        for limit in fields(self):
            value = getattr(self, limit.name)
            if value is not None:
                check(f"constraint {limit.name}", value, POSITIVE)

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Eqs. 11-13, then the measures' limits."""
        paper = (
            Limit(quantity="lateral", lower=-self.lateral, upper=self.lateral),  # Eq. 11
            Limit(quantity="yaw", lower=-self.yaw, upper=self.yaw),  # Eq. 12
            Limit(quantity="com_height", lower=self.com_height),  # Eq. 13
        )
        return paper + tuple(_measure_limit(name, value) for name, value in self._measures())

    @property
    def names(self) -> tuple[str, ...]:
        """What each of `Assessment.violations` is of."""
        return (*(limit.quantity for limit in self.limits), "frames")

    def _measures(self) -> list[tuple[str, float]]:
        names = [limit.name for limit in fields(self)][3:]
        return [(name, getattr(self, name)) for name in names if getattr(self, name) is not None]


def _measure_limit(name: str, value: float) -> Limit:
    if name == "clearance":
        return Limit(quantity=name, lower=value)
    if (
        name == "cost_of_transport"
    ):  # Infinite for a walk that does not advance, unlike its inverse.
        return Limit(quantity="transport_efficiency", lower=1.0 / value)
    return Limit(quantity=name, upper=value)


def quantities(limits: Constraints, objective: Objective = Objective.DISTANCE) -> tuple[str, ...]:
    """OUTPUTS, then whatever else the objective and the constraints need of a walk."""
    names = (*OUTPUTS, objective.quantity, *(limit.quantity for limit in limits.limits))
    return tuple(dict.fromkeys(names))


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """A walk measured against the problem."""

    objective: float
    """What is minimised: -Z_f [m], Eq. 15, or minus the inverse of the cost of transport."""
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
    missing = (FRAMES - walk.frames) / FRAMES  # Eq. 14
    if not walk.survived:
        missing = max(missing, 1.0 / FRAMES)
    excess = [float(limit.excess(quantity(walk, limit.quantity))) for limit in limits.limits]
    gained = quantity(walk, objective.quantity)
    return Assessment(
        objective=-gained if math.isfinite(gained) else 0.0,
        # What cannot be said of a walk counts as broken by the limit's own size.
        violations=np.nan_to_num(np.maximum([*excess, missing], 0.0), nan=1.0),
    )
