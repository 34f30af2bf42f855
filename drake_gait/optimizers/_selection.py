"""Selection: how far points exceed their constraints, and which point is the better, purely.

A point has a cost and an excess, which is the sum of its violations, each in the unit of its
constraint. The excess is compared first and the cost second: the rules of feasibility. With an
epsilon, a smaller excess counts as none. A penalty turns excess into cost.
docs/experiments/2026-11-22-isade-choices.md has the choice of every constant.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drake_gait.arrays import numbers
from drake_gait.errors import SettingsError

Array = NDArray[np.float64]

EPSILON_QUANTILE = 0.2  # of the first excesses: the epsilon at the start
EPSILON_UNTIL = 0.3  # of the generations: the epsilon is zero from here on
EPSILON_POWER = 5.0


def violations_of(constraints: ArrayLike | None, n: int, m: int | None) -> Array:
    """Violations, shape (n, m), 0 where satisfied and infinite where they are not a number.

    Args:
        constraints: Values that are satisfied at or below 0, shape (n, m) or (n,); None for m = 0.
        n: Number of points.
        m: Number of constraints; None if any will do.

    Raises:
        SettingsError: The shape is another.
    """
    raw = np.empty((n, 0)) if constraints is None else numbers("violations", constraints)
    violations = np.where(np.isnan(raw), np.inf, np.maximum(raw, 0.0))
    if violations.ndim == 1:
        violations = violations[:, None]
    if violations.ndim != 2 or len(violations) != n or m not in (None, violations.shape[1]):
        wanted = f"({n}, {'m' if m is None else m})"
        raise SettingsError(f"violations must be {wanted} in shape, got {violations.shape}")
    return violations


def constraint_units(violations: Array) -> Array:
    """Largest finite violation of each constraint, shape (m,), or 1 where there is none."""
    largest = np.where(np.isfinite(violations), violations, 0.0).max(0)
    return np.where(largest == 0.0, 1.0, largest)


def first_epsilon(violations: Array, excess: Array) -> float:
    """Epsilon at the start of a run, from its first points; 0 if some point meets each constraint.

    Args:
        violations: Shape (n, m).
        excess: Their sums in the units of the constraints, shape (n,).
    """
    # An equality shows itself as a constraint that no random point meets.
    if not (violations > 0.0).all(0).any():
        return 0.0
    level = float(np.sort(excess)[int(EPSILON_QUANTILE * len(excess))])
    return level if level < np.inf else 0.0


def epsilon(first: float, generation: int, max_generations: int) -> float:
    """Excess that counts as none in a generation: `first` at the start, soon 0."""
    left = 1.0 - generation / (EPSILON_UNTIL * max_generations)
    return first * left**EPSILON_POWER if left > 0.0 else 0.0


def beats(excess: Array, cost: Array, other_excess: Array, other_cost: Array) -> NDArray[np.bool_]:
    """Return whether each point is better than its other, not merely as good, shape (n,)."""
    better: NDArray[np.bool_] = (excess < other_excess) | (
        (excess == other_excess) & (cost < other_cost)
    )
    return better
