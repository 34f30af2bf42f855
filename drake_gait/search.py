"""The procedure: samples, network, ISADE, confirmation by simulation (paper, IV.C, steps 1-6).

The study file is the state. A search that goes on after an interruption reads it and proposes the
same walks again, because every random number has an address (seed, purpose, index) and a network
is trained on the walks before its own only.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import norm, qmc

from drake_gait import isade, surrogate
from drake_gait.gait import FloatArray
from drake_gait.problem import Candidate, Constraints, DesignSpace, assess
from drake_gait.settings import StudySettings
from drake_gait.store import Study, StudyWalk
from drake_gait.surrogate import FEWEST_SURVIVORS, OUTPUTS, Prediction, Surrogate
from drake_gait.walk import Outcome
from drake_gait.workers import Finished

Evaluate = Callable[[Sequence[Candidate]], Iterable[Finished]]
"""Simulates candidates and yields them as they finish, in any order."""

_DESIGN, _PROPOSAL, _NETWORK = 1, 2, 3  # Addresses of random numbers.

# The trust region around the best walk, as a half width in units of the box.
_RADIUS, _SMALLEST_RADIUS, _LARGEST_RADIUS = 0.6, 0.15, 1.2
_GROWTH, _SHRINKAGE = 1.3, 0.9

# The paper stops ISADE after 1000 iterations, or 50 without a better point. A trust region is small
# enough for fewer, and a batch takes several runs.
_ISADE_ITERATIONS, _ISADE_STAGNATION = 200, 50

_NEIGHBOURHOOD = 0.25
"""Trials of one batch closer than about this part of the trust region count as the same."""


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a search has come."""

    walks: int
    """Walks simulated."""
    total: int
    """Walks that the study may simulate."""
    survivors: int
    """Walks whose robot stayed on its feet."""
    feasible: int
    """Walks that satisfy every constraint."""
    failures: Mapping[str, int]
    """The other walks by what kept them from their last frame, as Walk.failure says it."""
    best: StudyWalk | None
    """The feasible walk that went furthest."""
    network: Surrogate | None
    """The latest network, when one has been trained since the command was started."""


def search(
    settings: StudySettings,
    study: Study,
    evaluate: Evaluate,
    report: Callable[[Progress], None] = lambda progress: None,
) -> None:
    """Run a study to its end, from wherever it stands.

    Args:
        settings: What to search, and with how many walks.
        study: Where every finished walk is kept.
        evaluate: Simulates candidates.
        report: Told how far it is, after every walk.
    """
    run = _Run(settings, study, evaluate, report)
    run.simulate(design_of_experiments(settings), "design", 0)  # Steps 1 and 2.
    for iteration in range(1, run.iterations + 1):
        if run.has_converged(iteration):  # Step 6.
            break
        if run.is_complete(iteration):
            continue
        if not run.can_learn(iteration):
            run.simulate(further_samples(settings, iteration), "design", iteration)
        else:
            network = run.learn(iteration)  # Step 3.
            trials = run.propose(network, iteration)  # Step 4.
            run.simulate(trials, "infill", iteration, network)  # Step 5.


def design_of_experiments(settings: StudySettings) -> FloatArray:
    """A Latin hypercube in the box: design vectors, shape (samples, d)."""
    return _latin_hypercube(settings, settings.search.samples, _DESIGN)


def further_samples(settings: StudySettings, iteration: int) -> FloatArray:
    """Design vectors, shape (batch, d), for an iteration with too few survivors for a network."""
    return _latin_hypercube(settings, settings.search.batch, _DESIGN, iteration)


def _latin_hypercube(settings: StudySettings, count: int, *address: int) -> FloatArray:
    rng = np.random.default_rng([settings.seed, *address])
    unit = qmc.LatinHypercube(settings.space.dimension, rng=rng).random(count)
    lower, upper = settings.space.box.T
    samples: FloatArray = lower + (upper - lower) * unit
    return samples


def feasible_walks(walks: Iterable[StudyWalk], limits: Constraints) -> list[StudyWalk]:
    """The walks that satisfy every constraint, furthest first."""
    feasible = [walk for walk in walks if assess(walk.walk, limits).feasible]
    return sorted(feasible, key=lambda walk: (-walk.walk.forward, walk.id))


def training_data(
    walks: Sequence[StudyWalk], space: DesignSpace
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Design vectors (n, d), outputs (n, 4) as OUTPUTS, and who survived (n,)."""
    x = np.array([space.encode(walk.candidate) for walk in walks])
    outputs = np.array([[getattr(walk.walk, name) for name in OUTPUTS] for walk in walks])
    survived = np.array([walk.walk.survived for walk in walks], dtype=bool)
    return x, outputs, survived


class _Run:
    """One search: the walks known so far, and what the steps do with them."""

    def __init__(
        self,
        settings: StudySettings,
        study: Study,
        evaluate: Evaluate,
        report: Callable[[Progress], None],
    ) -> None:
        self._settings = settings
        self._space, self._limits = settings.space, settings.constraints
        self._study, self._evaluate, self._report = study, evaluate, report
        self._walks = {walk.id: walk for walk in study.walks()}
        self._failures = Counter(walk.walk.failure for walk in self._walks.values())
        self._network: Surrogate | None = None
        self._improvements: dict[int, bool] = {}

    @property
    def iterations(self) -> int:
        """Networks that the budget has room for."""
        plan = self._settings.search
        return -(-(plan.simulations - plan.samples) // plan.batch)

    def simulate(
        self, x: FloatArray, stage: str, iteration: int, network: Surrogate | None = None
    ) -> None:
        """Simulate those of an iteration's design vectors, shape (n, d), not simulated yet."""
        ids = self._ids(iteration)
        missing = [index for index, number in enumerate(ids) if number not in self._walks]
        candidates = [self._space.decode(x[index]) for index in missing]
        # Of all: the last digits of a prediction depend on how many are made together.
        expected = network.predict(x) if network else None
        for finished in self._evaluate(candidates) if candidates else ():
            place = missing[finished.index]
            walk = StudyWalk(
                id=ids[place],
                stage=stage,
                iteration=iteration,
                candidate=candidates[finished.index],
                walk=finished.walk,
                predicted=_expected(expected, place) if expected else None,
                seconds=finished.seconds,
            )
            self._study.add(walk)
            self._walks[walk.id] = walk
            self._failures[walk.walk.failure] += 1
            self._report(self._progress())

    def is_complete(self, iteration: int) -> bool:
        """Whether every walk of an iteration is known."""
        return all(number in self._walks for number in self._ids(iteration))

    def can_learn(self, iteration: int) -> bool:
        """Whether enough walks before an iteration survived for a network."""
        survivors = sum(walk.walk.survived for walk in self._before(iteration))
        return survivors >= FEWEST_SURVIVORS

    def learn(self, iteration: int) -> Surrogate:
        """The network of an iteration, from all walks before it."""
        self._network = surrogate.fit(
            *training_data(self._before(iteration), self._space),
            seed=_seed(self._settings.seed, _NETWORK, iteration),
        )
        self._report(self._progress())
        return self._network

    def propose(self, network: Surrogate, iteration: int) -> FloatArray:
        """The design vectors of an iteration, shape (n, d): optima of the network, apart."""
        before = self._before(iteration)
        centre = self._space.encode(best_walk(before, self._limits).candidate)
        radius = self._radius(iteration)
        limits = self._space.limits
        lower = np.maximum(limits[:, 0], np.minimum(centre, limits[:, 1]) - radius)
        upper = np.minimum(limits[:, 1], np.maximum(centre, limits[:, 0]) + radius)
        feasible = feasible_walks(before, self._limits)
        to_beat = feasible[0].walk.forward if feasible else None
        trials: list[FloatArray] = []
        for number in self._ids(iteration):
            acquisition = _Acquisition(network, self._limits, to_beat, trials, radius)
            found = isade.minimize(
                acquisition,
                np.column_stack([lower, upper]),
                vectorized=True,
                seed=_seed(self._settings.seed, _PROPOSAL, number),
                max_evaluations=10**9,
                max_iterations=_ISADE_ITERATIONS,
                stagnation=_ISADE_STAGNATION,
                initial=np.clip(centre, lower, upper)[None, :],
            )
            trials.append(found.x)
        return np.array(trials)

    def has_converged(self, iteration: int) -> bool:
        """Whether as many networks as the study bears have not bettered the best feasible walk."""
        patience = self._settings.search.stagnation
        if patience is None or iteration <= patience:
            return False
        recent = range(iteration - patience, iteration)
        return not any(self._improved(past) for past in recent)

    def _ids(self, iteration: int) -> range:
        """Ids of an iteration's walks; iteration 0 is the design of experiments."""
        plan = self._settings.search
        if iteration == 0:
            return range(plan.samples)
        start = plan.samples + (iteration - 1) * plan.batch
        return range(start, min(start + plan.batch, plan.simulations))

    def _before(self, iteration: int) -> list[StudyWalk]:
        """All walks with an id before those of an iteration, in order."""
        return [self._walks[number] for number in range(self._ids(iteration).start)]

    def _improved(self, iteration: int) -> bool:
        """Whether an iteration's walks beat all before them."""
        if iteration not in self._improvements:
            ids = self._ids(iteration)
            best = best_walk([self._walks[number] for number in range(ids.stop)], self._limits)
            self._improvements[iteration] = best.id in ids
        return self._improvements[iteration]

    def _radius(self, iteration: int) -> float:
        """Half width of the trust region: it grows with every success, and shrinks without."""
        radius = _RADIUS
        for past in range(1, iteration):
            radius *= _GROWTH if self._improved(past) else _SHRINKAGE
            radius = min(max(radius, _SMALLEST_RADIUS), _LARGEST_RADIUS)
        return radius

    def _progress(self) -> Progress:
        walks = list(self._walks.values())
        feasible = feasible_walks(walks, self._limits)
        return Progress(
            walks=len(walks),
            total=self._settings.search.simulations,
            survivors=sum(walk.walk.survived for walk in walks),
            feasible=len(feasible),
            failures={cause: number for cause, number in self._failures.items() if cause},
            best=feasible[0] if feasible else None,
            network=self._network,
        )


def best_walk(walks: Sequence[StudyWalk], limits: Constraints) -> StudyWalk:
    """The furthest feasible walk, or, where none is feasible, the one nearest to it.

    A walk on its feet is nearer than a fall, and a fall nearer than what could not be simulated,
    whose numbers mean nothing.
    """
    feasible = feasible_walks(walks, limits)
    if feasible:
        return feasible[0]
    order = list(Outcome)

    def distance(walk: StudyWalk) -> tuple[int, float, int]:
        violation = float(assess(walk.walk, limits).violations.sum())
        return order.index(walk.walk.outcome), violation, walk.id

    return min(walks, key=distance)


class _Acquisition:
    """What ISADE minimises: the improvement to expect times the chance that the walk is feasible.

    Constrained expected improvement (Schonlau, Welch, Jones 1998), as a negative logarithm. Without
    a feasible walk yet, the chance alone. Around trials of the same batch it falls off.
    """

    def __init__(
        self,
        network: Surrogate,
        limits: Constraints,
        to_beat: float | None,
        trials: Sequence[FloatArray],
        radius: float,
    ) -> None:
        self._network = network
        self._limits = limits
        self._to_beat = to_beat
        self._trials = trials
        self._reach = _NEIGHBOURHOOD * radius

    def __call__(self, x: FloatArray) -> FloatArray:
        """Costs, shape (n,), of design vectors, shape (n, d)."""
        expected = self._network.predict(x)
        log_value = _log(self._chance(expected))
        if self._to_beat is not None:
            log_value += _log(_expected_improvement(expected, self._to_beat))
        for trial in self._trials:
            distance = ((x - trial) ** 2).mean(axis=1) / self._reach**2
            log_value += _log(-np.expm1(-0.5 * distance))
        cost: FloatArray = -log_value
        return cost

    def _chance(self, expected: Prediction) -> FloatArray:
        """Probability of a feasible walk, shape (n,)."""
        limits = self._limits
        _, lateral, yaw, height = expected.mean.T
        _, lateral_error, yaw_error, height_error = expected.deviation.T
        chance: FloatArray = (
            expected.survival
            * _within(lateral, lateral_error, limits.lateral)
            * _within(yaw, yaw_error, limits.yaw)
            * ndtr((height - limits.com_height) / height_error)
        )
        return chance


def _expected_improvement(expected: Prediction, to_beat: float) -> FloatArray:
    """Mean of max(Z - to_beat, 0) where Z is normal [m], shape (n,)."""
    mean, deviation = expected.mean[:, 0], expected.deviation[:, 0]
    z = (mean - to_beat) / deviation
    gain: FloatArray = deviation * (z * ndtr(z) + norm.pdf(z))
    return gain


def _within(mean: FloatArray, deviation: FloatArray, limit: float) -> FloatArray:
    """Probability that a normal variable lies in ± limit."""
    inside: FloatArray = ndtr((limit - mean) / deviation) - ndtr((-limit - mean) / deviation)
    return inside


def _log(value: FloatArray) -> FloatArray:
    logarithm: FloatArray = np.log(np.maximum(value, 1e-300))
    return logarithm


def _expected(prediction: Prediction, index: int) -> dict[str, float]:
    forward, lateral, yaw, _ = (float(value) for value in prediction.mean[index])
    survival = float(prediction.survival[index])
    return {"forward": forward, "lateral": lateral, "yaw": yaw, "survival": survival}


def _seed(*address: int) -> int:
    """One seed for a library that takes no address."""
    return int(np.random.SeedSequence(address).generate_state(1)[0])
