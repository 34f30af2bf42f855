"""Grounds: every walk of a search is on slippery or on sticky ground, and a network learns which.

The ground of a walk is a number: -0.5 at the slippery end, 0.5 at the sticky one, 0 between. An end
differs by the part `confirmation.friction` from `walk.friction`. The ground follows from the walk's
place in the study, so that the study file need not hold it. It is one more input of a network. A
candidate is expected on both ends.

Walks of one batch are on the same ground: what is compared is compared on the same one. (Varying
environments: Milano, Carvalho and Nolfi 2018. Environmental variables: Cakmak and others 2020.)
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drake_gait.gait import FloatArray
from drake_gait.study.finalists import tier_of
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.prediction import Network, Prediction
from drake_gait.walk import WalkSettings

SLIPPERY, BETWEEN, STICKY = -0.5, 0.0, 0.5
ENDS = (SLIPPERY, STICKY)


def end_of_variation(variation: int) -> float:
    """Return the ground of a perturbed walk: odd variations, from 1, are on the slippery one."""
    return SLIPPERY if variation % 2 else STICKY


def end_of_proposal(settings: StudySettings, iteration: int, id_: int) -> float:
    """Return the ground of a candidate's own walk.

    Args:
        settings: Say whether the search has two grounds.
        iteration: The walk's batch; batches alternate.
        id_: The walk's id; in the first batch, which nobody ranks, candidates alternate.
    """
    if not settings.two_grounds:
        return BETWEEN
    if iteration:
        return SLIPPERY if iteration % 2 else STICKY
    plan = settings.search
    return ENDS[id_ // (1 if plan.learns else plan.replicas) % 2]


def end_of(settings: StudySettings, walk: StudyWalk) -> float:
    """Return the ground of any walk of a study."""
    if not walk.is_search_walk:
        tier = tier_of(settings.confirmation, walk.variation)
        if walk.is_mean or (tier and "friction" not in settings.confirmation.changes(tier)):
            return BETWEEN
    if walk.variation > 0:
        return end_of_variation(walk.variation + _before(settings, walk))
    if walk.variation < 0:
        return BETWEEN
    first = walk.id if walk.nominal is None else walk.nominal
    return end_of_proposal(settings, walk.iteration, first)


def on_ground(walk: WalkSettings, settings: StudySettings, end: float) -> WalkSettings:
    """Return how a walk is simulated on a ground."""
    if end == BETWEEN:
        return walk
    return replace(
        walk, friction=(1.0 + 2.0 * end * settings.confirmation.friction) * walk.friction
    )


def grounded_inputs(settings: StudySettings, walks: Sequence[StudyWalk]) -> FloatArray:
    """Return what a network learns walks from: design vectors and grounds, shape (n, d + 1).

    Without grounds in the search, design vectors alone, shape (n, d).
    """
    width = settings.space.dimension
    x = np.array([settings.space.encode(walk.candidate) for walk in walks]).reshape(-1, width)
    if not settings.two_grounds:
        return x
    return np.column_stack([x, [end_of(settings, walk) for walk in walks]])


class Grounded:
    """A network of design vectors and grounds, asked about design vectors.

    Args:
        network: Predicts walks from `grounded_inputs`.
        ends: The grounds that a candidate is expected on.
    """

    def __init__(self, network: Network, ends: Sequence[float] = ENDS) -> None:
        self._network, self._ends = network, ends

    def predictions(self, x: FloatArray) -> tuple[Prediction, ...]:
        """Return a prediction for each ground, of design vectors, shape (n, d)."""
        grounds = np.repeat(self._ends, len(x))
        both = self._network.predict(np.column_stack([np.tile(x, (len(self._ends), 1)), grounds]))
        parts = (slice(n * len(x), (n + 1) * len(x)) for n in range(len(self._ends)))
        return tuple(
            Prediction(
                mean=both.mean[part], deviation=both.deviation[part], survival=both.survival[part]
            )
            for part in parts
        )

    def predict(self, x: FloatArray) -> Prediction:
        """Return one prediction for all grounds together."""
        return together(self.predictions(x))

    def on(self, end: float) -> "Grounded":
        """Return the same network, asked about one ground."""
        return Grounded(self._network, (end,))


def predictions(network: Network, x: FloatArray) -> tuple[Prediction, ...]:
    """Return a prediction for each ground that a network tells apart."""
    return network.predictions(x) if isinstance(network, Grounded) else (network.predict(x),)


def together(parts: Sequence[Prediction]) -> Prediction:
    """Return one prediction for all grounds: means, their deviation, and the lesser survival.

    The deviation is that of a walk on a ground that nobody knows: the grounds' own, and half of
    the difference between them.
    """
    means = np.array([part.mean for part in parts])
    variances = np.array([part.deviation**2 for part in parts])
    return Prediction(
        mean=means.mean(axis=0),
        deviation=np.sqrt(variances.mean(axis=0) + means.var(axis=0)),
        survival=np.min([part.survival for part in parts], axis=0),
    )


def _before(settings: StudySettings, walk: StudyWalk) -> int:
    """Variations that a search has had before those of its confirmation."""
    return settings.search.replicas - 1 if not walk.is_search_walk else 0
