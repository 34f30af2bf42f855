"""The optimisation problem: what is searched, and what makes one walk better than another.

Paper, section III.C (Eqs. 10-17), as a maximisation of the distance walked under four constraints.
"""

import math
from dataclasses import dataclass, field, fields
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.errors import SettingsError
from drake_gait.foot import DESIGN_LIMITS, DESIGN_UNITS, SEARCHED_IN_LOG, FootDesign
from drake_gait.gait import ANGLE_LIMITS, FRAMES, TERMS, WAVEFORMS, FloatArray, Gait
from drake_gait.ranges import POSITIVE, OutOfRangeError, Range, Unit, check
from drake_gait.walk import Outcome, Walk, WalkSettings

PENALTY = 1000.0
"""The paper's gamma, Eq. 17 [mm per unit of scaled violation]."""

ROUNDING = 1e-9
"""A coefficient beyond its range by no more than this is at its end [rad]."""

COEFFICIENTS = tuple(f"{waveform}_{term}" for waveform in WAVEFORMS for term in TERMS)
"""Names of the sixteen coefficients, in the order of every design vector."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """What one simulation is asked to walk: a gait on a pair of feet."""

    gait: Gait
    """The sixteen coefficients."""
    foot: FootDesign = field(default_factory=FootDesign)
    """The toes."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One simulation to run: all that its numbers depend on."""

    candidate: Candidate
    """What walks."""
    settings: WalkSettings = field(default_factory=WalkSettings)
    """How it is simulated."""


class Objective(StrEnum):
    """What a study wants of a walk."""

    DISTANCE = "distance"
    """The largest distance walked forward, Eq. 10."""
    COST_OF_TRANSPORT = "cost_of_transport"
    """The smallest driving work per weight and distance; the paper's future work."""

    @property
    def quantity(self) -> str:
        """Name of the quantity that is maximised, see `quantity`."""
        return "forward" if self is Objective.DISTANCE else "transport_efficiency"


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
        return (*(limit.quantity for limit in self.limits), "steps")

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


OUTPUTS = ("forward", "lateral", "yaw", "com_height")
"""What every network predicts: Z_f, X_f [m], R_f [rad], Y_f [m]."""

OF_EVERY_WALK = (*OUTPUTS, "yaw_swing")
"""What every walk has, with measures or without."""


def quantity(walk: Walk, name: str) -> float:
    """One number of a walk, in SI units.

    Args:
        walk: The walk.
        name: One of OF_EVERY_WALK, a field of `walk.Measures`, or "transport_efficiency", the
            inverse of the cost of transport. Of several feet or toes, the worst.

    Raises:
        SettingsError: the walk was simulated without measures.
    """
    if name in OF_EVERY_WALK:
        known = getattr(walk, name)
        return math.nan if known is None else float(known)
    if walk.outcome is Outcome.DIVERGED:
        return math.nan
    if walk.measures is None:
        raise SettingsError(f"{name} needs the measures of a walk; simulate it with measures=True")
    if name == "transport_efficiency":
        return 1.0 / walk.measures.cost_of_transport
    value = getattr(walk.measures, name)
    worst = min if name == "clearance" else max
    return float(worst(value) if isinstance(value, tuple) else value)


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
        """Whether all constraints hold."""
        return not self.violations.any()

    @property
    def fitness(self) -> float:
        """The paper's F(x) with scaled violations [mm], Eqs. 16-17."""
        return 1e3 * self.objective + PENALTY * float(self.violations.sum())


def assess(
    walk: Walk, limits: Constraints, objective: Objective = Objective.DISTANCE
) -> Assessment:
    """Objective and violations of one simulated walk."""
    missing = (FRAMES - walk.steps) / FRAMES  # Eq. 14
    if not walk.survived:
        missing = max(missing, 1.0 / FRAMES)
    excess = [float(limit.excess(quantity(walk, limit.quantity))) for limit in limits.limits]
    gained = quantity(walk, objective.quantity)
    return Assessment(
        objective=-gained if math.isfinite(gained) else 0.0,
        # What cannot be said of a walk counts as broken by the limit's own size.
        violations=np.nan_to_num(np.maximum([*excess, missing], 0.0), nan=1.0),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignSpace:
    """Where gaits and feet are looked for.

    A design vector x is dimensionless: samples are drawn from the `box` -1 <= x <= 1, and `limits`
    says how far beyond it the search may go. Design variables of the foot that are not
    open stay as in `foot`.
    """

    centre: FloatArray
    """Coefficients in the middle of the box [rad], shape (4, 4)."""
    half_width: FloatArray
    """Half the width of the box [rad], shape (4, 4), each > 0."""
    foot: FootDesign = field(default_factory=FootDesign)
    """The foot of every candidate, but for the fields in `foot_ranges`."""
    foot_ranges: tuple[tuple[str, float, float], ...] = ()
    """Open fields of the foot with their smallest and largest value [SI]."""

    def __post_init__(self) -> None:
        for name in ("centre", "half_width"):
            values = np.array(getattr(self, name), dtype=float)
            if values.shape != (4, 4) or not np.isfinite(values).all():
                told = values.tolist()
                raise SettingsError(f"{name} must be 4 rows of 4 finite numbers, got {told}")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        lower, upper = _coefficient_limits()
        # The winner of another study comes through degrees, from the very end of a range too.
        within = np.clip(self.centre, lower, upper)
        if (np.abs(self.centre - within) <= ROUNDING).all() and (self.centre != within).any():
            within.setflags(write=False)
            object.__setattr__(self, "centre", within)
        for row, column in np.ndindex(4, 4):
            limits = Range(lower=float(lower[row, column]), upper=float(upper[row, column]))
            for name, allowed, demand in (
                ("half_width", POSITIVE, "must be"),
                ("centre", limits, "must, by Table I, be"),
            ):
                value = float(getattr(self, name)[row, column])
                if value not in allowed:
                    raise OutOfRangeError(
                        f"{name} of {WAVEFORMS[row]}_{TERMS[column]}", name, value, allowed,
                        Unit(name="rad"), demand=demand, place=(row, column),
                    )  # fmt: skip
        opened = [name for name, _, _ in self.foot_ranges]
        for name, low, high in self.foot_ranges:
            if opened.count(name) > 1:
                raise SettingsError(f"{name} is open twice; give it one range")
            if name not in DESIGN_LIMITS:
                raise SettingsError(f"no foot design variable '{name}'; there are "
                                    f"{', '.join(DESIGN_LIMITS)}")  # fmt: skip
            smallest, largest = DESIGN_LIMITS[name]
            if not smallest <= low < high <= largest:
                raise OutOfRangeError(
                    f"range of {name}", name, [low, high], Range(lower=smallest, upper=largest),
                    Unit(name=DESIGN_UNITS[name]), demand="must rise and lie in",
                )  # fmt: skip
        if opened and self.foot.rigid_toes:
            raise SettingsError(
                f"{opened[0]} is open, but rigid toes have nothing to search; close it, or let "
                "rigid_toes be false"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the design variables, in the order of x."""
        return COEFFICIENTS + tuple(name for name, _, _ in self.foot_ranges)

    @property
    def dimension(self) -> int:
        """Number of design variables d."""
        return len(self.names)

    @property
    def limits(self) -> FloatArray:
        """How far the search may go, shape (d, 2): Table I's ranges, and the foot's box."""
        lower, upper = _coefficient_limits()
        coefficients = np.stack(
            [
                ((lower - self.centre) / self.half_width).ravel(),
                ((upper - self.centre) / self.half_width).ravel(),
            ],
            axis=1,
        )
        return np.vstack([coefficients, np.tile([-1.0, 1.0], (len(self.foot_ranges), 1))])

    @property
    def box(self) -> FloatArray:
        """Where samples are drawn, shape (d, 2): -1 to 1, as far as the limits allow."""
        return np.clip([-1.0, 1.0], self.limits[:, :1], self.limits[:, 1:])

    def decode(self, x: ArrayLike) -> Candidate:
        """The candidate at x, shape (d,)."""
        x = np.asarray(x, dtype=float)
        if x.shape != (self.dimension,):
            raise SettingsError(f"a design vector has shape ({self.dimension},), got {x.shape}")
        gait = Gait(coefficients=self.centre + self.half_width * x[:16].reshape(4, 4))
        changes = {}
        for (name, low, high), value in zip(self.foot_ranges, x[16:], strict=True):
            lower, upper = _scaled(name, [low, high])
            scaled = lower + (value + 1.0) / 2.0 * (upper - lower)
            found = np.exp(scaled) if name in SEARCHED_IN_LOG else scaled
            changes[name] = float(np.clip(found, low, high))
        values = {item.name: getattr(self.foot, item.name) for item in fields(self.foot)}
        return Candidate(gait=gait, foot=FootDesign(**{**values, **changes}))

    def encode(self, candidate: Candidate) -> FloatArray:
        """The design vector of a candidate, shape (d,)."""
        x = ((candidate.gait.coefficients - self.centre) / self.half_width).ravel()
        for name, low, high in self.foot_ranges:
            value, lower, upper = _scaled(name, [getattr(candidate.foot, name), low, high])
            x = np.append(x, 2.0 * (value - lower) / (upper - lower) - 1.0)
        return x


def _scaled(name: str, values: ArrayLike) -> FloatArray:
    """Values of a field of the foot on the scale on which it is searched."""
    scaled: FloatArray = np.log(values) if name in SEARCHED_IN_LOG else np.asarray(values)
    return scaled


def _coefficient_limits() -> tuple[FloatArray, FloatArray]:
    """Smallest and largest coefficients [rad], shape (4, 4) each, that Table I leaves room for.

    The mean a may be any angle of the joint's range, an amplitude at most half of the range.
    """
    lower, upper = ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1]
    amplitude = np.tile(((upper - lower) / 2.0)[:, None], (1, 3))
    return np.column_stack([lower, -amplitude]), np.column_stack([upper, amplitude])
