"""How a study searches and confirms: what is refused, and in which words."""

import math

import pytest

from drake_gait.errors import SettingsError
from drake_gait.problem import Objective
from drake_gait.study.search_settings import ConfirmationSettings, Mode, SearchSettings


def refusal(settings, **values):
    """The line that values are refused with."""
    with pytest.raises(SettingsError) as caught:
        settings(**values)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("name", "value", "known"),
    [
        ("mode", "defualt", "default, isade-network, paper, isade, cmaes"),
        ("mode", 3, "default, isade-network, paper, isade, cmaes"),
        ("mode", None, "default, isade-network, paper, isade, cmaes"),
        ("mode", [], "default, isade-network, paper, isade, cmaes"),
    ],
)
def test_a_choice_that_there_is_not_is_refused_with_those_that_there_are(name, value, known):
    expected = f"search.{name} must be one of {known}, got {value!r}"
    assert refusal(SearchSettings, **{name: value}) == expected


@pytest.mark.parametrize("text", ["speed", "maximise", "least energy", "slip minimise", 3])
def test_an_objective_that_is_no_quantity_is_refused_with_those_that_are(text):
    said = refusal(SearchSettings, objective=text)
    assert said.startswith("search.objective must be one of distance, lateral, ")
    assert said.endswith(f"got {text!r}")


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("objective", [Objective.DISTANCE, Objective.COST_OF_TRANSPORT])
def test_a_choice_may_be_given_by_its_word(mode, objective):
    found = SearchSettings(mode=str(mode), objective=str(objective))
    assert found.mode is mode
    assert found.objective == objective


@pytest.mark.parametrize("value", [0, -1, 2.5, 2.0, "2", True, math.nan, None])
@pytest.mark.parametrize(
    ("name", "least"), [("samples", 1), ("simulations", 1), ("batch", 4), ("replicas", 1)]
)
def test_a_number_of_walks_is_a_whole_number_of_the_least_or_more(name, least, value):
    expected = f"search.{name} must be a whole number >= {least}, got {value!r}"
    assert refusal(SearchSettings, **{name: value}) == expected


@pytest.mark.parametrize("value", [0, 1.5, True])
def test_stagnation_is_a_whole_number_of_networks_or_none(value):
    assert "search.stagnation must be a whole number >= 1" in refusal(
        SearchSettings, stagnation=value
    )
    assert SearchSettings(stagnation=None).stagnation is None


def test_more_samples_than_walks_in_all_are_refused_with_both_numbers():
    message = refusal(SearchSettings, samples=41, simulations=40)
    assert message.startswith("search.samples (41) must not exceed search.simulations (40)")
    SearchSettings(samples=40, simulations=40)


@pytest.mark.parametrize(("mode", "proposed"), [("default", 20), ("isade", 60)])
def test_walks_that_are_no_whole_number_of_candidates_are_refused(mode, proposed):
    plan = {"mode": mode, "samples": 40, "simulations": 40 * (mode == "default") + proposed}
    message = refusal(SearchSettings, replicas=7, **plan)
    assert f"leaves {proposed} walks" in message
    assert message.endswith("it must leave a multiple of search.replicas (7)")
    SearchSettings(replicas=5, **plan)


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("walks", 0),
        ("reference_walks", 0),
        ("servo_walks", 0),
        ("winners", 1),
        ("replicas", 1),
        ("feasible", 1),
    ],
)
@pytest.mark.parametrize("beyond", [-1, 0.5, True])
def test_a_number_of_the_confirmation_is_a_whole_one(name, least, beyond):
    value = True if beyond is True else least + beyond
    expected = f"confirmation.{name} must be a whole number >= {least}, got {value!r}"
    assert refusal(ConfirmationSettings, **{name: value}) == expected


def test_more_feasible_walks_than_there_are_cannot_be_asked_for():
    message = refusal(ConfirmationSettings, replicas=4, feasible=5)
    assert message == "confirmation.feasible (5) must not exceed confirmation.replicas (4)"
    ConfirmationSettings(replicas=4, feasible=4)


@pytest.mark.parametrize("degrees", [-0.01, 5.8, math.nan, math.inf])
def test_noise_out_of_range_is_refused_in_its_unit(degrees):
    noise = math.radians(degrees)
    message = refusal(ConfirmationSettings, noise=noise)
    assert message == f"confirmation.noise must be 0 to 0.1 rad, got {noise}"
    ConfirmationSettings(noise=0.0)


@pytest.mark.parametrize("friction", [-0.1, 0.51, math.nan])
def test_friction_out_of_range_is_refused(friction):
    message = refusal(ConfirmationSettings, friction=friction)
    assert message == f"confirmation.friction must be 0 to 0.5, got {friction}"
    ConfirmationSettings(friction=0.5)
