"""ISADE: improved self-adaptive differential evolution, with bounds, constraints and whole numbers.

The optimiser of the paper's section IV.B (Eqs. 22-28), as a function and as ask / tell:

    result = minimize(cost, bounds, constraints=violation, vectorized=True)

    optimiser = Isade(bounds, seed=1, max_generations=500)
    while optimiser.generation <= 500:
        trials = optimiser.ask()                          # shape (n, d)
        optimiser.tell(cost(trials), violation(trials))   # shapes (n,) and (n, m)
    print(optimiser.best_x, optimiser.best_cost)

The random numbers of a generation have the address (seed, generation), so the seed fixes the run
and the small `state()` continues it exactly. docs/isade.md has the choice of every constant
and the comparison of both variants with other optimisers.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult

from drake_gait.errors import SettingsError

Array = NDArray[np.float64]

VARIANTS = ("paper", "history")
HANDLINGS = ("epsilon", "feasibility", "penalty")
LEAST_SIZE = 5  # four different others for each individual

RANK_STEEPNESS = 10.0  # alpha
SCALE_RANGE = (0.15, 1.55)  # F_min, F_max
EXPONENT_RANGE = (0.2, 5.0)  # n_min, n_max
SCHEMES = np.array(
    [  # of best, r1, r2, r3, r4: origin + F (second - third) + F (fourth - fifth)
        (0, 1, 2, 3, 3),  # Eq. 22a, best/1
        (0, 1, 2, 3, 4),  # Eq. 22b, best/2
        (1, 0, 1, 3, 2),  # Eq. 22c, rand-to-best/1; r2 is always subtracted, for "history"
    ]
).T
NEXT_SEATS = np.arange(1, 5)[:, None]
CROSSOVER_RATES = (0.05, 0.5, 0.95)  # Cr_min, Cr_medium, Cr_max
REDRAW_PROBABILITY = 0.1  # tau
JUMP = 0x9E3779B97F4A7C15F39CC0605CEDC835  # as PCG64.jumped, which takes ten times as long
UNSAVED = ("_bits", "_rng", "_trial")  # beginnings of names: made anew from the rest
DECIMALS = 9  # of F: exp and power differ in their last bit from machine to machine

EPSILON_QUANTILE = 0.2  # of the first violations: the level at the start
EPSILON_UNTIL = 0.3  # of the generations: the level is zero from here on
EPSILON_POWER = 5.0

MEMORY_SIZE = 6  # "history" only, from here on
ELITE = 0.11  # part of the population that takes the place of the best
SPREAD = 0.1  # of F and Cr about what the memory holds
TURNED_RANGE = (0.1, 0.9)  # part of the trials crossed along the population's principal axes
AXES_AGE = 10  # generations until the principal axes are found anew


# --- the equations -------------------------------------------------------------------------------


@cache
def rank_scale(size: int) -> Array:
    """Scale F of the individuals ranked 1 (best) to `size`, shape (size,): the best moves most."""
    rank = np.arange(1, size + 1)
    scale = 1.0 / (1.0 + np.exp(RANK_STEEPNESS * (rank - size / 2.0) / size))  # Eq. 23
    scale = np.round(scale, DECIMALS)
    scale.setflags(write=False)  # it is shared
    return scale


def mean_scale(generation: int, max_generations: int) -> float:
    """Scale F shared by a generation: F_max at first, F_min from `max_generations` on."""
    progress = min(generation / max_generations, 1.0)
    low, high = EXPONENT_RANGE
    exponent = low + (high - low) * progress  # Eq. 25
    low, high = SCALE_RANGE
    scale: float = low + (high - low) * (1.0 - progress) ** exponent  # Eq. 24
    return round(scale, DECIMALS)


def donors(
    x: Array,
    best: NDArray[np.intp] | np.intp,
    others: NDArray[np.intp],
    scheme: NDArray[np.intp],
    scale: Array,
) -> Array:
    """Donor of every individual, shape (n, d), as a row of `SCHEMES` makes it.

    Args:
        x: Points, shape (k, d).
        best: Index of the best point, or one such index for each individual, shape (n,).
        others: Indices of four other points for each individual, shape (4, n).
        scheme: Row of `SCHEMES` for each individual, shape (n,).
        scale: F of each individual, shape (n,).
    """
    n = len(scale)
    cast = np.empty((5, n), np.intp)
    cast[0], cast[1:] = best, others
    chosen = cast[SCHEMES.take(scheme, axis=1), np.arange(n)]
    origin, plus_1, minus_1, plus_2, minus_2 = x.take(chosen, axis=0)
    step = plus_1 - minus_1
    step += plus_2 - minus_2
    step *= scale[:, None]
    donor: Array = origin + step  # Eq. 22
    return donor


def principal_axes(x: Array) -> Array:
    """Directions in which points spread independently, as columns, shape (d, d)."""
    centred = x - x.mean(0)
    axes: Array = np.linalg.eigh(centred.T @ centred).eigenvectors
    return axes


def next_rates(rates: Array, redraw: Array, draw: Array) -> Array:
    """Next crossover rates from two uniform draws each, shape (n,): a few become low or high."""
    low, medium, high = CROSSOVER_RATES
    drawn = np.where(draw < medium, low, high)  # Eq. 28
    return np.where(redraw < REDRAW_PROBABILITY, drawn, rates)  # Eq. 27


def neighbours(draw: Array) -> NDArray[np.intp]:
    """For each of n individuals four different others, any four alike, shape (4, n).

    Args:
        draw: A uniform draw for each, shape (n,): their order around a ring.
    """
    seated = draw.argsort()
    seat = seated.argsort()
    others: NDArray[np.intp] = seated.take(seat + NEXT_SEATS, mode="wrap")
    return others


# --- ask and tell --------------------------------------------------------------------------------


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
        self.bounds = _checked_bounds(bounds)
        self.variant = _one_of("variant", variant, VARIANTS)
        self.handling = _one_of("handling", handling, HANDLINGS)
        self.integrality = _checked_integrality(integrality, self.bounds)
        self.population_size = _checked_size(population_size, len(self.bounds), variant)
        self.seed = _at_least("seed", seed, 0)
        self.max_generations = _at_least("max_generations", max_generations, 1)
        if not 0.0 < penalty < np.inf:
            raise SettingsError(f"penalty must be finite and > 0, got {penalty}")
        self.penalty = float(penalty)
        self._mixed = bool(self.integrality.any())
        # A whole number k owns [k - 1/2, k + 1/2]: differences below one keep their meaning.
        lower, upper = self.bounds.T
        self._lower = np.where(self.integrality, np.ceil(lower) - 0.5, lower)
        self._upper = np.where(self.integrality, np.floor(upper) + 0.5, upper)
        self._bits = np.random.PCG64(self.seed)
        self._bits_start = self._bits.state
        self._rng = np.random.Generator(self._bits)
        n, d = self.population_size, len(self.bounds)
        self._x = self._rng.uniform(self._lower, self._upper, (n, d))
        self._rates = next_rates(np.empty(n), np.zeros(n), self._rng.random(n))
        self._place(initial)
        self.generation = 0
        self.best_x, self.best_cost, self.best_violation = np.full(d, np.nan), np.inf, np.empty(0)
        self._best_excess = np.inf
        self._costs, self._excess = np.full(n, np.inf), np.full(n, np.inf)
        self._unit = np.empty(0)
        self._first_level = 0.0
        self._archive = np.empty((0, d))
        self._memory = np.full((3, MEMORY_SIZE), 0.5)
        self._trials: Array | None = None
        self._axes = np.eye(d)
        self._trial_rates = self._trial_scale = self._trial_turned = np.empty(0)

    @property
    def population(self) -> Array:
        """The individuals, shape (n, d)."""
        return self._decode(self._x)

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
        return self._decode(self._trials)

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
        violation = self._checked_violations(violations)
        if self.generation == 0:
            self._measure(violation)
        excess = (violation / self._unit).sum(1) if len(self._unit) else np.zeros(len(cost))
        old, old_excess = self._merit(self._costs, self._excess)
        new, new_excess = self._merit(cost, excess)
        won = (new_excess < old_excess) | ((new_excess == old_excess) & (new <= old))
        if self.variant == "history" and self.generation > 0:
            self._remember(won & ((new_excess < old_excess) | (new < old)))
        np.copyto(self._x, self._trials, where=won[:, None])
        self._costs[won], self._excess[won] = cost[won], excess[won]
        self._rates[won] = self._trial_rates[won]
        first = np.lexsort((cost, excess))[0]
        found = (float(excess[first]), float(cost[first]))
        if found < (self._best_excess, self.best_cost) or self.generation == 0:
            self._best_excess, self.best_cost = found
            self.best_x, self.best_violation = self._decode(self._trials[first]), violation[first]
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
        return self

    def _next_trials(self) -> Array:
        rng = self._addressed_rng()
        x, (n, d) = self._x, self._x.shape
        cost, excess = self._merit(self._costs, self._excess)
        order = np.lexsort((cost, excess))
        uniform = rng.random((n, d + 5))
        scheme, forced, redraw, draw, seat = uniform[:, d:].T
        others = neighbours(seat)
        points, best = x, order[0]
        if self.variant == "paper":
            scale = np.empty(n)
            shared = mean_scale(self.generation, self.max_generations)
            scale[order] = (rank_scale(n) + shared) / 2.0  # Eq. 26
            rates = next_rates(self._rates, redraw, draw)
        else:
            elite = max(round(ELITE * n), 2)
            best = order[rng.integers(elite, size=n)]
            points = np.concatenate((x, self._archive))
            stored = rng.integers(len(points), size=n)
            others[1] = np.where(stored < n, others[1], stored)
            about = self._memory[:, rng.integers(MEMORY_SIZE, size=n)]
            scale = np.abs(about[0] + SPREAD * rng.standard_cauchy(n)).clip(0.02, 1.0)
            rates = (about[1] + SPREAD * rng.standard_normal(n)).clip(0.02, 1.0)
        self._trial_scale, self._trial_rates = scale, rates
        donor = donors(points, best, others, (3.0 * scheme).astype(np.intp), scale)
        crossed = uniform[:, :d] < rates[:, None]
        crossed[np.arange(n), (d * forced).astype(np.intp)] = True
        trials = x.copy()
        np.copyto(trials, donor, where=crossed)
        if self.variant == "history":
            width = self._upper - self._lower
            if self.generation % AXES_AGE == 1:
                self._axes = principal_axes(x[order[: n // 2]] / width)
            turned = draw < about[2]
            step = (donor - x)[turned] / width @ self._axes * crossed[turned]
            trials[turned] = x[turned] + step @ self._axes.T * width
            self._trial_turned = turned
        nearest = np.minimum(np.maximum(trials, self._lower), self._upper)
        # What left the box comes to half-way between its parent and the bound.
        np.copyto(trials, (nearest + x) / 2.0, where=trials != nearest)
        return trials

    def _addressed_rng(self) -> np.random.Generator:
        """The random numbers of this generation, at its own place in the seed's stream."""
        self._bits.state = self._bits_start
        self._bits.advance(self.generation * JUMP)
        return self._rng

    def _remember(self, better: NDArray[np.bool_]) -> None:
        """Learn from the trials that beat their parents; archive those parents."""
        if better.any():
            good = np.stack((self._trial_scale, self._trial_rates))[:, better]
            # The contraharmonic mean leans to large values, lest F shrink too early.
            means = (good**2).sum(1) / good.sum(1)
            turned = self._trial_turned[better].mean().clip(*TURNED_RANGE)
            self._memory[:, self.generation % MEMORY_SIZE] = (*means, turned)
            self._archive = np.concatenate((self._archive, self._x[better]))

    def _shrink(self) -> None:
        left = max(self.max_generations - self.generation, 0)
        n = LEAST_SIZE + (self.population_size - LEAST_SIZE) * left // self.max_generations
        if n < len(self._x):
            cost, excess = self._merit(self._costs, self._excess)
            keep = np.sort(np.lexsort((cost, excess))[:n])
            self._x, self._rates = self._x[keep], self._rates[keep]
            self._costs, self._excess = self._costs[keep], self._excess[keep]
        self._archive = self._archive[-n:]

    def _decode(self, x: Array) -> Array:
        if not self._mixed:
            return x.copy()
        whole = np.clip(np.rint(x), self._lower + 0.5, self._upper - 0.5)
        return np.where(self.integrality, whole, x)

    def _merit(self, costs: Array, excess: Array) -> tuple[Array, Array]:
        """What selection compares, the excess before the cost; both of shape (n,)."""
        if self.handling == "penalty":
            return costs + self.penalty * excess, np.zeros(len(costs))
        left = 1.0 - self.generation / (EPSILON_UNTIL * self.max_generations)
        if self._first_level > 0.0 < left:
            level = self._first_level * left**EPSILON_POWER
            excess = np.where(excess <= level, 0.0, excess)
        return costs, excess

    def _measure(self, violation: Array) -> None:
        """Set the unit of each constraint, and the first epsilon, by the first population."""
        largest = np.where(np.isfinite(violation), violation, 0.0).max(0)
        raw = (largest == 0.0) | (self.handling == "penalty")
        self._unit = np.where(raw, 1.0, largest)
        # An equality shows itself as a constraint that no random point meets.
        if self.handling == "epsilon" and (violation > 0.0).all(0).any():
            excess = np.sort((violation / self._unit).sum(1))
            level = float(excess[int(EPSILON_QUANTILE * len(excess))])
            self._first_level = level if level < np.inf else 0.0

    def _checked_violations(self, violations: ArrayLike | None) -> Array:
        n = len(self._x)
        raw = np.empty((n, 0)) if violations is None else np.asarray(violations, np.float64)
        violation = np.where(np.isnan(raw), np.inf, np.maximum(raw, 0.0))
        if violation.ndim == 1:
            violation = violation[:, None]
        m = len(self._unit) if self.generation else violation.shape[-1]
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
    handling: str = "epsilon",
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
    _one_of("variant", variant, VARIANTS)
    size = _checked_size(population_size, len(_checked_bounds(bounds)), variant)
    _at_least("max_evaluations", max_evaluations, 2 * size)
    last = LEAST_SIZE if variant == "history" else size
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


# --- checks --------------------------------------------------------------------------------------


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
    return _at_least("population_size", population_size, LEAST_SIZE)


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
