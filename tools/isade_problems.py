"""Test problems with published optima: the constrained ones, and 16 variables shifted and rotated.

Smooth and multimodal functions have their usual definitions. The optimum is moved away from the
origin. Functions whose name says so are turned by a random rotation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import constrained_problems as constrained
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Minimise `evaluate` inside `bounds`, with every constraint at most zero."""

    name: str
    bounds: Array
    """Lower and upper bound of every variable, shape (d, 2)."""
    optimum: float
    """Best known value."""
    evaluate: Callable[[Array], tuple[Array, Array]]
    """Points, shape (n, d), to costs, shape (n,), and constraints, shape (n, m)."""
    integrality: NDArray[np.bool_] | None = None
    """Which variables are whole numbers, shape (d,)."""

    @property
    def target(self) -> float:
        """Largest cost that counts as solved: 1e-4 relative, absolute where the optimum is 0."""
        return self.optimum + 1e-4 * (abs(self.optimum) or 1.0)

    @property
    def constrained(self) -> bool:
        """Return whether there is any constraint besides the bounds."""
        return self.evaluate(self.bounds[:, 0][None])[1].shape[1] > 0


def _box(*pairs: tuple[float, float]) -> Array:
    return np.array(pairs, dtype=np.float64)


# --- 16 variables, shifted and rotated -----------------------------------------------------------


def _sphere(z: Array) -> Array:
    return (z**2).sum(1)


def _rosenbrock(z: Array) -> Array:
    y = z + 1.0
    return (100.0 * (y[:, 1:] - y[:, :-1] ** 2) ** 2 + (y[:, :-1] - 1.0) ** 2).sum(1)


def _rastrigin(z: Array) -> Array:
    return (z**2 - 10.0 * np.cos(2.0 * np.pi * z) + 10.0).sum(1)


def _ackley(z: Array) -> Array:
    root = np.sqrt((z**2).mean(1))
    wave = np.cos(2.0 * np.pi * z).mean(1)
    return -20.0 * np.exp(-0.2 * root) - np.exp(wave) + 20.0 + np.e


def _griewank(z: Array) -> Array:
    wave = np.cos(z / np.sqrt(np.arange(1, z.shape[1] + 1))).prod(1)
    return (z**2).sum(1) / 4000.0 - wave + 1.0


def _ellipsoid(z: Array) -> Array:
    weight = 10.0 ** (6.0 * np.arange(z.shape[1]) / (z.shape[1] - 1))
    return (weight * z**2).sum(1)


def _schwefel(z: Array) -> Array:
    y = z + 420.968746
    return (418.9828872724338 - y * np.sin(np.sqrt(np.abs(y)))).sum(1)


def _moved(
    name: str, shape: Callable[[Array], Array], half_width: float, *, rotated: bool = False
) -> Problem:
    """`shape` with its optimum, 0 at z = 0, at a fixed random point of the box, and turned."""
    d = 16
    rng = np.random.default_rng([20, *name.encode()])
    shift = rng.uniform(-0.6, 0.6, d) * half_width
    turn = np.eye(d)
    if rotated:
        q, r = np.linalg.qr(rng.standard_normal((d, d)))
        turn = q * np.sign(np.diag(r))

    def evaluate(x: Array) -> tuple[Array, Array]:
        return shape((x - shift) @ turn), np.empty((len(x), 0))

    bounds = np.tile([-half_width, half_width], (d, 1))
    if shape is _schwefel:
        # Beyond +-500 Schwefel's function falls below its optimum: the box moves with the optimum.
        bounds = bounds + shift[:, None] - 420.968746
    return Problem(name=name, bounds=bounds, optimum=0.0, evaluate=evaluate)


PROBLEMS: dict[str, Problem] = {
    problem.name: problem
    for problem in (
        Problem(
            name="welded_beam",
            bounds=_box((0.1, 2.0), (0.1, 10.0), (0.1, 10.0), (0.1, 2.0)),
            optimum=1.724852,
            evaluate=constrained.welded_beam,
        ),
        Problem(
            name="vessel",
            bounds=_box((0.0625, 6.1875), (0.0625, 6.1875), (10.0, 200.0), (10.0, 240.0)),
            optimum=5804.376217,
            evaluate=constrained.pressure_vessel,
        ),
        Problem(
            name="vessel_mixed",
            bounds=_box((1.0, 99.0), (1.0, 99.0), (10.0, 200.0), (10.0, 200.0)),
            optimum=6059.714335,
            evaluate=constrained.pressure_vessel_mixed,
            integrality=np.array([True, True, False, False]),
        ),
        Problem(
            name="spring",
            bounds=_box((0.05, 2.0), (0.25, 1.3), (2.0, 15.0)),
            optimum=0.012665232788,
            evaluate=constrained.tension_spring,
        ),
        Problem(
            name="speed_reducer",
            bounds=_box(
                (2.6, 3.6), (0.7, 0.8), (17, 28), (7.3, 8.3), (7.3, 8.3), (2.9, 3.9), (5.0, 5.5)
            ),
            optimum=2994.471066,
            evaluate=constrained.speed_reducer,
            integrality=np.array([False, False, True, False, False, False, False]),
        ),
        Problem(
            name="three_bar",
            bounds=_box((0.0, 1.0), (0.0, 1.0)),
            optimum=263.89584338,
            evaluate=constrained.three_bar_truss,
        ),
        Problem(
            name="himmelblau",
            bounds=_box((78.0, 102.0), (33.0, 45.0), (27.0, 45.0), (27.0, 45.0), (27.0, 45.0)),
            optimum=-31025.560243,
            evaluate=constrained.himmelblau,
        ),
        Problem(
            name="g01",
            bounds=_box(*[(0.0, 1.0)] * 9, *[(0.0, 100.0)] * 3, (0.0, 1.0)),
            optimum=-15.0,
            evaluate=constrained.g01,
        ),
        Problem(
            name="g02",
            bounds=_box(*[(0.0, 10.0)] * 20),
            optimum=-0.8036191042,
            evaluate=constrained.g02,
        ),
        Problem(
            name="g03",
            bounds=_box(*[(0.0, 1.0)] * 10),
            optimum=-1.0005001,
            evaluate=constrained.g03,
        ),
        Problem(
            name="g04",
            bounds=_box((78.0, 102.0), (33.0, 45.0), (27.0, 45.0), (27.0, 45.0), (27.0, 45.0)),
            optimum=-30665.5386717834,
            evaluate=constrained.g04,
        ),
        Problem(
            name="g05",
            bounds=_box((0.0, 1200.0), (0.0, 1200.0), (-0.55, 0.55), (-0.55, 0.55)),
            optimum=5126.4967140071,
            evaluate=constrained.g05,
        ),
        Problem(
            name="g06",
            bounds=_box((13.0, 100.0), (0.0, 100.0)),
            optimum=-6961.8138755802,
            evaluate=constrained.g06,
        ),
        Problem(
            name="g07",
            bounds=_box(*[(-10.0, 10.0)] * 10),
            optimum=24.3062090682,
            evaluate=constrained.g07,
        ),
        Problem(
            name="g08",
            bounds=_box(*[(0.0, 10.0)] * 2),
            optimum=-0.0958250414,
            evaluate=constrained.g08,
        ),
        Problem(
            name="g09",
            bounds=_box(*[(-10.0, 10.0)] * 7),
            optimum=680.6300573744,
            evaluate=constrained.g09,
        ),
        Problem(
            name="g10",
            bounds=_box((100.0, 1e4), (1e3, 1e4), (1e3, 1e4), *[(10.0, 1000.0)] * 5),
            optimum=7049.2480205287,
            evaluate=constrained.g10,
        ),
        Problem(
            name="g11", bounds=_box(*[(-1.0, 1.0)] * 2), optimum=0.7499, evaluate=constrained.g11
        ),
        Problem(
            name="g12", bounds=_box(*[(0.0, 10.0)] * 3), optimum=-1.0, evaluate=constrained.g12
        ),
        Problem(
            name="g13",
            bounds=_box((-2.3, 2.3), (-2.3, 2.3), (-3.2, 3.2), (-3.2, 3.2), (-3.2, 3.2)),
            optimum=0.0539415140,
            evaluate=constrained.g13,
        ),
        _moved("sphere", _sphere, 100.0),
        _moved("ellipsoid_rotated", _ellipsoid, 100.0, rotated=True),
        _moved("rosenbrock", _rosenbrock, 30.0),
        _moved("rosenbrock_rotated", _rosenbrock, 30.0, rotated=True),
        _moved("rastrigin", _rastrigin, 5.12),
        _moved("rastrigin_rotated", _rastrigin, 5.12, rotated=True),
        _moved("ackley", _ackley, 32.0),
        _moved("ackley_rotated", _ackley, 32.0, rotated=True),
        _moved("griewank", _griewank, 600.0),
        _moved("griewank_rotated", _griewank, 600.0, rotated=True),
        _moved("schwefel", _schwefel, 500.0),
    )
}
"""Every problem by name."""

TUNING = (
    "welded_beam",
    "vessel_mixed",
    "speed_reducer",
    "himmelblau",
    "g02",
    "g05",
    "g07",
    "g09",
    "g10",
    "g11",
    "g13",
    "ellipsoid_rotated",
    "rosenbrock",
    "rastrigin_rotated",
    "ackley",
    "griewank_rotated",
    "schwefel",
)
"""Problems that settings may be chosen on; the others confirm them."""
