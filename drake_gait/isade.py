"""ISADE: improved self-adaptive differential evolution, with bounds, constraints and whole numbers.

The optimiser of the paper's section IV.B (Eqs. 22-28), as a function and as ask / tell:

    result = minimize(cost, bounds, constraints=violation, vectorized=True)

    optimiser = Isade(bounds, seed=1, max_generations=500)
    for _ in range(500):
        trials = optimiser.ask()                          # shape (n, d)
        optimiser.tell(cost(trials), violation(trials))   # shapes (n,) and (n, m)
    print(optimiser.best_x, optimiser.best_cost)

The random numbers of a generation come from `default_rng([seed, generation])`, so the seed fixes
the run and the small `state()` continues it exactly. docs/isade.md tells how each constant was
chosen and how the optimiser compares with others.
"""

from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult

from drake_gait.errors import SettingsError

Array = NDArray[np.float64]

RANK_STEEPNESS = 10.0  # alpha
SCALE_RANGE = (0.15, 1.55)  # F_min, F_max
EXPONENT_RANGE = (0.2, 6.0)  # n_min, n_max
CROSSOVER_RATES = (0.05, 0.5, 0.95)  # Cr_min, Cr_medium, Cr_max
REDRAW_PROBABILITY = 0.1  # tau
DECIMALS = 9  # of F: exp and power differ in the last bit from machine to machine

EPSILON_QUANTILE, EPSILON_UNTIL, EPSILON_POWER = 0.2, 0.3, 5.0
"""Level at first, as a quantile of the first violations; when it is zero, as a part of the run."""

VARIANTS = ("paper",)
HANDLINGS = ("feasibility", "epsilon", "penalty")
PENDING = ("_trials", "_trial_rates")
"""What lives from `ask` to `tell` only."""


# --- the equations -------------------------------------------------------------------------------


def rank_scale(size: int) -> Array:
    """Scale F of the individuals ranked 1 (best) to `size`, shape (size,): the best moves most."""
    rank = np.arange(1, size + 1)
    scale = 1.0 / (1.0 + np.exp(RANK_STEEPNESS * (rank - size / 2.0) / size))  # Eq. 23
    return np.round(scale, DECIMALS)


def mean_scale(generation: int, max_generations: int) -> float:
    """Scale F shared by a generation: F_max at first, F_min from `max_generations` on."""
    progress = min(generation / max_generations, 1.0)
    low, high = EXPONENT_RANGE
    exponent = low + (high - low) * progress  # Eq. 25
    low, high = SCALE_RANGE
    scale = low + (high - low) * (1.0 - progress) ** exponent  # Eq. 24
    return float(np.round(scale, DECIMALS))


def donors(
    x: Array, best: Array, scale: Array, scheme: NDArray[np.int64], others: NDArray[np.intp]
) -> Array:
    """Donor of every individual, shape (n, d).

    Args:
        x: Population, shape (n, d).
        best: Best individual, shape (d,).
        scale: F of every individual, shape (n, 1).
        scheme: 0, 1 or 2 for Eq. 22a, 22b or 22c, shape (n, 1).
        others: Indices of four individuals for each, shape (4, n).
    """
    x1, x2, x3, x4 = x[others]
    best_1 = best + scale * (x1 - x2)  # Eq. 22a
    best_2 = best_1 + scale * (x3 - x4)  # Eq. 22b
    rand_to_best_1 = x1 + scale * (best - x1) + scale * (x2 - x3)  # Eq. 22c
    donor: Array = np.where(scheme == 0, best_1, np.where(scheme == 1, best_2, rand_to_best_1))
    return donor


def redrawn_rates(
    rates: Array, rng: np.random.Generator, *, probability: float = REDRAW_PROBABILITY
) -> Array:
    """Next crossover rates, shape (n,): few are redrawn, and a redrawn one is low or high."""
    low, medium, high = CROSSOVER_RATES
    redraw = rng.random(len(rates)) < probability  # Eq. 27
    drawn = np.where(rng.random(len(rates)) < medium, low, high)  # Eq. 28
    return np.where(redraw, drawn, rates)


def draw_others(size: int, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """For each of `size` individuals `count` different others, uniformly, shape (count, size)."""
    # Everybody takes a random seat in a ring; the others sit at the same random distances from all.
    seat = rng.permutation(size)
    seated = np.argsort(seat)
    distance = 1 + rng.permutation(size - 1)[:count, None]
    others: NDArray[np.intp] = seated[(seat + distance) % size]
    return others


# --- ask and tell --------------------------------------------------------------------------------


class Isade:
    """ISADE by ask and tell.

    Args:
        bounds: Lower and upper bound of every variable, shape (d, 2).
        population_size: Individuals n, at least 5; clip(5 d, 40, 60) if not given.
        seed: Fixes every random number, at least 0.
        max_generations: Generation at which the shared scale (Eq. 24) has come down to F_min.
        integrality: Which variables are whole numbers, shape (d,).
        variant: "paper".
        handling: How constraints count. "feasibility": a feasible point beats an infeasible one, a
            smaller violation a larger one, and between equals the cost decides. "epsilon": the
            same, but a violation below a level that shrinks to zero counts as none; for equality
            constraints. "penalty": cost + penalty x sum of violations, the paper's form (Eq. 10).
        penalty: The weight (gamma) of "penalty".
        initial: Points that open the first population, shape (k, d) with k <= n.

    Raises:
        SettingsError: A value above cannot be used.
    """

    generation: int
    """Generations told so far; 0 is the random first population."""
    best_x: Array
    """Best point told so far by the rules of feasibility, shape (d,)."""
    best_cost: float
    """Its cost; infinite before the first `tell`."""
    best_violation: Array
    """Its violations, 0 where satisfied, shape (m,)."""

    def __init__(
        self,
        bounds: ArrayLike,
        *,
        population_size: int | None = None,
        seed: int = 0,
        max_generations: int = 1000,
        integrality: ArrayLike | None = None,
        variant: str = "paper",
        handling: str = "feasibility",
        penalty: float = 1000.0,
        initial: ArrayLike | None = None,
    ) -> None:
        self.bounds = _checked_bounds(bounds)
        d = len(self.bounds)
        self.population_size = _checked_size(population_size, d)
        self.seed = _at_least("seed", seed, 0)
        self.max_generations = _at_least("max_generations", max_generations, 1)
        self.integrality = _checked_integrality(integrality, self.bounds)
        self.variant = _one_of("variant", variant, VARIANTS)
        self.handling = _one_of("handling", handling, HANDLINGS)
        if not 0.0 < penalty < np.inf:
            raise SettingsError(f"penalty must be finite and > 0, got {penalty}")
        self.penalty = float(penalty)
        self.generation = 0
        self.best_x = np.full(d, np.nan)
        self.best_cost = np.inf
        self.best_violation = np.empty(0)
        # A whole number k owns [k - 1/2, k + 1/2): differences below one keep their meaning.
        half = np.where(self.integrality, 0.5, 0.0)
        self._lower = np.where(self.integrality, np.ceil(self.bounds[:, 0]), self.bounds[:, 0])
        self._upper = np.where(self.integrality, np.floor(self.bounds[:, 1]), self.bounds[:, 1])
        self._lower, self._upper = self._lower - half, self._upper + half
        rng = np.random.default_rng([self.seed, 0])
        n = self.population_size
        self._x = rng.uniform(self._lower, self._upper, (n, d))
        self._rates = redrawn_rates(np.full(n, np.nan), rng, probability=1.0)
        self._place(initial)
        self._costs = np.full(n, np.inf)
        self._violations = np.empty((n, 0))
        self._violation_scale = np.empty(0)
        self._epsilon = 0.0
        self._rank_scale = rank_scale(n)
        self._trials: Array | None = None
        self._trial_rates = self._rates

    @property
    def population(self) -> Array:
        """The individuals, whole numbers rounded, shape (n, d)."""
        return self._decode(self._x)

    @property
    def costs(self) -> Array:
        """Their costs, shape (n,); infinite before the first `tell`."""
        return self._costs.copy()

    def ask(self) -> Array:
        """The next trials, shape (n, d), inside the bounds; the first are the random population.

        Raises:
            SettingsError: The last trials have not been told.
        """
        if self._trials is not None:
            raise SettingsError("ask() called twice; tell() the costs of the last trials first")
        self._trials = self._x if self.generation == 0 else self._next_trials()
        return self._decode(self._trials)

    def tell(self, costs: ArrayLike, violations: ArrayLike | None = None) -> None:
        """Take the costs of the trials that `ask` gave; a trial replaces its parent if not worse.

        Args:
            costs: Costs in the order of the trials, shape (n,); one that is not finite loses.
            violations: How far each constraint is exceeded, satisfied at or below 0, shape (n, m)
                or (n,). The same m every time; None if there is no constraint.

        Raises:
            SettingsError: No trials are waiting, or a shape does not fit.
        """
        if self._trials is None:
            raise SettingsError("tell() called before ask(); ask() for trials first")
        cost = _finite_or_inf(costs)
        if cost.shape != (len(self._trials),):
            raise SettingsError(f"costs must be ({len(self._trials)},) in shape, got {cost.shape}")
        violation = self._checked_violations(violations)
        if self.generation == 0:
            self._costs, self._violations = cost, violation
            self._start_constraints()
        else:
            old, old_excess = self._merit(self._costs, self._violations)
            new, new_excess = self._merit(cost, violation)
            won = (new_excess < old_excess) | ((new_excess == old_excess) & (new <= old))
            self._x[won] = self._trials[won]
            self._costs[won] = cost[won]
            self._violations[won] = violation[won]
            self._rates[won] = self._trial_rates[won]
        self._keep_best(self._trials, cost, violation)
        self._trials = None
        self.generation += 1

    def state(self) -> dict[str, Any]:
        """All that continues the run, as arrays, numbers and strings: `numpy.savez` can keep it.

        Trials that were asked and not told are left out: `ask` gives them again.
        """
        return {
            name: np.copy(value)[()] for name, value in vars(self).items() if name not in PENDING
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """The optimiser that `state` was taken from, to continue as if never interrupted.

        Raises:
            SettingsError: The entries are not those of `state`.
        """
        self = cls([(0.0, 1.0)])
        if wrong := sorted(self.state().keys() ^ state.keys()):
            raise SettingsError(f"state lacks or has too many: {', '.join(wrong)}; pass state()")
        for name, value in state.items():
            setattr(self, name, np.copy(value)[()])
        return self

    def _next_trials(self) -> Array:
        rng = np.random.default_rng([self.seed, self.generation])
        n, d = self._x.shape
        cost, excess = self._merit(self._costs, self._violations)
        order = np.lexsort((cost, excess))
        scale = np.empty((n, 1))
        shared = mean_scale(self.generation, self.max_generations)
        scale[order, 0] = (self._rank_scale + shared) / 2.0  # Eq. 26
        scheme = rng.integers(3, size=(n, 1))
        donor = donors(self._x, self._x[order[0]], scale, scheme, draw_others(n, 4, rng))
        self._trial_rates = redrawn_rates(self._rates, rng)
        crossed = rng.random((n, d)) < self._trial_rates[:, None]
        crossed[np.arange(n), rng.integers(d, size=n)] = True
        return self._repair(np.where(crossed, donor, self._x))

    def _repair(self, trials: Array) -> Array:
        """Put what left the box half-way between the parent and the bound that it crossed."""
        trials = np.where(trials < self._lower, (self._lower + self._x) / 2.0, trials)
        return np.where(trials > self._upper, (self._upper + self._x) / 2.0, trials)

    def _decode(self, x: Array) -> Array:
        if not self.integrality.any():
            return x.copy()
        # The upper end of the last whole number's interval rounds up, out of the box.
        whole = np.clip(np.rint(x), self._lower + 0.5, self._upper - 0.5)
        return np.where(self.integrality, whole, x)

    def _merit(self, costs: Array, violations: Array) -> tuple[Array, Array]:
        """What selection compares: first the excess, then the cost, both shape (n,)."""
        if self.handling == "penalty":
            return costs + self.penalty * violations.sum(1), np.zeros(len(costs))  # Eq. 10
        excess = (violations / self._violation_scale).sum(1)
        if self.handling == "epsilon":
            excess[excess <= self._epsilon_level()] = 0.0
        return costs, excess

    def _epsilon_level(self) -> float:
        left: float = 1.0 - self.generation / (EPSILON_UNTIL * self.max_generations)
        return float(self._epsilon * max(left, 0.0) ** EPSILON_POWER)

    def _start_constraints(self) -> None:
        # Constraints differ in unit: each is measured by the first population's largest violation.
        finite = np.where(np.isfinite(self._violations), self._violations, 0.0)
        largest = finite.max(0)
        self._violation_scale = np.where(largest > 0.0, largest, 1.0)
        excess = np.sort((self._violations / self._violation_scale).sum(1))
        level = excess[int(EPSILON_QUANTILE * len(excess))]
        self._epsilon = float(level) if np.isfinite(level) else 0.0
        self.best_violation = np.full(len(largest), np.inf)

    def _keep_best(self, x: Array, cost: Array, violation: Array) -> None:
        excess = (violation / self._violation_scale).sum(1)
        i = np.lexsort((cost, excess))[0]
        best_excess = (self.best_violation / self._violation_scale).sum()
        better = (excess[i], cost[i]) < (best_excess, self.best_cost)
        if better or self.generation == 0:
            self.best_x = self._decode(x[i])
            self.best_cost = float(cost[i])
            self.best_violation = violation[i]

    def _checked_violations(self, violations: ArrayLike | None) -> Array:
        n = len(self._x)
        violation = np.empty((n, 0)) if violations is None else _finite_or_inf(violations)
        violation = np.maximum(violation, 0.0)
        if violation.ndim == 1:
            violation = violation[:, None]
        m = self._violations.shape[1] if self.generation else violation.shape[-1]
        if violation.shape != (n, m):
            raise SettingsError(f"violations must be ({n}, {m}) in shape, got {violation.shape}")
        return violation

    def _place(self, initial: ArrayLike | None) -> None:
        if initial is None:
            return
        n, d = self._x.shape
        points = np.asarray(initial, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != d or len(points) > n:
            raise SettingsError(
                f"initial must be (k, {d}) in shape with k <= {n}, got {points.shape}"
            )
        if not ((self._lower <= points) & (points <= self._upper)).all():
            raise SettingsError("initial has a point outside the bounds; clip it first")
        self._x[: len(points)] = points


# --- minimize ------------------------------------------------------------------------------------


def minimize(
    fun: Callable[[Array], Any],
    bounds: ArrayLike,
    *,
    constraints: Callable[[Array], Any] | None = None,
    seed: int = 0,
    max_evaluations: int = 30_000,
    population_size: int | None = None,
    max_iterations: int | None = None,
    stagnation: int | None = None,
    vectorized: bool = False,
    integrality: ArrayLike | None = None,
    callback: Callable[[OptimizeResult], Any] | None = None,
    variant: str = "paper",
    handling: str = "feasibility",
    penalty: float = 1000.0,
    initial: ArrayLike | None = None,
) -> OptimizeResult:
    """Minimise `fun` inside `bounds`, subject to `constraints(x) <= 0`.

    Args:
        fun: Cost of x, shape (d,); with `vectorized` the costs, shape (n,), of x, shape (n, d).
        bounds: Lower and upper bound of every variable, shape (d, 2).
        constraints: Values g, shape (m,), satisfied where g <= 0; shape (n, m) with `vectorized`.
        seed: Fixes the run.
        max_evaluations: Calls of `fun` at most, for single points; whole generations are made.
        population_size: As `Isade`; so are `integrality` to `initial`.
        max_iterations: Generations after the first population at most. The paper stops at 1000.
        stagnation: Stop after so many generations without a better point. The paper stops at 50.
        vectorized: Whether `fun` and `constraints` take a whole generation at once.
        integrality: Which variables are whole numbers, shape (d,).
        callback: Called with the result so far after every generation; stops the run by truth.
        variant: Form of the algorithm.
        handling: How constraints count.
        penalty: Weight of violations for "penalty".
        initial: Points that open the first population, shape (k, d).

    Returns:
        x, fun, maxcv (largest violation of x), nfev, nit, success (x is feasible and its cost
        finite), message, population (n, d) and population_energies (n,).

    Raises:
        SettingsError: A setting cannot be used, or `fun` or `constraints` return a wrong shape.
    """
    size = _checked_size(population_size, len(_checked_bounds(bounds)))
    generations = _at_least("max_evaluations", max_evaluations, 2 * size) // size - 1
    if max_iterations is not None:
        generations = min(generations, _at_least("max_iterations", max_iterations, 1))
    if stagnation is not None:
        _at_least("stagnation", stagnation, 1)
    optimiser = Isade(
        bounds,
        population_size=size,
        seed=seed,
        max_generations=generations,
        integrality=integrality,
        variant=variant,
        handling=handling,
        penalty=penalty,
        initial=initial,
    )
    evaluations, idle = 0, 0
    while True:
        trials, best = optimiser.ask(), optimiser.best_x
        optimiser.tell(
            fun(trials) if vectorized else [fun(x) for x in trials],
            constraints
            and (constraints(trials) if vectorized else [constraints(x) for x in trials]),
        )
        evaluations += len(trials)
        idle = idle + 1 if optimiser.best_x is best else 0
        message = ""
        if optimiser.generation > generations:
            message = "The budget of evaluations or iterations is spent."
        elif idle == stagnation:
            message = f"No better point in {stagnation} generations."
        result = _result(optimiser, evaluations, message)
        if callback is not None and callback(result):
            result.message = message = message or "The callback stopped the run."
        if message:
            return result


def _result(optimiser: Isade, evaluations: int, message: str) -> OptimizeResult:
    largest = float(optimiser.best_violation.max(initial=0.0))
    return OptimizeResult(
        x=optimiser.best_x.copy(),
        fun=optimiser.best_cost,
        maxcv=largest,
        nfev=evaluations,
        nit=optimiser.generation - 1,
        success=bool(largest == 0.0 and np.isfinite(optimiser.best_cost)),
        message=message,
        population=optimiser.population,
        population_energies=optimiser.costs,
    )


# --- checks --------------------------------------------------------------------------------------


def _finite_or_inf(values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    array[~np.isfinite(array)] = np.inf
    return array


def _at_least(name: str, value: int, least: int) -> int:
    if isinstance(value, float) or not value >= least:
        raise SettingsError(f"{name} must be a whole number of at least {least}, got {value}")
    return int(value)


def _one_of(name: str, value: str, known: tuple[str, ...]) -> str:
    if value not in known:
        raise SettingsError(f"no {name} {value!r}; there are {', '.join(known)}")
    return str(value)


def _checked_size(population_size: int | None, d: int) -> int:
    if population_size is None:
        return min(max(5 * d, 40), 60)
    return _at_least("population_size", population_size, 5)


def _checked_bounds(bounds: ArrayLike) -> Array:
    box = np.array(bounds, dtype=np.float64)
    if box.ndim != 2 or box.shape[1] != 2 or len(box) == 0:
        raise SettingsError(f"bounds must be (d, 2) in shape with d > 0, got {box.shape}")
    for i, (lower, upper) in enumerate(box):
        if not -np.inf < lower < upper < np.inf:
            raise SettingsError(f"bounds of variable {i} must be finite, lower < upper: {box[i]}")
    return box


def _checked_integrality(integrality: ArrayLike | None, bounds: Array) -> NDArray[np.bool_]:
    whole = np.zeros(len(bounds), np.bool_)
    if integrality is not None:
        whole = np.array(integrality, dtype=np.bool_)
    if whole.shape != (len(bounds),):
        raise SettingsError(f"integrality must be ({len(bounds)},) in shape, got {whole.shape}")
    for i in np.flatnonzero(whole & (np.ceil(bounds[:, 0]) > np.floor(bounds[:, 1]))):
        raise SettingsError(f"bounds of variable {i} hold no whole number: {bounds[i]}")
    return whole
