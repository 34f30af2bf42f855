"""Beliefs of a search: an ensemble of networks of its walks, and the questions to it.

A network learns the latest 600 walks, so that it never takes longer. It learns only when the walks
have grown by a twentieth; until then the processes of its errors know the new ones. The iteration's
number alone decides which walks a network learns from.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from drake_gait.gait import FloatArray
from drake_gait.problem import quantity
from drake_gait.search.acquisition import Test, chance_to_hold
from drake_gait.search.grounds import Grounded, grounded_inputs, predictions, together
from drake_gait.search.proposer import (
    Proposal,
    all_walks,
    design_of_experiments,
    latin_hypercube,
)
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.records import StudyWalk
from drake_gait.study.search_settings import Risk
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.prediction import FEWEST_SURVIVORS, BoolArray, Network, learnable
from drake_gait.surrogates.settings import NetworkSettings

if TYPE_CHECKING:  # It loads torch, which whoever asks how a walk was simulated need not.
    from drake_gait.surrogates.ensemble import Surrogate

WINDOW = 600
"""Walks, the latest, that a network learns."""
_GROWTH = 20
"""A network is learnt anew when there are more walks than before by one in so many."""
_AT_LEISURE = 300
"""Samples from which on a network may learn while two batches are simulated, not one."""


class Learner:
    """Learns for the iterations of a search, and says what is to be expected of candidates.

    Args:
        settings: The study.
        samples: Candidates of the first iteration.
        batch: Candidates of every other iteration.
        network: Size of the networks, and how long they learn.
        overlap: Candidates of the batch before that a proposal does without.
    """

    def __init__(
        self,
        settings: StudySettings,
        samples: int,
        batch: int,
        network: NetworkSettings | None = None,
        overlap: int = 0,
    ) -> None:
        self._settings, self._samples, self._batch = settings, samples, batch
        self._network, self._overlap = network, overlap
        self._vintages = [0, 1]

    def vintage(self, iteration: int) -> int:
        """Return the iteration whose network an iteration uses, at most its own.

        The network of iteration v knows the samples of all iterations before v.
        """
        while len(self._vintages) <= iteration:
            self._vintages.append(self._next_vintage())
        return self._vintages[iteration]

    def learn(self, iteration: int, known: Sequence[Sample]) -> "Surrogate | None":
        """Return the network of the samples known to an iteration, if enough survived."""
        walks = all_walks(known)[-WINDOW:]
        seed = seed_of(self._settings.seed, Purpose.NETWORK, iteration)
        return learnt(self._settings, walks, seed, self._network)

    def asked(self, network: "Surrogate", iteration: int, known: Sequence[Sample]) -> Network:
        """Return what an iteration asks: its network, corrected by the walks since."""
        learnt_from = self._count(self.vintage(iteration))
        return corrected(self._settings, network, all_walks(known[learnt_from:]))

    def _next_vintage(self) -> int:
        """Return the vintage of the next iteration."""
        iteration, last = len(self._vintages), self._vintages[-1]
        ahead = 1 if self._count(iteration) < _AT_LEISURE else 2
        if self._overlap:  # The batch before is not known in time.
            ahead += 1
        newest = max(last, iteration - ahead)
        since = self._count(newest) - self._count(last)
        return newest if _GROWTH * since > min(self._count(last), WINDOW) else last

    def _count(self, iteration: int) -> int:
        """Return the number of samples that an iteration knows."""
        return 0 if iteration == 0 else self._samples + (iteration - 1) * self._batch


class NetworkProposer:
    """Base of the proposers that ask a network of the latest walks.

    Args:
        settings: The study.
        network: Size of the networks, and how long they learn.
        overlap: Candidates of the batch before that a proposal does without: they are still being
            simulated.
    """

    def __init__(
        self, settings: StudySettings, network: NetworkSettings | None, overlap: int = 0
    ) -> None:
        self._settings, self.overlap = settings, overlap
        self.samples, self.batch = settings.search.samples, settings.search.batch
        self._learner = Learner(settings, self.samples, self.batch, network, overlap)

    def vintage(self, iteration: int) -> int:
        """Return an earlier iteration where networks take longer than walks."""
        return self._learner.vintage(iteration)

    def learn(self, iteration: int, known: Sequence[Sample]) -> "Surrogate | None":
        """Return an ensemble of networks of the latest walks, if enough survived."""
        return self._learner.learn(iteration, known)

    def _unlearnt(self, iteration: int, count: int) -> Proposal:
        """Return the samples of the box that are walked before there is a network."""
        if iteration == 0:
            return Proposal(x=design_of_experiments(self._settings), stage="design")
        x = latin_hypercube(self._settings, self.batch, iteration)
        return Proposal(x=x[:count], stage="design")


def learnt(
    settings: StudySettings,
    walks: Sequence[StudyWalk],
    seed: int,
    network: NetworkSettings | None = None,
) -> "Surrogate | None":
    """Return the network of some walks, or None if too few survived."""
    from drake_gait.surrogates import ensemble

    x, outputs, survived = grounded_data(settings, walks)
    if learnable(outputs, survived).sum() < FEWEST_SURVIVORS:
        return None
    return ensemble.fit(x, outputs, survived, seed=seed, settings=network)


def corrected(settings: StudySettings, network: "Surrogate", since: Sequence[StudyWalk]) -> Network:
    """Return a network with its errors, those on walks since it learnt too, to ask about x."""
    from drake_gait.surrogates.residual_gp import KrigedNetwork

    kriged = KrigedNetwork(network, *grounded_data(settings, since))
    return Grounded(kriged) if settings.two_grounds else kriged


def grounded_data(
    settings: StudySettings, walks: Sequence[StudyWalk]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return inputs (n, d or d + 1), outputs (n, k) and who survived (n,)."""
    outputs = [[quantity(walk.walk, name) for name in settings.outputs] for walk in walks]
    return (
        grounded_inputs(settings, walks),
        np.array(outputs).reshape(len(walks), len(settings.outputs)),
        np.array([walk.walk.survived for walk in walks], dtype=bool),
    )


def promise(settings: StudySettings, network: Network, x: FloatArray) -> tuple[FloatArray, ...]:
    """Return the chance of a candidate's walk to hold, and its mean gain, each of shape (n,)."""
    expected = predictions(network, x)
    names, plan, limits = settings.outputs, settings.search, settings.constraints.limits
    if (test := Test.of(settings)) is None:
        chance = chance_to_hold(expected, names, limits, plan.risk)
    else:
        chance = test.chance_of_a_walk(network, x, names, limits)
    return chance, together(expected).mean[:, names.index(plan.objective.quantity)]


def to_pass(settings: StudySettings, chance: FloatArray) -> FloatArray:
    """Return what a chance of each walk, shape (n,), is worth to a search, by its risk."""
    test = Test.of(settings)
    return chance if test is None else test.chance_to_pass(chance)


def gain_to_beat(
    settings: StudySettings, network: Network, known: Sequence[Sample]
) -> float | None:
    """Return the gain that an improvement is measured from; None without a feasible sample.

    On two grounds it is the mean gain of the candidate with the largest chance times gain, else
    that of the best. A gain that luck has brought to one walk counts by what neighbours say of it.
    With `Risk.TRUST` it is chance times gain itself, what is to be expected of a candidate that may
    yet fail: a safer one betters it as a further one does.

    Of a long search the furthest feasible samples are asked, so that it never takes longer.
    """
    feasible = [one for one in known if one.assessment.feasible]
    if not feasible:
        return None
    if not settings.two_grounds:
        return -min(feasible, key=lambda one: one.rank).assessment.objective
    if len(feasible) > WINDOW:
        feasible = sorted(feasible, key=lambda one: one.rank)[:WINDOW]
    x = np.array([settings.space.encode(one.candidate) for one in feasible])
    chance, gain = promise(settings, network, x)
    worth = np.maximum(to_pass(settings, chance), 1e-12)
    best = int(np.argmax(worth * np.maximum(gain, 1e-9)))
    trusts = settings.search.risk is Risk.TRUST and gain[best] > 0.0
    return float(worth[best] * gain[best] if trusts else gain[best])
