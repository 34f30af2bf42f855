"""Addresses of random numbers, so that no number depends on the order of walks."""

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """Purpose of random numbers; a number given once is never given again."""

    DESIGN = 1
    """Samples in the box."""
    PROPOSAL = 2
    """Optimisers that propose candidates."""
    NETWORK = 3
    """Initial weights and folds of a network."""
    NOISE = 4
    """Noise on the coefficients of a walk that is walked again."""
    RECOMMENDATION = 5
    """Initial weights and folds of the network that recommends what is confirmed."""
    SCREENING = 6
    """Trials of ISADE of which a network walks the best."""
    SERVO = 7
    """Servos and masses of a walk that the winner is walked again with."""
    OWN_CHANGE = 13
    """A user's own changes of a walk that confirms another one."""
    GRID_NOISE = 11
    """Noise on the coefficients of the walks of a grid of feet."""
    EXPECTED_NOISE = 14
    """Noise on the coefficients for which a chance to hold is averaged."""
    TRUST = 12
    """Noise on the coefficients of the walks that a comparison of searches trusts."""


def generator(seed: int, purpose: Purpose, *index: int) -> np.random.Generator:
    """Return the generator at an address.

    Args:
        seed: The study's seed, >= 0.
        purpose: What the numbers are for.
        index: Which of them: iteration, walk, variation and so on, each >= 0.
    """
    return np.random.default_rng([seed, purpose, *index])


def seed_of(seed: int, purpose: Purpose, *index: int) -> int:
    """Return one 32-bit seed at an address, for a library that takes no address."""
    return int(np.random.SeedSequence([seed, purpose, *index]).generate_state(1)[0])
