"""Recommendation: candidates in the order in which it pays to walk them again.

The furthest single walk of a search is also the luckiest. A recommendation comes from the mean
of a network that knows every walk, the answers of a confirmation too. First come those whose chance
to hold, times what they gain, is largest. Candidates that were never walked are among them: the
means of a good one and its nearest feasible neighbours. An average avoids what is sensitive.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from drake_gait.gait import FloatArray
from drake_gait.problem import Candidate, quantity
from drake_gait.search.learner import corrected, learnt, promise
from drake_gait.search.proposer import all_walks
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.prediction import BoolArray, IntArray, Network

_NEIGHBOURS = 4
"""Feasible candidates that are averaged with one."""
_AVERAGED = 24
"""Candidates, the most promising, that are averaged with their neighbours."""
_LATEST = 48
"""Samples, the latest, whose feasible ones have a mean."""
_LEARNT = 2000
"""Walks, the latest, that its network learns."""
_PRIOR = np.array([0.0, 1.0, 0.3, 0.3])
_PRIOR_DEVIATION = np.array([1.0, 0.5, 0.5, 0.5])
"""Of the weights of `_features`, before any answer (docs/explanation/robust-search.md)."""
_LEAST = 1e-3
_NEWTON = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Recommended:
    """A candidate that a search recommends."""

    x: FloatArray
    """Its design vector, shape (d,)."""
    candidate: Candidate
    """The gait and the foot."""
    number: int | None
    """The sample that it is; None for a mean, which was never walked."""
    nearest: int
    """The sample that it is or whose neighbourhood it is the mean of."""
    chance: float
    """Probability that a walk holds, on every ground."""
    gain: float
    """What is to be expected of a walk that holds: distance [m], or what the study maximises."""

    promise: float
    """Chance times what the gain is beyond the one that is asked for."""


class Adviser:
    """Recommendations of a finished search, which learn from every answer.

    The network's chance is what it says of a walk that nobody made. A logistic regression says how
    far to believe it, and how much distance and a narrow margin cost beside it. It begins with the
    experience of long searches, and learns from every answer. The same samples and answers
    recommend the same.

    Args:
        settings: The study.
        samples: All samples of its search.
    """

    def __init__(self, settings: StudySettings, samples: Sequence[Sample]) -> None:
        self._settings = settings
        self._field = _field(settings, samples)
        self._x = np.array([one.x for one in self._field])
        self._features = _features(settings, self._field, samples)
        # Each answer once, with its place in the field; a walk that is kept keeps its identity.
        self._heard: dict[int, tuple[StudyWalk, int, bool]] = {}

    def recommended(
        self, answers: Sequence[StudyWalk] = (), *, beyond: float = 0.0
    ) -> list[Recommended]:
        """Return the candidates to walk again, the most promising first.

        Args:
            answers: Walks that were made to confirm some; each tells of the candidate that it is
                nearest to.
            beyond: Gain that is confirmed already; who does not expect more is left out.
        """
        if not self._field:
            return []
        near, held = self._told(answers)
        weights = _logistic_weights(self._features[near], held)
        chance = expit(self._features @ weights)
        found = [
            replace(one, chance=float(value), promise=float(value) * (one.gain - beyond))
            for one, value in zip(self._field, chance, strict=True)
            if one.gain > beyond
        ]
        return sorted(found, key=lambda one: -one.promise)

    def _told(self, answers: Sequence[StudyWalk]) -> tuple[IntArray, BoolArray]:
        """Return the place of each answer in the field, and whether it held, shape (n,) each."""
        for walk in answers:
            if id(walk) not in self._heard:
                x = self._settings.space.encode(walk.candidate)
                near = int(np.argmin(((self._x - x) ** 2).sum(axis=1)))
                held = self._settings.assess(walk.walk).feasible
                self._heard[id(walk)] = walk, near, held
        found = [self._heard[id(walk)][1:] for walk in answers]
        near_ones, held_ones = zip(*found, strict=True) if found else ((), ())
        return np.array(near_ones, dtype=np.int64), np.array(held_ones, dtype=bool)


def recommended(
    settings: StudySettings,
    samples: Sequence[Sample],
    answers: Sequence[StudyWalk] = (),
    *,
    beyond: float = 0.0,
) -> list[Recommended]:
    """Return candidates of a search, and means of some, the most promising first.

    Args:
        settings: The study.
        samples: All samples of its search.
        answers: Walks that were made to confirm some.
        beyond: Gain that is confirmed already.

    Returns:
        Every feasible sample, the mean of each of the best 24 with its four nearest feasible
        neighbours, and that of the latest feasible ones; without enough survivors for a network,
        the feasible samples alone.
    """
    return Adviser(settings, samples).recommended(answers, beyond=beyond)


def _field(settings: StudySettings, samples: Sequence[Sample]) -> list[Recommended]:
    """Return the candidates that may be recommended, with the chance that a network gives them."""
    feasible = sorted((one for one in samples if one.assessment.feasible), key=lambda one: one.rank)
    # Of more than the search's own: what holds may be among the first.
    seed = seed_of(settings.seed, Purpose.RECOMMENDATION)
    network = learnt(settings, all_walks(samples)[-_LEARNT:], seed) if feasible else None
    if network is None:
        return [_as_walked(settings, one) for one in feasible]
    asked = corrected(settings, network, ())
    x = np.array([settings.space.encode(one.candidate) for one in feasible])
    numbers = [one.number for one in feasible]
    chance, gain = promise(settings, asked, x)
    order = np.argsort(-chance * gain, kind="stable")[:_AVERAGED].tolist()
    means, nearest = _means(x, order)
    recent = [n for n, number in enumerate(numbers) if number >= len(samples) - _LATEST]
    if recent:
        means = np.vstack([means, x[recent].mean(axis=0)])
        nearest.append(int(np.argmin(((x - means[-1]) ** 2).sum(axis=1))))
    return [
        *_promised(settings, asked, x, numbers, numbers),
        *_promised(settings, asked, means, [None] * len(means), [numbers[one] for one in nearest]),
    ]


def _features(
    settings: StudySettings, field: Sequence[Recommended], samples: Sequence[Sample]
) -> FloatArray:
    """Return what the chance of candidates follows from, shape (n, 4).

    One, the network's log odds, how much shorter than the others, and how far within the limits.
    """
    if not field:
        return np.empty((0, len(_PRIOR)))
    gain = np.array([one.gain for one in field])
    spread = max(float(gain.std()), 1e-9)
    chance = np.clip([one.chance for one in field], _LEAST, 1.0 - _LEAST)
    by_number = {one.number: one for one in samples}
    margins = [_margin(settings, by_number[one.nearest]) for one in field]
    shorter = (np.median(gain) - gain) / spread
    return np.column_stack([np.ones(len(field)), logit(chance), shorter, margins])


def _margin(settings: StudySettings, one: Sample) -> float:
    """Return how far within its limits a sample walked, from -1 at a limit to 1 in the middle."""
    walk = one.walks[0].walk
    symmetric = [limit for limit in settings.constraints.limits if limit.lower == -limit.upper]
    excess = [float(limit.excess(quantity(walk, limit.quantity))) for limit in symmetric]
    return -2.0 * max(excess, default=-0.5) - 1.0


def _logistic_weights(features: FloatArray, held: BoolArray) -> FloatArray:
    """Return the likeliest weights of features, shape (n, k), of which some held, shape (n,).

    Newton's method on the logistic likelihood with a normal prior, which has one maximum.
    """
    weights, precision = _PRIOR.copy(), 1.0 / _PRIOR_DEVIATION**2
    for _ in range(_NEWTON):
        chance = expit(features @ weights)
        slope = features.T @ (held - chance) - precision * (weights - _PRIOR)
        curvature = (features.T * (chance * (1.0 - chance))) @ features + np.diag(precision)
        step = np.linalg.solve(curvature, slope)
        weights = weights + step * min(1.0, 1.0 / max(float(np.abs(step).max()), 1e-12))
    return weights


def _means(x: FloatArray, places: Sequence[int]) -> tuple[FloatArray, list[int]]:
    """Return the means of some points and their neighbours, shape (m, d), and whose they are."""
    if len(x) <= _NEIGHBOURS:
        return np.empty((0, x.shape[1])), []
    means = []
    for place in places:
        distance = ((x - x[place]) ** 2).sum(axis=1)
        means.append(x[np.argsort(distance, kind="stable")[: _NEIGHBOURS + 1]].mean(axis=0))
    return np.array(means), [int(place) for place in places]


def _promised(
    settings: StudySettings,
    asked: Network,
    x: FloatArray,
    numbers: Sequence[int | None],
    nearest: Sequence[int],
) -> list[Recommended]:
    chance, gain = promise(settings, asked, x)
    return [
        Recommended(
            x=point,
            candidate=settings.space.decode(point),
            number=number,
            nearest=near,
            chance=float(chance[place]),
            gain=float(gain[place]),
            promise=float(chance[place] * gain[place]),
        )
        for place, (point, number, near) in enumerate(zip(x, numbers, nearest, strict=True))
    ]


def _as_walked(settings: StudySettings, one: Sample) -> Recommended:
    """Return a sample as it walked, where nothing can be learnt of it."""
    return Recommended(
        x=settings.space.encode(one.candidate),
        candidate=one.candidate,
        number=one.number,
        nearest=one.number,
        chance=0.5,
        gain=-one.assessment.objective,
        promise=-0.5 * one.assessment.objective,
    )
