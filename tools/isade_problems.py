"""Test problems with published optima, evaluated for many points at once.

Engineering designs: Coello Coello (2000), Sandgren (1990), Golinski (1973), Himmelblau (1972), in
the forms collected by Mezura-Montes and Coello Coello (2005). g01-g13: Liang et al., "Problem
definitions and evaluation criteria for the CEC 2006 special session on constrained real-parameter
optimization" (2006). Smooth and multimodal functions: the usual definitions in 16 variables,
optimum moved away from the origin, and turned by a random rotation where the name says so.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EQUALITY_TOLERANCE = 1e-4
"""Half-width of the band that stands for an equality constraint, as CEC2006 prescribes."""


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
        """Whether there is any constraint besides the bounds."""
        return self.evaluate(self.bounds[:, 0][None])[1].shape[1] > 0


def _box(*pairs: tuple[float, float]) -> Array:
    return np.array(pairs, dtype=np.float64)


def _stack(*constraints: Array) -> Array:
    return np.stack(constraints, axis=1)


def _equal(value: Array) -> Array:
    return np.abs(value) - EQUALITY_TOLERANCE


# --- engineering designs -------------------------------------------------------------------------


def _welded_beam(x: Array) -> tuple[Array, Array]:
    h, l, t, b = x.T  # noqa: E741 - the problem's letters
    load, span, e, g = 6000.0, 14.0, 30e6, 12e6
    tau_1 = load / (np.sqrt(2.0) * h * l)
    moment = load * (span + l / 2.0)
    radius = np.sqrt(l**2 / 4.0 + ((h + t) / 2.0) ** 2)
    polar = 2.0 * np.sqrt(2.0) * h * l * (l**2 / 12.0 + ((h + t) / 2.0) ** 2)
    tau_2 = moment * radius / polar
    tau = np.sqrt(tau_1**2 + tau_1 * tau_2 * l / radius + tau_2**2)
    sigma = 6.0 * load * span / (b * t**2)
    deflection = 4.0 * load * span**3 / (e * t**3 * b)
    buckling = (
        4.013 * e * t * b**3 / 6.0 / span**2 * (1.0 - t / (2.0 * span) * np.sqrt(e / (4.0 * g)))
    )
    cost = 1.10471 * h**2 * l + 0.04811 * t * b * (14.0 + l)
    return cost, _stack(
        tau - 13600.0,
        sigma - 30000.0,
        h - b,
        0.10471 * h**2 + 0.04811 * t * b * (14.0 + l) - 5.0,
        0.125 - h,
        deflection - 0.25,
        load - buckling,
    )


def _pressure_vessel(x: Array) -> tuple[Array, Array]:
    shell, head, radius, length = x.T
    cost = (
        0.6224 * shell * radius * length
        + 1.7781 * head * radius**2
        + 3.1661 * shell**2 * length
        + 19.84 * shell**2 * radius
    )
    volume = np.pi * radius**2 * length + 4.0 / 3.0 * np.pi * radius**3
    return cost, _stack(
        0.0193 * radius - shell, 0.00954 * radius - head, 1_296_000.0 - volume, length - 240.0
    )


def _pressure_vessel_mixed(x: Array) -> tuple[Array, Array]:
    return _pressure_vessel(x * np.array([0.0625, 0.0625, 1.0, 1.0]))


def _tension_spring(x: Array) -> tuple[Array, Array]:
    wire, coil, turns = x.T
    return (turns + 2.0) * coil * wire**2, _stack(
        1.0 - coil**3 * turns / (71785.0 * wire**4),
        (4.0 * coil**2 - wire * coil) / (12566.0 * (coil * wire**3 - wire**4))
        + 1.0 / (5108.0 * wire**2)
        - 1.0,
        1.0 - 140.45 * wire / (coil**2 * turns),
        (coil + wire) / 1.5 - 1.0,
    )


def _speed_reducer(x: Array) -> tuple[Array, Array]:
    b, m, z, l1, l2, d1, d2 = x.T
    cost = (
        0.7854 * b * m**2 * (3.3333 * z**2 + 14.9334 * z - 43.0934)
        - 1.508 * b * (d1**2 + d2**2)
        + 7.4777 * (d1**3 + d2**3)
        + 0.7854 * (l1 * d1**2 + l2 * d2**2)
    )
    return cost, _stack(
        27.0 / (b * m**2 * z) - 1.0,
        397.5 / (b * m**2 * z**2) - 1.0,
        1.93 * l1**3 / (m * z * d1**4) - 1.0,
        1.93 * l2**3 / (m * z * d2**4) - 1.0,
        np.sqrt((745.0 * l1 / (m * z)) ** 2 + 16.9e6) / (110.0 * d1**3) - 1.0,
        np.sqrt((745.0 * l2 / (m * z)) ** 2 + 157.5e6) / (85.0 * d2**3) - 1.0,
        m * z / 40.0 - 1.0,
        5.0 * m / b - 1.0,
        b / (12.0 * m) - 1.0,
        (1.5 * d1 + 1.9) / l1 - 1.0,
        (1.1 * d2 + 1.9) / l2 - 1.0,
    )


def _three_bar_truss(x: Array) -> tuple[Array, Array]:
    a1, a2 = x.T
    root = np.sqrt(2.0)
    load = stress = 2.0
    whole = root * a1**2 + 2.0 * a1 * a2
    # The corner a1 = a2 = 0 divides by zero; the infinite stress that follows is the right answer.
    with np.errstate(divide="ignore", invalid="ignore"):
        return 100.0 * (2.0 * root * a1 + a2), _stack(
            (root * a1 + a2) / whole * load - stress,
            a2 / whole * load - stress,
            1.0 / (a1 + root * a2) * load - stress,
        )


def _himmelblau(x: Array, coefficient: float = 0.00026) -> tuple[Array, Array]:
    x1, x2, x3, x4, x5 = x.T
    cost = 5.3578547 * x3**2 + 0.8356891 * x1 * x5 + 37.293239 * x1 - 40792.141
    u = 85.334407 + 0.0056858 * x2 * x5 + coefficient * x1 * x4 - 0.0022053 * x3 * x5
    v = 80.51249 + 0.0071317 * x2 * x5 + 0.0029955 * x1 * x2 + 0.0021813 * x3**2
    w = 9.300961 + 0.0047026 * x3 * x5 + 0.0012547 * x1 * x3 + 0.0019085 * x3 * x4
    return cost, _stack(u - 92.0, -u, v - 110.0, 90.0 - v, w - 25.0, 20.0 - w)


# --- CEC2006 g01-g13 -----------------------------------------------------------------------------


def _g01(x: Array) -> tuple[Array, Array]:
    a, b = x[:, :4], x[:, 4:]
    cost = 5.0 * a.sum(1) - 5.0 * (a**2).sum(1) - b.sum(1)
    x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, _ = x.T
    return cost, _stack(
        2 * x1 + 2 * x2 + x10 + x11 - 10,
        2 * x1 + 2 * x3 + x10 + x12 - 10,
        2 * x2 + 2 * x3 + x11 + x12 - 10,
        -8 * x1 + x10,
        -8 * x2 + x11,
        -8 * x3 + x12,
        -2 * x4 - x5 + x10,
        -2 * x6 - x7 + x11,
        -2 * x8 - x9 + x12,
    )


def _g02(x: Array) -> tuple[Array, Array]:
    d = x.shape[1]
    cosine = np.cos(x)
    top = np.abs((cosine**4).sum(1) - 2.0 * (cosine**2).prod(1))
    # The origin is 0/0; it breaks the first constraint, so its cost only has to be a number.
    cost = -top / np.sqrt(np.maximum((np.arange(1, d + 1) * x**2).sum(1), 1e-300))
    return cost, _stack(0.75 - x.prod(1), x.sum(1) - 7.5 * d)


def _g03(x: Array) -> tuple[Array, Array]:
    d = x.shape[1]
    return -(np.sqrt(d) ** d) * x.prod(1), _stack(_equal((x**2).sum(1) - 1.0))


def _g04(x: Array) -> tuple[Array, Array]:
    # Himmelblau's problem with the coefficient that a much-copied misprint gave it.
    return _himmelblau(x, coefficient=0.0006262)


def _g05(x: Array) -> tuple[Array, Array]:
    x1, x2, x3, x4 = x.T
    cost = 3.0 * x1 + 1e-6 * x1**3 + 2.0 * x2 + 2e-6 / 3.0 * x2**3
    return cost, _stack(
        x3 - x4 - 0.55,
        x4 - x3 - 0.55,
        _equal(1000 * np.sin(-x3 - 0.25) + 1000 * np.sin(-x4 - 0.25) + 894.8 - x1),
        _equal(1000 * np.sin(x3 - 0.25) + 1000 * np.sin(x3 - x4 - 0.25) + 894.8 - x2),
        _equal(1000 * np.sin(x4 - 0.25) + 1000 * np.sin(x4 - x3 - 0.25) + 1294.8),
    )


def _g06(x: Array) -> tuple[Array, Array]:
    x1, x2 = x.T
    return (x1 - 10.0) ** 3 + (x2 - 20.0) ** 3, _stack(
        100.0 - (x1 - 5.0) ** 2 - (x2 - 5.0) ** 2, (x1 - 6.0) ** 2 + (x2 - 5.0) ** 2 - 82.81
    )


def _g07(x: Array) -> tuple[Array, Array]:
    x1, x2, x3, x4, x5, x6, x7, x8, x9, x10 = x.T
    cost = (
        x1**2 + x2**2 + x1 * x2 - 14 * x1 - 16 * x2 + (x3 - 10) ** 2 + 4 * (x4 - 5) ** 2
        + (x5 - 3) ** 2 + 2 * (x6 - 1) ** 2 + 5 * x7**2 + 7 * (x8 - 11) ** 2
        + 2 * (x9 - 10) ** 2 + (x10 - 7) ** 2 + 45
    )  # fmt: skip
    return cost, _stack(
        -105 + 4 * x1 + 5 * x2 - 3 * x7 + 9 * x8,
        10 * x1 - 8 * x2 - 17 * x7 + 2 * x8,
        -8 * x1 + 2 * x2 + 5 * x9 - 2 * x10 - 12,
        3 * (x1 - 2) ** 2 + 4 * (x2 - 3) ** 2 + 2 * x3**2 - 7 * x4 - 120,
        5 * x1**2 + 8 * x2 + (x3 - 6) ** 2 - 2 * x4 - 40,
        x1**2 + 2 * (x2 - 2) ** 2 - 2 * x1 * x2 + 14 * x5 - 6 * x6,
        0.5 * (x1 - 8) ** 2 + 2 * (x2 - 4) ** 2 + 3 * x5**2 - x6 - 30,
        -3 * x1 + 6 * x2 + 12 * (x9 - 8) ** 2 - 7 * x10,
    )


def _g08(x: Array) -> tuple[Array, Array]:
    x1, x2 = x.T
    # x1 = 0 breaks the first constraint, so its cost only has to be a number.
    below = np.maximum(x1**3 * (x1 + x2), 1e-300)
    cost = -(np.sin(2 * np.pi * x1) ** 3) * np.sin(2 * np.pi * x2) / below
    return cost, _stack(x1**2 - x2 + 1.0, 1.0 - x1 + (x2 - 4.0) ** 2)


def _g09(x: Array) -> tuple[Array, Array]:
    x1, x2, x3, x4, x5, x6, x7 = x.T
    cost = (
        (x1 - 10) ** 2 + 5 * (x2 - 12) ** 2 + x3**4 + 3 * (x4 - 11) ** 2 + 10 * x5**6
        + 7 * x6**2 + x7**4 - 4 * x6 * x7 - 10 * x6 - 8 * x7
    )  # fmt: skip
    return cost, _stack(
        -127 + 2 * x1**2 + 3 * x2**4 + x3 + 4 * x4**2 + 5 * x5,
        -282 + 7 * x1 + 3 * x2 + 10 * x3**2 + x4 - x5,
        -196 + 23 * x1 + x2**2 + 6 * x6**2 - 8 * x7,
        4 * x1**2 + x2**2 - 3 * x1 * x2 + 2 * x3**2 + 5 * x6 - 11 * x7,
    )


def _g10(x: Array) -> tuple[Array, Array]:
    x1, x2, x3, x4, x5, x6, x7, x8 = x.T
    return x1 + x2 + x3, _stack(
        -1.0 + 0.0025 * (x4 + x6),
        -1.0 + 0.0025 * (x5 + x7 - x4),
        -1.0 + 0.01 * (x8 - x5),
        -x1 * x6 + 833.33252 * x4 + 100.0 * x1 - 83333.333,
        -x2 * x7 + 1250.0 * x5 + x2 * x4 - 1250.0 * x4,
        -x3 * x8 + 1_250_000.0 + x3 * x5 - 2500.0 * x5,
    )


def _g11(x: Array) -> tuple[Array, Array]:
    x1, x2 = x.T
    return x1**2 + (x2 - 1.0) ** 2, _stack(_equal(x2 - x1**2))


def _g12(x: Array) -> tuple[Array, Array]:
    # Feasible inside any of 9 x 9 x 9 small spheres: the nearest centre decides.
    centre = np.clip(np.rint(x), 1.0, 9.0)
    cost = -(100.0 - ((x - 5.0) ** 2).sum(1)) / 100.0
    return cost, _stack(((x - centre) ** 2).sum(1) - 0.0625)


def _g13(x: Array) -> tuple[Array, Array]:
    x1, x2, x3, x4, x5 = x.T
    return np.exp(x.prod(1)), _stack(
        _equal((x**2).sum(1) - 10.0), _equal(x2 * x3 - 5.0 * x4 * x5), _equal(x1**3 + x2**3 + 1.0)
    )


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
            evaluate=_welded_beam,
        ),
        Problem(
            name="vessel",
            bounds=_box((0.0625, 6.1875), (0.0625, 6.1875), (10.0, 200.0), (10.0, 240.0)),
            optimum=5804.376217,
            evaluate=_pressure_vessel,
        ),
        Problem(
            name="vessel_mixed",
            bounds=_box((1.0, 99.0), (1.0, 99.0), (10.0, 200.0), (10.0, 200.0)),
            optimum=6059.714335,
            evaluate=_pressure_vessel_mixed,
            integrality=np.array([True, True, False, False]),
        ),
        Problem(
            name="spring",
            bounds=_box((0.05, 2.0), (0.25, 1.3), (2.0, 15.0)),
            optimum=0.012665232788,
            evaluate=_tension_spring,
        ),
        Problem(
            name="speed_reducer",
            bounds=_box(
                (2.6, 3.6), (0.7, 0.8), (17, 28), (7.3, 8.3), (7.3, 8.3), (2.9, 3.9), (5.0, 5.5)
            ),
            optimum=2994.471066,
            evaluate=_speed_reducer,
            integrality=np.array([False, False, True, False, False, False, False]),
        ),
        Problem(
            name="three_bar",
            bounds=_box((0.0, 1.0), (0.0, 1.0)),
            optimum=263.89584338,
            evaluate=_three_bar_truss,
        ),
        Problem(
            name="himmelblau",
            bounds=_box((78.0, 102.0), (33.0, 45.0), (27.0, 45.0), (27.0, 45.0), (27.0, 45.0)),
            optimum=-31025.560243,
            evaluate=_himmelblau,
        ),
        Problem(
            name="g01",
            bounds=_box(*[(0.0, 1.0)] * 9, *[(0.0, 100.0)] * 3, (0.0, 1.0)),
            optimum=-15.0,
            evaluate=_g01,
        ),
        Problem(name="g02", bounds=_box(*[(0.0, 10.0)] * 20), optimum=-0.8036191042, evaluate=_g02),
        Problem(name="g03", bounds=_box(*[(0.0, 1.0)] * 10), optimum=-1.0005001, evaluate=_g03),
        Problem(
            name="g04",
            bounds=_box((78.0, 102.0), (33.0, 45.0), (27.0, 45.0), (27.0, 45.0), (27.0, 45.0)),
            optimum=-30665.5386717834,
            evaluate=_g04,
        ),
        Problem(
            name="g05",
            bounds=_box((0.0, 1200.0), (0.0, 1200.0), (-0.55, 0.55), (-0.55, 0.55)),
            optimum=5126.4967140071,
            evaluate=_g05,
        ),
        Problem(
            name="g06",
            bounds=_box((13.0, 100.0), (0.0, 100.0)),
            optimum=-6961.8138755802,
            evaluate=_g06,
        ),
        Problem(
            name="g07", bounds=_box(*[(-10.0, 10.0)] * 10), optimum=24.3062090682, evaluate=_g07
        ),
        Problem(name="g08", bounds=_box(*[(0.0, 10.0)] * 2), optimum=-0.0958250414, evaluate=_g08),
        Problem(
            name="g09", bounds=_box(*[(-10.0, 10.0)] * 7), optimum=680.6300573744, evaluate=_g09
        ),
        Problem(
            name="g10",
            bounds=_box((100.0, 1e4), (1e3, 1e4), (1e3, 1e4), *[(10.0, 1000.0)] * 5),
            optimum=7049.2480205287,
            evaluate=_g10,
        ),
        Problem(name="g11", bounds=_box(*[(-1.0, 1.0)] * 2), optimum=0.7499, evaluate=_g11),
        Problem(name="g12", bounds=_box(*[(0.0, 10.0)] * 3), optimum=-1.0, evaluate=_g12),
        Problem(
            name="g13",
            bounds=_box((-2.3, 2.3), (-2.3, 2.3), (-3.2, 3.2), (-3.2, 3.2), (-3.2, 3.2)),
            optimum=0.0539415140,
            evaluate=_g13,
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
