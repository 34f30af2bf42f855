from pathlib import Path

import numpy as np
import pytest
from conftest import texts

from drake_gait.errors import SettingsError
from drake_gait.surrogates.sensitivity import Sensitivity
from drake_gait.visualization import study as study_figures

OUTPUTS = [("distance", "mm"), ("lateral", "mm"), ("yaw", "deg")]


@pytest.mark.parametrize(
    ("forward_mm", "feasible"),
    [
        ([], []),
        ([np.nan, np.nan], [False, False]),
        ([100.0, np.nan, 150.0, 120.0], [False, False, True, False]),
        ([100.0, 120.0], [True, True]),
    ],
    ids=["no walk yet", "all fell", "mixed", "all feasible"],
)
def test_convergence_is_drawn_at_any_stage_of_a_study(
    forward_mm: list[float], feasible: list[bool], tmp_path: Path
) -> None:
    path = tmp_path / "convergence.svg"
    study_figures.convergence(forward_mm, feasible, path, samples=1)
    assert {"walk", "distance walked [mm]"} <= set(texts(path))
    assert ("fell" in texts(path)) == bool(np.isnan(forward_mm).any())


def test_the_best_feasible_walk_never_gets_worse() -> None:
    forward = np.array([90.0, np.nan, 120.0, 100.0, 150.0])
    best = study_figures._best_so_far(forward, np.array([False, False, True, True, True]))
    np.testing.assert_array_equal(best, [np.nan, np.nan, 120.0, 120.0, 150.0])


def test_convergence_refuses_flags_of_another_length(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="one flag for each walk"):
        study_figures.convergence([1.0, 2.0], [True], tmp_path / "convergence.png", samples=1)


def test_each_output_gets_two_panels_with_its_unit_and_their_scores(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    simulated = rng.normal(size=(30, 3))
    heldout = simulated + 0.5
    heldout[:20] = np.nan  # walks that every network has seen
    path = tmp_path / "predicted.svg"
    study_figures.predicted_against_simulated(
        simulated, simulated, heldout, [0.97, 0.96, 0.95], [0.5, 0.25, -0.125], OUTPUTS, path
    )
    shown = texts(path)
    for _, unit in OUTPUTS:
        assert {f"simulated [{unit}]", f"predicted [{unit}]"} <= set(shown)
    assert {"distance, training: R² 0.97", "lateral, held out: R² 0.25"} <= set(shown)
    assert {"yaw, training: R² 0.95", "yaw, held out: R² -0.12"} <= set(shown)


def test_predictions_of_another_shape_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="held out"):
        study_figures.predicted_against_simulated(
            np.zeros((4, 3)),
            np.zeros((4, 3)),
            np.zeros((2, 3)),
            [0] * 3,
            [0] * 3,
            OUTPUTS,
            tmp_path / "predicted.png",
        )


def test_sensitivity_names_every_variable_the_strongest_on_top(tmp_path: Path) -> None:
    found = Sensitivity(
        names=("hip_a", "knee_b", "big_toe_width"),
        total=np.array([0.2, 0.7, 0.1]),
        alone=np.array([0.1, 0.6, -0.01]),
        slope=np.array([0.01, -0.02, 0.003]),
    )
    path = tmp_path / "sensitivity.svg"
    study_figures.sensitivity(found, path)
    shown = texts(path)
    assert [text for text in shown if text in ("hip a", "knee b", "big toe width")] == [
        "big toe width",
        "hip a",
        "knee b",
    ]
    assert {"more of it: further", "more of it: less far"} <= set(shown)


@pytest.mark.parametrize("feasible", [[True, True, False], [False] * 3], ids=["some", "none"])
def test_parallel_coordinates_have_an_axis_for_each_variable(
    tmp_path: Path, feasible: list[bool]
) -> None:
    x = np.array([[0.0, 1.0], [0.5, -2.0], [0.1, 0.2]])
    path = tmp_path / "coordinates.svg"
    study_figures.parallel_coordinates(
        x, [100.0, 200.0, 50.0], feasible, x[1], ("hip_a", "knee_b"), path, label="winner"
    )
    shown = texts(path)
    assert {"hip a", "knee b", "value [half widths of the box]", "winner"} <= set(shown)
    assert ("distance of feasible walks [mm]" in shown) == any(feasible)


def test_no_point_of_a_pareto_front_is_bettered_in_both() -> None:
    rng = np.random.default_rng(0)
    gain, cost = rng.random((2, 60))
    front = study_figures.pareto_front(gain, cost)
    assert (np.diff(gain[front]) > 0.0).all()
    for point in range(60):
        bettered = ((gain > gain[point]) & (cost <= cost[point])) | (
            (gain >= gain[point]) & (cost < cost[point])
        )
        assert (point in front) == (not bettered.any())


def test_a_walk_without_a_cost_is_not_on_the_front() -> None:
    front = study_figures.pareto_front(np.array([1.0, 2.0, 3.0]), np.array([0.5, np.nan, np.inf]))
    np.testing.assert_array_equal(front, [0])


def test_the_pareto_figure_has_units_and_survives_walks_without_advance(tmp_path: Path) -> None:
    path = tmp_path / "pareto.svg"
    study_figures.pareto([100.0, 120.0, 0.0], [0.3, 0.4, np.inf], [True, True, False], path)
    assert {"distance walked [mm]", "cost of transport [1]", "Pareto front"} <= set(texts(path))


def test_the_pareto_figure_speaks_of_infeasible_walks_only_where_one_was_measured(
    tmp_path: Path,
) -> None:
    path = tmp_path / "pareto.svg"
    study_figures.pareto([100.0, 120.0], [0.3, np.nan], [True, False], path)
    assert "not feasible" not in texts(path)
    study_figures.pareto([100.0, 120.0], [0.3, 0.4], [True, False], path)
    assert "not feasible" in texts(path)


def test_drawings_of_a_long_study_have_no_mark_for_each_walk(tmp_path):
    rng = np.random.default_rng(0)
    x, forward = rng.uniform(-1.0, 1.0, (5001, 2)), rng.uniform(0.0, 500.0, 5001)
    held = forward > 400.0
    study_figures.convergence(forward, held, tmp_path / "all.svg", samples=60)
    path = tmp_path / "lines.svg"
    study_figures.parallel_coordinates(x, forward, held, x[0], ["a", "b"], path)
    for drawn in (tmp_path / "all.svg", path):
        text = drawn.read_text(encoding="utf-8")
        assert text.count("<use") + text.count("<path") < 1000
