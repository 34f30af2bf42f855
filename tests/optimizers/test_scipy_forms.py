"""ISADE takes what scipy's optimisers take, in every form that they have."""

import io
import threading
from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, NonlinearConstraint

from drake_gait.errors import SettingsError
from drake_gait.optimizers.isade import Isade, minimize

LOW, HIGH = [-5.0, -4.0, -3.0], [5.0, 6.0, 7.0]
BOX = np.array([LOW, HIGH]).T


def sphere(x):
    return float((x**2).sum())


def rows(x):
    return (x**2).sum(axis=1)


def run(bounds=BOX, fun=sphere, **settings):
    return minimize(fun, bounds, **{"max_evaluations": 400} | settings)


def same(one, other):
    return one.population.tolist() == other.population.tolist() and one.fun == other.fun


@pytest.fixture(scope="module")
def plain():
    return run()


# --- bounds, seeds, budgets ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "bounds",
    [
        lambda: Bounds(LOW, HIGH),
        lambda: zip(LOW, HIGH, strict=True),
        lambda: ([low, high] for low, high in BOX),
        lambda: dict(zip("abc", BOX, strict=True)).values(),
        lambda: tuple(map(tuple, BOX.tolist())),
        lambda: BOX.astype(np.float32),
        lambda: np.asfortranarray(BOX),
        lambda: [(Fraction(low), Fraction(high)) for low, high in BOX],
    ],
)
def test_bounds_of_every_form_give_the_same_run(plain, bounds):
    assert same(run(bounds()), plain)
    assert Isade(bounds()).ask().tolist() == Isade(BOX).ask().tolist()


def test_one_bound_of_scipy_s_serves_all_variables():
    assert same(run(Bounds([-5.0] * 3, 5.0)), run([(-5.0, 5.0)] * 3))


@pytest.mark.parametrize(
    "bounds", [None, "ab", 3, [(0.0, None)], [(0, 1j)], [(0, 1), (2,)], Bounds([0.0], [np.inf])]
)
def test_bounds_that_are_none_are_refused(bounds):
    with pytest.raises(SettingsError, match="bounds"):
        run(bounds)


@pytest.mark.parametrize("seed", [np.int64(0), 0.0, np.uint8(0)])
def test_a_whole_number_of_any_type_is_the_same_seed(plain, seed):
    assert same(run(seed=seed), plain)


def test_no_seed_gives_another_run_every_time():
    assert not same(run(seed=None), run(seed=None))
    assert not same(run(rng=None), run(rng=None))


@pytest.mark.parametrize(
    "made",
    [
        np.random.default_rng,
        np.random.RandomState,
        np.random.SeedSequence,
        np.random.PCG64,
        lambda seed: [seed, 1],
    ],
)
def test_a_generator_fixes_the_run_by_either_name(made):
    assert same(run(seed=made(5)), run(seed=made(5)))
    assert same(run(seed=made(5)), run(rng=made(5)))
    assert not same(run(seed=made(5)), run(seed=made(6)))


def test_a_generator_continues_from_run_to_run_and_leaves_the_global_one_alone():
    generator, before = np.random.default_rng(5), np.random.get_state()[1].tolist()  # noqa: NPY002
    assert not same(run(seed=generator), run(seed=generator))
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


@pytest.mark.parametrize("seed", [-1, 1.5, "x", [-1], np.nan])
def test_an_unusable_seed_is_refused(seed):
    with pytest.raises(SettingsError, match="seed"):
        run(seed=seed)


def test_two_seeds_are_refused():
    with pytest.raises(SettingsError, match="seed and rng"):
        run(seed=3, rng=4)


@pytest.mark.parametrize("seed", [2**63, 2**64, 2**200])
def test_a_run_with_a_seed_of_any_size_is_kept_and_resumed(seed):
    optimiser = Isade(BOX, seed=seed)
    optimiser.tell(rows(optimiser.ask()))
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **optimiser.state())
    file.seek(0)
    resumed = Isade.from_state(np.load(file))
    assert resumed.ask().tolist() == optimiser.ask().tolist()
    assert resumed.seed == seed


@pytest.mark.parametrize("budget", [4e2, np.float32(400), np.int16(400)])
def test_a_whole_budget_of_any_type_is_the_same(plain, budget):
    assert same(run(max_evaluations=budget), plain)


@pytest.mark.parametrize("budget", [400.5, np.inf, np.nan, "400", None])
def test_a_budget_that_is_no_whole_number_is_refused_with_it(budget):
    with pytest.raises(SettingsError, match=f"max_evaluations .*got {budget}"):
        run(max_evaluations=budget)


# --- functions -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form",
    [
        np.asarray,
        np.atleast_1d,
        np.atleast_2d,
        np.float64,
        lambda cost: [cost],
        lambda cost: np.array([cost], dtype=object),
    ],
)
def test_a_cost_of_one_number_in_any_shape_gives_the_same_run(plain, form):
    assert same(run(fun=lambda x: form(sphere(x))), plain)


def test_costs_as_a_column_give_the_same_run(plain):
    assert same(run(fun=rows, vectorized=True), plain)
    assert same(run(fun=lambda x: rows(x)[:, None], vectorized=True), plain)


@pytest.mark.parametrize("cost", [1, True, np.int8(1), Fraction(1)])
def test_a_cost_of_any_real_type_is_its_number(cost):
    assert run(fun=lambda x: cost).fun == 1.0


@pytest.mark.parametrize("cost", [None, "1", 1j, [1.0, 2.0]])
def test_a_value_that_is_not_a_cost_is_refused(cost):
    with pytest.raises(SettingsError, match="costs must be"):
        run(fun=lambda x: cost)


def test_a_function_may_change_what_it_is_given_and_give_what_it_will_change(plain):
    buffer = np.zeros(1)

    def cost(x):
        buffer[0] = sphere(x)
        x[:] = np.nan
        return buffer

    assert same(run(fun=cost), plain)


@pytest.mark.parametrize("args", [(2.0,), 2.0, [2.0]])
def test_further_arguments_are_handed_on(args):
    result = minimize(lambda x, a: sphere(x - a), BOX, args, max_evaluations=4_000)
    np.testing.assert_allclose(result.x, 2.0, atol=1e-6)


def test_a_guess_opens_the_population_before_the_initial_points():
    assert run(x0=[0.0, 0.0, 0.0]).fun == 0.0
    seen = []
    run(fun=lambda x: seen.append(x.tolist()) or 0.0, x0=[1, 1, 1], initial=[[2, 2, 2]])
    assert seen[:2] == [[1, 1, 1], [2, 2, 2]]
    with pytest.raises(SettingsError, match=r"x0 must be \(3,\)"):
        run(x0=[0.0])


def test_one_truth_makes_all_variables_whole():
    assert (run(integrality=True).population % 1 == 0).all()


# --- constraints ---------------------------------------------------------------------------------

SUM = {  # x_0 + x_1 >= 1, whose nearest point to the origin is (0.5, 0.5, 0)
    "function": lambda x: 1.0 - x[0] - x[1],
    "nonlinear": NonlinearConstraint(lambda x: x[0] + x[1], 1.0, np.inf),
    "between": NonlinearConstraint(lambda x: [x[0] + x[1]], [1.0], [4.0]),
    "linear": LinearConstraint([[1.0, 1.0, 0.0]], 1.0),
    "row": LinearConstraint([1, 1, 0], 1, 4),
    "sparse": LinearConstraint(sparse.csr_array([[1.0, 1.0, 0.0]]), 1.0, 4.0),
    "dictionary": {"type": "ineq", "fun": lambda x: x[0] + x[1] - 1.0, "jac": None},
    "arguments": {"type": "INEQ", "fun": lambda x, a, b: x[0] + x[1] - a * b, "args": (2.0, 0.5)},
    "equality": NonlinearConstraint(lambda x: x[0] + x[1], 1.0, 1.0),
    "equal": {"type": "eq", "fun": lambda x, a: x[0] + x[1] - a, "args": 1.0},
}


@pytest.mark.parametrize("form", SUM)
def test_a_constraint_of_every_form_is_met(form):
    result = run(constraints=SUM[form], max_evaluations=8_000)
    np.testing.assert_allclose(result.x, [0.5, 0.5, 0.0], atol=1e-3)
    assert result.success
    assert result.maxcv == 0.0


def test_constraints_of_several_forms_are_met_together():
    given = (
        SUM["dictionary"],
        Bounds([-np.inf, -np.inf, 0.25], np.inf),
        lambda x: [0.75 - x[0], -1.0],
    )
    for several in (given, list(given), iter(given)):
        result = run(constraints=several, max_evaluations=8_000)
        np.testing.assert_allclose(result.x, [0.75, 0.25, 0.25], atol=1e-3)


def test_no_constraints_in_any_form_give_the_same_run(plain):
    assert same(run(constraints=()), plain)
    assert same(run(constraints=[]), plain)


@pytest.mark.parametrize(
    "constraint",
    [
        NonlinearConstraint(lambda x: x[:, 0] + x[:, 1], 1.0, 4.0),
        SUM["sparse"],
        SUM["row"],
        {"type": "ineq", "fun": lambda x: (x[:, :1] + x[:, 1:2]) - 1.0},
    ],
)
def test_constraints_take_whole_generations(constraint):
    result = run(fun=rows, vectorized=True, constraints=constraint, max_evaluations=8_000)
    np.testing.assert_allclose(result.x, [0.5, 0.5, 0.0], atol=1e-3)


def test_an_equality_is_met_within_the_tolerance_that_is_given():
    missed = run(constraints=SUM["equality"], tolerance=0.5, max_evaluations=8_000)
    assert missed.x[:2].sum() == pytest.approx(0.5, abs=1e-3)
    exact = run(constraints=SUM["equality"], tolerance=0.0)
    assert not exact.success
    assert f"{exact.maxcv:g}" in exact.message


@pytest.mark.parametrize(
    ("constraint", "words"),
    [
        (3, "constraints must be .* got 3"),
        ("x", "constraints must be .* got 'x'"),
        ([sphere, 3], "constraint 1 must be .* got 3"),
        ({"fun": sphere}, "constraint 0: type must be 'ineq' or 'eq', got None"),
        ({"type": "le", "fun": sphere}, "constraint 0: type .* got 'le'"),
        ({"type": "eq"}, "constraint 0: fun must be a function, got None"),
        (LinearConstraint([[1.0, 1.0]], 0.0, 1.0), "constraint 0: A must have 3 columns, has 2"),
        (NonlinearConstraint(sphere, 2.0, 1.0), "constraint 0: lb must be at or below ub"),
        (NonlinearConstraint(sphere, np.nan, 1.0), "constraint 0: lb must be at or below ub"),
        (NonlinearConstraint(sphere, [0, 0], 1.0), r"constraint 0: .* got \(2,\)"),
        (NonlinearConstraint(lambda x: "1", 0.0, 1.0), "constraint 0 must be real numbers"),
        (lambda x: [1.0] * (1 + (x[0] > 0)), "violations must be as many at every x"),
    ],
)
def test_an_unusable_constraint_is_refused_by_its_number(constraint, words):
    with pytest.raises(SettingsError, match=words):
        run(constraints=constraint)


# --- callbacks -----------------------------------------------------------------------------------


def test_each_form_of_callback_sees_the_run():
    seen = []

    def by_name(intermediate_result):
        seen.append(intermediate_result.x)

    def old(xk, convergence):
        assert 0.0 < convergence < np.inf
        seen.append(xk)

    def old_by_name(xk, *, convergence=None):
        assert convergence > 0.0
        seen.append(xk)

    runs = []
    for callback in (by_name, old, old_by_name, lambda result: seen.append(result.x)):
        seen.clear()
        run(callback=callback)
        runs.append(np.array(seen).tolist())
    assert len(runs[0]) == 10
    assert runs[0] == runs[1] == runs[2] == runs[3]


def test_convergence_grows_as_the_population_gathers():
    seen = []
    minimize(
        lambda x: 1.0 + sphere(x), BOX, callback=lambda xk, convergence: seen.append(convergence)
    )
    assert seen[0] < 0.1
    assert seen[-1] > 1.0
    seen.clear()
    run(callback=lambda xk, convergence: seen.append(convergence), fun=lambda x: np.nan)
    assert set(seen) == {0.0}


def stop(*_):
    raise StopIteration


class Stopper:
    def __call__(self, intermediate_result):
        return np.bool_(True)


@pytest.mark.parametrize(
    "callback", [stop, Stopper(), lambda xk, convergence=0: True, lambda result: 1]
)
def test_a_callback_stops_the_run(callback):
    result = run(callback=callback)
    assert (result.nit, result.nfev) == (0, 40)
    assert "callback" in result.message
    assert result.success


# --- what goes wrong on the way ------------------------------------------------------------------


@pytest.mark.parametrize("error", [ValueError("no mesh"), KeyboardInterrupt(), StopIteration()])
@pytest.mark.parametrize("vectorized", [False, True])
def test_an_exception_brings_the_best_so_far(error, vectorized):
    costs = []

    def cost(x):
        if len(costs) >= 95:
            raise error
        costs.extend(found := rows(np.atleast_2d(x)))
        return found

    with pytest.raises(type(error)) as caught:
        run(fun=cost, vectorized=vectorized)
    best = caught.value.result
    assert caught.value is error
    assert (best.nfev, best.nit, best.success) == (len(costs), 2 if vectorized else 1, False)
    assert best.fun == min(costs) == sphere(best.x)
    assert type(error).__name__ in best.message
    assert "result" in caught.value.__notes__[0]


def test_an_exception_at_once_has_no_best():
    with pytest.raises(ZeroDivisionError) as caught:
        run(fun=lambda x: 1 / 0)
    assert (caught.value.result.nfev, caught.value.result.fun) == (0, np.inf)
    assert "No point had a finite cost" in caught.value.result.message


def test_an_exception_in_a_constraint_or_a_callback_brings_the_best_so_far():
    seen = []

    def constraint(x):
        seen.append(x)
        return {"early": -1.0}["early" if len(seen) < 50 else "late"]

    with pytest.raises(KeyError) as caught:
        run(constraints=constraint)
    assert caught.value.result.nfev == 49
    with pytest.raises(ZeroDivisionError) as divided:
        run(callback=lambda result: 1 / 0)
    assert (divided.value.result.nfev, divided.value.result.nit) == (40, 0)


@pytest.mark.parametrize("cost", [np.nan, np.inf, -np.inf])
def test_a_run_without_a_finite_cost_says_so(cost):
    result = run(fun=lambda x: cost)
    assert not result.success
    assert result.message.endswith("No point had a finite cost.")


def test_a_run_without_a_feasible_finite_cost_says_so():
    result = run(fun=lambda x: np.nan if x[0] > 0.0 else 1.0, constraints=lambda x: -x[0])
    assert not result.success
    assert result.message.endswith("No feasible point had a finite cost.")


def test_a_run_without_a_feasible_point_says_by_how_much():
    result = run(constraints=lambda x: 0.125)
    assert not result.success
    assert result.message.endswith("The best point violates a constraint by 0.125.")


def test_runs_in_threads_give_what_they_give_one_after_the_other():
    found = {}
    threads = [
        threading.Thread(target=lambda seed=seed: found.update({seed: run(seed=seed)}))
        for seed in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(same(found[seed], run(seed=seed)) for seed in range(3))
