"""Settings of the search, its measures and its confirmation, as a person writes them."""

import json

import numpy as np
import pytest
from conftest import MINIMAL

from drake_gait.errors import SettingsError
from drake_gait.problem import Objective, Trial
from drake_gait.search.runner import perturbed
from drake_gait.study.search_settings import ConfirmationSettings, Mode, SearchSettings
from drake_gait.study.settings import study_settings

EVERY_SEARCH = f"""
{MINIMAL}
[search]
mode = "isade"
objective = "cost_of_transport"
samples = 30
simulations = 90
replicas = 3
[confirmation]
walks = 60
winners = 2
replicas = 6
feasible = 5
noise_deg = 0.1
friction = 0.2
[constraints]
energy_j = 9.0
positive_energy_j = 8.0
cost_of_transport = 2.5
peak_torque_n_m = 1.1
peak_speed_rad_per_s = 6.5
saturated_fraction = 0.1
slip_mm = 12
clearance_mm = 4
duty_factor = 0.7
peak_ground_reaction = 1.8
toe_range_deg = 20
yaw_swing_deg = 15
torso_tilt_deg = 10
[walk]
friction = 0.9
"""


def test_the_procedure_the_objective_and_the_confirmation_are_read(read):
    study = read(EVERY_SEARCH)
    assert study.search == SearchSettings(
        mode=Mode.ISADE,
        objective=Objective.COST_OF_TRANSPORT,
        samples=30,
        simulations=90,
        replicas=3,
    )
    expected = ConfirmationSettings(
        walks=60, winners=2, replicas=6, feasible=5, noise=np.radians(0.1), friction=0.2
    )
    assert study.confirmation == expected
    assert study.walk.friction == 0.9


def test_limits_of_measures_are_written_in_the_units_of_their_names(read):
    limits = read(EVERY_SEARCH).constraints
    assert (limits.energy, limits.positive_energy, limits.cost_of_transport) == (9.0, 8.0, 2.5)
    assert (limits.peak_torque, limits.peak_speed) == (1.1, 6.5)
    assert (limits.saturated_fraction, limits.duty_factor) == (0.1, 0.7)
    assert limits.peak_ground_reaction == 1.8
    assert (limits.slip, limits.clearance) == pytest.approx((0.012, 0.004))
    angles = np.degrees([limits.toe_range, limits.yaw_swing, limits.torso_tilt])
    assert angles == pytest.approx([20.0, 15.0, 10.0])


@pytest.mark.parametrize("key", ["slip_mm", "yaw_swing_deg"])
def test_what_is_limited_is_an_output_of_the_network(read, key):
    limited = read(MINIMAL, {("constraints", key): 10})
    assert limited.outputs[-1] == key.rpartition("_")[0]
    assert len(limited.outputs) == len(read(MINIMAL).outputs) + 1


@pytest.mark.parametrize("measures", [True, False])
def test_a_key_without_effect_is_read_and_told(read, measures):
    settings = read(MINIMAL, {("walk", "measures"): measures, ("walk", "step_ms"): 2.0})
    assert settings.walk == read(MINIMAL, {("walk", "step_ms"): 2.0}).walk
    (note,) = settings.notes
    assert note.startswith("walk.measures is without effect")
    assert read(MINIMAL).notes == ()
    with pytest.raises(SettingsError, match=r"walk\.measure\b.*measure"):
        read(MINIMAL, {("walk", "measure"): True})


def test_every_variation_of_the_extreme_frictions_can_be_walked(read):
    for friction in (0.1, 1.5):
        overrides = {("walk", "friction"): friction, ("confirmation", "friction"): 0.5}
        study = read(MINIMAL, overrides)
        trial = Trial(candidate=study.space.decode(np.zeros(16)), settings=study.walk)
        found = [perturbed(trial, study, 0, variation).settings.friction for variation in (1, 2)]
        assert found == pytest.approx([0.5 * friction, 1.5 * friction])


def test_they_return_from_their_description(read):
    description = read(EVERY_SEARCH).description()
    again = study_settings(json.loads(json.dumps(description)))
    assert again.description() == description
    assert again.search == read(EVERY_SEARCH).search
    assert study_settings({**description, "walk.measures": True}).description() == description


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[search]\nmode = 'defualt'", "search.mode must be one of default, isade-network"),
        ("[search]\nobjective = 'speed'", "search.objective must be one of distance"),
        ("[search]\nreplicas = 7", "leaves 300 walks for candidates that are proposed"),
        ("[confirmation]\nwalks = -1", "confirmation.walks"),
        ("[confirmation]\nfeasible = 9", "confirmation.feasible (9)"),
        (
            "[confirmation]\nnoise_deg = 6",
            "confirmation.noise_deg must be 0 to 5.72958 degrees, got 6",
        ),
        ("[confirmation]\nnoise_deg = 'x'", "confirmation.noise"),
        ("[confirmation]\nfriction = nan", "confirmation.friction"),
        ("[confirmation]\nfriction = 0.6", "confirmation.friction must be 0 to 0.5, got 0.6"),
        ("[constraints]\nslip_mm = 0", "slip"),
        ("[constraints]\nclearance_mm = nan", "constraints.clearance_mm"),
        ("[walk]\nfriction = 0.09", "walk.friction must be 0.1 to 1.5, got 0.09"),
        ("[walk]\nfriction = 1.6", "walk.friction must be 0.1 to 1.5, got 1.6"),
        ("[walk]\nfriction = 3", "friction must be"),
        ("[walk]\nfriction = true", "walk.friction"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(read, text, complaint):
    with pytest.raises(SettingsError) as refusal:
        read(MINIMAL + text)
    assert complaint in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_search_leaves_the_ids_of_its_confirmation_free():
    with pytest.raises(SettingsError, match=r"search\.simulations .* got 1000000"):
        SearchSettings(simulations=1_000_000)
    assert SearchSettings(simulations=999_999).simulations == 999_999
