"""Costs and constraints of constrained test problems, for many points at once.

Engineering designs: Coello Coello (2000), Sandgren (1990), Golinski (1973), Himmelblau (1972).
Mezura-Montes and Coello Coello (2005) collected their forms. Problems g01 to g13: Liang et al.,
"Problem definitions and evaluation criteria for the CEC 2006 special session on constrained
real-parameter optimization" (2006).

Each function takes points, shape (n, d), to costs, shape (n,), and constraints, shape (n, m),
satisfied at or below 0.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EQUALITY_TOLERANCE = 1e-4
"""Half-width of the band that stands for an equality constraint, as CEC2006 prescribes."""


def _stack(*constraints: Array) -> Array:
    return np.stack(constraints, axis=1)


def _equal(value: Array) -> Array:
    return np.abs(value) - EQUALITY_TOLERANCE


# --- engineering designs -------------------------------------------------------------------------


def welded_beam(x: Array) -> tuple[Array, Array]:
    """Cheapest welded beam: height and length of the weld, height and width of the bar [in]."""
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


def pressure_vessel(x: Array) -> tuple[Array, Array]:
    """Cheapest pressure vessel: thickness of shell and head, radius, length [in]."""
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


def pressure_vessel_mixed(x: Array) -> tuple[Array, Array]:
    """The same, with both thicknesses in sixteenths of an inch."""
    return pressure_vessel(x * np.array([0.0625, 0.0625, 1.0, 1.0]))


def tension_spring(x: Array) -> tuple[Array, Array]:
    """Lightest spring: diameters of wire and coil [in], number of turns."""
    wire, coil, turns = x.T
    return (turns + 2.0) * coil * wire**2, _stack(
        1.0 - coil**3 * turns / (71785.0 * wire**4),
        (4.0 * coil**2 - wire * coil) / (12566.0 * (coil * wire**3 - wire**4))
        + 1.0 / (5108.0 * wire**2)
        - 1.0,
        1.0 - 140.45 * wire / (coil**2 * turns),
        (coil + wire) / 1.5 - 1.0,
    )


def speed_reducer(x: Array) -> tuple[Array, Array]:
    """Lightest speed reducer: face, module, teeth, lengths and diameters of two shafts [cm]."""
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


def three_bar_truss(x: Array) -> tuple[Array, Array]:
    """Lightest truss of three bars: cross-sections of the outer bars and of the middle one."""
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


def himmelblau(x: Array, coefficient: float = 0.00026) -> tuple[Array, Array]:
    """Himmelblau's nonlinear problem of five variables."""
    x1, x2, x3, x4, x5 = x.T
    cost = 5.3578547 * x3**2 + 0.8356891 * x1 * x5 + 37.293239 * x1 - 40792.141
    u = 85.334407 + 0.0056858 * x2 * x5 + coefficient * x1 * x4 - 0.0022053 * x3 * x5
    v = 80.51249 + 0.0071317 * x2 * x5 + 0.0029955 * x1 * x2 + 0.0021813 * x3**2
    w = 9.300961 + 0.0047026 * x3 * x5 + 0.0012547 * x1 * x3 + 0.0019085 * x3 * x4
    return cost, _stack(u - 92.0, -u, v - 110.0, 90.0 - v, w - 25.0, 20.0 - w)


# --- CEC2006 g01-g13 -----------------------------------------------------------------------------


def g01(x: Array) -> tuple[Array, Array]:
    """13 variables, nine linear inequalities."""
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


def g02(x: Array) -> tuple[Array, Array]:
    """Any number of variables; very many local optima."""
    d = x.shape[1]
    cosine = np.cos(x)
    top = np.abs((cosine**4).sum(1) - 2.0 * (cosine**2).prod(1))
    # The origin is 0/0; it breaks the first constraint, so its cost only has to be a number.
    cost = -top / np.sqrt(np.maximum((np.arange(1, d + 1) * x**2).sum(1), 1e-300))
    return cost, _stack(0.75 - x.prod(1), x.sum(1) - 7.5 * d)


def g03(x: Array) -> tuple[Array, Array]:
    """Any number of variables on a sphere."""
    d = x.shape[1]
    return -(np.sqrt(d) ** d) * x.prod(1), _stack(_equal((x**2).sum(1) - 1.0))


def g04(x: Array) -> tuple[Array, Array]:
    """Himmelblau's problem with the coefficient that a much-copied misprint gave it."""
    return himmelblau(x, coefficient=0.0006262)


def g05(x: Array) -> tuple[Array, Array]:
    """Four variables, two inequalities and three equalities."""
    x1, x2, x3, x4 = x.T
    cost = 3.0 * x1 + 1e-6 * x1**3 + 2.0 * x2 + 2e-6 / 3.0 * x2**3
    return cost, _stack(
        x3 - x4 - 0.55,
        x4 - x3 - 0.55,
        _equal(1000 * np.sin(-x3 - 0.25) + 1000 * np.sin(-x4 - 0.25) + 894.8 - x1),
        _equal(1000 * np.sin(x3 - 0.25) + 1000 * np.sin(x3 - x4 - 0.25) + 894.8 - x2),
        _equal(1000 * np.sin(x4 - 0.25) + 1000 * np.sin(x4 - x3 - 0.25) + 1294.8),
    )


def g06(x: Array) -> tuple[Array, Array]:
    """Two variables, a thin crescent."""
    x1, x2 = x.T
    return (x1 - 10.0) ** 3 + (x2 - 20.0) ** 3, _stack(
        100.0 - (x1 - 5.0) ** 2 - (x2 - 5.0) ** 2, (x1 - 6.0) ** 2 + (x2 - 5.0) ** 2 - 82.81
    )


def g07(x: Array) -> tuple[Array, Array]:
    """Ten variables, eight inequalities."""
    x1, x2, x3, x4, x5, x6, x7, x8, x9, x10 = x.T
    cost = (
        x1**2
        + x2**2
        + x1 * x2
        - 14 * x1
        - 16 * x2
        + (x3 - 10) ** 2
        + 4 * (x4 - 5) ** 2
        + (x5 - 3) ** 2
        + 2 * (x6 - 1) ** 2
        + 5 * x7**2
        + 7 * (x8 - 11) ** 2
        + 2 * (x9 - 10) ** 2
        + (x10 - 7) ** 2
        + 45
    )
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


def g08(x: Array) -> tuple[Array, Array]:
    """Two variables, two inequalities."""
    x1, x2 = x.T
    # x1 = 0 breaks the first constraint, so its cost only has to be a number.
    below = np.maximum(x1**3 * (x1 + x2), 1e-300)
    cost = -(np.sin(2 * np.pi * x1) ** 3) * np.sin(2 * np.pi * x2) / below
    return cost, _stack(x1**2 - x2 + 1.0, 1.0 - x1 + (x2 - 4.0) ** 2)


def g09(x: Array) -> tuple[Array, Array]:
    """Seven variables, four inequalities."""
    x1, x2, x3, x4, x5, x6, x7 = x.T
    cost = (
        (x1 - 10) ** 2
        + 5 * (x2 - 12) ** 2
        + x3**4
        + 3 * (x4 - 11) ** 2
        + 10 * x5**6
        + 7 * x6**2
        + x7**4
        - 4 * x6 * x7
        - 10 * x6
        - 8 * x7
    )
    return cost, _stack(
        -127 + 2 * x1**2 + 3 * x2**4 + x3 + 4 * x4**2 + 5 * x5,
        -282 + 7 * x1 + 3 * x2 + 10 * x3**2 + x4 - x5,
        -196 + 23 * x1 + x2**2 + 6 * x6**2 - 8 * x7,
        4 * x1**2 + x2**2 - 3 * x1 * x2 + 2 * x3**2 + 5 * x6 - 11 * x7,
    )


def g10(x: Array) -> tuple[Array, Array]:
    """Eight variables of very different size, six inequalities."""
    x1, x2, x3, x4, x5, x6, x7, x8 = x.T
    return x1 + x2 + x3, _stack(
        -1.0 + 0.0025 * (x4 + x6),
        -1.0 + 0.0025 * (x5 + x7 - x4),
        -1.0 + 0.01 * (x8 - x5),
        -x1 * x6 + 833.33252 * x4 + 100.0 * x1 - 83333.333,
        -x2 * x7 + 1250.0 * x5 + x2 * x4 - 1250.0 * x4,
        -x3 * x8 + 1_250_000.0 + x3 * x5 - 2500.0 * x5,
    )


def g11(x: Array) -> tuple[Array, Array]:
    """Two variables on a parabola."""
    x1, x2 = x.T
    return x1**2 + (x2 - 1.0) ** 2, _stack(_equal(x2 - x1**2))


def g12(x: Array) -> tuple[Array, Array]:
    """Three variables, feasible inside any of 9 x 9 x 9 small spheres."""
    centre = np.clip(np.rint(x), 1.0, 9.0)  # the nearest
    cost = -(100.0 - ((x - 5.0) ** 2).sum(1)) / 100.0
    return cost, _stack(((x - centre) ** 2).sum(1) - 0.0625)


def g13(x: Array) -> tuple[Array, Array]:
    """Five variables, three equalities."""
    x1, x2, x3, x4, x5 = x.T
    return np.exp(x.prod(1)), _stack(
        _equal((x**2).sum(1) - 10.0), _equal(x2 * x3 - 5.0 * x4 * x5), _equal(x1**3 + x2**3 + 1.0)
    )
