"""ISADE drives, the network screens: differential evolution of which only the best trials walk.

ISADE's population are the most promising of the candidates that were walked. Its three schemes
make many trials of them (Eq. 22, or those of the variant "history"). The network ranks the trials
by the acquisition, on both grounds. The best of a batch, apart from each other, are walked. A walk
counts by what the network makes of it and of its neighbours, so that no lucky one stays for good.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist

from drake_gait.gait import FloatArray
from drake_gait.optimizers.isade import Isade
from drake_gait.search.acquisition import Acquisition, Test
from drake_gait.search.learner import NetworkProposer, gain_to_beat, promise, to_pass
from drake_gait.search.proposer import Proposal
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.ensemble import Surrogate
from drake_gait.surrogates.prediction import Network
from drake_gait.surrogates.settings import NetworkSettings

_POPULATION = 15
"""Individuals: the most promising of the latest 600 candidates."""
_DRAWS = 40
"""Trials of each individual that the network ranks."""
_GENERATIONS = 12
"""Iterations over which the scale of Eq. 24 shrinks."""
_LATEST = 600
_SAME = 1e-9
"""Distance, in units of the box, up to which two candidates are one."""


class NetworkIsade(NetworkProposer):
    """ISADE on simulated walks, of whose many trials a network has the best walked.

    Args:
        settings: The study.
        variant: That of `isade.Isade`.
        network: Size of the networks, and how long they learn.
    """

    def __init__(
        self,
        settings: StudySettings,
        variant: str = "paper",
        *,
        network: NetworkSettings | None = None,
    ) -> None:
        super().__init__(settings, network)
        self._variant = variant
        self.name = f"NetworkIsade({variant!r}, {network or NetworkSettings()})"

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """The design of experiments, then the best of many trials of ISADE."""
        if iteration == 0 or not isinstance(network, Surrogate):
            return self._unlearnt(iteration, count)
        asked = self._learner.asked(network, iteration, known)
        population, costs = self._population(asked, known)
        trials = self._trials(iteration, population, costs)
        x = self._chosen(asked, known, trials, population)
        return Proposal(x=x[:count], stage="infill", network=asked)

    def _population(self, asked: Network, known: Sequence[Sample]) -> tuple[FloatArray, FloatArray]:
        """Return the most promising candidates, shape (n, d), and their costs, shape (n,)."""
        latest = [one for one in known if one.walks[0].walk.survived][-_LATEST:]
        x = np.array([self._settings.space.encode(one.candidate) for one in latest])
        chance, gain = promise(self._settings, asked, x)
        cost = -np.log(np.maximum(to_pass(self._settings, chance), 1e-12)) - np.log(
            np.maximum(gain, 1e-3)
        )
        best = np.argsort(cost, kind="stable")[:_POPULATION]
        return x[best], cost[best]

    def _trials(self, iteration: int, population: FloatArray, costs: FloatArray) -> FloatArray:
        """Return many trials of each individual, shape (draws x n, d)."""
        limits = self._settings.space.limits
        inside = np.clip(population, limits[:, 0], limits[:, 1])
        drawn = []
        for draw in range(_DRAWS):
            optimiser = Isade(
                limits,
                population_size=len(inside),
                seed=seed_of(self._settings.seed, Purpose.SCREENING, iteration, draw),
                max_generations=_GENERATIONS,
                variant=self._variant,
                initial=inside,
            )
            optimiser.ask()
            optimiser.tell(costs)
            if self._variant == "paper":
                optimiser.generation = min(iteration, _GENERATIONS)
            drawn.append(optimiser.ask())
        return np.vstack(drawn)

    def _chosen(
        self,
        asked: Network,
        known: Sequence[Sample],
        trials: FloatArray,
        population: FloatArray,
    ) -> FloatArray:
        """Return the trials of a batch, each time the best of the rest."""
        settings = self._settings
        acquisition = Acquisition(
            asked,
            settings.outputs,
            settings.search.objective.quantity,
            settings.constraints.limits,
            gain_to_beat(settings, asked, known),
            [],
            2.0 * float(population.std(axis=0).mean()),
            settings.search.replicas,
            settings.search.risk,
            Test.of(settings),
        )
        # Relatives share coordinates, so that a trial may be somebody who has walked.
        walked = np.array([settings.space.encode(one.candidate) for one in known])
        is_new = cdist(trials, walked).min(axis=1) > _SAME
        return acquisition.best_apart(trials[is_new], self.batch)
