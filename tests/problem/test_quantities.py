"""One declaration of a quantity gives its key, limit, output, columns and objective."""

import math
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.gait import STANDING, Start
from drake_gait.problem import (
    BUILT_IN,
    OUTPUTS,
    Candidate,
    Constraints,
    Limit,
    Needs,
    Objective,
    Quantity,
    Side,
    Trial,
    assess,
    evaluated,
    quantities,
    quantity,
)
from drake_gait.ranges import MM
from drake_gait.study.keys import CONSTRAINTS, KEYS
from drake_gait.study.records import NAMES
from drake_gait.walk import Outcome, Walk, WalkSettings

SHORT = Quantity(name="short", unit=MM, read=lambda walk: 0.5 - walk.forward)
FEET = Quantity(
    name="feet", side="lower", parts=("right", "left"), read=lambda walk: (walk.yaw, 0.3)
)


def a_walk(**changes):
    numbers = {"frames": 240, "forward": 0.1, "lateral": 0.0, "yaw": 0.0, "com_height": 0.245}
    return Walk(**{"outcome": Outcome.WALKED, **numbers, **changes})


@pytest.mark.parametrize("one", BUILT_IN.values(), ids=str)
def test_a_declaration_gives_key_limit_output_and_columns(one):
    assert CONSTRAINTS[one.key] == (one.name, one.unit)
    assert one.key in KEYS["constraints"]
    limits = Constraints(**{one.name: 0.25})
    assert getattr(limits, one.name) == 0.25
    assert one.scaled() in [limit.quantity for limit in limits.limits]
    assert one.scaled() in quantities(limits)
    assert set(one.columns) <= set(NAMES)


@pytest.mark.parametrize("one", [*BUILT_IN.values(), SHORT, FEET], ids=str)
def test_a_quantity_survives_the_way_to_a_worker(one):
    found = pickle.loads(pickle.dumps(one))
    assert (found.name, found.unit, found.side, found.parts) == (
        *(one.name, one.unit, one.side),
        one.parts,
    )
    assert (found is one) == (one.name in BUILT_IN)
    if one.needs is Needs.WALK:
        assert found.values(a_walk(yaw_swing=0.2)) == one.values(a_walk(yaw_swing=0.2))


def test_of_two_feet_the_worse_counts_as_the_side_says():
    pair = {
        side: Quantity(
            name="pair", parts=("right", "left"), side=side, read=lambda walk: (0.1, -0.3)
        ).of(a_walk())
        for side in Side
    }
    assert pair == {Side.UPPER: 0.1, Side.LOWER: -0.3, Side.BOTH: -0.3}


def test_a_limit_is_one_number_on_the_side_of_its_quantity_or_a_range():
    assert Limit.at(SHORT, 0.2) == Limit(SHORT, upper=0.2)
    assert Limit.at(FEET, 0.2) == Limit(FEET, lower=0.2)
    assert Limit.at(BUILT_IN["yaw"], 0.2) == Limit("yaw", lower=-0.2, upper=0.2)
    for value in (0.2, [0.1, 0.2], [-0.2, 0.1], [0.0, 0.2]):
        assert Limit.at(SHORT, value).value == value
    assert Limit(SHORT, lower=0.3).value == [0.3, np.inf]


@pytest.mark.parametrize(
    "ends", [{}, {"upper": 0.0}, {"lower": 2.0, "upper": 1.0}, {"lower": np.nan}]
)
def test_a_limit_that_leaves_nothing_or_has_no_size_is_refused(ends):
    with pytest.raises(SettingsError, match="limit of slip must have lower < upper"):
        Limit("slip", **ends)


def test_a_range_is_broken_on_either_side_in_parts_of_its_end():
    limits = Constraints(forward=(0.1, 0.2))
    broken = [assess(a_walk(forward=z), limits).violations[3] for z in (0.05, 0.1, 0.15, 0.3)]
    assert broken == pytest.approx([0.5, 0.0, 0.0, 0.5])


def test_an_own_quantity_is_limited_predicted_and_assessed():
    limits = Constraints(Limit(SHORT, upper=0.2))
    assert limits.names[3:] == ("short", "frames")
    assert quantities(limits, Objective(FEET))[-2:] == ("gain_of_feet", "short")
    assert assess(a_walk(forward=0.1), limits).violations[3] == pytest.approx(1.0)
    assert assess(a_walk(forward=0.4), limits).feasible
    assert quantity(a_walk(forward=0.4), SHORT) == pytest.approx(0.1)


@pytest.mark.parametrize("one", [one for one in BUILT_IN.values() if one.scale], ids=str)
@pytest.mark.parametrize("end", ["lower", "upper"])
def test_a_scale_keeps_which_values_are_within_a_limit(one, end):
    limit = Limit(one, **{end: 0.08})
    for value in (0.01, 0.079, 0.081, 5.0, np.inf):
        inside = limit.lower <= value <= limit.upper
        assert (limit.scaled().excess(one.scale.function(value)) <= 0.0) == inside


@pytest.mark.parametrize("maximise", [True, False])
def test_a_gain_is_positive_finite_and_grows_as_its_quantity_gets_better(maximise):
    gain = Objective(SHORT, maximise=maximise).quantity
    values = [gain.of(a_walk(forward=0.5 - value)) for value in (-3.0, -0.01, 0.0, 0.01, 3.0)]
    assert min(values) > 0.0
    assert np.isfinite(values).all()
    ranked = sorted(values, reverse=not maximise)
    assert values == ranked
    assert len(set(values)) == 5


def test_of_what_goes_both_ways_the_size_is_minimised():
    gain = Objective("lateral", maximise=False).quantity
    left, straight, right = (gain.of(a_walk(lateral=y)) for y in (0.1, 0.0, -0.1))
    assert left == right < straight


def test_distance_and_cost_are_the_objectives_that_they_were():
    assert Objective.DISTANCE.quantity == "forward"
    assert Objective.COST_OF_TRANSPORT.quantity == "transport_efficiency"
    assert [str(one) for one in (Objective.DISTANCE, Objective.COST_OF_TRANSPORT)] == [
        "distance",
        "cost_of_transport",
    ]


@pytest.mark.parametrize("text", ["distance", "energy", "maximise slip", "minimise short", "feet"])
def test_an_objective_returns_from_its_text(text):
    found = Objective.read(text, (SHORT, FEET))
    assert Objective.read(str(found), (SHORT, FEET)) == found
    assert found.maximise == (text in ("distance", "maximise slip", "feet"))


def test_a_walk_leaves_its_history_where_its_quantities_were_read():
    history = SimpleNamespace(com=np.arange(9.0).reshape(3, 3) ** 2)
    own = Quantity(name="sway", needs="history", read=lambda walk: np.ptp(walk.history.com[:, 1]))
    trial = Trial(candidate=Candidate(gait=STANDING), quantities=(own, SHORT))
    walk = evaluated(a_walk(history=history), trial)
    assert walk.history is None
    assert walk.values["sway"] == (48.0,)
    assert own.of(walk) == walk.values["sway"][0]
    assert walk.values["short"] == (0.4,)


def test_the_jump_is_known_of_every_trial_whatever_becomes_of_it():
    for start in Start:
        trial = Trial(candidate=Candidate(gait=STANDING), settings=WalkSettings(start=start))
        walk = evaluated(Walk.diverged("solver"), trial)
        assert quantity(walk, "jump") == np.abs(STANDING.jumps_from(start)).max()


def test_a_quantity_that_a_walk_does_not_tell_is_not_feasible():
    own = Quantity(name="sway", needs="history", read=lambda walk: 0.0)
    assert math.isnan(own.of(a_walk()))
    assert not assess(a_walk(), Constraints(Limit(own, upper=1.0))).feasible


@pytest.mark.parametrize(
    ("said", "reason"),
    [(1 / np.array([1.0, 2.0]), "got 2"), ("x", "ValueError"), (None, "TypeError")],
)
def test_what_is_no_number_is_told_with_the_quantity(said, reason):
    with pytest.raises(SettingsError, match=rf"quantity odd .*{reason}"):
        Quantity(name="odd", read=lambda walk: said).of(a_walk())


@pytest.mark.parametrize("name", ["", "Sway", "2nd", "a b", "a;b", "class"])
def test_a_name_that_cannot_be_a_column_is_refused(name):
    with pytest.raises(SettingsError, match="quantity's name must be lower-case"):
        Quantity(name=name, read=float)


def test_a_slip_ratio_is_the_worse_foot_s_slip_in_parts_of_the_distance(measures):
    walk = a_walk(forward=0.5, measures=measures)
    assert quantity(walk, "slip_ratio") == max(measures.slip) / 0.5
    assert quantity(a_walk(forward=-0.5, measures=measures), "slip_ratio") == math.inf
    assert tuple(BUILT_IN)[:4] == OUTPUTS
