"""What proposes the next candidates of a search: networks, or an optimiser on the simulator itself.

Every random number has an address (seed, purpose, index), and a proposer keeps nothing that it
could not find again from the samples before: a search that goes on proposes the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray
from scipy.stats import qmc

from drake_gait import isade, surrogate
from drake_gait.acquisition import Acquisition
from drake_gait.gait import FRAMES, FloatArray
from drake_gait.plan import Mode
from drake_gait.problem import PENALTY, DesignSpace, quantity
from drake_gait.ranking import Sample
from drake_gait.records import StudyWalk
from drake_gait.settings import StudySettings
from drake_gait.surrogate import FEWEST_SURVIVORS, Network, Surrogate

_DESIGN, _PROPOSAL, _NETWORK = 1, 2, 3  # Addresses of random numbers.

# The trust region around the best walk, as a half width in units of the box.
_RADIUS, _SMALLEST_RADIUS, _LARGEST_RADIUS = 0.6, 0.15, 1.2
_GROWTH, _SHRINKAGE = 1.3, 0.9

# The paper stops ISADE after 1000 iterations, or 50 without a better point. A trust region is small
# enough for fewer, and a batch takes several runs.
_ISADE_ITERATIONS, _ISADE_STAGNATION = 200, 50
_PAPER_ITERATIONS, _PAPER_STAGNATION = 1000, 50

_POPULATION = 30
"""Individuals of ISADE on the simulator: a budget of hundreds of walks bears no more."""
_GENERATIONS = 13
"""Generations over which its steps shrink, those of 400 walks: were they the budget's own, a larger
budget would change walks that there are."""
_STEP = 0.5
"""First step size of CMA-ES in units of the box."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Candidates to simulate."""

    x: FloatArray
    """Design vectors, shape (n, d)."""
    stage: str
    """What they are for: "design" or "infill"."""
    network: Network | None = None
    """What expects something of them."""


class Proposer(Protocol):
    """One way to search."""

    samples: int
    """Candidates of the first iteration."""
    batch: int
    """Candidates of every other iteration."""
    overlaps: bool
    """Whether it proposes while the iteration before is still being simulated."""

    def propose(
        self, iteration: int, known: Sequence[Sample], under_way: FloatArray, count: int
    ) -> Proposal:
        """The candidates of an iteration.

        Args:
            iteration: Its number, from 0.
            known: The samples of the iterations before it; where the proposer overlaps, without
                those of the last one.
            under_way: Design vectors of those that are not known yet, shape (m, d).
            count: Candidates to propose; fewer than a batch at the end of the budget.
        """
        ...


def proposer(settings: StudySettings) -> Proposer:
    """The proposer of a study's mode."""
    modes: dict[Mode, Callable[[StudySettings], Proposer]] = {
        Mode.DEFAULT: TrustRegion,
        Mode.PAPER: PaperProcedure,
        Mode.ISADE: DirectIsade,
        Mode.CMAES: DirectCmaes,
    }
    return modes[settings.search.mode](settings)


def design_of_experiments(settings: StudySettings) -> FloatArray:
    """A Latin hypercube in the box: design vectors, shape (samples, d)."""
    return _latin_hypercube(settings, settings.search.samples, _DESIGN)


def _latin_hypercube(settings: StudySettings, count: int, *address: int) -> FloatArray:
    rng = np.random.default_rng([settings.seed, *address])
    unit = qmc.LatinHypercube(settings.space.dimension, rng=rng).random(count)
    lower, upper = settings.space.box.T
    samples: FloatArray = lower + (upper - lower) * unit
    return samples


def training_data(
    walks: Sequence[StudyWalk], space: DesignSpace, names: Sequence[str]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Design vectors (n, d), the named quantities (n, k), and who survived (n,)."""
    x = np.array([space.encode(walk.candidate) for walk in walks])
    outputs = np.array([[quantity(walk.walk, name) for name in names] for walk in walks])
    survived = np.array([walk.walk.survived for walk in walks], dtype=bool)
    return x, outputs, survived


def _all_walks(samples: Sequence[Sample]) -> list[StudyWalk]:
    return [walk for sample in samples for walk in sample.walks]


class TrustRegion:
    """The default: an ensemble of networks, and ISADE on what it expects around the best walk."""

    overlaps = True

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        self.samples, self.batch = settings.search.samples, settings.search.batch

    def propose(
        self, iteration: int, known: Sequence[Sample], under_way: FloatArray, count: int
    ) -> Proposal:
        """The design of experiments, then points of the largest acquisition, apart."""
        settings = self._settings
        if iteration == 0:
            return Proposal(x=design_of_experiments(settings), stage="design")
        survivors = sum(walk.walk.survived for walk in _all_walks(known))
        if survivors < FEWEST_SURVIVORS:
            x = _latin_hypercube(settings, settings.search.batch, _DESIGN, iteration)
            return Proposal(x=x[:count], stage="design")
        network = surrogate.fit(
            *training_data(_all_walks(known), settings.space, settings.outputs),
            seed=_seed(settings.seed, _NETWORK, iteration),
        )
        x = self._optima(network, iteration, known, under_way, count)
        return Proposal(x=x, stage="infill", network=network)

    def _optima(
        self,
        network: Surrogate,
        iteration: int,
        known: Sequence[Sample],
        under_way: FloatArray,
        count: int,
    ) -> FloatArray:
        settings = self._settings
        best = min(known, key=lambda sample: sample.rank)
        centre = settings.space.encode(best.candidate)
        radius = self._radius(known)
        limits = settings.space.limits
        lower = np.maximum(limits[:, 0], np.minimum(centre, limits[:, 1]) - radius)
        upper = np.minimum(limits[:, 1], np.maximum(centre, limits[:, 0]) + radius)
        trials = list(under_way)
        for index in range(count):
            acquisition = Acquisition(
                network,
                settings.outputs,
                settings.search.objective.quantity,
                settings.constraints.limits,
                -best.assessment.objective if best.assessment.feasible else None,
                trials,
                radius,
                settings.search.replicas,
            )
            found = isade.minimize(
                acquisition,
                np.column_stack([lower, upper]),
                vectorized=True,
                seed=_seed(settings.seed, _PROPOSAL, iteration, index),
                max_evaluations=10**9,
                max_iterations=_ISADE_ITERATIONS,
                stagnation=_ISADE_STAGNATION,
                initial=np.clip(centre, lower, upper)[None, :],
            )
            trials.append(found.x)
        return np.array(trials[len(under_way) :])

    def _radius(self, known: Sequence[Sample]) -> float:
        """Half width of the trust region: it grows with every success, and shrinks without."""
        radius = _RADIUS
        best = min(known[: self.samples], key=lambda sample: sample.rank)
        for start in range(self.samples, len(known), self.batch):
            leader = min([best, *known[start : start + self.batch]], key=lambda one: one.rank)
            radius *= _GROWTH if leader is not best else _SHRINKAGE
            radius = min(max(radius, _SMALLEST_RADIUS), _LARGEST_RADIUS)
            best = leader
        return radius


class PaperProcedure:
    """The paper's section IV.C to the letter, for comparison.

    One network of all samples, falls and all; its optimum under the penalty function is simulated
    and added.
    """

    overlaps = False
    batch = 1

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        self.samples = settings.search.samples
        self._names = (*settings.outputs, "steps")

    def propose(
        self, iteration: int, known: Sequence[Sample], under_way: FloatArray, count: int
    ) -> Proposal:
        """The design of experiments, then the optimum of the network."""
        settings = self._settings
        if iteration == 0:
            return Proposal(x=design_of_experiments(settings), stage="design")
        x, outputs, _ = training_data(_all_walks(known), settings.space, settings.outputs)
        frames = [[float(walk.walk.steps)] for walk in _all_walks(known)]
        targets = np.nan_to_num(np.column_stack([outputs, frames]))
        network = surrogate.fit_single(x, targets, seed=_seed(settings.seed, _NETWORK, iteration))

        def fitness(points: FloatArray) -> FloatArray:
            """F(x) of what the network expects [mm], Eqs. 16-17."""
            return self._fitness(network.predict(points).mean)

        found = isade.minimize(
            fitness,
            settings.space.box,
            vectorized=True,
            seed=_seed(settings.seed, _PROPOSAL, iteration),
            max_evaluations=10**9,
            max_iterations=_PAPER_ITERATIONS,
            stagnation=_PAPER_STAGNATION,
        )
        return Proposal(x=found.x[None, :], stage="infill", network=network)

    def _fitness(self, expected: FloatArray) -> FloatArray:
        column = self._names.index
        violation = np.maximum((FRAMES - expected[:, column("steps")]) / FRAMES, 0.0)
        for limit in self._settings.constraints.limits:
            violation += np.maximum(limit.excess(expected[:, column(limit.quantity)]), 0.0)
        gain = expected[:, column(self._settings.search.objective.quantity)]
        fitness: FloatArray = -1e3 * gain + PENALTY * violation
        return fitness


class DirectIsade:
    """ISADE on the simulator, from a Latin hypercube in the box."""

    overlaps = False

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        self.samples = self.batch = _POPULATION
        self._optimiser: isade.Isade | None = None

    def propose(
        self, iteration: int, known: Sequence[Sample], under_way: FloatArray, count: int
    ) -> Proposal:
        """A generation."""
        settings = self._settings
        if self._optimiser is None:
            self._optimiser = isade.Isade(
                settings.space.limits,
                population_size=_POPULATION,
                seed=_seed(settings.seed, _PROPOSAL),
                max_generations=_GENERATIONS,
                initial=_latin_hypercube(settings, _POPULATION, _DESIGN),
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

    overlaps = False

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        limits = settings.space.limits
        self._optimiser = CMA(
            mean=np.clip(np.zeros(len(limits)), limits[:, 0], limits[:, 1]),
            sigma=_STEP,
            bounds=limits,
            seed=_seed(settings.seed, _PROPOSAL) % 2**31,
        )
        self.samples = self.batch = self._optimiser.population_size
        self._asked: list[FloatArray] = []

    def propose(
        self, iteration: int, known: Sequence[Sample], under_way: FloatArray, count: int
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


def _seed(*address: int) -> int:
    """One seed for a library that takes no address."""
    return int(np.random.SeedSequence(address).generate_state(1)[0])
