"""The default way to search: networks choose in a region that follows what was simulated."""

from collections.abc import Sequence
from typing import cast

import numpy as np
from cmaes import CMA
from scipy.spatial.distance import cdist

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.optimizers import isade
from drake_gait.search.acquisition import Acquisition, Test
from drake_gait.search.grounds import end_of_proposal, grounded_inputs
from drake_gait.search.learner import NetworkProposer, gain_to_beat
from drake_gait.search.proposer import (
    IsadeSettings,
    Proposal,
)
from drake_gait.search.seeding import Purpose, seed_of
from drake_gait.study.ranking import Sample
from drake_gait.study.search_settings import Risk
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.ensemble import Surrogate
from drake_gait.surrogates.prediction import Network
from drake_gait.surrogates.residual_gp import ErrorProcesses
from drake_gait.surrogates.settings import NetworkSettings

# The trust region: its first step in units of the box, that of a restart, generations without a
# feasible candidate until then, points drawn for each that is simulated, how many standard
# deviations ISADE may go from the middle, and the part of the samples that it starts from, 1 / n.
_STEP_OF_REGION, _STEP_OF_RESTART, _PATIENCE = 0.35, 0.15, 4
_DRAWS, _REACH, _ELITE = 3, 1.5, 5
_WIDEST = 0.4
"""Widest mean deviation of what a search that weighs trust draws, in units of the box."""
_MODELLED, _CAPPED = 200, 0.8
"""Samples, the latest, that tell the fitness to expect; its quantile above which all are alike."""
_SAME = 1e-9
"""Distance, in units of the box, up to which two candidates are one."""
_POPULATION = 36
"""Of ISADE in the region: it begins with the region's draws."""
IN_REGION = IsadeSettings(iterations=30)
"""When ISADE stops in the region: workers wait for it."""


class TrustRegion(NetworkProposer):
    """The default: an ensemble of networks chooses in a region that follows what was simulated.

    The region is the distribution of CMA-ES, which learns from every simulated walk where the
    constraints leave room. A network could hardly tell it (docs/explanation/search.md).
    Of many points that
    are drawn from it, those with the largest acquisition are simulated, and the optimum that ISADE
    finds in it.

    Args:
        settings: The study's: its box, limits, objective, seed, samples and batch.
        isade: When ISADE stops in the region; its population is the region's draws.
        network: Size of the networks, and how long they learn.
        tells_all: Tell the region all that it drew, with what is to be expected of it.
        isade_points: Points of a batch that ISADE finds.
        overlaps: Propose a batch while half of the one before is still being simulated, so that
            workers never wait. The region then learns of a batch one iteration later.
    """

    def __init__(
        self,
        settings: StudySettings,
        *,
        isade: IsadeSettings = IN_REGION,
        network: NetworkSettings | None = None,
        tells_all: bool = False,
        isade_points: int = 1,
        overlaps: bool = True,
    ) -> None:
        if tells_all and overlaps:
            raise SettingsError("tells_all needs the latest batch; give overlaps=False with it")
        super().__init__(settings, network, settings.search.batch // 2 if overlaps else 0)
        self._tells_all, self._isade_points = tells_all, isade_points
        self._isade, self._network = isade, network or NetworkSettings()
        told = f"{tells_all}, {isade_points}, {overlaps}"
        self.name = f"TrustRegion({self._isade}, {self._network}, {told})"
        self._region: CMA | None = None
        self._draws: FloatArray = np.empty((0, settings.space.dimension))
        self._started = 1
        self._told = 0

    def propose(
        self, iteration: int, known: Sequence[Sample], network: Network | None, count: int
    ) -> Proposal:
        """The design of experiments, then points of large acquisition, apart."""
        if iteration == 0 or not isinstance(network, Surrogate):
            return self._unlearnt(iteration, count)
        while self._told < iteration:  # Also what a study did before it went on.
            self._told += 1
            # The region hears whole batches, each on one ground.
            whole = self._told - (2 if self.overlap and self._told > 1 else 1)
            self._move(self._told, whole, known[: self.samples + whole * self.batch])
        asked = self._learner.asked(network, iteration, known)
        x = self._chosen(asked, iteration, known)
        return Proposal(x=x[:count], stage="infill", network=asked)

    def _move(self, iteration: int, whole: int, known: Sequence[Sample]) -> None:
        """Move the region by the latest of the batches that are whole, and draw from it."""
        space = self._settings.space
        if self._region is None:
            self._restart(iteration, self._elite(known), _STEP_OF_REGION)
        elif self._is_stuck(iteration, known):
            best = min(known, key=lambda one: one.rank)
            self._restart(iteration, space.encode(best.candidate), _STEP_OF_RESTART)
        elif whole:
            self._region.tell(self._told_of(iteration, known))
        region = cast(CMA, self._region)
        self._draws = np.array([region.ask() for _ in range(_DRAWS * self.batch)])
        if self._settings.search.risk is Risk.TRUST:
            # What a model picks widens the region without end: nearer points are drawn, and told.
            nearer = min(1.0, _WIDEST / float(self._draws.std(axis=0).mean()))
            self._draws = region.mean + nearer * (self._draws - region.mean)

    def _told_of(self, iteration: int, known: Sequence[Sample]) -> list[tuple[FloatArray, float]]:
        """Return points and fitness that the region learns of the last batch.

        Points that a model has picked alone would widen it without end. So it may learn all that it
        drew (Hansen 2019, Bajer and others 2019). Each has the fitness to expect on the ground of
        the batch, which follows from the walks of the study file alone.
        """
        space = self._settings.space
        told = [
            (space.encode(one.candidate), one.assessment.fitness) for one in known[-self.batch :]
        ]
        if not self._tells_all:
            return told
        walked = np.array([x for x, _ in told])
        others = self._draws[cdist(self._draws, walked).min(axis=1) > _SAME]
        drawn = np.vstack([walked, others[: len(self._draws) - len(told)]])
        expected = self._expected_fitness(drawn, iteration - 1, known)
        return list(zip(drawn, expected.tolist(), strict=True))

    def _expected_fitness(
        self, x: FloatArray, iteration: int, known: Sequence[Sample]
    ) -> FloatArray:
        settings, recent = self._settings, known[-_MODELLED:]
        inputs = grounded_inputs(settings, [one.walks[0] for one in recent])
        fitness = np.array([one.assessment.fitness for one in recent])
        # The worst say that they are bad, and not how bad.
        fitness = np.minimum(fitness, np.quantile(fitness, _CAPPED))
        if settings.two_grounds:
            end = end_of_proposal(settings, iteration, 0)
            x = np.column_stack([x, np.full(len(x), end)])
        mean = fitness.mean()
        errors = ErrorProcesses(inputs, (fitness - mean)[:, None])
        found: FloatArray = mean + errors.predict(x)[0][:, 0]
        return found

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
            population_size=self.batch * (_DRAWS if self._tells_all else 1),
        )

    def _is_stuck(self, iteration: int, known: Sequence[Sample]) -> bool:
        """Return whether the region has left all feasible points, or has shrunk to a point."""
        if cast(CMA, self._region).should_stop():
            return True
        if iteration - self._started < _PATIENCE:
            return False
        recent = known[-_PATIENCE * self.batch :]
        found_before = any(one.assessment.feasible for one in known)
        return found_before and not any(one.assessment.feasible for one in recent)

    def _chosen(self, network: Network, iteration: int, known: Sequence[Sample]) -> FloatArray:
        settings, draws = self._settings, self._draws
        to_beat = gain_to_beat(settings, network, known)
        middle, spread = draws.mean(axis=0), draws.std(axis=0)
        limits = settings.space.limits
        around = np.clip(
            np.column_stack([middle - _REACH * spread, middle + _REACH * spread]),
            limits[:, :1],
            limits[:, 1:],
        )
        acquisition = Acquisition(
            network,
            settings.outputs,
            settings.search.objective.quantity,
            settings.constraints.limits,
            to_beat,
            [],
            2.0 * float(spread.mean()),
            settings.search.replicas,
            settings.search.risk,
            Test.of(settings),
        )
        trials: list[FloatArray] = []
        for index in range(self._isade_points):
            found = isade.minimize(
                acquisition.away_from(trials),
                around,
                vectorized=True,
                seed=seed_of(settings.seed, Purpose.PROPOSAL, iteration, index),
                max_evaluations=10**9,
                population_size=_POPULATION,
                max_iterations=self._isade.iterations,
                stagnation=self._isade.stagnation,
                initial=np.clip(draws, around[:, 0], around[:, 1])[:_POPULATION],
            )
            trials.append(found.x)
        cost = acquisition(draws)
        for index in range(len(trials), self.batch):
            part = np.arange(index, len(draws), self.batch)
            near = acquisition.nearness(draws[part], trials)
            trials.append(draws[part[np.argmin(cost[part] + near)]])
        return np.array(trials)
