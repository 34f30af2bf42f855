"""Compare ISADE with other optimisers on problems with known optima.

    python tools/bench_isade.py --output isade.jsonl                        all that is missing
    python tools/bench_isade.py --output isade.jsonl --solvers scipy cmaes  only these
    python tools/bench_isade.py --own-time                                  ISADE's own time

A run stops at a feasible point within 1e-4 (relative) of the optimum. Or it stops when its
evaluations are spent: 30 000 with constraints, 60 000 without. Each run is one line of the
output file, written when it ends; runs already in the file are not repeated. Other optimisers run
with the settings they come with. Those that know no constraints (L-SHADE, CMA-ES) minimise one
number that orders points by the rules of feasibility.
"""

import argparse
import contextlib
import json
import statistics
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from isade_problems import PROBLEMS, TUNING, Problem
from markdown_table import heading, row
from numpy.typing import NDArray

from drake_gait.optimizers._variation import neighbours
from drake_gait.optimizers.isade import VARIANTS, Isade, minimize

Array = NDArray[np.float64]

FEASIBLE_BELOW = 1e7
"""No feasible point of any problem costs as much."""

PROBE_SIZE = 60
"""Individuals in the measurement of ISADE's own time."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run of one solver on one problem with one seed."""

    solver: str
    problem: str
    seed: int
    evaluations: int | None
    """Evaluations until solved; None if it was not."""
    best: float
    """Lowest feasible cost met; infinite if none was feasible."""
    seconds: float


class OverError(Exception):
    """The problem is solved, or the evaluations are spent."""


class Meter:
    """A problem that counts its evaluations, and ends the run by raising `OverError`."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.budget = 30_000 if problem.constrained else 60_000
        self.count = 0
        self.solved_at: int | None = None
        self.best = np.inf
        self.whole = problem.integrality if problem.integrality is not None else False
        lower, upper = problem.bounds.T
        sample = np.random.default_rng(0).uniform(lower, upper, (1000, len(lower)))
        largest = np.nanmax(problem.evaluate(sample)[1], axis=0, initial=0.0)
        self._unit = np.where(largest > 0.0, largest, 1.0)

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Costs, shape (n,), and constraints, shape (n, m), of points, shape (n, d)."""
        cost, constraints = self.problem.evaluate(np.where(self.whole, np.rint(x), x))
        left = max(self.budget - self.count, 0)
        feasible = np.where((constraints <= 0.0).all(1), cost, np.inf)[:left]
        self.best = min(self.best, float(feasible.min(initial=np.inf)))
        solved = np.flatnonzero(feasible <= self.problem.target)
        if len(solved) and self.solved_at is None:
            self.solved_at = self.count + int(solved[0]) + 1
        self.count += len(x)
        if self.solved_at is not None or self.count >= self.budget:
            raise OverError
        return cost, constraints

    def merit(self, x: Array) -> Array:
        """One number, shape (n,), that orders points by the rules of feasibility."""
        cost, constraints = self(x)
        violation = (np.maximum(constraints, 0.0) / self._unit).sum(1)
        return np.nan_to_num(np.where(violation > 0.0, FEASIBLE_BELOW + violation, cost))


def _isade(variant: str) -> Callable[[Meter, int], None]:
    def solve(meter: Meter, seed: int) -> None:
        told: list[Array] = []

        def cost(x: Array) -> Array:
            value, constraints = meter(x)
            told[:] = [constraints]
            return value

        minimize(
            cost,
            meter.problem.bounds,
            constraints=lambda x: told[0],
            seed=seed,
            max_evaluations=meter.budget,
            vectorized=True,
            integrality=meter.problem.integrality,
            variant=variant,
        )

    return solve


def _scipy(meter: Meter, seed: int) -> None:
    from scipy.optimize import NonlinearConstraint, differential_evolution

    # Constraints are asked for every trial, and costs for the feasible ones: count the former.
    known: dict[bytes, float] = {}

    def constraints(x: Array) -> Array:
        points = np.atleast_2d(x.T)
        cost, values = meter(points)
        known.clear()
        known.update({p.tobytes(): c for p, c in zip(points, cost, strict=True)})
        return values.T if x.ndim == 2 else values[0]

    def cost(x: Array) -> Array:
        points = np.atleast_2d(x.T)
        if not meter.problem.constrained:
            return meter(points)[0]
        points = np.ascontiguousarray(points)
        if all(p.tobytes() in known for p in points):
            return np.array([known[p.tobytes()] for p in points])
        return meter.problem.evaluate(points)[0]

    d = len(meter.problem.bounds)
    differential_evolution(
        cost,
        meter.problem.bounds,
        maxiter=meter.budget // (15 * d),
        tol=0.0,  # as all others, it spends what it has
        rng=seed,
        vectorized=True,
        updating="deferred",
        integrality=meter.problem.integrality,
        constraints=NonlinearConstraint(constraints, -np.inf, 0.0)
        if meter.problem.constrained
        else (),
    )


def _lshade(meter: Meter, seed: int) -> None:
    import minionpy

    def cost(x: list[list[float]]) -> list[float]:
        try:
            return meter.merit(np.array(x)).tolist()
        except OverError:
            return [0.0] * len(x)

    minionpy.LSHADE(
        cost,
        [(float(a), float(b)) for a, b in meter.problem.bounds],
        maxevals=meter.budget,
        seed=seed,
        callback=lambda _: meter.solved_at is not None,
    ).optimize()


def _cmaes(meter: Meter, seed: int) -> None:
    from cmaes import CMA

    rng = np.random.default_rng(seed)
    lower, upper = meter.problem.bounds.T
    d, size = len(lower), None
    while True:  # each restart doubles the population (IPOP)
        optimiser = CMA(
            mean=rng.random(d),
            sigma=0.3,
            bounds=np.tile([0.0, 1.0], (d, 1)),
            population_size=size,
            seed=int(rng.integers(2**31)),
        )
        size = 2 * optimiser.population_size
        while not optimiser.should_stop():
            points = [optimiser.ask() for _ in range(optimiser.population_size)]
            merit = meter.merit(lower + np.array(points) * (upper - lower))
            optimiser.tell(list(zip(points, merit.tolist(), strict=True)))


def _pymoo(meter: Meter, seed: int) -> None:
    from pymoo.algorithms.soo.nonconvex.de import DE
    from pymoo.core.problem import Problem as PymooProblem
    from pymoo.optimize import minimize as pymoo_minimize

    lower, upper = meter.problem.bounds.T
    m = meter.problem.evaluate(lower[None])[1].shape[1]

    class Posed(PymooProblem):
        def __init__(self) -> None:
            super().__init__(n_var=len(lower), n_obj=1, n_ieq_constr=m, xl=lower, xu=upper)

        def _evaluate(self, x: Array, out: dict[str, Array], *_: object, **__: object) -> None:
            out["F"], out["G"] = meter(x)

    pymoo_minimize(Posed(), DE(), ("n_eval", meter.budget), seed=seed)


SOLVERS: dict[str, Callable[[Meter, int], None]] = {
    **{f"isade-{variant}": _isade(variant) for variant in VARIANTS},
    "l-shade": _lshade,
    "cmaes": _cmaes,
    "scipy": _scipy,
    "pymoo": _pymoo,
}


def run(solver: str, problem: str, seed: int) -> Run:
    """One solver on one problem with one seed."""
    meter = Meter(PROBLEMS[problem])
    start = time.perf_counter()
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        with contextlib.suppress(OverError):
            SOLVERS[solver](meter, seed)
    return Run(
        solver=solver,
        problem=problem,
        seed=seed,
        evaluations=meter.solved_at,
        best=meter.best,
        seconds=round(time.perf_counter() - start, 3),
    )


def read(path: Path) -> list[Run]:
    """The runs in an output file; none if there is no file."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [Run(**json.loads(line)) for line in lines]


def run_missing(wanted: Iterable[tuple[str, str, int]], path: Path, jobs: int) -> None:
    """Run what the output file lacks, and add each run to it as it ends."""
    known = {(r.solver, r.problem, r.seed) for r in read(path)}
    missing = [key for key in wanted if key not in known]
    with path.open("a") as file, ProcessPoolExecutor(jobs) as pool:
        for done in pool.map(run, *zip(*missing, strict=True)) if missing else ():
            file.write(json.dumps(asdict(done)) + "\n")
            file.flush()


def table(runs: list[Run], solvers: list[str], problems: list[str]) -> Iterator[str]:
    """Lines of a Markdown table: successes, and the median evaluations of the successful."""
    cells = {
        (problem, solver): [r for r in runs if (r.problem, r.solver) == (problem, solver)]
        for problem in problems
        for solver in solvers
    }
    yield heading(["problem", "half", *solvers], words=2)
    for problem in problems:
        half = "tuned" if problem in TUNING else "held out"
        yield row([problem, half, *(_cell(cells[problem, solver]) for solver in solvers)])
    for half, inside in (("tuned", True), ("held out", False)):
        members = [p for p in problems if (p in TUNING) == inside]
        sums = (
            _cell([r for p in members for r in cells[p, solver]], total=True) for solver in solvers
        )
        yield row(["**sum**", half, *sums])


def _cell(runs: list[Run], *, total: bool = False) -> str:
    solved = [r.evaluations for r in runs if r.evaluations is not None]
    if not runs or total:
        return f"{len(solved)}/{len(runs)}" if runs else ""
    median = f" ({statistics.median_low(solved)})" if solved else ""
    return f"{len(solved)}/{len(runs)}{median}"


def own_time() -> Iterator[str]:
    """Lines of a Markdown table: ISADE's time for one generation beside that of bare DE."""
    columns = [name for variant in VARIANTS for name in (f"{variant} [µs]", "ratio")]
    yield heading(["d", "n", "bare rand/1/bin [µs]", *columns], words=0)
    for d in (16, 30, 50, 100):
        # Turns alternate, and the best of many counts: other work on the machine only adds time.
        turns = [[_bare_seconds(d), *(_isade_seconds(d, v) for v in VARIANTS)] for _ in range(25)]
        bare, *own = (1e6 * np.min(turns, axis=0)).tolist()
        times = (text for t in own for text in (f"{t:.0f}", f"{t / bare:.2f}"))
        yield row([d, PROBE_SIZE, f"{bare:.0f}", *times])


def _bare_seconds(d: int, generations: int = 200) -> float:
    """Seconds for one generation of the least that is differential evolution, costs left out."""
    rng = np.random.default_rng(0)
    n, lower, upper = PROBE_SIZE, np.full(d, -1.0), np.full(d, 1.0)
    x, costs = rng.uniform(lower, upper, (n, d)), np.zeros(n)
    told = np.arange(n, 0.0, -1.0)
    start = time.perf_counter()
    for generation in range(generations):
        first, second, third, _ = neighbours(rng.random(n))
        donor = x[first] + 0.5 * (x[second] - x[third])
        crossed = rng.random((n, d)) < 0.9
        crossed[np.arange(n), rng.integers(d, size=n)] = True
        trials = np.clip(np.where(crossed, donor, x), lower, upper)
        new = told - generation
        won = new <= costs
        x[won], costs[won] = trials[won], new[won]
    return (time.perf_counter() - start) / generations


def _isade_seconds(d: int, variant: str, generations: int = 200) -> float:
    """Seconds for one `ask` and `tell` of a population of the same size."""
    optimiser = Isade(
        np.tile([-1.0, 1.0], (d, 1)),
        population_size=PROBE_SIZE,
        # So long a run hardly shrinks the population: sizes stay comparable.
        max_generations=1_000 * generations,
        variant=variant,
    )
    told = np.arange(PROBE_SIZE, 0.0, -1.0)
    start = time.perf_counter()
    for generation in range(generations):
        trials = optimiser.ask()
        optimiser.tell(told[: len(trials)] - generation)
    return (time.perf_counter() - start) / generations


def main() -> None:
    """Parse, run what is missing, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=Path("isade.jsonl"), help="file of runs")
    parser.add_argument("--seeds", type=int, default=20, help="seeds 0 to this, exclusive")
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=list(PROBLEMS))
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SOLVERS))
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--own-time", action="store_true", help="only measure ISADE's own time")
    parser.add_argument("--no-runs", action="store_true", help="only print what the file holds")
    options = parser.parse_args()
    if options.own_time:
        print("\n".join(own_time()))
        return
    wanted = [
        (solver, problem, seed)
        for solver in options.solvers
        for problem in options.problems
        for seed in range(options.seeds)
    ]
    if not options.no_runs:
        run_missing(wanted, options.output, options.jobs)
    runs = [r for r in read(options.output) if (r.solver, r.problem, r.seed) in set(wanted)]
    print("\n".join(table(runs, options.solvers, options.problems)))


if __name__ == "__main__":
    main()
