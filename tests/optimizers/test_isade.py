"""ISADE: its laws for all inputs, what it reaches, what it refuses."""

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_gait.errors import SettingsError
from drake_gait.optimizers.isade import HANDLINGS, VARIANTS, Isade, minimize

BOX = [(-5.0, 5.0)] * 3

few = settings(max_examples=25, deadline=None)
variants = st.sampled_from(VARIANTS)
handlings = st.sampled_from(HANDLINGS)
seeds = st.integers(0, 2**32)


def sphere(x):
    return (x**2).sum(-1)


def rastrigin(x):
    return (x**2 - 10.0 * np.cos(2.0 * np.pi * x) + 10.0).sum(-1)


def outside_unit_ball(x):
    """Feasible outside the ball, where the sphere's optimum is 1."""
    return 1.0 - sphere(x)[..., None]


def advance(optimiser, generations, fun=sphere, constraints=None):
    """Tell `generations` generations; the trials of each."""
    told = []
    for _ in range(generations):
        trials = optimiser.ask()
        optimiser.tell(fun(trials), constraints and constraints(trials))
        told.append(trials)
    return told


# --- laws ----------------------------------------------------------------------------------------


@few
@given(variant=variants, handling=handlings, seed=seeds, low=st.floats(-1e3, 1e3))
def test_trials_never_leave_the_bounds(variant, handling, seed, low):
    bounds = np.array([(low, low + 1.0), (-1e-3, 1e3), (low - 0.5, low + 7.3)])
    optimiser = Isade(
        bounds,
        seed=seed,
        max_generations=15,
        variant=variant,
        handling=handling,
        integrality=[False, False, True],
    )
    for trials in advance(optimiser, 15, constraints=outside_unit_ball):
        assert (bounds[:, 0] <= trials).all()
        assert (trials <= bounds[:, 1]).all()
        np.testing.assert_array_equal(trials[:, 2], np.rint(trials[:, 2]))


@few
@given(variant=variants, seed=seeds)
def test_without_constraints_the_best_and_every_cost_never_get_worse(variant, seed):
    optimiser = Isade(BOX, seed=seed, max_generations=20, variant=variant)
    advance(optimiser, 1, rastrigin)
    for _ in range(20):
        best, worst = optimiser.best_cost, optimiser.costs.max()
        advance(optimiser, 1, rastrigin)
        assert optimiser.best_cost <= best
        assert optimiser.costs.max() <= worst
        assert optimiser.costs.min() == optimiser.best_cost == rastrigin(optimiser.best_x)


@few
@given(variant=variants, handling=handlings, seed=seeds)
def test_the_best_point_never_gives_up_feasibility_nor_then_cost(variant, handling, seed):
    optimiser = Isade(BOX, seed=seed, max_generations=20, variant=variant, handling=handling)
    advance(optimiser, 1, constraints=outside_unit_ball)
    for _ in range(20):
        before = (optimiser.best_violation.sum(), optimiser.best_cost)
        advance(optimiser, 1, constraints=outside_unit_ball)
        assert (optimiser.best_violation.sum(), optimiser.best_cost) <= before


@few
@given(variant=variants, seed=seeds, constant=st.integers(-(2**20), 2**20))
def test_a_constant_added_to_the_cost_changes_no_trial(variant, seed, constant):
    def steps(x):  # whole numbers: adding another is exact
        return np.floor(10.0 * rastrigin(x))

    one = Isade(BOX, seed=seed, max_generations=10, variant=variant)
    other = Isade(BOX, seed=seed, max_generations=10, variant=variant)
    for a, b in zip(
        advance(one, 10, steps), advance(other, 10, lambda x: steps(x) + constant), strict=True
    ):
        np.testing.assert_array_equal(a, b)


@few
@given(variant=variants, handling=handlings, seed=seeds, generations=st.integers(0, 12))
def test_a_run_resumed_from_its_state_continues_as_if_never_interrupted(
    variant, handling, seed, generations
):
    optimiser = Isade(
        BOX,
        seed=seed,
        max_generations=20,
        variant=variant,
        handling=handling,
        integrality=[True, False, False],
    )
    advance(optimiser, generations, rastrigin, outside_unit_ball)
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **optimiser.state())
    file.seek(0)
    with np.load(file) as state:
        resumed = Isade.from_state(state)
    ahead = advance(optimiser, 8, rastrigin, outside_unit_ball)
    again = advance(resumed, 8, rastrigin, outside_unit_ball)
    for a, b in zip(ahead, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert resumed.best_cost == optimiser.best_cost


def test_trials_asked_and_not_told_are_asked_again_after_a_resume():
    optimiser = Isade(BOX, seed=3)
    advance(optimiser, 2)
    trials = optimiser.ask()
    np.testing.assert_array_equal(Isade.from_state(optimiser.state()).ask(), trials)


def test_a_state_does_not_change_while_the_run_continues():
    optimiser = Isade(BOX, seed=3)
    advance(optimiser, 2)
    state = optimiser.state()
    first = Isade.from_state(state).ask()
    advance(optimiser, 3)
    np.testing.assert_array_equal(Isade.from_state(state).ask(), first)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_seed_gives_the_same_run_and_another_seed_another(variant):
    def run(seed):
        return minimize(rastrigin, BOX, seed=seed, max_evaluations=800, variant=variant)

    assert run(1).population.tolist() == run(1).population.tolist()
    assert run(1).population.tolist() != run(2).population.tolist()


@few
@given(variant=variants, seed=seeds, power=st.integers(-10, 10))
def test_the_unit_of_a_variable_does_not_matter(variant, seed, power):
    unit = 2.0**power  # exact in floating point
    one = minimize(sphere, BOX, seed=seed, max_evaluations=400, variant=variant)
    other = minimize(
        lambda x: sphere(x / unit),
        np.array(BOX) * unit,
        seed=seed,
        max_evaluations=400,
        variant=variant,
    )
    assert other.fun == pytest.approx(one.fun, rel=1e-6)


def test_one_point_at_a_time_and_whole_generations_give_the_same_run():
    settings = {"constraints": outside_unit_ball, "seed": 4, "max_evaluations": 1_000}
    one = minimize(sphere, BOX, **settings)
    whole = minimize(sphere, BOX, vectorized=True, **settings)
    np.testing.assert_array_equal(one.x, whole.x)
    assert one.nfev == whole.nfev


def test_costs_that_are_not_finite_lose():
    def half_undefined(x):
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(x[:, 0] < -1.0, -np.inf, np.log(x[:, 0]) ** 2 + sphere(x[:, 1:]))

    result = minimize(half_undefined, BOX, vectorized=True, max_evaluations=4_000)
    np.testing.assert_allclose(result.x, [1.0, 0.0, 0.0], atol=1e-3)
    assert result.success


def test_violations_that_are_not_finite_lose():
    def constraints(x):
        return np.where(x[:, :1] < 1.0, np.nan, 1.0 - x[:, :1])

    result = minimize(sphere, BOX, constraints=constraints, vectorized=True, max_evaluations=4_000)
    np.testing.assert_allclose(result.x, [1.0, 0.0, 0.0], atol=1e-3)


def test_nothing_finite_is_no_success():
    result = minimize(lambda x: np.nan, BOX, max_evaluations=200)
    assert not result.success
    assert result.fun == np.inf


# --- reach ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_paper_s_form_solves_rastrigin_in_eight_variables(seed):
    result = minimize(
        rastrigin, [(-4.0, 6.0)] * 8, seed=seed, vectorized=True, max_evaluations=20_000
    )
    assert result.fun < 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_the_history_variant_solves_a_turned_ellipsoid(seed):
    axes = np.linalg.qr(np.random.default_rng(0).standard_normal((8, 8)))[0]
    weight = 10.0 ** np.linspace(0.0, 6.0, 8)
    result = minimize(
        lambda x: ((x - 1.0) @ axes) ** 2 @ weight,
        [(-5.0, 5.0)] * 8,
        seed=seed,
        vectorized=True,
        variant="history",
        max_evaluations=20_000,
    )
    assert result.fun < 1e-4


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("seed", range(3))
def test_the_corner_of_g06_is_found(variant, seed):
    def cost(x):
        return (x[:, 0] - 10.0) ** 3 + (x[:, 1] - 20.0) ** 3

    def constraints(x):
        first, second = x.T
        return np.stack(
            [
                100.0 - (first - 5.0) ** 2 - (second - 5.0) ** 2,
                (first - 6.0) ** 2 + (second - 5.0) ** 2 - 82.81,
            ],
            axis=1,
        )

    result = minimize(
        cost,
        [(13.0, 100.0), (0.0, 100.0)],
        constraints=constraints,
        seed=seed,
        vectorized=True,
        variant=variant,
        max_evaluations=15_000,
    )
    assert result.success
    assert result.maxcv == 0.0
    assert result.fun == pytest.approx(-6961.8138756, rel=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_an_equality_is_met_with_a_shrinking_epsilon(seed):
    result = minimize(  # g11: the band of width 1e-4 about a parabola
        lambda x: x[:, 0] ** 2 + (x[:, 1] - 1.0) ** 2,
        [(-1.0, 1.0)] * 2,
        vectorized=True,
        constraints=lambda x: np.abs(x[:, 1] - x[:, 0] ** 2)[:, None] - 1e-4,
        seed=seed,
        handling="epsilon",
        max_evaluations=15_000,
    )
    assert result.success
    assert result.fun == pytest.approx(0.7499, rel=1e-4)


def test_whole_numbers_are_found_among_real_ones():
    result = minimize(
        lambda x: (x[:, 0] - 2.6) ** 2 + (x[:, 1] - 2.6) ** 2,
        [(-9.5, 9.5)] * 2,
        seed=1,
        integrality=[True, False],
        vectorized=True,
        max_evaluations=4_000,
    )
    np.testing.assert_allclose(result.x, [3.0, 2.6], atol=1e-4)


def test_the_penalty_lets_cost_pay_for_violation():
    def run(penalty):
        return minimize(
            sphere,
            BOX,
            constraints=outside_unit_ball,
            handling="penalty",
            penalty=penalty,
            vectorized=True,
            max_evaluations=4_000,
        )

    assert sphere(run(1e3).population).min() > 0.99
    assert sphere(run(0.1).population).max() < 0.1


# --- the driver ----------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("budget", [120, 555, 1_000])
def test_no_more_evaluations_are_made_than_allowed(variant, budget):
    seen = []
    result = minimize(
        lambda x: seen.append(1) or sphere(x), BOX, max_evaluations=budget, variant=variant
    )
    assert len(seen) == result.nfev <= budget
    assert result.nfev > 0.6 * budget


def test_iterations_end_the_run():
    result = minimize(sphere, BOX, max_iterations=7)
    assert result.nit == 7
    assert result.nfev == 8 * len(result.population)


def test_stagnation_ends_the_run():
    result = minimize(lambda x: 1.0, BOX, stagnation=5)
    assert result.nit == 5
    assert "5 generations" in result.message


def test_a_callback_sees_every_generation_and_can_end_the_run():
    seen = []

    def callback(result):
        seen.append(result.fun)
        return len(seen) == 4

    result = minimize(sphere, BOX, callback=callback)
    assert result.nit == 3
    assert seen == sorted(seen, reverse=True)
    assert "callback" in result.message


def test_the_initial_points_open_the_first_population():
    points = np.array([[1.0, 2.0, 3.0], [0.5, 0.0, 0.0]])
    assert Isade(BOX, initial=points).ask()[:2].tolist() == points.tolist()
    assert minimize(sphere, BOX, initial=[[0.0, 0.0, 0.0]], max_evaluations=100).fun == 0.0


def test_the_result_does_not_change_with_a_later_generation():
    kept = []
    minimize(sphere, BOX, max_iterations=5, callback=lambda r: kept.append((r, r.x.tolist())))
    assert all(result.x.tolist() == x for result, x in kept)


# --- misuse --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"bounds": []}, "bounds must be"),
        ({"bounds": [(0.0, 1.0, 2.0)]}, "bounds must be"),
        ({"bounds": [(0.0, 1.0), (1.0, 0.0)]}, "variable 1"),
        ({"bounds": [(0.0, 0.0)]}, "variable 0"),
        ({"bounds": [(0.0, np.nan)]}, "variable 0"),
        ({"bounds": [(0.0, np.inf)]}, "variable 0"),
        ({"bounds": [(-1e308, 1e308)]}, "variable 0"),
        ({"population_size": 4}, "population_size"),
        ({"population_size": 9.5}, "population_size"),
        ({"seed": -1}, "seed"),
        ({"max_generations": 0}, "max_generations"),
        ({"integrality": [True]}, "integrality"),
        ({"bounds": [(0.1, 0.9)], "integrality": [True]}, "no whole number"),
        ({"variant": "papre"}, "there are paper"),
        ({"handling": "death"}, "there are epsilon"),
        ({"penalty": 0.0}, "penalty"),
        ({"penalty": np.nan}, "penalty"),
        ({"initial": [1.0, 2.0, 3.0]}, "initial must be"),
        ({"initial": np.zeros((99, 3))}, "initial must be"),
        ({"initial": [[0.0, 0.0, 5.1]]}, "outside the bounds"),
        ({"initial": [[0.0, 0.0, np.nan]]}, "outside the bounds"),
    ],
)
def test_a_setting_that_cannot_be_used_is_refused(wrong, words):
    with pytest.raises(SettingsError, match=words):
        Isade(**{"bounds": BOX} | wrong)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"max_evaluations": 10}, "max_evaluations"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"stagnation": 0}, "stagnation"),
        ({"fun": lambda x: x}, "costs must be"),
        ({"fun": lambda x: 1.0, "vectorized": True}, "costs must be"),
        ({"constraints": lambda x: x[:, None, None], "vectorized": True}, "violations must be"),
        ({"constraints": lambda x: 1.0, "vectorized": True}, "violations must be"),
    ],
)
def test_a_call_that_cannot_be_used_is_refused(wrong, words):
    with pytest.raises(SettingsError, match=words):
        minimize(**{"fun": sphere, "bounds": BOX} | wrong)


def test_ask_twice_and_tell_twice_are_refused():
    optimiser = Isade(BOX)
    with pytest.raises(SettingsError, match="ask\\(\\) for trials first"):
        optimiser.tell([1.0])
    optimiser.ask()
    with pytest.raises(SettingsError, match="called twice"):
        optimiser.ask()


def test_constraints_that_change_in_number_are_refused():
    optimiser = Isade(BOX)
    advance(optimiser, 1, constraints=outside_unit_ball)
    trials = optimiser.ask()
    with pytest.raises(SettingsError, match=r"\(40, 1\)"):
        optimiser.tell(sphere(trials))


def test_a_refused_tell_can_be_repeated():
    optimiser = Isade(BOX)
    trials = optimiser.ask()
    with pytest.raises(SettingsError, match="costs must be"):
        optimiser.tell([1.0])
    optimiser.tell(sphere(trials))
    assert optimiser.generation == 1


def test_a_state_with_an_entry_missing_is_refused():
    state = Isade(BOX).state()
    del state["best_x"]
    with pytest.raises(SettingsError, match="best_x"):
        Isade.from_state(state)
