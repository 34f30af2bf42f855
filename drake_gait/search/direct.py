"""Optimisers on the simulator itself, without a surrogate: ISADE and CMA-ES."""

from collections.abc import Sequence

import numpy as np
from cmaes import CMA

from drake_gait.gait import FloatArray
from drake_gait.optimizers import isade
from drake_gait.ranges import POSITIVE, check
from drake_gait.search.proposer import (
    Proposal,
    latin_hypercube,
)
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.prediction import Network


class _Direct:
    """Base of the optimisers on the simulator: they learn nothing, and wait for all walks."""

    def vintage(self, iteration: int) -> int:
        """Return the iteration itself."""
        return iteration

    def learn(self, iteration: int, known: Sequence[Sample]) -> Network | None:
        """Learn nothing."""
        return None


class DirectIsade(_Direct):
    """ISADE on the simulator, from a Latin hypercube in the box.

    Args:
        settings: The study's: its box and seed.
        population: Individuals; a budget of hundreds of walks bears no more than 30.
        generations: Generations over which its steps shrink, those of 400 walks. Were they the
            budget's own, a larger budget would change walks that there are.
    """

    def __init__(
        self, settings: StudySettings, *, population: int = 30, generations: int = 13
    ) -> None:
        self._settings = settings
        self._generations = generations
        self.samples = self.batch = population
        self.name = f"DirectIsade(population={population}, generations={generations})"
        self._optimiser: isade.Isade | None = None

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """A generation."""
        settings = self._settings
        if self._optimiser is None:
            self._optimiser = isade.Isade(
                settings.space.limits,
                population_size=self.batch,
                seed=seed_of(settings.seed, Purpose.PROPOSAL),
                max_generations=self._generations,
                initial=latin_hypercube(settings, self.batch),
            )
        while self._optimiser.generation < iteration:  # Also what a study did before it went on.
            start = self._optimiser.generation * self.batch
            self._optimiser.ask()
            found = [sample.assessment for sample in known[start : start + self.batch]]
            self._optimiser.tell(
                [one.objective for one in found], np.array([one.violations for one in found])
            )
        trials = isade.Isade.from_state(self._optimiser.state()).ask()
        return Proposal(x=trials[:count], stage="infill" if iteration else "design")


class DirectCmaes(_Direct):
    """CMA-ES (the `cmaes` library) on the paper's penalised fitness, from the middle of the box.

    Args:
        settings: The study's: its box and seed.
        step: First step size in units of the box.
    """

    def __init__(self, settings: StudySettings, *, step: float = 0.5) -> None:
        check("step", step, POSITIVE)
        self._settings = settings
        limits = settings.space.limits
        self._optimiser = CMA(
            mean=np.clip(np.zeros(len(limits)), limits[:, 0], limits[:, 1]),
            sigma=step,
            bounds=limits,
            seed=seed_of(settings.seed, Purpose.PROPOSAL) % 2**31,
        )
        self.samples = self.batch = self._optimiser.population_size
        self.name = f"DirectCmaes(step={step})"
        self._asked: list[FloatArray] = []

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
