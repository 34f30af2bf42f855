"""Evolution: the state of a run of ISADE, told one generation after another.

docs/experiments/2026-11-22-isade-choices.md has the choice of every constant.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drake_gait.arrays import numbers, whole_number
from drake_gait.errors import SettingsError
from drake_gait.optimizers import _selection as selection
from drake_gait.optimizers import _variation as variation
from drake_gait.optimizers._box import Box
from drake_gait.optimizers._scipy_forms import Pairs, seed_number

Array = NDArray[np.float64]

VARIANTS = ("paper", "history")
HANDLINGS = ("epsilon", "feasibility", "penalty")

AXES_AGE = 10  # generations until the principal axes of "history" are found anew
JUMP = 0x9E3779B97F4A7C15F39CC0605CEDC835  # as PCG64.jumped, which takes ten times as long
UNSAVED = ("_bits", "_rng", "_trial", "_box")  # beginnings of names: made anew from the rest


class Isade:
    """ISADE by ask and tell.

    Args:
        bounds: Lower and upper bound of every variable, shape (d, 2), or scipy's `Bounds`.
        population_size: Individuals n, at least 5; clip(5 d, 40, 60) if not given, and
            clip(10 d, 60, 150) for "history".
        seed: Fixes every random number, at least 0; None or a numpy `Generator` draws one.
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
        bounds: Pairs,
        *,
        population_size: float | None = None,
        seed: Any = 0,
        max_generations: float = 1000,
        integrality: ArrayLike | None = None,
        variant: str = "paper",
        handling: str = "epsilon",
        penalty: float = 1000.0,
        initial: ArrayLike | None = None,
    ) -> None:
        self._box = Box(bounds, integrality)
        self.bounds, self.integrality = self._box.bounds, self._box.integrality
        self.variant = one_of("variant", variant, VARIANTS)
        self.handling = one_of("handling", handling, HANDLINGS)
        self.population_size = checked_size(population_size, len(self.bounds), variant)
        self.seed = seed_number(seed)
        self.max_generations = whole_number("max_generations", max_generations, 1)
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

    @property
    def waits(self) -> bool:
        """Return whether trials were asked for that have no cost yet."""
        return self._trials is not None

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
        cost = numbers("costs", costs)
        if cost.shape == (len(self._x), 1):
            cost = cost[:, 0]
        if cost.shape != (len(self._x),):
            raise SettingsError(f"costs must be ({len(self._x)},) in shape, got {cost.shape}")
        cost[~np.isfinite(cost)] = np.inf
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
        found = {name: value for name, value in vars(self).items() if not name.startswith(UNSAVED)}
        if self.seed >= 2**63:
            found["seed"] = str(self.seed)  # No array holds it otherwise.
        return {name: np.copy(value)[()] for name, value in found.items()}

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
        self.seed = int(self.seed)
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
        """Return excess and cost as selection compares them, in this order; each of shape (n,)."""
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


def one_of(name: str, value: str, known: Iterable[str]) -> str:
    """Return the value, if it is a known one.

    Raises:
        SettingsError: It is not.
    """
    if value not in known:
        raise SettingsError(f"no {name} {value!r}; there are {', '.join(known)}")
    return str(value)


def checked_size(population_size: float | None, d: int, variant: str) -> int:
    """Individuals of a population in d variables, chosen by the variant if not given.

    Raises:
        SettingsError: They are too few.
    """
    if population_size is None:
        return min(max(5 * d, 40), 60) if variant == "paper" else min(max(10 * d, 60), 150)
    return whole_number("population_size", population_size, variation.LEAST_SIZE)
