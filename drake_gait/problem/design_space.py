"""The space in which gaits and feet are looked for, and its design vectors."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.errors import SettingsError
from drake_gait.foot import DESIGN_LIMITS, DESIGN_UNITS, SEARCHED_IN_LOG, FootDesign
from drake_gait.gait import PAPER, ROUNDING, TERMS, FloatArray, GaitFamily, PaperFamily
from drake_gait.problem.candidate import Candidate
from drake_gait.ranges import POSITIVE, OutOfRangeError, Range, Unit


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignSpace:
    """Space of gaits and feet that is searched.

    A design vector x is dimensionless: samples are drawn from the `box` -1 <= x <= 1. The `limits`
    say how far beyond it the search may go. Design variables of the foot that are not
    open stay as in `foot`.

    The box of the paper's family is two tables of coefficients, shape (4, 4), and all of them are
    open. Of another family it is values by the names of variables. One without a half width, or
    with 0, stays at its centre; one without a centre is at its default.
    """

    centre: FloatArray
    """Variables in the middle of the box [SI], shape (4, 4), (n,), or values by name."""
    half_width: FloatArray
    """Half the width of the box [SI], likewise; of the paper's family each > 0."""
    foot: FootDesign = field(default_factory=FootDesign)
    """The foot of every candidate, but for the fields in `foot_ranges`."""
    foot_ranges: tuple[tuple[str, float, float], ...] = ()
    """Open fields of the foot with their smallest and largest value [SI]."""
    family: GaitFamily = PAPER
    """The family of the gaits."""

    def __post_init__(self) -> None:
        for name in ("centre", "half_width"):
            values = self._array(name, getattr(self, name))
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        lower, upper = (end.reshape(self.centre.shape) for end in self.family.limits.T)
        # The winner of another study comes through degrees, from the very end of a range too.
        within = np.clip(self.centre, lower, upper)
        if (np.abs(self.centre - within) <= ROUNDING).all() and (self.centre != within).any():
            within.setflags(write=False)
            object.__setattr__(self, "centre", within)
        self._check_box()
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

        if not self.dimension:
            raise SettingsError(
                "the box opens no variable; give half_width of some of "
                f"{', '.join(self.family.names)}"
            )

    def _array(self, name: str, given: Any) -> FloatArray:
        """Return a corner of the box as an array."""
        family = self.family
        if isinstance(family, PaperFamily):
            values = np.array(given, dtype=float)
            if values.shape != (4, 4) or not np.isfinite(values).all():
                told = values.tolist()
                raise SettingsError(f"{name} must be 4 rows of 4 finite numbers, got {told}")
            return values
        if isinstance(given, Mapping):
            rest = dict.fromkeys(family.names, 0.0) if name == "half_width" else {}
            given = family.values({**rest, **given}, what=name)
        values = np.array(given, dtype=float)
        if values.shape != (len(family.names),) or not np.isfinite(values).all():
            raise SettingsError(
                f"{name} must be a finite number for each of the {len(family.names)} variables of "
                f"the gait family {family.label}, or values by their names, got {values.tolist()}"
            )
        return values

    def _check_box(self) -> None:
        """Refuse a centre beyond the limits of a variable, and a half width that is none."""
        paper = isinstance(self.family, PaperFamily)
        widths = POSITIVE if paper else Range(lower=0.0)
        for number, one in enumerate(self.family.variables):
            for name, allowed, demand in (
                ("half_width", widths, "must be"),
                ("centre", one.allowed, "must, by Table I, be" if paper else "must be"),
            ):
                value = float(getattr(self, name).flat[number])
                if value not in allowed:
                    unit = "rad" if one.is_angle else one.unit.name
                    raise OutOfRangeError(
                        f"{name} of {one.name}",
                        name if paper else f"{name}.{one.name}",
                        value,
                        allowed,
                        Unit(name=unit),
                        demand=demand,
                        place=divmod(number, len(TERMS)) if paper else None,
                    )

    @property
    def open_variables(self) -> tuple[int, ...]:
        """Which variables of the family are searched; the others stay at the centre."""
        return tuple(np.flatnonzero(self.half_width).tolist())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the design variables, in the order of x."""
        names = self.family.names
        return (
            *(names[place] for place in self.open_variables),
            *(name for name, _, _ in self.foot_ranges),
        )

    @property
    def dimension(self) -> int:
        """Number of design variables d."""
        return len(self.names)

    @property
    def limits(self) -> FloatArray:
        """Return the limits of the search, shape (d, 2): of the variables, and the foot's box.

        Those of the paper's coefficients follow from Table I.
        """
        place = list(self.open_variables)
        centre, half_width = self.centre.ravel()[place], self.half_width.ravel()[place]
        variables = (self.family.limits[place] - centre[:, None]) / half_width[:, None]
        return np.vstack([variables, np.tile([-1.0, 1.0], (len(self.foot_ranges), 1))])

    @property
    def box(self) -> FloatArray:
        """Return the box of the samples, shape (d, 2): -1 to 1, as far as the limits allow."""
        return np.clip([-1.0, 1.0], self.limits[:, :1], self.limits[:, 1:])

    @property
    def middle(self) -> Candidate:
        """Return the candidate in the middle of the box."""
        return self.decode(np.zeros(self.dimension))

    def noise(self, deviation: float) -> FloatArray:
        """Return the deviation of x, shape (d,), that noise on every angle of a gait brings.

        Args:
            deviation: That of each angle [rad].
        """
        place = list(self.open_variables)
        angles = np.array([self.family.variables[one].is_angle for one in place])
        of_gait = deviation * angles / self.half_width.ravel()[place]
        return np.concatenate([of_gait, np.zeros(len(self.foot_ranges))])

    def decode(self, x: ArrayLike) -> Candidate:
        """The candidate at x, shape (d,)."""
        x = np.asarray(x, dtype=float)
        if x.shape != (self.dimension,):
            raise SettingsError(f"a design vector has shape ({self.dimension},), got {x.shape}")
        place = list(self.open_variables)
        of_gait, of_foot = x[: len(place)], x[len(place) :]
        variables = np.array(self.centre.ravel())
        variables[place] += self.half_width.ravel()[place] * of_gait
        gait = self.family.gait(variables)
        changes = {}
        for (name, low, high), value in zip(self.foot_ranges, of_foot, strict=True):
            lower, upper = _scaled(name, [low, high])
            scaled = lower + (value + 1.0) / 2.0 * (upper - lower)
            found = np.exp(scaled) if name in SEARCHED_IN_LOG else scaled
            changes[name] = float(np.clip(found, low, high))
        values = {item.name: getattr(self.foot, item.name) for item in fields(self.foot)}
        return Candidate(gait=gait, foot=FootDesign(**{**values, **changes}))

    def encode(self, candidate: Candidate) -> FloatArray:
        """The design vector of a candidate, shape (d,)."""
        place = list(self.open_variables)
        moved = candidate.gait.variables[place] - self.centre.ravel()[place]
        x = moved / self.half_width.ravel()[place]
        for name, low, high in self.foot_ranges:
            value, lower, upper = _scaled(name, [getattr(candidate.foot, name), low, high])
            x = np.append(x, 2.0 * (value - lower) / (upper - lower) - 1.0)
        return x


def _scaled(name: str, values: ArrayLike) -> FloatArray:
    """Values of a field of the foot on the scale on which it is searched."""
    scaled: FloatArray = np.log(values) if name in SEARCHED_IN_LOG else np.asarray(values)
    return scaled
