"""A robust problem whose answer is known: walks with a bias, a ground and noise, computed."""

import dataclasses

import numpy as np
from conftest import walk_at

from drake_gait.execution.base import Finished
from drake_gait.problem import Constraints

LIMIT = Constraints().lateral
BIAS, SWAY, NOISE = 0.5, 0.6, 0.03
"""Drift at the box's middle, and on a ground for each unit of x0, and noise, in limits."""
FURTHEST = (1.0 - 3 * NOISE) / SWAY
"""The x0 whose drift stays within the limit on both grounds, noise and all."""


def forward_of(x):
    """Return the distance [m]: it grows with x0, and falls off beside the middle of all others."""
    return 0.2 + 0.05 * x[0] - 0.004 * (x[2:8] ** 2).sum() - 0.002 * max(x[0] - 3.0, 0.0) ** 2


ROBUST_BEST = forward_of(np.array([FURTHEST, -BIAS, *np.zeros(14)]))
"""The largest distance that holds on both grounds [m]."""


def walk_on(x, ground, noise):
    """Return a walk: x1 steers against the bias, x0 is paid for by a drift that the ground decides.

    Args:
        x: Design vector, shape (16,).
        ground: From -1, slippery, to 1, sticky.
        noise: A standard normal number.
    """
    drift = BIAS + x[1] + SWAY * x[0] * ground + NOISE * noise
    level = dataclasses.replace(walk_at(np.zeros(16)), com_height=0.2445, yaw=0.0)
    return dataclasses.replace(level, forward=float(forward_of(x)), lateral=float(LIMIT * drift))


class Grounds:
    """Computes walks on the ground of their trials; noise follows from the design vector."""

    def __init__(self, settings):
        self.settings, self.frictions = settings, []

    def walk(self, trial):
        x = self.settings.space.encode(trial.candidate)
        change = self.settings.confirmation.friction
        ground = (trial.settings.friction - 1.0) / change
        self.frictions.append(trial.settings.friction)
        seed = [abs(int(1e9 * value)) for value in (*x, ground)]
        return walk_on(x, ground, np.random.default_rng(seed).standard_normal())

    def __call__(self, trials):
        for index, trial in enumerate(trials):
            yield Finished(index=index, walk=self.walk(trial), seconds=0.0)


def trusted(settings, candidate, walks=8):
    """Return the median distance of a candidate's perturbed walks, 0 if two of them fail [m]."""
    from drake_gait.problem import Trial
    from drake_gait.search.runner import perturbed

    nominal = Trial(candidate=candidate, settings=settings.walk)
    ground = Grounds(settings)
    found = [
        ground.walk(perturbed(nominal, settings, 987654, number)) for number in range(1, walks + 1)
    ]
    held = sum(settings.assess(walk).feasible for walk in found)
    return float(np.median([walk.forward for walk in found])) if held >= walks - 1 else 0.0
