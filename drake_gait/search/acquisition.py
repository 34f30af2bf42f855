"""Acquisition: ISADE minimises it on the network, to find a better feasible walk.

Where walks are on two grounds, a candidate is worth something only if it holds on both. Near the
edge of a limit the ground decides, not luck.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, ndtr

from drake_gait.gait import FloatArray
from drake_gait.problem import Limit
from drake_gait.search.grounds import predictions, together
from drake_gait.search.seeding import Purpose, generator
from drake_gait.study.ranking import robust_count
from drake_gait.study.search_settings import Risk
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.prediction import Network, Prediction

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
        to_beat: The gain that counts as none: of the best feasible walk so far, or the expected one
            of the candidate that is to be trusted most; None without a feasible walk.
        trials: Design vectors that are under way, shape (d,) each.
        radius: Half width of the trust region in units of the box.
        replicas: Walks of a candidate, of which seven of eight must be feasible.
        risk: What weighs against the gain, where the network tells two grounds apart.
        test: The test that a candidate is to pass, with `Risk.TRUST`.
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
        risk: Risk = Risk.CHANCE,
        test: "Test | None" = None,
    ) -> None:
        self._network, self._risk, self._test = network, risk, test
        self._gain = names.index(gain)
        self._names, self._limits = names, limits
        self._to_beat, self._trials = to_beat, trials
        self._replicas, self._needed = replicas, robust_count(replicas)
        self._reach = _NEIGHBOURHOOD * radius

    def __call__(self, x: FloatArray) -> FloatArray:
        """Costs, shape (n,), of design vectors, shape (n, d)."""
        expected = predictions(self._network, x)
        if self._test is None:
            log_value = _log(self.chance(expected))
        else:
            held = self._test.chance_of_a_walk(self._network, x, self._names, self._limits)
            log_value = _log(self._test.chance_to_pass(held))
        if self._to_beat is not None:
            log_value += _log(self._improvement(expected, self._to_beat))
        cost: FloatArray = self.nearness(x, self._trials) - log_value
        return cost

    def away_from(self, trials: Sequence[FloatArray]) -> "Acquisition":
        """Return the same acquisition with these trials under way."""
        other = copy(self)
        other._trials = tuple(trials)
        return other

    def best_apart(self, x: FloatArray, count: int) -> FloatArray:
        """Return the points of least cost, shape (count, d), each away from those before it."""
        cost, chosen = self(x), list[FloatArray]()
        for _ in range(count):
            chosen.append(x[np.argmin(cost)])
            cost = cost + self.nearness(x, chosen[-1:])
        return np.array(chosen)

    def nearness(self, x: FloatArray, trials: Sequence[FloatArray]) -> FloatArray:
        """Return what it costs points, shape (n, d), to be near to trials, shape (n,)."""
        cost = np.zeros(len(x))
        for trial in trials:
            distance = ((x - trial) ** 2).mean(axis=1) / self._reach**2
            cost -= _log(-np.expm1(-0.5 * distance))
        return cost

    def chance(self, expected: Sequence[Prediction]) -> FloatArray:
        """Probability of a feasible candidate, shape (n,)."""
        chance = chance_to_hold(expected, self._names, self._limits, self._risk)
        return at_least(self._needed, self._replicas, chance)

    def _improvement(self, expected: Sequence[Prediction], to_beat: float) -> FloatArray:
        found = [
            expected_improvement(one.mean[:, self._gain], one.deviation[:, self._gain], to_beat)
            for one in (expected if self._risk is Risk.WORST else [together(expected)])
        ]
        least: FloatArray = np.min(found, axis=0)
        return least


@dataclass(frozen=True, kw_only=True, eq=False)
class Test:
    """The confirmation's first test of a candidate: walks with noise on every angle."""

    __test__ = False  # Of pytest's.

    walks: int
    """Walks of a candidate."""
    feasible: int
    """How many of them must be feasible."""
    noise: FloatArray
    """Noise of the walks for which a chance is averaged, in box units, shape (m, d)."""

    @classmethod
    def of(cls, settings: StudySettings) -> "Test | None":
        """Return the test of a study whose search weighs trust; None for others."""
        if settings.search.risk is not Risk.TRUST:
            return None
        plan, space = settings.confirmation, settings.space
        drawn = generator(settings.seed, Purpose.EXPECTED_NOISE).standard_normal(
            (_NOISES, space.dimension)
        )
        # In pairs, so that the mean of the noise is none.
        noise = np.concatenate([drawn, -drawn]) * space.noise(plan.noise)
        return cls(walks=plan.replicas, feasible=plan.feasible, noise=noise)

    def chance_of_a_walk(
        self, network: Network, x: FloatArray, names: Sequence[str], limits: Sequence[Limit]
    ) -> FloatArray:
        """Return the chance of a walk with noise to be feasible, shape (n,), at x, shape (n, d)."""
        moved = (x[None] + self.noise[:, None]).reshape(-1, x.shape[1])
        chance = chance_to_hold(predictions(network, moved), names, limits, Risk.TRUST)
        mean: FloatArray = chance.reshape(len(self.noise), -1).mean(axis=0)
        return mean

    def chance_to_pass(self, chance: FloatArray) -> FloatArray:
        """Return the chance to pass, shape (n,), of candidates whose walks have each a chance."""
        return at_least(self.feasible, self.walks, chance)


def at_least(needed: int, walks: int, chance: FloatArray) -> FloatArray:
    """Return the chance that so many of all walks hold, where each has a chance for itself."""
    found: FloatArray = betainc(needed, walks - needed + 1, chance)
    return found


_NOISES = 3
"""Pairs of noise: as many again cost twice the time and change chances by hundredths."""


def chance_to_hold(
    expected: Sequence[Prediction],
    names: Sequence[str],
    limits: Sequence[Limit],
    risk: Risk = Risk.CHANCE,
) -> FloatArray:
    """Return the probability that all limits hold and the robot stays on its feet, shape (n,).

    On one ground each limit has the normal distribution of its quantity. On two, the error of a
    prediction is the same at both ends, because most of it is the candidate's own. Both ends hold
    if the interval between them, moved by one error, is within the limit. Of deviations and chances
    to survive the worse counts.

    Args:
        expected: A prediction for each ground.
        names: The quantities that are predicted, in order.
        limits: Their limits.
        risk: With "mean", the mean of the chances that the grounds have for themselves.
    """
    if risk is Risk.MEAN and len(expected) > 1:
        alone = [chance_to_hold([one], names, limits) for one in expected]
        mean: FloatArray = np.mean(alone, axis=0)
        return mean
    chance: FloatArray = np.min([one.survival for one in expected], axis=0)
    for limit in limits:
        column = names.index(limit.quantity)
        means = np.array([one.mean[:, column] for one in expected])
        deviation = np.max([one.deviation[:, column] for one in expected], axis=0)
        below = ndtr((limit.lower - means.min(axis=0)) / deviation)
        above = ndtr((limit.upper - means.max(axis=0)) / deviation)
        chance = chance * np.maximum(above - below, 0.0)
    return chance


def expected_improvement(mean: FloatArray, deviation: FloatArray, to_beat: float) -> FloatArray:
    """Mean of max(y - to_beat, 0) where y is normal, shape (n,)."""
    z = (mean - to_beat) / deviation
    gain: FloatArray = deviation * (z * ndtr(z) + np.exp(-(z**2) / 2.0) / np.sqrt(2.0 * np.pi))
    return gain


def _log(value: FloatArray) -> FloatArray:
    logarithm: FloatArray = np.log(np.maximum(value, 1e-300))
    return logarithm
