"""The forms in which scipy's optimisers take bounds, seeds, constraints and callbacks.

Whoever calls `scipy.optimize.differential_evolution` can hand the same ones to ISADE.
"""

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import Bounds, LinearConstraint, NonlinearConstraint, OptimizeResult

from drake_gait.arrays import numbers, whole_number
from drake_gait.errors import SettingsError

Array = NDArray[np.float64]
Pairs: TypeAlias = ArrayLike | Bounds | Iterable[Any]
"""Bounds: pairs, shape (d, 2), as an array or any iterable, or scipy's `Bounds`."""
Constraint: TypeAlias = (
    Callable[[Array], Any] | Mapping[str, Any] | NonlinearConstraint | LinearConstraint | Bounds
)
"""One constraint: a function that is satisfied at or below 0, or one of scipy's forms."""

_CONVERGED = 0.01
"""Scatter of the costs over their mean at which scipy's convergence is 1: its own default."""


def pairs(bounds: Pairs) -> Array:
    """Return bounds as an array, of shape (d, 2) if they are bounds.

    Raises:
        SettingsError: They are no real numbers.
    """
    if isinstance(bounds, Bounds):
        lower, upper = (numbers("bounds", side) for side in (bounds.lb, bounds.ub))
        try:
            sides = np.broadcast_arrays(np.atleast_1d(lower), np.atleast_1d(upper))
        except ValueError:
            raise SettingsError(
                f"bounds must have lb and ub of one shape, got {lower.shape} and {upper.shape}"
            ) from None
        return np.stack(sides, axis=-1)
    return numbers("bounds", bounds)


def seed_number(seed: Any) -> int:
    """Return a seed as one whole number, drawn from what numpy takes as a seed if it is none.

    Args:
        seed: An int; None for another one every time; or a `Generator`, which is advanced, a
            `RandomState`, a `BitGenerator`, a `SeedSequence` or a sequence of ints.

    Raises:
        SettingsError: It is none of these, or is negative.
    """
    if isinstance(seed, np.random.RandomState):
        return int(seed.randint(2**31 - 1))
    drawn = np.random.Generator | np.random.BitGenerator | np.random.SeedSequence
    if seed is None or isinstance(seed, drawn | list | tuple | np.ndarray):
        try:
            return int(np.random.default_rng(seed).integers(2**63 - 1))
        except (TypeError, ValueError) as error:
            raise SettingsError(f"seed {seed!r:.80} cannot be used: {error}") from None
    return whole_number("seed", seed, 0)


def teller(callback: Callable[..., Any] | None) -> Callable[[OptimizeResult], bool]:
    """Turn a callback of any form into a function of the result so far, true where it stops.

    Args:
        callback: `callback(intermediate_result=...)`, `callback(x, convergence)`, or
            `callback(result)`; it stops the run by truth or by StopIteration. None never does.
    """
    if callback is None:
        return lambda result: False
    form = _form_of(callback)

    def tell(result: OptimizeResult) -> bool:
        try:
            return bool(form(result))
        except StopIteration:
            return True

    return tell


def _form_of(callback: Callable[..., Any]) -> Callable[[OptimizeResult], Any]:
    try:
        signature = inspect.signature(callback)
    except (TypeError, ValueError):  # Some built-in functions have none.
        return callback
    if "intermediate_result" in signature.parameters:
        return lambda result: callback(intermediate_result=result)
    if _takes(signature, 0, 0):
        return lambda result: callback(result.x.copy(), _convergence(result))
    if _takes(signature, 0, convergence=0):
        return lambda result: callback(result.x.copy(), convergence=_convergence(result))
    return callback


def _takes(signature: inspect.Signature, *positions: int, **names: int) -> bool:
    try:
        signature.bind(*positions, **names)
    except TypeError:
        return False
    return True


def _convergence(result: OptimizeResult) -> float:
    """Return scipy's convergence of a population's costs: 0.01 x mean / scatter."""
    costs = result.population_energies
    if not np.isfinite(costs).all():
        return 0.0
    return float(_CONVERGED * abs(costs.mean()) / (costs.std() + np.finfo(float).tiny))


class Constraints:
    """Constraints of any of scipy's forms as violations, satisfied at or below 0.

    Args:
        given: A function, whose values are satisfied at or below 0; a `NonlinearConstraint`, a
            `LinearConstraint` or `Bounds`; a dictionary with `type` ("ineq": at or above 0, "eq":
            0), `fun` and perhaps `args`; or a sequence of them. None, or nothing, for none.
        dimension: Variables d.
        tolerance: How far an equality of scipy's forms may be missed.

    Raises:
        SettingsError: One of them is none of these forms, or contradicts itself.
    """

    def __init__(self, given: Any, dimension: int, tolerance: float) -> None:
        if not 0.0 <= tolerance < np.inf:
            raise SettingsError(f"tolerance must be finite and >= 0, got {tolerance}")
        self._dimension, self._tolerance = dimension, float(tolerance)
        if given is None:
            given = ()
        elif callable(given) or isinstance(given, Mapping) or hasattr(given, "lb"):
            given = (given,)
        elif not isinstance(given, Iterable) or isinstance(given, str | bytes):
            raise SettingsError(_unknown("constraints", given))
        self._parts = [self._part(f"constraint {i}", one) for i, one in enumerate(given)]

    def __bool__(self) -> bool:
        return bool(self._parts)

    def at(self, x: Array) -> Array:
        """Violations at one point, shape (d,); shape (m,).

        Raises:
            SettingsError: A function returns no real numbers, or more than one row of them.
        """
        found = []
        for part in self._parts:
            values = part(x)
            if values.ndim > 1 and values.size != max(values.shape):
                raise SettingsError(f"violations must be (m,) in shape, got {values.shape}")
            found.append(values.ravel())
        return np.concatenate(found)

    def of(self, points: Array) -> Array:
        """Violations of points, shape (n, d), by functions that take them all; shape (n, m).

        Raises:
            SettingsError: A function returns another shape than (n, m) or (n,).
        """
        found = []
        for part in self._parts:
            values = part(points)
            if values.ndim == 1:
                values = values[:, None]
            if values.ndim != 2 or len(values) != len(points):
                raise SettingsError(
                    f"violations must be ({len(points)}, m) in shape, got {values.shape}"
                )
            found.append(values)
        return np.concatenate(found, axis=1)

    def _part(self, name: str, one: Any) -> Callable[[Array], Array]:
        """Violations by one constraint of one point, or of rows of points."""
        if isinstance(one, Mapping):
            return self._of_dictionary(name, one)
        if isinstance(one, Bounds):
            return self._between(name, one, lambda x: x.copy())
        if isinstance(one, LinearConstraint):
            matrix = one.A if hasattr(one.A, "tocsr") else np.atleast_2d(numbers(name, one.A))
            if matrix.shape[-1] != self._dimension:
                raise SettingsError(
                    f"{name}: A must have {self._dimension} columns, has {matrix.shape[-1]}"
                )
            return self._between(name, one, lambda x: np.asarray((matrix @ x.T).T))
        if isinstance(one, NonlinearConstraint):
            return self._between(name, one, one.fun)
        if callable(one):
            return lambda x: numbers("violations", one(x))
        raise SettingsError(_unknown(name, one))

    def _of_dictionary(self, name: str, one: Mapping[str, Any]) -> Callable[[Array], Array]:
        kind, fun, args = str(one.get("type")).lower(), one.get("fun"), _tuple(one.get("args", ()))
        if kind not in ("ineq", "eq"):
            raise SettingsError(f"{name}: type must be 'ineq' or 'eq', got {one.get('type')!r}")
        if not callable(fun):
            raise SettingsError(f"{name}: fun must be a function, got {fun!r}")
        ends = NonlinearConstraint(fun, 0.0, np.inf if kind == "ineq" else 0.0)
        return self._between(name, ends, lambda x: fun(x, *args))

    def _between(self, name: str, ends: Any, fun: Callable[[Array], Any]) -> Callable[[Array], Any]:
        lower, upper = (
            np.atleast_1d(numbers(f"{name}: {end}", getattr(ends, end))) for end in ("lb", "ub")
        )
        try:
            ordered = bool((lower <= upper).all())
        except ValueError:
            ordered = False
        if not ordered:
            raise SettingsError(f"{name}: lb must be at or below ub, got {lower} and {upper}")

        def violations(x: Array) -> Array:
            values = numbers(name, fun(x))
            if values.ndim == x.ndim - 1:
                values = values[..., None]
            if values.ndim > x.ndim and values.size == max(values.shape):
                values = values.ravel()
            try:
                with np.errstate(invalid="ignore"):
                    exceeded = np.maximum(lower - values, values - upper)
                    missed = np.abs(values - lower) - self._tolerance
            except ValueError:
                exceeded = np.empty(0)
            if exceeded.shape != values.shape:
                raise SettingsError(
                    f"{name}: lb and ub must fit its values, {values.shape} in shape; got "
                    f"{lower.shape} and {upper.shape}"
                )
            return np.where(lower == upper, missed, exceeded)

        return violations


class Evaluator:
    """Costs and violations of a generation, kept one by one: what is known survives an error.

    Args:
        fun: Cost of x, shape (d,), or with `vectorized` the costs (n,) of x, shape (n, d).
        args: Further arguments of `fun`.
        constraints: What must be satisfied.
        vectorized: Whether the functions take all points at once.

    Attributes:
        count: Points whose cost and violations are known.
    """

    def __init__(
        self, fun: Callable[..., Any], args: Any, constraints: Constraints, vectorized: bool
    ) -> None:
        self._fun, self._args, self._constraints = fun, _tuple(args), constraints
        self._vectorized = vectorized
        self.count = 0
        self._costs: list[float] = []
        self._violations: list[Array] = []

    def evaluate(self, points: Array) -> tuple[Array, Array | None]:
        """Costs, shape (n,), and violations, shape (n, m), or None if there is no constraint.

        Raises:
            SettingsError: A function returns what has another shape, or is no number.
        """
        self._costs, self._violations = [], []
        if self._vectorized:
            costs = numbers("costs", self._fun(points.copy(), *self._args))
            violations = self._constraints.of(points) if self._constraints else None
            self.count += len(points)
            return costs, violations
        for x in points:
            cost = _one_number(self._fun(x.copy(), *self._args))
            if self._constraints:
                self._violations.append(self._constraints.at(x.copy()))
                if self._violations[0].shape != self._violations[-1].shape:
                    raise SettingsError(
                        f"violations must be as many at every x; got {len(self._violations[0])} "
                        f"and {len(self._violations[-1])}"
                    )
            self._costs.append(cost)
            self.count += 1
        return np.array(self._costs), np.array(self._violations) if self._constraints else None

    def known(self, size: int) -> tuple[Array, Array | None] | None:
        """As `evaluate`, of a generation that an error broke off: infinite where not known.

        None if none of its points is known.
        """
        done = len(self._costs)
        if done == 0:
            return None
        costs = np.full(size, np.inf)
        costs[:done] = self._costs
        if not self._constraints:
            return costs, None
        violations = np.full((size, len(self._violations[0])), np.inf)
        violations[:done] = self._violations[:done]
        return costs, violations


def _one_number(value: Any) -> float:
    if isinstance(value, float):
        return value
    found = numbers("costs", value)
    if found.size != 1:
        raise SettingsError(f"costs must be one number for each x, got {found.shape} in shape")
    return float(found.ravel()[0])


def _tuple(args: Any) -> tuple[Any, ...]:
    return tuple(args) if isinstance(args, tuple | list) else (args,)


def _unknown(name: str, given: Any) -> str:
    return (
        f"{name} must be a function, a NonlinearConstraint, a LinearConstraint, Bounds or a "
        f"dictionary, or a sequence of these; got {given!r:.80}"
    )
