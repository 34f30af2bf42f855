"""A study's outcome as numbers and as text."""

import dataclasses
import json

import numpy as np
import pytest

from drake_gait.report.result import (
    PAPER_TABLE,
    baselines_line,
    in_words,
    r_squared_line,
    summary,
)
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.baselines import Comparison
from drake_gait.walk import Outcome, Walk

KEYS = {
    *("study", "seed", "feasible", "forward_mm", "lateral_mm", "yaw_deg", "com_height_mm"),
    *("frames", "coefficients_deg", "foot", "simulations", "survivors", "feasible_count"),
    *("r2_train", "r2_heldout", "r2_heldout_ridge", "r2_heldout_kriging"),
    *("survival_auc", "survival_auc_logistic", "wall_s", "versions"),
}


def of(entry, number, **changes):
    return dataclasses.replace(entry, id=number, walk=dataclasses.replace(entry.walk, **changes))


@pytest.fixture
def walks(entry):
    return [
        of(entry, 0, forward=0.1, lateral=-0.002, yaw=np.radians(1.5), com_height=0.2441),
        of(entry, 1, forward=0.15456, lateral=0.000725, yaw=np.radians(3.837), com_height=0.245),
        of(entry, 2, forward=0.3, lateral=0.5),
        of(entry, 3, outcome=Outcome.FELL, frames=100, com_height=0.05, forward=0.4),
    ]


@pytest.fixture(scope="module")
def network():
    x = np.random.default_rng(0).uniform(-1, 1, (60, 16))
    outputs = x[:, :4] * [0.02, 0.01, 0.1, 0.0] + [0.15, 0.0, 0.0, 0.25]
    return surrogate.fit(x, outputs, np.ones(60, dtype=bool))


@pytest.fixture
def outcome(study, walks, network):
    return summary(study, walks, network, wall_s=12.5)


def test_the_paper_s_table_ii_is_as_printed():
    assert len(PAPER_TABLE) == 8
    assert PAPER_TABLE[0] == (0.725, 154.56, 3.837, 240)
    assert PAPER_TABLE[-1] == (0.044, 177.96, 1.203, 240)
    forward = [row[1] for row in PAPER_TABLE]
    assert forward == sorted(forward)


def test_the_summary_has_every_key_that_is_promised(outcome):
    assert set(outcome) >= KEYS
    assert set(outcome["foot"]) == {
        *("big_toe_stiffness", "lesser_toes_stiffness", "toe_damping"),
        *("big_toe_width", "toe_length", "rigid_toes"),
    }


def test_the_summary_holds_the_best_walk_in_the_units_of_its_keys(outcome, entry):
    assert (outcome["walk"], outcome["feasible"], outcome["frames"]) == (1, True, 240)
    assert outcome["forward_mm"] == pytest.approx(154.56)
    assert outcome["lateral_mm"] == pytest.approx(0.725)
    assert outcome["yaw_deg"] == pytest.approx(3.837)
    assert outcome["com_height_mm"] == pytest.approx(245.0)
    assert np.array(outcome["coefficients_deg"]) == pytest.approx(entry.candidate.gait.degrees)
    assert outcome["foot"] == dataclasses.asdict(entry.candidate.foot)


def test_the_summary_counts_walks_survivors_and_feasible_walks(outcome):
    assert (outcome["simulations"], outcome["survivors"], outcome["feasible_count"]) == (4, 3, 2)
    assert (outcome["study"], outcome["seed"], outcome["wall_s"]) == ("small", 0, 12.5)


def test_the_summary_has_r2_of_every_output(outcome, network):
    for key, values in (("r2_train", network.r2_train), ("r2_heldout", network.r2_heldout)):
        assert list(outcome[key]) == ["forward", "lateral", "yaw", "com_height"]
        assert outcome[key]["forward"] == values[0]
    # Nothing varies in the height of this study's walks.
    assert outcome["r2_heldout"]["com_height"] is None


def test_the_summary_is_json_that_every_reader_takes(outcome, study, walks):
    def refuse(constant):
        pytest.fail(f"{constant} is no JSON")

    text = json.dumps(outcome)
    assert json.loads(text, parse_constant=refuse) == outcome
    assert json.loads(json.dumps(summary(study, walks, None, wall_s=0.0)))["r2_train"] == {
        "forward": None,
        "lateral": None,
        "yaw": None,
        "com_height": None,
    }


def test_the_baselines_stand_beside_the_network(study, walks, network):
    found = Comparison(
        ridge=np.array([0.25, 0.5, -0.125, -np.inf]),
        kriging=np.array([0.375, 0.625, 0.0, np.nan]),
        network_auc=0.875,
        logistic_auc=None,
    )
    outcome = summary(study, walks, network, baselines=found, wall_s=0.0)
    assert json.loads(json.dumps(outcome, allow_nan=False)) == outcome
    assert outcome["r2_heldout_ridge"] == {
        "forward": 0.25,
        "lateral": 0.5,
        "yaw": -0.125,
        "com_height": None,
    }
    assert outcome["r2_heldout_kriging"]["forward"] == 0.375
    assert (outcome["survival_auc"], outcome["survival_auc_logistic"]) == (0.875, None)
    line = baselines_line(outcome)
    assert "ridge Z 0.25   X 0.50   R -0.12" in line
    assert "kriging Z 0.38   X 0.62   R 0.00" in line
    assert line.endswith("survival (AUC) network 0.88, logistic -")


def test_a_study_without_a_network_has_no_baselines(study, walks):
    outcome = summary(study, walks, None, wall_s=0.0)
    assert outcome["r2_heldout_ridge"] == dict.fromkeys(outcome["r2_heldout"])
    assert outcome["survival_auc"] is None


def test_the_summary_of_a_study_without_a_feasible_walk_says_so(study, walks):
    outcome = summary(study, walks[2:], None, wall_s=0.0)
    assert outcome["feasible"] is False
    assert outcome["walk"] == 2
    assert outcome["feasible_count"] == 0


def test_the_summary_of_a_study_of_lost_walks_says_so(study, entry):
    lost = [dataclasses.replace(entry, walk=Walk.diverged("made up"))]
    outcome = summary(study, lost, None, wall_s=0.0)
    assert (outcome["feasible"], outcome["outcome"], outcome["survivors"]) == (False, "diverged", 0)


def test_a_walk_in_words_has_the_paper_s_four_numbers(walks):
    assert in_words(walks[1].walk) == ("154.6 mm forward, 0.7 mm lateral, 3.84 degrees, 240 frames")


def test_the_line_on_r2_has_training_and_held_out_of_every_output(network):
    line = r_squared_line(network)
    assert "training / held-out" in line
    assert f"Z {network.r2_train[0]:.2f} / {network.r2_heldout[0]:.2f}" in line
    assert [name for name in "ZXRY" if f" {name} " in line] == list("ZXRY")
