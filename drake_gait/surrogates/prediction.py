"""Predictions of walks, and the networks that make them, without a library that learns."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drake_gait.gait import FloatArray

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

FEWEST_SURVIVORS = 16
"""Walks that must have survived before a network can be fitted: two for each of its members."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Expectations of a network for n candidates."""

    mean: FloatArray
    """Outputs of a walk that survives, shape (n, k)."""
    deviation: FloatArray
    """Standard deviation of the error to expect, shape (n, k): members' spread and residuals."""
    survival: FloatArray
    """Probability that the robot stays on its feet, shape (n,)."""


class Network(Protocol):
    """A surrogate: it predicts walks."""

    def predict(self, x: FloatArray) -> Prediction:
        """Predictions for design vectors, shape (n, d)."""
        ...


def learnable(outputs: FloatArray, survived: BoolArray) -> BoolArray:
    """Return which walks a network can learn from, shape (n,): they survived, and left numbers.

    A walk that went nowhere has no finite cost of transport.
    """
    found: BoolArray = survived & np.isfinite(outputs).all(axis=1)
    return found
