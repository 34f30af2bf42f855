"""Sensitivity of the distance to the design variables, by the network, in the box of a study.

These are Sobol's indices (Sobol 2001), by the estimators of Saltelli and others (2010) in scipy.
The inputs are independent and uniform in the box, as the samples of the design of experiments are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import sobol_indices, uniform

from drake_gait.gait import FloatArray
from drake_gait.problem import DesignSpace

_POINTS = 512  # a power of two; the network is asked at (d + 2) times as many


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """Shares of d design variables in the variance of an output."""

    names: Sequence[str]
    """The design variables."""
    total: FloatArray
    """Share of the output's variance that a variable has a part in, shape (d,): Sobol's total."""
    alone: FloatArray
    """Share that it explains by itself, shape (d,): Sobol's first order."""
    slope: FloatArray
    """Change of the output over half the box, of the plane nearest to it, shape (d,)."""


def sensitivity(
    predict: Callable[[FloatArray], FloatArray], space: DesignSpace, *, seed: int = 0
) -> Sensitivity:
    """Sensitivity of a function of design vectors, in the box that samples are drawn from.

    Args:
        predict: Outputs, shape (n,), at design vectors, shape (n, d).
        space: Where the design vectors lie.
        seed: Fixes the points.
    """
    lower, upper = space.box.T
    found = sobol_indices(
        func=lambda x: predict(np.ascontiguousarray(x.T)),
        n=_POINTS,
        dists=[uniform(loc=low, scale=high - low) for low, high in zip(lower, upper, strict=True)],
        rng=np.random.default_rng(seed),
    )
    x = lower + (upper - lower) * np.random.default_rng([seed, 1]).random((8 * _POINTS, len(lower)))
    plane = np.column_stack([np.ones(len(x)), x])
    slope = np.linalg.lstsq(plane, predict(x))[0][1:]
    return Sensitivity(
        names=space.names, total=found.total_order, alone=found.first_order, slope=slope
    )
