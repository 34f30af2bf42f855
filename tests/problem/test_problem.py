"""The problem (Eqs. 10-17) and the space it is solved in."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drake_gait.errors import SettingsError
from drake_gait.foot import DESIGN_LIMITS, FootDesign
from drake_gait.gait import ANGLE_LIMITS, STANDING
from drake_gait.problem import (
    COEFFICIENTS,
    OUTPUTS,
    Candidate,
    Constraints,
    DesignSpace,
    Objective,
    assess,
    quantities,
)
from drake_gait.report.result import PAPER_TABLE
from drake_gait.walk import Measures, Outcome, Walk

FOOT_RANGES = (
    ("big_toe_stiffness", 0.002, 0.2),
    ("lesser_toes_stiffness", 0.0015, 0.15),
    ("toe_damping", 1e-5, 1e-3),
    ("big_toe_width", 0.010, 0.040),
)


@pytest.fixture(scope="session")
def foot_space(space):
    return dataclasses.replace(space, foot_ranges=FOOT_RANGES)


def a_walk(outcome=Outcome.WALKED, **changes):
    numbers = {"frames": 240, "forward": 0.1, "lateral": 0.0, "yaw": 0.0, "com_height": 0.245}
    return Walk(outcome=outcome, **{**numbers, **changes})


def violations(**changes):
    found = assess(a_walk(**changes), Constraints()).violations
    return dict(zip(Constraints().names, found.tolist(), strict=True))


def test_the_constraints_are_the_paper_s():
    limits = Constraints()
    assert (limits.lateral, limits.com_height) == (0.020, 0.24353)
    assert np.degrees(limits.yaw) == pytest.approx(5.0)


@pytest.mark.parametrize("row", range(8))
def test_each_walk_of_the_paper_s_table_ii_is_feasible(row):
    lateral, forward, yaw, frames = PAPER_TABLE[row]
    walk = a_walk(forward=forward / 1e3, lateral=lateral / 1e3, yaw=np.radians(yaw), frames=frames)
    assessment = assess(walk, Constraints())
    assert assessment.feasible
    assert assessment.fitness == pytest.approx(-forward)


def test_the_paper_s_fourth_walk_is_no_longer_feasible_half_a_millimetre_further_aside():
    assert not assess(a_walk(lateral=0.01969 + 0.0005), Constraints()).feasible


def test_walking_further_is_a_smaller_objective():
    near, far = (assess(a_walk(forward=forward), Constraints()) for forward in (0.1, 0.2))
    assert near.objective == -0.1
    assert far.objective < near.objective
    assert far.fitness == pytest.approx(-200.0)


# Each violation divided by its limit.
@pytest.mark.parametrize(
    ("name", "changes", "violation"),
    [
        ("lateral", {"lateral": 0.025}, 0.25),
        ("lateral", {"lateral": -0.060}, 2.0),
        ("yaw", {"yaw": np.radians(6.0)}, 0.2),
        ("yaw", {"yaw": np.radians(-15.0)}, 2.0),
        ("com_height", {"com_height": 0.24353 / 2}, 0.5),
        ("com_height", {"com_height": 0.0}, 1.0),
        ("frames", {"frames": 180, "outcome": Outcome.FELL}, 0.25),
        ("frames", {"frames": 0, "outcome": Outcome.FELL}, 1.0),
    ],
)
def test_a_violation_has_its_hand_computed_size_and_leaves_the_others_zero(
    name, changes, violation
):
    assert violations(**changes) == pytest.approx({**violations(), name: violation})


def test_a_limit_that_is_just_met_is_not_violated():
    on_the_limit = a_walk(lateral=-0.020, yaw=np.radians(5.0), com_height=0.24353)
    assert assess(on_the_limit, Constraints()).feasible


def test_the_fitness_adds_a_thousand_millimetres_for_each_unit_of_violation():
    # 150 mm; lateral 25 of 20 mm, yaw 6 of 5 degrees: -150 + 1000 (0.25 + 0.2).
    walk = a_walk(forward=0.150, lateral=0.025, yaw=np.radians(6.0))
    assert assess(walk, Constraints()).fitness == pytest.approx(300.0)


@given(
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.floats(-4, 4),
    st.floats(0, 0.4),
    st.integers(0, 240),
    st.sampled_from([Outcome.FELL, Outcome.DIVERGED]),
)
def test_a_fall_is_never_feasible(forward, lateral, yaw, com_height, frames, outcome):
    walk = a_walk(
        outcome, forward=forward, lateral=lateral, yaw=yaw, com_height=com_height, frames=frames
    )
    assessment = assess(walk, Constraints())
    assert not assessment.feasible
    assert assessment.violations[3] > 0.0


def test_a_fall_in_the_last_frame_is_not_feasible():
    assert violations(outcome=Outcome.FELL, frames=240)["frames"] == pytest.approx(1 / 240)


@pytest.mark.parametrize("name", ["lateral", "yaw", "com_height"])
def test_a_walk_whose_number_is_none_is_not_feasible(name):
    assert not assess(a_walk(**{name: np.nan}), Constraints()).feasible


@given(st.floats(-0.1, 0.1), st.floats(-1, 1), st.floats(0, 0.4))
def test_a_mirrored_walk_is_as_good(lateral, yaw, com_height):
    walk = a_walk(lateral=lateral, yaw=yaw, com_height=com_height)
    mirrored = dataclasses.replace(walk, lateral=-lateral, yaw=-yaw)
    assert assess(walk, Constraints()).fitness == assess(mirrored, Constraints()).fitness


def test_a_limit_measures_many_values_at_once_and_inside_it_is_negative():
    lateral = Constraints(lateral=0.01).limits[0]
    assert lateral.excess([0.0, 0.02, -0.03, 0.01]) == pytest.approx([-1.0, 1.0, 2.0, 0.0])
    height = Constraints(com_height=0.2).limits[2]
    assert height.excess([0.1, 0.25, 0.2]) == pytest.approx([0.5, -0.25, 0.0])


MEASURES = Measures(
    energy=3.0,
    positive_energy=2.0,
    cost_of_transport=0.5,
    peak_torque=1.0,
    peak_speed=5.0,
    saturated_fraction=0.01,
    slip=(0.03, 0.05),
    clearance=(0.004, 0.002),
    duty_factor=(0.6, 0.7),
    peak_ground_reaction=1.5,
    toe_range=(0.1, 0.4, 0.2, 0.3),
    torso_tilt=0.1,
    driving_torque=0.9,
    braking_torque=1.0,
    driving_speed=4.0,
    braking_speed=5.0,
    line_share=0.8,
)
# A limit that MEASURES break, with the violation by hand: the worst of two feet counts.
BROKEN = [
    ("energy", 2.0, 0.5),
    ("positive_energy", 1.0, 1.0),
    ("cost_of_transport", 0.4, 0.2),
    ("peak_torque", 0.5, 1.0),
    ("peak_speed", 4.0, 0.25),
    ("saturated_fraction", 0.005, 1.0),
    ("slip", 0.04, 0.25),
    ("clearance", 0.004, 0.5),
    ("duty_factor", 0.5, 0.4),
    ("peak_ground_reaction", 1.2, 0.25),
    ("toe_range", 0.2, 1.0),
    ("torso_tilt", 0.05, 1.0),
    ("driving_torque", 0.6, 0.5),
    ("braking_torque", 0.5, 1.0),
    ("driving_speed", 3.2, 0.25),
    ("braking_speed", 4.0, 0.25),
    ("line_share", 0.4, 1.0),
    ("yaw_swing", 0.1, 1.0),
]


def test_every_measure_of_a_walk_can_be_made_a_constraint():
    measured = [field.name for field in dataclasses.fields(Measures)]
    assert [name for name, _, _ in BROKEN] == [*measured, "yaw_swing"]


@pytest.mark.parametrize(("name", "limit", "violation"), BROKEN)
def test_a_measure_beyond_its_limit_makes_a_walk_infeasible(name, limit, violation):
    walk = a_walk(measures=MEASURES, yaw_swing=0.2)
    assert assess(walk, Constraints()).feasible
    broken = assess(walk, Constraints(**{name: limit}))
    assert broken.violations == pytest.approx([0, 0, 0, violation, 0])
    met = limit / 4.0 if name == "clearance" else limit * 4.0
    assert assess(walk, Constraints(**{name: met})).feasible


def test_a_walk_without_the_measures_that_a_limit_needs_is_a_mistake():
    with pytest.raises(
        SettingsError, match=r"slip needs the measures of a walk.*simulate it again"
    ):
        assess(a_walk(), Constraints(slip=0.04))


def test_the_range_of_the_heading_needs_no_measures():
    limits = Constraints(yaw_swing=0.1)
    assert assess(a_walk(yaw_swing=0.05), limits).feasible
    assert assess(a_walk(yaw_swing=0.15), limits).violations == pytest.approx([0, 0, 0, 0.5, 0])
    # A walk of a study file that knows no such range yet.
    assert assess(a_walk(), limits).violations == pytest.approx([0, 0, 0, 1, 0])


def test_a_diverged_walk_breaks_a_limit_on_its_measures():
    assessment = assess(Walk.diverged("solver"), Constraints(slip=0.04))
    assert assessment.violations[3] == 1.0
    assert not assessment.feasible


def test_a_cheaper_walk_is_a_smaller_objective_when_the_cost_of_transport_is_asked_for():
    cheap = dataclasses.replace(MEASURES, cost_of_transport=0.25)
    costs = [
        assess(a_walk(measures=measures), Constraints(), Objective.COST_OF_TRANSPORT).objective
        for measures in (cheap, MEASURES, dataclasses.replace(MEASURES, cost_of_transport=np.inf))
    ]
    assert costs == [-4.0, -2.0, 0.0]


def test_a_network_is_asked_for_what_objective_and_constraints_need():
    assert quantities(Constraints()) == OUTPUTS
    assert quantities(Constraints(slip=0.04), Objective.COST_OF_TRANSPORT) == (
        *OUTPUTS,
        "transport_efficiency",
        "slip",
    )


@pytest.mark.parametrize("name", ["lateral", "yaw", "com_height"])
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf])
def test_a_limit_that_is_none_is_refused_by_its_name(name, value):
    with pytest.raises(SettingsError, match=rf"constraint {name} must be > 0.*got {value}"):
        Constraints(**{name: value})


def test_the_sixteen_coefficients_are_named_row_by_row():
    assert len(COEFFICIENTS) == 16
    assert COEFFICIENTS[:5] == ("roll_a", "roll_b", "roll_c", "roll_d", "hip_a")
    assert COEFFICIENTS[-1] == "ankle_d"


def test_the_middle_of_a_space_is_its_centre_on_its_foot(space):
    candidate = space.decode(np.zeros(16))
    assert (candidate.gait.coefficients == space.centre).all()
    assert candidate.foot == space.foot


def test_a_coordinate_of_one_is_half_a_width_from_the_centre(space):
    x = np.zeros(16)
    x[COEFFICIENTS.index("knee_b")] = 1.0
    degrees = space.decode(x).gait.degrees - np.degrees(space.centre)
    expected = np.zeros((4, 4))
    expected[2, 1] = 2.0
    assert degrees == pytest.approx(expected, abs=1e-9)


def test_a_foot_s_range_is_searched_in_its_logarithm(foot_space):
    x = np.zeros(20)
    # Ends and geometric middle of 0.002 to 0.2.
    for value, stiffness in ((-1.0, 0.002), (0.0, 0.02), (1.0, 0.2)):
        x[16] = value
        assert foot_space.decode(x).foot.big_toe_stiffness == pytest.approx(stiffness, rel=1e-12)


def test_a_size_of_the_foot_is_searched_as_it_is(space):
    ranges = (("big_toe_width", 0.010, 0.040), ("toe_length", 0.020, 0.030))
    opened = dataclasses.replace(space, foot_ranges=ranges)
    for value, width, length in ((-1.0, 0.010, 0.020), (0.0, 0.025, 0.025), (0.5, 0.0325, 0.0275)):
        foot = opened.decode(np.append(np.zeros(16), [value, value])).foot
        assert foot.big_toe_width == pytest.approx(width, rel=1e-12)
        assert foot.toe_length == pytest.approx(length, rel=1e-12)


def test_rigid_toes_have_nothing_to_search(space):
    rigid = dataclasses.replace(space, foot=FootDesign(rigid_toes=True))
    assert rigid.decode(np.zeros(16)).foot.rigid_toes
    with pytest.raises(SettingsError, match=r"big_toe_width is open, but rigid toes"):
        dataclasses.replace(rigid, foot_ranges=(("big_toe_width", 0.010, 0.040),))


def test_a_foot_s_value_never_leaves_its_range_by_rounding():
    space = DesignSpace(
        centre=np.zeros((4, 4)),
        half_width=np.full((4, 4), 0.01),
        foot_ranges=tuple((name, *limits) for name, limits in DESIGN_LIMITS.items()),
    )
    for value in (-1.0, 1.0):
        x = np.concatenate([np.zeros(16), np.full(len(DESIGN_LIMITS), value)])
        column = 0 if value < 0 else 1
        found = dataclasses.asdict(space.decode(x).foot)
        for name, limits in DESIGN_LIMITS.items():
            assert found[name] == pytest.approx(limits[column])


@given(x=arrays(float, 20, elements=st.floats(-1, 1)))
def test_encode_undoes_decode(foot_space, x):
    assert foot_space.encode(foot_space.decode(x)) == pytest.approx(x, abs=1e-9)


@given(x=arrays(float, 20, elements=st.floats(-1, 1)))
def test_decode_undoes_encode(foot_space, x):
    candidate = foot_space.decode(x)
    again = foot_space.decode(foot_space.encode(candidate))
    assert again.gait.coefficients == pytest.approx(candidate.gait.coefficients, abs=1e-12)
    found, expected = dataclasses.asdict(again.foot), dataclasses.asdict(candidate.foot)
    assert found == pytest.approx(expected, rel=1e-9)


def test_fields_of_the_foot_that_are_not_open_stay(space):
    foot = FootDesign(big_toe_stiffness=0.05, toe_damping=3e-4)
    half_open = dataclasses.replace(
        space, foot=foot, foot_ranges=(("big_toe_width", 0.010, 0.040),)
    )
    assert half_open.names[16:] == ("big_toe_width",)
    found = half_open.decode(np.append(np.zeros(16), 1.0)).foot
    assert found == dataclasses.replace(foot, big_toe_width=found.big_toe_width)
    assert found.big_toe_width == pytest.approx(0.040)


def test_the_limits_are_table_i_and_the_foot_s_box(foot_space):
    limits = foot_space.limits
    assert limits.shape == (foot_space.dimension, 2) == (20, 2)
    lower, upper = (foot_space.decode(end).gait.degrees for end in limits.T)
    # A mean may be any angle of Table I, an amplitude half of its range.
    amplitude = np.array([[15.0], [50.0], [30.0], [50.0]])
    table = np.degrees(ANGLE_LIMITS)
    assert lower == pytest.approx(np.hstack([table[:, :1], np.tile(-amplitude, 3)]), abs=1e-9)
    assert upper == pytest.approx(np.hstack([table[:, 1:], np.tile(amplitude, 3)]), abs=1e-9)
    assert (limits[16:] == [-1.0, 1.0]).all()


def test_the_box_lies_within_the_limits(foot_space):
    assert (foot_space.limits[:, 0] <= -1.0).all()
    assert (foot_space.limits[:, 1] >= 1.0).all()


@pytest.mark.parametrize("shape", [(15,), (17,), (4, 4), ()])
def test_a_design_vector_of_another_shape_is_refused_with_both(space, shape):
    with pytest.raises(SettingsError, match=r"shape \(16,\), got \("):
        space.decode(np.zeros(shape))


@pytest.mark.parametrize("name", ["centre", "half_width"])
@pytest.mark.parametrize("value", [np.zeros(16), np.full((4, 4), np.nan), np.full((4, 4), np.inf)])
def test_a_box_that_is_none_is_refused(name, value):
    box = {"centre": np.zeros((4, 4)), "half_width": np.full((4, 4), 0.01), name: value}
    with pytest.raises(SettingsError, match=f"{name} must be 4 rows of 4 finite numbers"):
        DesignSpace(**box)


@pytest.mark.parametrize("width", [0.0, -0.01])
def test_a_box_without_width_is_refused(width):
    half_width = np.full((4, 4), 0.01)
    half_width[1, 2] = width
    with pytest.raises(
        SettingsError, match=rf"half_width of hip_c must be > 0 rad and finite, got {width}"
    ):
        DesignSpace(centre=np.zeros((4, 4)), half_width=half_width)


def test_a_box_about_a_centre_outside_table_i_is_refused_with_the_range():
    centre = np.zeros((4, 4))
    centre[2, 0] = np.radians(70.0)
    with pytest.raises(
        SettingsError, match=r"centre of knee_a must, by Table I, be 0 to 1.0472 rad, got 1.22"
    ):
        DesignSpace(centre=centre, half_width=np.full((4, 4), 0.01))


def test_a_box_that_reaches_beyond_table_i_is_clipped_by_its_limits():
    centre = np.zeros((4, 4))
    centre[2, 0] = np.radians(1.0)
    space = DesignSpace(centre=centre, half_width=np.full((4, 4), np.radians(2.0)))
    assert space.box[COEFFICIENTS.index("knee_a")] == pytest.approx([-0.5, 1.0])
    assert (space.box[:8] == [-1.0, 1.0]).all()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("toe_stifness", 0.01, 0.02), r"no foot design variable 'toe_stifness'.*toe_damping"),
        (("big_toe_width", 0.03, 0.02), "must rise"),
        (("big_toe_width", 0.02, 0.02), "must rise"),
        (("big_toe_width", 0.001, 0.02), "lie in 0.008 to 0.05 m, got"),
        (("big_toe_width", 0.02, 0.06), "lie in 0.008 to 0.05 m, got"),
        (("big_toe_width", np.nan, 0.02), "must rise"),
    ],
)
def test_a_range_of_the_foot_that_is_none_is_refused(space, change, text):
    with pytest.raises(SettingsError, match=text):
        dataclasses.replace(space, foot_ranges=(change,))


def test_a_variable_of_the_foot_cannot_be_open_twice(space):
    twice = (("big_toe_width", 0.01, 0.02), ("big_toe_width", 0.02, 0.03))
    with pytest.raises(SettingsError, match=r"big_toe_width.*twice"):
        dataclasses.replace(space, foot_ranges=twice)


def test_candidates_are_equal_when_gait_and_foot_are():
    assert Candidate(gait=STANDING) == Candidate(gait=STANDING, foot=FootDesign())
    assert Candidate(gait=STANDING) != Candidate(gait=STANDING, foot=FootDesign(big_toe_width=0.03))
