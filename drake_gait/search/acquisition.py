"""What ISADE minimises on the network: where a better feasible walk is to be expected."""

from collections.abc import Sequence

import numpy as np
from scipy.special import betainc, ndtr
from scipy.stats import norm

from drake_gait.gait import FloatArray
from drake_gait.problem.problem import Limit
from drake_gait.study.ranking import robust_count
from drake_gait.surrogates.ensemble import Network, Prediction

_NEIGHBOURHOOD = 0.25
"""Trials of one batch closer than about this part of the trust region count as the same."""


class Acquisition:
    """The improvement to expect times the chance that the walk is feasible, a cost for ISADE.

    Constrained expected improvement (Schonlau, Welch, Jones 1998), as a negative logarithm. Without
    a feasible walk yet, the chance alone. Around trials that are under way it falls off.

    Args:
        network: Predicts walks.
        names: The quantities that it predicts, in order.
        gain: The one that is to grow.
        limits: What makes a walk feasible.
        to_beat: The gain of the best feasible walk so far, if there is one.
        trials: Design vectors that are under way, shape (d,) each.
        radius: Half width of the trust region in units of the box.
        replicas: Walks of a candidate, of which seven of eight must be feasible.
    """

    def __init__(
        self,
        network: Network,
        names: Sequence[str],
        gain: str,
        limits: Sequence[Limit],
        to_beat: float | None,
        trials: Sequence[FloatArray],
        radius: float,
        replicas: int = 1,
    ) -> None:
        self._network = network
        self._gain = names.index(gain)
        self._limits = [(names.index(limit.quantity), limit) for limit in limits]
        self._to_beat = to_beat
        self._trials = trials
        self._replicas, self._needed = replicas, robust_count(replicas)
        self._reach = _NEIGHBOURHOOD * radius

    def __call__(self, x: FloatArray) -> FloatArray:
        """Costs, shape (n,), of design vectors, shape (n, d)."""
        expected = self._network.predict(x)
        log_value = _log(self.chance(expected))
        if self._to_beat is not None:
            mean, deviation = expected.mean[:, self._gain], expected.deviation[:, self._gain]
            log_value += _log(expected_improvement(mean, deviation, self._to_beat))
        for trial in self._trials:
            distance = ((x - trial) ** 2).mean(axis=1) / self._reach**2
            log_value += _log(-np.expm1(-0.5 * distance))
        cost: FloatArray = -log_value
        return cost

    def chance(self, expected: Prediction) -> FloatArray:
        """Probability of a feasible candidate, shape (n,)."""
        chance = expected.survival.copy()
        for column, limit in self._limits:
            mean, deviation = expected.mean[:, column], expected.deviation[:, column]
            below = ndtr((limit.lower - mean) / deviation)
            chance *= ndtr((limit.upper - mean) / deviation) - below
        # Of at least so many of its walks, where each has this chance for itself.
        together: FloatArray = betainc(self._needed, self._replicas - self._needed + 1, chance)
        return together


def expected_improvement(mean: FloatArray, deviation: FloatArray, to_beat: float) -> FloatArray:
    """Mean of max(y - to_beat, 0) where y is normal, shape (n,)."""
    z = (mean - to_beat) / deviation
    gain: FloatArray = deviation * (z * ndtr(z) + norm.pdf(z))
    return gain


def _log(value: FloatArray) -> FloatArray:
    logarithm: FloatArray = np.log(np.maximum(value, 1e-300))
    return logarithm
