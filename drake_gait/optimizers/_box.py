"""The box: bounds of an optimiser's variables, and which of them are whole numbers."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drake_gait.arrays import numbers
from drake_gait.errors import SettingsError
from drake_gait.optimizers._scipy_forms import Pairs, pairs

Array = NDArray[np.float64]


class Box:
    """Bounds of the variables, and which of them are whole numbers.

    Whole numbers are searched among real ones: k owns [k - 1/2, k + 1/2], so that differences below
    one keep their meaning.

    Args:
        bounds: Lower and upper bound of every variable, shape (d, 2), as an array, an iterable of
            pairs or scipy's `Bounds`.
        integrality: Which variables are whole numbers, shape (d,), or one truth for all; none if
            not given.

    Attributes:
        bounds: Shape (d, 2).
        integrality: Shape (d,).
        lower: Least value of every variable before rounding, shape (d,).
        upper: Largest value of every variable before rounding, shape (d,).

    Raises:
        SettingsError: A bound is infinite or missing, or no number lies between two.
    """

    def __init__(self, bounds: Pairs, integrality: ArrayLike | None = None) -> None:
        self.bounds = _checked_bounds(bounds)
        self.integrality = _checked_integrality(integrality, self.bounds)
        self._mixed = bool(self.integrality.any())
        lower, upper = self.bounds.T
        self.lower: Array = np.where(self.integrality, np.ceil(lower) - 0.5, lower)
        self.upper: Array = np.where(self.integrality, np.floor(upper) + 0.5, upper)

    def random(self, n: int, rng: np.random.Generator) -> Array:
        """Uniform random points before rounding, shape (n, d)."""
        # As rng.uniform, whose product and sum some processors round once, and others twice.
        points: Array = self.lower + (self.upper - self.lower) * rng.random((n, len(self.lower)))
        return points

    def decode(self, x: Array) -> Array:
        """A copy of points, shape (n, d) or (d,), with the whole numbers rounded."""
        if not self._mixed:
            return x.copy()
        whole = np.clip(np.rint(x), self.lower + 0.5, self.upper - 0.5)
        return np.where(self.integrality, whole, x)

    def half_way_back(self, trials: Array, parents: Array) -> Array:
        """Trials, shape (n, d), with what left the box half-way between its parent and the bound.

        Args:
            trials: Points that may have left the box, shape (n, d); changed in place.
            parents: Points of the box that they come from, shape (n, d).
        """
        nearest = np.minimum(np.maximum(trials, self.lower), self.upper)
        np.copyto(trials, (nearest + parents) / 2.0, where=trials != nearest)
        return trials

    def checked(self, initial: ArrayLike, most: int) -> Array:
        """Points to start from, shape (k, d).

        Raises:
            SettingsError: The shape is another, k is above `most`, or a point is outside.
        """
        points = numbers("initial", initial)
        d = len(self.bounds)
        if points.ndim != 2 or points.shape[1] != d or len(points) > most:
            raise SettingsError(
                f"initial must be (k, {d}) in shape with k <= {most}, got {points.shape}"
            )
        if not ((self.lower <= points) & (points <= self.upper)).all():
            raise SettingsError("initial has a point outside the bounds; clip it first")
        return points


def _checked_bounds(bounds: Pairs) -> Array:
    box = pairs(bounds)
    if box.ndim != 2 or box.shape[1] != 2 or len(box) == 0:
        raise SettingsError(f"bounds must be (d, 2) in shape with d > 0, got {box.shape}")
    for i, (lower, upper) in enumerate(box.tolist()):
        if not 0.0 < upper - lower < np.inf:
            raise SettingsError(f"bounds of variable {i} must be finite, lower < upper: {box[i]}")
    return box


def _checked_integrality(integrality: ArrayLike | None, bounds: Array) -> NDArray[np.bool_]:
    whole = np.zeros(len(bounds), np.bool_)
    if integrality is not None:
        whole = np.array(integrality, dtype=np.bool_)
        whole = np.full(len(bounds), whole) if whole.ndim == 0 else whole
    if whole.shape != (len(bounds),):
        raise SettingsError(f"integrality must be ({len(bounds)},) in shape, got {whole.shape}")
    for i in np.flatnonzero(whole & (np.ceil(bounds[:, 0]) > np.floor(bounds[:, 1]))):
        raise SettingsError(f"bounds of variable {i} hold no whole number: {bounds[i]}")
    return whole
