"""The space in which gaits and feet are looked for, and its design vectors."""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.errors import SettingsError
from drake_gait.foot import DESIGN_LIMITS, DESIGN_UNITS, SEARCHED_IN_LOG, FootDesign
from drake_gait.gait import ANGLE_LIMITS, TERMS, WAVEFORMS, FloatArray, Gait
from drake_gait.problem.candidate import Candidate
from drake_gait.ranges import POSITIVE, OutOfRangeError, Range, Unit

ROUNDING = 1e-9
"""A coefficient beyond its range by no more than this is at its end [rad]."""

COEFFICIENTS = tuple(f"{waveform}_{term}" for waveform in WAVEFORMS for term in TERMS)
"""Names of the sixteen coefficients, in the order of every design vector."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignSpace:
    """Space of gaits and feet that is searched.

    A design vector x is dimensionless: samples are drawn from the `box` -1 <= x <= 1. The `limits`
    say how far beyond it the search may go. Design variables of the foot that are not
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
        """Return the limits of the search, shape (d, 2): Table I's ranges, and the foot's box."""
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
        """Return the box of the samples, shape (d, 2): -1 to 1, as far as the limits allow."""
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
