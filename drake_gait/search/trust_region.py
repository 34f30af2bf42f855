"""The default way to search: networks choose in a region that follows what was simulated."""

from collections.abc import Sequence
from typing import cast

import numpy as np
from cmaes import CMA

from drake_gait.gait import FloatArray
from drake_gait.optimizers import isade
from drake_gait.search import proposer
from drake_gait.search.acquisition import Acquisition
from drake_gait.search.proposer import (
    Proposal,
    all_walks,
    design_of_experiments,
    latin_hypercube,
    training_data,
)
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.ensemble import FEWEST_SURVIVORS, Network, Surrogate
from drake_gait.surrogates.residual_gp import KrigedNetwork

# The trust region: its first step in units of the box, that of a restart, generations without a
# feasible candidate until then, points drawn for each that is simulated, how many standard
# deviations ISADE may go from the middle, and the part of the samples that it starts from, 1 / n.
_STEP_OF_REGION, _STEP_OF_RESTART, _PATIENCE = 0.35, 0.15, 4
_DRAWS, _REACH, _ELITE = 3, 1.5, 5


class TrustRegion:
    """The default: an ensemble of networks chooses in a region that follows what was simulated.

    The region is the distribution of CMA-ES, which learns from every simulated walk where the
    constraints leave room; a network could hardly tell it (docs/explanation/search.md).
    Of many points that
    are drawn from it, those with the largest acquisition are simulated, and the optimum that ISADE
    finds in it.
    """

    learns_ahead = True

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        self.samples, self.batch = settings.search.samples, settings.search.batch
        self._region: CMA | None = None
        self._draws: FloatArray = np.empty((0, settings.space.dimension))
        self._started = 1
        self._told = 0

    def learn(self, iteration: int, known: Sequence[Sample]) -> Surrogate | None:
        """An ensemble of networks of all walks, if enough survived."""
        settings, walks = self._settings, all_walks(known)
        x, outputs, survived = training_data(walks, settings.space, settings.outputs)
        if surrogate.learnable(outputs, survived).sum() < FEWEST_SURVIVORS:
            return None
        seed = seed_of(settings.seed, Purpose.NETWORK, iteration)
        return surrogate.fit(x, outputs, survived, seed=seed)

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """The design of experiments, then points of large acquisition, apart."""
        settings = self._settings
        if iteration == 0:
            return Proposal(x=design_of_experiments(settings), stage="design")
        if not isinstance(network, Surrogate):
            x = latin_hypercube(settings, self.batch, iteration)
            return Proposal(x=x[:count], stage="design")
        while self._told < iteration:  # Also what a study did before it went on.
            self._told += 1
            stop = self.samples + (self._told - 1) * self.batch
            self._move(self._told, known[:stop])
        since = all_walks(known)[len(network.x) :]
        kriged = KrigedNetwork(network, *training_data(since, settings.space, settings.outputs))
        x = self._chosen(kriged, iteration, known)
        return Proposal(x=x[:count], stage="infill", network=kriged)

    def _move(self, iteration: int, known: Sequence[Sample]) -> None:
        """Move the region by the last iteration, and draw from it."""
        space, last = self._settings.space, known[-self.batch :]
        if self._region is None:
            self._restart(iteration, self._elite(known), _STEP_OF_REGION)
        elif self._is_stuck(iteration, known):
            best = min(known, key=lambda one: one.rank)
            self._restart(iteration, space.encode(best.candidate), _STEP_OF_RESTART)
        else:
            self._region.tell(
                [(space.encode(one.candidate), one.assessment.fitness) for one in last]
            )
        region = cast(CMA, self._region)
        self._draws = np.array([region.ask() for _ in range(_DRAWS * self.batch)])

    def _elite(self, known: Sequence[Sample]) -> FloatArray:
        """Mean of the best fifth by the paper's fitness, the better ones weighing more."""
        ranked = sorted(known, key=lambda one: one.assessment.fitness)
        elite = ranked[: max(1, len(ranked) // _ELITE)]
        weights = np.log(len(elite) + 0.5) - np.log(np.arange(1, len(elite) + 1))
        x = [self._settings.space.encode(one.candidate) for one in elite]
        mean: FloatArray = np.average(x, axis=0, weights=weights)
        return mean

    def _restart(self, iteration: int, mean: FloatArray, step: float) -> None:
        limits = self._settings.space.limits
        self._started = iteration
        self._region = CMA(
            mean=np.clip(mean, limits[:, 0], limits[:, 1]),
            sigma=step,
            bounds=limits,
            seed=seed_of(self._settings.seed, Purpose.PROPOSAL, iteration) % 2**31,
            population_size=self.batch,
        )

    def _is_stuck(self, iteration: int, known: Sequence[Sample]) -> bool:
        """Whether the region has left what is feasible behind, or has shrunk to a point."""
        if cast(CMA, self._region).should_stop():
            return True
        if iteration - self._started < _PATIENCE:
            return False
        recent = known[-_PATIENCE * self.batch :]
        found_before = any(one.assessment.feasible for one in known)
        return found_before and not any(one.assessment.feasible for one in recent)

    def _chosen(self, network: Network, iteration: int, known: Sequence[Sample]) -> FloatArray:
        settings, draws = self._settings, self._draws
        best = min(known, key=lambda one: one.rank)
        middle, spread = draws.mean(axis=0), draws.std(axis=0)
        limits = settings.space.limits
        around = np.clip(
            np.column_stack([middle - _REACH * spread, middle + _REACH * spread]),
            limits[:, :1],
            limits[:, 1:],
        )
        trials: list[FloatArray] = []
        for index in range(self.batch):
            acquisition = Acquisition(
                network,
                settings.outputs,
                settings.search.objective.quantity,
                settings.constraints.limits,
                -best.assessment.objective if best.assessment.feasible else None,
                trials,
                2.0 * float(spread.mean()),
                settings.search.replicas,
            )
            if index == 0:
                found = isade.minimize(
                    acquisition,
                    around,
                    vectorized=True,
                    seed=seed_of(settings.seed, Purpose.PROPOSAL, iteration, index),
                    max_evaluations=10**9,
                    max_iterations=proposer.ISADE_ITERATIONS,
                    stagnation=proposer.ISADE_STAGNATION,
                )
                trials.append(found.x)
            else:
                part = draws[index :: self.batch]
                trials.append(part[np.argmin(acquisition(part))])
        return np.array(trials)
