"""Optimisers on the simulator itself, without a surrogate: ISADE and CMA-ES."""

from collections.abc import Sequence

import numpy as np
from cmaes import CMA

from drake_gait.gait import FloatArray
from drake_gait.optimizers import isade
from drake_gait.search.proposer import (
    Proposal,
    latin_hypercube,
)
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.ensemble import Network

_POPULATION = 30
"""Individuals of ISADE on the simulator: a budget of hundreds of walks bears no more."""
_GENERATIONS = 13
"""Generations over which its steps shrink, those of 400 walks: were they the budget's own, a larger
budget would change walks that there are."""
_STEP = 0.5
"""First step size of CMA-ES in units of the box."""


class DirectIsade:
    """ISADE on the simulator, from a Latin hypercube in the box."""

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        self.samples = self.batch = _POPULATION
        self._optimiser: isade.Isade | None = None

    def vintage(self, iteration: int) -> int:
        """Its own: it waits for all walks."""
        return iteration

    def learn(self, iteration: int, known: Sequence[Sample]) -> Network | None:
        """Nothing."""
        return None

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """A generation."""
        settings = self._settings
        if self._optimiser is None:
            self._optimiser = isade.Isade(
                settings.space.limits,
                population_size=_POPULATION,
                seed=seed_of(settings.seed, Purpose.PROPOSAL),
                max_generations=_GENERATIONS,
                initial=latin_hypercube(settings, _POPULATION),
            )
        while self._optimiser.generation < iteration:  # Also what a study did before it went on.
            start = self._optimiser.generation * _POPULATION
            self._optimiser.ask()
            found = [sample.assessment for sample in known[start : start + _POPULATION]]
            self._optimiser.tell(
                [one.objective for one in found], np.array([one.violations for one in found])
            )
        trials = isade.Isade.from_state(self._optimiser.state()).ask()
        return Proposal(x=trials[:count], stage="infill" if iteration else "design")


class DirectCmaes:
    """CMA-ES (the `cmaes` library) on the paper's penalised fitness, from the middle of the box."""

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        limits = settings.space.limits
        self._optimiser = CMA(
            mean=np.clip(np.zeros(len(limits)), limits[:, 0], limits[:, 1]),
            sigma=_STEP,
            bounds=limits,
            seed=seed_of(settings.seed, Purpose.PROPOSAL) % 2**31,
        )
        self.samples = self.batch = self._optimiser.population_size
        self._asked: list[FloatArray] = []

    def vintage(self, iteration: int) -> int:
        """Its own: it waits for all walks."""
        return iteration

    def learn(self, iteration: int, known: Sequence[Sample]) -> Network | None:
        """Nothing."""
        return None

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """A generation."""
        while len(self._asked) <= iteration * self.batch:
            generation = len(self._asked) // self.batch
            if generation:
                start = (generation - 1) * self.batch
                costs = [sample.assessment.fitness for sample in known[start : start + self.batch]]
                self._optimiser.tell(list(zip(self._asked[start:], costs, strict=True)))
            self._asked += [self._optimiser.ask() for _ in range(self.batch)]
        start = iteration * self.batch
        x = np.array(self._asked[start : start + count])
        return Proposal(x=x, stage="infill" if iteration else "design")
