"""ISADE: improved self-adaptive differential evolution, with bounds, constraints and whole numbers.

The optimiser of the paper's section IV.B (Eqs. 22-28), as a function and as ask / tell:

    result = minimize(cost, bounds, constraints=violation, vectorized=True)

    optimiser = Isade(bounds, seed=1, max_generations=500)
    while optimiser.generation <= 500:
        trials = optimiser.ask()                          # shape (n, d)
        optimiser.tell(cost(trials), violation(trials))   # shapes (n,) and (n, m)
    print(optimiser.best_x, optimiser.best_cost)

The random numbers of a generation have the address (seed, generation), so the seed fixes the run
and the small `state()` continues it exactly.
docs/explanation/isade.md has the choice of every constant
and the comparison of both variants with other optimisers.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult

from drake_gait.errors import SettingsError
from drake_gait.optimizers import _selection as selection
from drake_gait.optimizers import _variation as variation
from drake_gait.optimizers._box import Box

Array = NDArray[np.float64]

VARIANTS = ("paper", "history")
HANDLINGS = ("epsilon", "feasibility", "penalty")

AXES_AGE = 10  # generations until the principal axes of "history" are found anew
JUMP = 0x9E3779B97F4A7C15F39CC0605CEDC835  # as PCG64.jumped, which takes ten times as long
UNSAVED = ("_bits", "_rng", "_trial", "_box")  # beginnings of names: made anew from the rest


class Isade:
    """ISADE by ask and tell.

    Args:
        bounds: Lower and upper bound of every variable, shape (d, 2).
        population_size: Individuals n, at least 5; clip(5 d, 40, 60) if not given, and
            clip(10 d, 60, 150) for "history".
        seed: Fixes every random number, at least 0.
        max_generations: Generation at which the shared scale (Eq. 24) has come down to F_min, the
            epsilon has long been zero, and the population of "history" has shrunk to 5.
        integrality: Which variables are whole numbers, shape (d,).
        variant: "paper", or "history": F and Cr drawn about those that lately succeeded, any of
            the best 11 percent in the place of the best, differences with parents that lost their
            place, a shrinking population, and crossover along principal axes as far as it pays.
        handling: How constraints count. "feasibility": a feasible point beats an infeasible one, a
            smaller violation a larger one, and between equals the cost decides. "epsilon": the
            same, but if no first point meets some constraint, as with an equality, violations
            below a level that shrinks to zero count as none. "penalty": cost + penalty x sum of
            violations, the paper's form.
        penalty: The weight gamma of "penalty".
        initial: Points that open the first population, shape (k, d) with k <= n.

    Attributes:
        generation: Generations told so far; the first are random points.
        best_x: Best point told so far by the rules of feasibility, shape (d,).
        best_cost: Its cost.
        best_violation: Its violations, 0 where satisfied, shape (m,).

    Raises:
        SettingsError: A value above cannot be used.
    """

    def __init__(
        self,
        bounds: ArrayLike,
        *,
        population_size: int | None = None,
        seed: int = 0,
        max_generations: int = 1000,
        integrality: ArrayLike | None = None,
        variant: str = "paper",
        handling: str = "epsilon",
        penalty: float = 1000.0,
        initial: ArrayLike | None = None,
    ) -> None:
        self._box = Box(bounds, integrality)
        self.bounds, self.integrality = self._box.bounds, self._box.integrality
        self.variant = _one_of("variant", variant, VARIANTS)
        self.handling = _one_of("handling", handling, HANDLINGS)
        self.population_size = _checked_size(population_size, len(self.bounds), variant)
        self.seed = _at_least("seed", seed, 0)
        self.max_generations = _at_least("max_generations", max_generations, 1)
        if not 0.0 < penalty < np.inf:
            raise SettingsError(f"penalty must be finite and > 0, got {penalty}")
        self.penalty = float(penalty)
        self._bits = np.random.PCG64(self.seed)
        self._bits_start = self._bits.state
        self._rng = np.random.Generator(self._bits)
        n, d = self.population_size, len(self.bounds)
        self._x = self._box.random(n, self._rng)
        self._rates = variation.next_rates(np.empty(n), np.zeros(n), self._rng.random(n))
        if initial is not None:
            points = self._box.checked(initial, n)
            self._x[: len(points)] = points
        self.generation = 0
        self.best_x, self.best_cost, self.best_violation = np.full(d, np.nan), np.inf, np.empty(0)
        self._best_excess = np.inf
        self._costs, self._excess = np.full(n, np.inf), np.full(n, np.inf)
        self._unit = np.empty(0)
        self._first_level = 0.0
        self._archive = np.empty((0, d))
        self._memory = np.full((3, variation.MEMORY_SIZE), 0.5)
        self._trials: Array | None = None
        self._axes = np.eye(d)
        self._trial_rates = self._trial_scale = np.empty(0)
        self._trial_turned = np.empty(0, np.bool_)

    @property
    def population(self) -> Array:
        """The individuals, shape (n, d)."""
        return self._box.decode(self._x)

    @property
    def costs(self) -> Array:
        """Their costs, shape (n,); infinite before the first `tell`."""
        return self._costs.copy()

    def ask(self) -> Array:
        """The next trials, shape (n, d), inside the bounds; the first are random points.

        Raises:
            SettingsError: The last trials have not been told.
        """
        if self._trials is not None:
            raise SettingsError("ask() called twice; tell() the costs of the last trials first")
        if self.generation == 0:
            self._trials, self._trial_rates = self._x, self._rates
        else:
            self._trials = self._next_trials()
        return self._box.decode(self._trials)

    def tell(self, costs: ArrayLike, violations: ArrayLike | None = None) -> None:
        """Take the costs of the trials that `ask` gave; one that is not worse replaces its parent.

        Args:
            costs: Costs in the order of the trials, shape (n,); one that is not finite loses.
            violations: How far each constraint is exceeded, satisfied at or below 0, shape (n, m)
                or (n,). The same m every time; None if there is no constraint.

        Raises:
            SettingsError: No trials are waiting, or a shape does not fit.
        """
        if self._trials is None:
            raise SettingsError("tell() called before ask(); ask() for trials first")
        cost = np.array(costs, dtype=np.float64)
        cost[~np.isfinite(cost)] = np.inf
        if cost.shape != (len(self._x),):
            raise SettingsError(f"costs must be ({len(self._x)},) in shape, got {cost.shape}")
        m = len(self._unit) if self.generation else None
        violation = selection.violations_of(violations, len(cost), m)
        if self.generation == 0:
            raw = self.handling == "penalty"
            self._unit = (
                np.ones(violation.shape[1]) if raw else selection.constraint_units(violation)
            )
        excess = (violation / self._unit).sum(1) if len(self._unit) else np.zeros(len(cost))
        if self.generation == 0 and self.handling == "epsilon":
            self._first_level = selection.first_epsilon(violation, excess)
        old, new = self._merit(self._excess, self._costs), self._merit(excess, cost)
        if self.variant == "history" and self.generation > 0:
            self._remember(selection.beats(*new, *old))
        won = ~selection.beats(*old, *new)
        np.copyto(self._x, self._trials, where=won[:, None])
        self._costs[won], self._excess[won] = cost[won], excess[won]
        self._rates[won] = self._trial_rates[won]
        first = np.lexsort((cost, excess))[0]
        found = (float(excess[first]), float(cost[first]))
        if found < (self._best_excess, self.best_cost) or self.generation == 0:
            self._best_excess, self.best_cost = found
            self.best_x = self._box.decode(self._trials[first])
            self.best_violation = violation[first]
        self._trials = None
        self.generation += 1
        if self.variant == "history":
            self._shrink()

    def state(self) -> dict[str, Any]:
        """All that continues the run, as arrays, numbers and strings: `numpy.savez` can keep it.

        Trials that were asked and not told are left out: `ask` gives them again.
        """
        return {
            name: np.copy(value)[()]
            for name, value in vars(self).items()
            if not name.startswith(UNSAVED)
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """The optimiser that `state` was taken from, to continue as if never interrupted.

        Raises:
            SettingsError: The entries are not those of `state`.
        """
        self = cls([(0.0, 1.0)], seed=int(state.get("seed", 0)))
        if wrong := sorted(self.state().keys() ^ state.keys()):
            raise SettingsError(f"not what state() returned; look at {', '.join(wrong)}")
        for name, value in state.items():
            array = np.array(value)
            setattr(self, name, array if array.ndim else array.item())
        self._box = Box(self.bounds, self.integrality)
        return self

    def _next_trials(self) -> Array:
        rng = self._addressed_rng()
        x, (n, d) = self._x, self._x.shape
        order = self._order()
        uniform = rng.random((n, d + 5))
        scheme, forced, redraw, draw, seat = uniform[:, d:].T
        others = variation.neighbours(seat)
        points, best = x, order[0]
        if self.variant == "paper":
            scale = variation.scales(order, self.generation, self.max_generations)
            rates = variation.next_rates(self._rates, redraw, draw)
        else:
            best = variation.drawn_elite(order, rng)
            points = np.concatenate((x, self._archive))
            stored = rng.integers(len(points), size=n)
            others[1] = np.where(stored < n, others[1], stored)
            scale, rates, turning = variation.drawn_scales_and_rates(self._memory, n, rng)
        choice = (3.0 * scheme).astype(np.intp)  # Eqs. 22a-c, one third each
        donor = variation.donors(points, best, others, choice, scale)
        crossed = uniform[:, :d] < rates[:, None]
        crossed[np.arange(n), (d * forced).astype(np.intp)] = True
        trials = x.copy()
        np.copyto(trials, donor, where=crossed)
        if self.variant == "history":
            width = self._box.upper - self._box.lower
            if self.generation % AXES_AGE == 1:
                self._axes = variation.principal_axes(x[order[: n // 2]] / width)
            turned = draw < turning
            trials[turned] = variation.crossed_along(
                self._axes, x[turned], donor[turned], crossed[turned], width
            )
            self._trial_turned = turned
        self._trial_scale, self._trial_rates = scale, rates
        return self._box.half_way_back(trials, x)

    def _addressed_rng(self) -> np.random.Generator:
        """The random numbers of this generation, at its own place in the seed's stream."""
        self._bits.state = self._bits_start
        self._bits.advance(self.generation * JUMP)
        return self._rng

    def _order(self) -> NDArray[np.intp]:
        """Indices of the individuals from best to worst, shape (n,)."""
        excess, cost = self._merit(self._excess, self._costs)
        return np.lexsort((cost, excess))

    def _merit(self, excess: Array, costs: Array) -> tuple[Array, Array]:
        """What selection compares, the excess before the cost; both of shape (n,)."""
        if self.handling == "penalty":
            return np.zeros(len(costs)), costs + self.penalty * excess
        level = selection.epsilon(self._first_level, self.generation, self.max_generations)
        return (np.where(excess <= level, 0.0, excess) if level > 0.0 else excess), costs

    def _remember(self, better: NDArray[np.bool_]) -> None:
        """Learn from the trials that beat their parents; archive those parents."""
        if better.any():
            self._memory[:, self.generation % variation.MEMORY_SIZE] = variation.remembered(
                self._trial_scale, self._trial_rates, self._trial_turned, better
            )
            self._archive = np.concatenate((self._archive, self._x[better]))

    def _shrink(self) -> None:
        """Drop the worst individuals, and the oldest of the archive, as n falls."""
        n = variation.shrunken_size(self.population_size, self.generation, self.max_generations)
        if n < len(self._x):
            keep = np.sort(self._order()[:n])
            self._x, self._rates = self._x[keep], self._rates[keep]
            self._costs, self._excess = self._costs[keep], self._excess[keep]
        self._archive = self._archive[-n:]


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
    handling: str = "epsilon",
    penalty: float = 1000.0,
    initial: ArrayLike | None = None,
) -> OptimizeResult:
    """Minimise `fun` inside `bounds`, subject to `constraints(x) <= 0`; `Isade` says more.

    Args:
        fun: Cost of x, shape (d,); with `vectorized` the costs, shape (n,), of x, shape (n, d).
        bounds: Lower and upper bound of every variable, shape (d, 2).
        constraints: Values g, shape (m,), satisfied where g <= 0; shape (n, m) with `vectorized`.
        seed: Fixes the run.
        max_evaluations: Calls of `fun` at most, for single points; whole generations are made.
        population_size: Individuals.
        max_iterations: Generations after the first population at most; the paper's are 1000.
        stagnation: Stop after so many generations without a better point; the paper's are 50.
        vectorized: Whether `fun` and `constraints` take a whole generation at once.
        callback: Called with the result so far after every generation; stops the run by truth.
        integrality: Which variables are whole numbers, shape (d,).
        variant: Form of the algorithm: "paper" or "history".
        handling: How constraints count: "epsilon", "feasibility" or "penalty".
        penalty: Weight of violations for "penalty".
        initial: Points that open the first population, shape (k, d).

    Returns:
        x, fun, maxcv (largest violation of x), nfev, nit, success (x is feasible and its cost
        finite), message, population (n, d) and population_energies (n,).

    Raises:
        SettingsError: A setting cannot be used, or `fun` or `constraints` return a wrong shape.
    """
    _one_of("variant", variant, VARIANTS)
    size = _checked_size(population_size, len(Box(bounds).bounds), variant)
    _at_least("max_evaluations", max_evaluations, 2 * size)
    last = variation.LEAST_SIZE if variant == "history" else size
    generations = 2 * max_evaluations // (size + last) - 1
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


def _at_least(name: str, value: int, least: int) -> int:
    if isinstance(value, float) or not value >= least:
        raise SettingsError(f"{name} must be a whole number of at least {least}, got {value}")
    return int(value)


def _one_of(name: str, value: str, known: Iterable[str]) -> str:
    if value not in known:
        raise SettingsError(f"no {name} {value!r}; there are {', '.join(known)}")
    return str(value)


def _checked_size(population_size: int | None, d: int, variant: str) -> int:
    if population_size is None:
        return min(max(5 * d, 40), 60) if variant == "paper" else min(max(10 * d, 60), 150)
    return _at_least("population_size", population_size, variation.LEAST_SIZE)
