"""The paper's procedure to the letter: one network, and ISADE on its outputs (section IV.C)."""

from collections.abc import Sequence

import numpy as np

from drake_gait.gait import FloatArray
from drake_gait.optimizers import isade
from drake_gait.problem import PENALTY
from drake_gait.search.proposer import (
    IsadeSettings,
    Proposal,
    all_walks,
    design_of_experiments,
    training_data,
)
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.prediction import Network
from drake_gait.surrogates.settings import PAPER_NETWORK, NetworkSettings


class PaperProcedure:
    """The paper's section IV.C to the letter, for comparison.

    One network of all samples, falls and all; its optimum under the penalty function is simulated
    and added.

    Args:
        settings: The study's: its box, limits, objective, seed and samples.
        isade: When ISADE stops on the network.
        network: Size of the network, and how long it learns.
    """

    batch = 1

    def __init__(
        self,
        settings: StudySettings,
        *,
        isade: IsadeSettings | None = None,
        network: NetworkSettings = PAPER_NETWORK,
    ) -> None:
        self._settings = settings
        self._isade, self._network = isade or IsadeSettings(), network
        self.name = f"PaperProcedure({self._isade}, {self._network})"
        self.samples = settings.search.samples
        self._names = (*settings.outputs, "frames")
        self._frames = settings.space.middle.gait.frames

    def vintage(self, iteration: int) -> int:
        """Its own: each network knows all walks."""
        return iteration

    def learn(self, iteration: int, known: Sequence[Sample]) -> Network | None:
        """One network of all walks."""
        if iteration == 0:
            return None
        settings, walks = self._settings, all_walks(known)
        x, outputs, _ = training_data(walks, settings.space, settings.outputs)
        missing = [walk.walk.planned - walk.walk.frames for walk in walks]
        frames = [[float(self._frames - one)] for one in missing]
        targets = np.nan_to_num(np.column_stack([outputs, frames]))
        return surrogate.fit_single(
            x,
            targets,
            seed=seed_of(settings.seed, Purpose.NETWORK, iteration),
            settings=self._network,
        )

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """The design of experiments, then the optimum of the network."""
        settings = self._settings
        if network is None:
            return Proposal(x=design_of_experiments(settings), stage="design")

        def fitness(points: FloatArray) -> FloatArray:
            """F(x) of what the network expects [mm], Eqs. 16-17."""
            return self._fitness(network.predict(points).mean)

        found = isade.minimize(
            fitness,
            settings.space.box,
            vectorized=True,
            seed=seed_of(settings.seed, Purpose.PROPOSAL, iteration),
            max_evaluations=10**9,
            max_iterations=self._isade.iterations,
            stagnation=self._isade.stagnation,
        )
        return Proposal(x=found.x[None, :], stage="infill", network=network)

    def _fitness(self, expected: FloatArray) -> FloatArray:
        column = self._names.index
        violation = np.maximum((self._frames - expected[:, column("frames")]) / self._frames, 0.0)
        for limit in self._settings.constraints.limits:
            violation += np.maximum(limit.excess(expected[:, column(limit.quantity)]), 0.0)
        gain = expected[:, column(self._settings.search.objective.quantity)]
        fitness: FloatArray = -1e3 * gain + PENALTY * violation
        return fitness
