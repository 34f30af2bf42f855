"""Analysis of variance of two factors and their interaction between blocks.

Cells may have any number of replicas. Sums of squares are of type II (Langsrud 2003): what a
factor explains beyond all that does not contain it. In equally full cells they are the textbook's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One line of the table of an analysis of variance."""

    name: str
    """The factor, "interaction", or "residual"."""
    degrees: int
    """Degrees of freedom."""
    squares: float
    """Sum of squares, in the response's unit squared."""
    share: float
    """The sum of squares as a part of all those in the table."""
    ratio: float | None
    """Mean square over the residual's: F; None for the residual."""
    p_value: float | None
    """Probability of such an F or a larger one if the factor did nothing."""


def two_way(
    response: ArrayLike,
    first: ArrayLike,
    second: ArrayLike,
    blocks: ArrayLike,
    names: Sequence[str] = ("first", "second"),
) -> tuple[Effect, ...]:
    """Effects of two factors on a response, between blocks that may differ.

    Args:
        response: Shape (n,).
        first: Level of the first factor, a whole number, shape (n,).
        second: Level of the second factor, shape (n,).
        blocks: Whose response it is, shape (n,); all alike if there are no blocks.
        names: What the two factors are called.

    Returns:
        Both factors, their interaction, the residual.

    Raises:
        SettingsError: there are no more responses than the model has parameters, or no two of them
            differ within the cells.
    """
    y = np.asarray(response, dtype=float)
    one, two, block = (_indicators(np.asarray(levels)) for levels in (first, second, blocks))
    pair = np.asarray(first) * (int(np.max(second, initial=0)) + 1) + np.asarray(second)
    both = _indicators(pair)
    full, rank = _residual(y, block, both)
    degrees = len(y) - rank
    additive, additive_rank = _residual(y, block, one, two)
    without_first, second_rank = _residual(y, block, two)
    without_second, first_rank = _residual(y, block, one)
    # What rounding leaves is no scatter.
    if degrees < 1 or not full > 1e-12 * float(y @ y):
        raise SettingsError(
            f"an analysis of variance needs more than its {rank} parameters in responses that "
            f"scatter, got {len(y)}"
        )
    parts = (
        (names[0], without_first - additive, additive_rank - second_rank),
        (names[1], without_second - additive, additive_rank - first_rank),
        ("interaction", additive - full, rank - additive_rank),
    )
    total = full + sum(squares for _, squares, _ in parts)
    found = []
    for name, squares, freedom in parts:
        ratio = squares / freedom / (full / degrees) if freedom else None
        found.append(
            Effect(
                name=name,
                degrees=freedom,
                squares=squares,
                share=squares / total,
                ratio=ratio,
                p_value=None if ratio is None else float(stats.f.sf(ratio, freedom, degrees)),
            )
        )
    residual = Effect(
        name="residual", degrees=degrees, squares=full, share=full / total, ratio=None, p_value=None
    )
    return (*found, residual)


def _indicators(levels: FloatArray) -> FloatArray:
    """One column for each level that occurs, shape (n, levels)."""
    columns: FloatArray = (levels[:, None] == np.unique(levels)).astype(float)
    return columns


def _residual(y: FloatArray, *columns: FloatArray) -> tuple[float, int]:
    """Sum of squares that a linear model leaves, and its number of free parameters."""
    matrix = np.hstack(columns)
    solution, _, rank, _ = np.linalg.lstsq(matrix, y)
    return float(((y - matrix @ solution) ** 2).sum()), int(rank)
