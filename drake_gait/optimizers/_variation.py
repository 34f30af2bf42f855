"""Variation: how ISADE makes trials of its individuals, as pure functions.

The paper's equations (section IV.B, Eqs. 22-28) come first, then what the variant "history" has in
the place of Eqs. 23-28. Random numbers are arguments.
docs/experiments/2026-11-22-isade-choices.md has the choice of every
constant.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LEAST_SIZE = 5  # four different others for each individual

RANK_STEEPNESS = 10.0  # alpha
SCALE_RANGE = (0.15, 1.55)  # F_min, F_max
EXPONENT_RANGE = (0.2, 5.0)  # n_min, n_max
SCHEMES = np.array(
    [  # of best, r1, r2, r3, r4: origin + F (second - third) + F (fourth - fifth)
        (0, 1, 2, 3, 3),  # Eq. 22a, best/1
        (0, 1, 2, 3, 4),  # Eq. 22b, best/2
        (1, 0, 1, 3, 2),  # Eq. 22c, rand-to-best/1; r2 is always subtracted, for "history"
    ]
).T
CROSSOVER_RATES = (0.05, 0.5, 0.95)  # Cr_min, Cr_medium, Cr_max
REDRAW_PROBABILITY = 0.1  # tau
NEXT_SEATS = np.arange(1, 5)[:, None]
DECIMALS = 9  # of F: exp and power differ in their last bit from machine to machine

MEMORY_SIZE = 6  # "history" only, from here on
ELITE = 0.11  # part of the population that takes the place of the best
SPREAD = 0.1  # of F and Cr about what the memory holds
DRAWN_RANGE = (0.02, 1.0)  # of F and Cr
TURNED_RANGE = (0.1, 0.9)  # part of the trials crossed along the population's principal axes


# --- the paper's equations -----------------------------------------------------------------------


@cache
def rank_scale(size: int) -> Array:
    """Scale F of the individuals ranked 1 (best) to `size`, shape (size,): the best moves most."""
    rank = np.arange(1, size + 1)
    scale = 1.0 / (1.0 + np.exp(RANK_STEEPNESS * (rank - size / 2.0) / size))  # Eq. 23
    scale = np.round(scale, DECIMALS)
    scale.setflags(write=False)  # it is shared
    return scale


def mean_scale(generation: int, max_generations: int) -> float:
    """Scale F shared by a generation: F_max at first, F_min from `max_generations` on."""
    progress = min(generation / max_generations, 1.0)
    low, high = EXPONENT_RANGE
    exponent = low + (high - low) * progress  # Eq. 25
    low, high = SCALE_RANGE
    scale: float = low + (high - low) * (1.0 - progress) ** exponent  # Eq. 24
    return round(scale, DECIMALS)


def scales(order: Indices, generation: int, max_generations: int) -> Array:
    """Scale F of every individual, shape (n,).

    Args:
        order: Indices of the individuals from best to worst, shape (n,).
        generation: Generations told so far.
        max_generations: Generation at which the shared part has come down to F_min.
    """
    scale = np.empty(len(order))
    shared = mean_scale(generation, max_generations)
    scale[order] = (rank_scale(len(order)) + shared) / 2.0  # Eq. 26
    return scale


def next_rates(rates: Array, redraw: Array, draw: Array) -> Array:
    """Next crossover rates from two uniform draws each, shape (n,): a few become low or high."""
    low, medium, high = CROSSOVER_RATES
    drawn = np.where(draw < medium, low, high)  # Eq. 28
    return np.where(redraw < REDRAW_PROBABILITY, drawn, rates)  # Eq. 27


def neighbours(draw: Array) -> Indices:
    """For each of n individuals four different others, any four alike, shape (4, n).

    Args:
        draw: A uniform draw for each, shape (n,): their order around a ring.
    """
    seated = draw.argsort()
    seat = seated.argsort()
    others: Indices = seated.take(seat + NEXT_SEATS, mode="wrap")
    return others


def donors(
    x: Array, best: Indices | np.intp, others: Indices, scheme: Indices, scale: Array
) -> Array:
    """Donor of every individual, shape (n, d).

    Args:
        x: Points, shape (k, d).
        best: Index of the best point, or one such index for each individual, shape (n,).
        others: Indices of four other points for each individual, shape (4, n).
        scheme: Which of the three `SCHEMES` for each individual, shape (n,).
        scale: F of each individual, shape (n,).
    """
    n = len(scale)
    cast = np.empty((5, n), np.intp)
    cast[0], cast[1:] = best, others
    chosen = cast[SCHEMES.take(scheme, axis=1), np.arange(n)]
    origin, plus_1, minus_1, plus_2, minus_2 = x.take(chosen, axis=0)
    step = plus_1 - minus_1
    step += plus_2 - minus_2
    step *= scale[:, None]
    donor: Array = origin + step  # Eq. 22
    return donor


# --- the variant "history" -----------------------------------------------------------------------


def drawn_elite(order: Indices, rng: np.random.Generator) -> Indices:
    """For each individual one of the best 11 percent, shape (n,); `order` as for `scales`."""
    elite = max(round(ELITE * len(order)), 2)
    return order[rng.integers(elite, size=len(order))]


def drawn_scales_and_rates(
    memory: Array, n: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """F, Cr and the probability of being turned for n trials, each of shape (n,).

    Args:
        memory: F, Cr and part turned of generations past, shape (3, MEMORY_SIZE).
        n: Number of trials.
        rng: Chooses a column of the memory for each trial, and scatters F and Cr about it.
    """
    scale, rate, turned = memory[:, rng.integers(MEMORY_SIZE, size=n)]
    scale = np.abs(scale + SPREAD * rng.standard_cauchy(n)).clip(*DRAWN_RANGE)
    rate = (rate + SPREAD * rng.standard_normal(n)).clip(*DRAWN_RANGE)
    return scale, rate, turned


def remembered(
    scale: Array, rates: Array, turned: NDArray[np.bool_], better: NDArray[np.bool_]
) -> Array:
    """Column of the memory, shape (3,), that a generation leaves.

    Args:
        scale: F of its trials, shape (n,).
        rates: Their Cr, shape (n,).
        turned: Whether they were crossed along principal axes, shape (n,).
        better: Whether they beat their parents, as at least one did, shape (n,).
    """
    good = np.stack((scale, rates))[:, better]
    # The contraharmonic mean leans to large values, lest F shrink too early.
    means = (good**2).sum(1) / good.sum(1)
    return np.array((*means, turned[better].mean().clip(*TURNED_RANGE)))


def principal_axes(x: Array) -> Array:
    """Directions in which points, shape (n, d), spread independently, as columns, shape (d, d)."""
    centred = x - x.mean(0)
    axes: Array = np.linalg.eigh(centred.T @ centred).eigenvectors
    return axes


def crossed_along(
    axes: Array, parents: Array, donor: Array, crossed: NDArray[np.bool_], width: Array
) -> Array:
    """Parents and donors crossed in turned coordinates, shape (n, d).

    Args:
        axes: Directions as columns, in units of the width, shape (d, d).
        parents: Points, shape (n, d).
        donor: Their donors, shape (n, d).
        crossed: Along which axes the donor gives its value, shape (n, d).
        width: Upper less lower bound, shape (d,).
    """
    step = (donor - parents) / width @ axes * crossed
    trials: Array = parents + step @ axes.T * width
    return trials


def shrunken_size(size: int, generation: int, max_generations: int) -> int:
    """Size of a population that falls linearly from `size` to 5 at `max_generations`."""
    left = max(max_generations - generation, 0)
    return LEAST_SIZE + (size - LEAST_SIZE) * left // max_generations
