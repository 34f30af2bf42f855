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

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult

from drake_gait.arrays import numbers, whole_number
from drake_gait.errors import SettingsError
from drake_gait.optimizers import _variation as variation
from drake_gait.optimizers._box import Box
from drake_gait.optimizers._evolution import HANDLINGS, VARIANTS, Isade, checked_size, one_of
from drake_gait.optimizers._scipy_forms import Constraint, Constraints, Evaluator, Pairs, teller

__all__ = ["HANDLINGS", "VARIANTS", "Isade", "minimize"]

Array = NDArray[np.float64]


def minimize(
    fun: Callable[..., Any],
    bounds: Pairs,
    args: Any = (),
    *,
    constraints: Constraint | Iterable[Constraint] | None = None,
    seed: Any = 0,
    rng: Any = ...,
    max_evaluations: float = 30_000,
    population_size: float | None = None,
    max_iterations: float | None = None,
    stagnation: float | None = None,
    vectorized: bool = False,
    integrality: ArrayLike | None = None,
    callback: Callable[..., Any] | None = None,
    variant: str = "paper",
    handling: str = "epsilon",
    penalty: float = 1000.0,
    tolerance: float = 1e-4,
    initial: ArrayLike | None = None,
    x0: ArrayLike | None = None,
) -> OptimizeResult:
    """Minimise `fun` inside `bounds`, subject to `constraints`; `Isade` says more.

    Takes what `scipy.optimize.differential_evolution` takes. Whatever `fun`, a constraint or the
    callback raises, Ctrl-C too, is passed on with the best so far as its attribute `result`.

    Args:
        fun: Cost of x, shape (d,); with `vectorized` the costs, shape (n,), of x, shape (n, d).
        bounds: Lower and upper bound of every variable, shape (d, 2), as an array, an iterable of
            pairs or scipy's `Bounds`.
        args: Further arguments of `fun`.
        constraints: A function with values g, shape (m,), satisfied where g <= 0, shape (n, m)
            with `vectorized`; scipy's `NonlinearConstraint`, `LinearConstraint` or `Bounds`, or its
            dictionaries, whose "ineq" is satisfied where fun(x) >= 0; or a sequence of these.
        seed: Fixes the run if it is a whole number; None, or a numpy `Generator`, draws one.
        rng: The same by scipy's newer name; give one of the two.
        max_evaluations: Calls of `fun` at most, for single points; whole generations are made.
        population_size: Individuals.
        max_iterations: Generations after the first population at most; the paper's are 1000.
        stagnation: Stop after so many generations without a better point; the paper's are 50.
        vectorized: Whether `fun` and `constraints` take a whole generation at once.
        integrality: Which variables are whole numbers, shape (d,), or one truth for all.
        callback: Called after every generation with the result so far, as
            `callback(intermediate_result=...)` or `callback(result)`, or as
            `callback(x, convergence)`; stops the run by truth or StopIteration.
        variant: Form of the algorithm: "paper" or "history".
        handling: How constraints count: "epsilon", "feasibility" or "penalty".
        penalty: Weight of violations for "penalty".
        tolerance: How far an equality of scipy's forms may be missed.
        initial: Points that open the first population, shape (k, d).
        x0: One more, before them, shape (d,).

    Returns:
        x, fun, maxcv (largest violation of x), nfev, nit, success (x is feasible and its cost
        finite), message, population (n, d) and population_energies (n,).

    Raises:
        SettingsError: A setting cannot be used, or `fun` or `constraints` return a wrong shape.
    """
    one_of("variant", variant, VARIANTS)
    box = Box(bounds, integrality)
    size = checked_size(population_size, len(box.bounds), variant)
    budget = whole_number("max_evaluations", max_evaluations, 2 * size)
    last = variation.LEAST_SIZE if variant == "history" else size
    generations = 2 * budget // (size + last) - 1
    if max_iterations is not None:
        generations = min(generations, whole_number("max_iterations", max_iterations, 1))
    if stagnation is not None:
        stagnation = whole_number("stagnation", stagnation, 1)
    if rng is not ... and seed != 0:
        raise SettingsError(f"seed and rng are two names of one thing; got {seed} and {rng}")
    checked = Constraints(constraints, len(box.bounds), tolerance)
    evaluator, told = Evaluator(fun, args, checked, vectorized), teller(callback)
    optimiser = Isade(
        box.bounds,
        population_size=size,
        seed=seed if rng is ... else rng,
        max_generations=generations,
        integrality=box.integrality,
        variant=variant,
        handling=handling,
        penalty=penalty,
        initial=_opening(initial, x0, len(box.bounds)),
    )
    idle, message = 0, ""
    try:
        while not message:
            trials, best = optimiser.ask(), optimiser.best_x
            optimiser.tell(*evaluator.evaluate(trials))
            idle = idle + 1 if optimiser.best_x is best else 0
            if optimiser.generation > generations:
                message = "The budget of evaluations or iterations is spent."
            elif idle == stagnation:
                message = f"No better point in {stagnation} generations."
            if callback is not None and told(_result(optimiser, evaluator.count, message)):
                message = message or "The callback stopped the run."
        return _result(optimiser, evaluator.count, message)
    except BaseException as error:
        _keep(error, optimiser, evaluator)
        raise


def _opening(initial: ArrayLike | None, x0: ArrayLike | None, d: int) -> Array | None:
    """Points that open the first population, shape (k, d); None if none are given."""
    points = None if initial is None else numbers("initial", initial)
    if x0 is None:
        return points
    first = np.atleast_1d(numbers("x0", x0))
    if first.shape != (d,):
        raise SettingsError(f"x0 must be ({d},) in shape, got {first.shape}")
    return first[None] if points is None else np.concatenate((first[None], points))


def _keep(error: BaseException, optimiser: Isade, evaluator: Evaluator) -> None:
    """Attach the best so far to an error, with the points that its generation had got to."""
    iterations = optimiser.generation - 1
    known = evaluator.known(len(optimiser.population))
    if known is not None and optimiser.waits:
        optimiser.tell(*known)
    ending = f"{type(error).__name__}: {error}".removesuffix(": ")
    result = _result(optimiser, evaluator.count, f"The run was broken off by {ending}.")
    result.nit, result.success = max(iterations, 0), False
    error.result = result  # type: ignore[attr-defined]
    error.add_note(f"The best of {result.nfev} evaluations is this exception's `result`.")


def _result(optimiser: Isade, evaluations: int, message: str) -> OptimizeResult:
    largest = float(optimiser.best_violation.max(initial=0.0))
    cost = optimiser.best_cost
    if message and largest > 0.0:
        message += f" The best point violates a constraint by {largest:g}."
    if message and not np.isfinite(cost):
        which = "feasible point" if len(optimiser.best_violation) else "point"
        message += f" No {which} had a finite cost."
    return OptimizeResult(
        x=optimiser.best_x.copy(),
        fun=cost,
        maxcv=largest,
        nfev=evaluations,
        nit=optimiser.generation - 1,
        success=bool(largest == 0.0 and np.isfinite(cost)),
        message=message,
        population=optimiser.population,
        population_energies=optimiser.costs,
    )
