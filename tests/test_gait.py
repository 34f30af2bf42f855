"""The gait function (Eqs. 1-9), by hand and for all coefficients."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import (
    ANGLE_LIMITS,
    ANGULAR_VELOCITY,
    CYCLE_TIME,
    FRAME_TIME,
    FRAMES,
    JOINTS,
    STANDING,
    TERMS,
    WAVEFORMS,
    Gait,
    PaperFamily,
    Start,
    Stop,
    joint_commands,
)
from drake_gait.gait.families import gait_of, plain_gait
from drake_gait.servo import TRAVEL

WALKING = range(16, 165)
"""Frames at which Eqs. 3-9 command the gait function itself."""

# Inside Table I at every instant, so that no clipping blurs a comparison.
EXAMPLE = [[0.5, -1.5, 3, 0.2], [13, -11, 8, 0.7], [25, -3, 14, 1.5], [8, 8, 8.5, -0.3]]

any_coefficients = arrays(float, (4, 4), elements=st.floats(-np.pi, np.pi))


@pytest.fixture
def gait():
    return Gait.from_degrees(EXAMPLE)


def one_term(row, column, degrees):
    coefficients = np.zeros((4, 4))
    coefficients[row, column] = degrees
    return Gait.from_degrees(coefficients)


def command(gait, time, joint):
    """Degrees sent to one joint at the frame of `time` [s]."""
    return np.degrees(gait.commands[round(time / FRAME_TIME), JOINTS.index(joint)])


def test_the_angular_velocity_is_that_of_two_steps_in_1_2_seconds():
    assert pytest.approx(5.236, abs=5e-4) == ANGULAR_VELOCITY


def test_the_walk_lasts_4_8_seconds():
    assert pytest.approx(4.8) == FRAMES * FRAME_TIME


def test_the_angle_limits_are_those_of_table_i():
    degrees = dict(zip(WAVEFORMS, np.degrees(ANGLE_LIMITS).round(9).tolist(), strict=True))
    assert degrees == {"roll": [-15, 15], "hip": [-50, 50], "knee": [0, 60], "ankle": [-50, 50]}


# Eq. 1 at t = 0, 0.1, 0.3, 0.6 and 0.75 s: w t is 0, 30, 90, 180 and 225 degrees.
@pytest.mark.parametrize(
    ("term", "values"),
    [
        ("a", [10, 10, 10, 10, 10]),
        ("b", [10, 10 * 0.8660254, 0, -10, -10 * 0.7071068]),
        ("c", [0, 5, 10, 0, -10 * 0.7071068]),
        ("d", [10, 5, -10, 10, 0]),
    ],
)
@pytest.mark.parametrize("waveform", ["roll", "hip", "ankle"])
def test_each_term_of_the_gait_function_has_its_hand_computed_values(term, values, waveform):
    row = WAVEFORMS.index(waveform)
    angles = one_term(row, TERMS.index(term), 10.0).waveforms([0.0, 0.1, 0.3, 0.6, 0.75])
    assert np.degrees(angles[:, row]) == pytest.approx(values, abs=1e-5)
    assert not np.delete(angles, row, axis=1).any()


def test_the_terms_of_the_gait_function_add():
    gait = Gait.from_degrees([[0, 0, 0, 0], [1, 2, 3, 4], [10, 2, 3, 4], [0, 0, 0, 0]])
    # At 0.1 s: 1 + 2 cos 30° + 3 sin 30° + 4 cos 60° = 6.2320508, and the knee 9 degrees more.
    assert np.degrees(gait.waveforms(0.1)) == pytest.approx(
        np.array([[0, 6.2320508, 15.2320508, 0]]), abs=1e-6
    )


def test_a_knee_does_not_bend_backwards():
    assert one_term(2, 0, -10.0).waveforms(0.2)[0, 2] == 0.0


@given(any_coefficients)
def test_the_gait_function_stays_within_table_i_for_all_coefficients(coefficients):
    angles = Gait(coefficients=coefficients).waveforms(np.linspace(0, 4.8, 97))
    assert (angles >= ANGLE_LIMITS[:, 0]).all()
    assert (angles <= ANGLE_LIMITS[:, 1]).all()


@given(any_coefficients)
def test_every_command_stays_within_table_i_for_all_coefficients(coefficients):
    commands = Gait(coefficients=coefficients).commands
    assert commands.shape == (241, 10)
    row = {"roll": 0, "hip_pitch": 1, "knee": 2, "ankle_pitch": 3}
    for column, joint in enumerate(JOINTS):
        lower, upper = ANGLE_LIMITS[next(row[part] for part in row if part in joint)]
        assert lower <= commands[:, column].min()
        assert commands[:, column].max() <= upper


@given(any_coefficients, st.floats(0, 10))
def test_the_gait_function_repeats_every_cycle(coefficients, time):
    gait = Gait(coefficients=coefficients)
    assert gait.waveforms(time) == pytest.approx(gait.waveforms(time + CYCLE_TIME), abs=1e-9)


def test_the_joints_are_right_then_left_from_the_hip_down():
    assert (
        *("hip_roll_r", "hip_pitch_r", "knee_r", "ankle_pitch_r", "ankle_roll_r"),
        *("hip_roll_l", "hip_pitch_l", "knee_l", "ankle_pitch_l", "ankle_roll_l"),
    ) == JOINTS


# The table of Eqs. 3-9: degrees at t = 0, 0.3, 3.3, 3.6 and 4.8 s.
@pytest.mark.parametrize(
    ("joint", "degrees"),
    [
        ("hip_roll_r", [0, 1.5, -1.5, 0, 0]),
        ("ankle_roll_r", [0, 1.5, -1.5, 0, 0]),
        ("hip_roll_l", [0, 1.5, -1.5, 0, 0]),
        ("ankle_roll_l", [0, 1.5, -1.5, 0, 0]),
        ("hip_pitch_r", [0, 0, 15, 0, 0]),
        ("knee_r", [0, 0, 30, 0, 0]),
        ("ankle_pitch_r", [0, 0, 15, 0, 0]),
        ("hip_pitch_l", [0, 15, 0, 0, 0]),
        ("knee_l", [0, 30, 0, 0, 0]),
        ("ankle_pitch_l", [0, 15, 0, 0, 0]),
    ],
)
@given(coefficients=any_coefficients)
def test_every_gait_meets_the_nodes_of_the_schedule(joint, degrees, coefficients):
    gait = Gait(coefficients=coefficients)
    found = [command(gait, time, joint) for time in (0.0, 0.3, 3.3, 3.6, 4.8)]
    assert found == pytest.approx(degrees, abs=1e-9)


def test_commands_between_the_nodes_are_interpolated():
    # A third of the way into the first half step, and of the way out of the last.
    assert command(STANDING, 0.1, "knee_l") == pytest.approx(10.0)
    assert command(STANDING, 0.1, "hip_roll_r") == pytest.approx(0.5)
    assert command(STANDING, 3.4, "knee_r") == pytest.approx(20.0)
    assert command(STANDING, 3.4, "ankle_roll_l") == pytest.approx(-1.0)


@given(any_coefficients)
def test_the_robot_stands_straight_for_the_last_1_2_seconds(coefficients):
    assert not Gait(coefficients=coefficients).commands[180:].any()


def test_the_left_leg_runs_the_gait_function_between_0_3_and_3_3_seconds(gait):
    # At 0.6 s the basis is (1, -1, 0, 1).
    assert command(gait, 0.6, "hip_pitch_l") == pytest.approx(13 + 11 + 0.7)
    assert command(gait, 0.6, "knee_l") == pytest.approx(25 + 3 + 1.5)
    assert command(gait, 0.6, "ankle_pitch_l") == pytest.approx(8 - 8 - 0.3)


def test_the_right_leg_runs_half_a_cycle_behind_the_left(gait):
    frames = np.array(WALKING)[:-30]
    right = gait.commands[np.ix_(frames + 30, [1, 2, 3])]
    left = gait.commands[np.ix_(frames, [6, 7, 8])]
    assert right == pytest.approx(left, abs=1e-9)


def test_roll_of_hips_and_ankles_is_one_waveform_on_both_sides(gait):
    rolls = gait.commands[:, [0, 4, 5, 9]]
    assert (rolls == rolls[:, :1]).all()
    # At 0.6 s: 0.5 + 1.5 + 0.2.
    assert command(gait, 0.6, "hip_roll_l") == pytest.approx(2.2)


@pytest.mark.parametrize("side", ["l", "r"])
def test_the_nodes_keep_the_swinging_foot_flat(side):
    commands = STANDING.commands[[0, 7, 15, 165, 172, 180]]
    hip, knee, ankle = (
        commands[:, JOINTS.index(f"{name}_{side}")] for name in ("hip_pitch", "knee", "ankle_pitch")
    )
    assert hip + ankle == pytest.approx(knee, abs=1e-12)
    assert knee.max() == pytest.approx(np.radians(30.0))


@given(any_coefficients)
def test_a_mirrored_gait_commands_the_mirrored_robot_half_a_cycle_later(coefficients):
    # Where roll's first harmonics and pitch stay and roll's even terms change their sign, every
    # command comes back after half a cycle with left and right exchanged and roll reversed.
    mirror = np.ones((4, 4))
    mirror[0, [0, 3]] = -1.0
    commands = Gait(coefficients=coefficients).commands
    mirrored = Gait(coefficients=coefficients * mirror).commands
    frames = np.array(WALKING)[:-30]
    exchanged = np.hstack([commands[frames, 5:], commands[frames, :5]])
    exchanged[:, [0, 4, 5, 9]] *= -1.0
    assert mirrored[frames + 30] == pytest.approx(exchanged, abs=1e-9)


def test_a_gait_that_meets_the_nodes_does_not_jump():
    # Roll 1.5 sin; pitch a + c sin with a = c = half the node: the node in swing, 0 in stance.
    gait = Gait.from_degrees([[0, 0, 1.5, 0], [7.5, 0, 7.5, 0], [15, 0, 15, 0], [7.5, 0, 7.5, 0]])
    assert gait.jumps == pytest.approx(np.zeros((2, 10)), abs=1e-9)
    # From frame to frame no joint then moves faster than the first half step does, 2 degrees.
    assert np.degrees(np.abs(np.diff(gait.commands, axis=0)).max()) == pytest.approx(2.0)


def test_jumps_say_how_far_the_gait_function_misses_each_node(gait):
    first, last = np.degrees(gait.jumps)
    # At 0.3 s the basis is (1, 0, 1, -1), at 3.3 s (1, 0, -1, -1); the right leg has the other.
    left_hip, left_knee = JOINTS.index("hip_pitch_l"), JOINTS.index("knee_l")
    right_hip, roll = JOINTS.index("hip_pitch_r"), JOINTS.index("ankle_roll_r")
    assert first[left_hip] == pytest.approx(13 + 8 - 0.7 - 15)
    assert first[left_knee] == pytest.approx(25 + 14 - 1.5 - 30)
    assert first[right_hip] == pytest.approx(13 - 8 - 0.7)
    assert first[roll] == pytest.approx(0.5 + 3 - 0.2 - 1.5)
    assert last[left_hip] == pytest.approx(13 - 8 - 0.7)
    assert last[right_hip] == pytest.approx(13 + 8 - 0.7 - 15)
    assert last[roll] == pytest.approx(0.5 - 3 - 0.2 + 1.5)


def test_standing_still_makes_the_first_and_the_last_half_step_only():
    assert not STANDING.commands[list(WALKING)].any()
    assert STANDING.commands[15].any()
    assert STANDING.commands[165].any()


@given(arrays(float, (4, 4), elements=st.floats(-180, 180)))
def test_degrees_return_from_a_gait_as_they_came(degrees):
    assert Gait.from_degrees(degrees).degrees == pytest.approx(degrees, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_coefficient_that_is_no_number_is_refused_by_its_name(value):
    coefficients = np.zeros((4, 4))
    coefficients[2, 1] = value
    with pytest.raises(SettingsError, match=r"must be finite, got -?(nan|inf) for b of knee"):
        Gait(coefficients=coefficients)
    with pytest.raises(SettingsError, match="b of knee"):
        Gait.from_degrees(coefficients)


@pytest.mark.parametrize("shape", [(16,), (4, 3), (3, 4), (), (1, 4, 4)])
def test_coefficients_of_another_shape_are_refused_with_both_shapes(shape):
    with pytest.raises(SettingsError, match=r"shape \(4, 4\), got \("):
        Gait(coefficients=np.zeros(shape))


@pytest.mark.parametrize("coefficients", [[["a"] * 4] * 4, [[1], [1, 2]], None, [[{}] * 4] * 4])
def test_coefficients_that_are_no_array_of_numbers_are_refused(coefficients):
    with pytest.raises(SettingsError, match=r"gait coefficients must"):
        Gait.from_degrees(coefficients)
    with pytest.raises(SettingsError, match=r"gait coefficients must"):
        Gait(coefficients=coefficients)


def test_degrees_given_as_radians_are_refused_with_the_cure():
    with pytest.raises(SettingsError, match=r"±180 degrees.*a of hip.*Gait\.from_degrees"):
        Gait(coefficients=np.array(EXAMPLE) * np.array([[1], [30], [1], [1]]))


def test_an_error_of_a_gait_is_both_a_gait_error_and_a_value_error():
    assert issubclass(SettingsError, GaitError)
    assert issubclass(SettingsError, ValueError)


def test_gaits_are_equal_when_their_coefficients_are(gait):
    assert gait == Gait.from_degrees(EXAMPLE)
    assert gait != STANDING
    assert gait != EXAMPLE
    assert len({gait, Gait.from_degrees(EXAMPLE), STANDING}) == 2


@given(arrays(float, (4, 4), elements=st.sampled_from([0.0, -0.0, 0.1])))
def test_equal_gaits_have_equal_hashes(coefficients):
    one, other = Gait(coefficients=coefficients), Gait(coefficients=np.abs(coefficients))
    assert one == other
    assert hash(one) == hash(other)


def test_a_gait_cannot_be_changed_from_outside(gait):
    values = np.zeros((4, 4))
    kept = Gait(coefficients=values)
    values[0, 0] = 1.0
    assert kept == STANDING
    with pytest.raises(ValueError, match="read-only"):
        gait.coefficients[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        gait.commands[0, 0] = 1.0


def test_a_gait_survives_the_way_to_another_process(gait):
    assert gait.commands.any()
    again = pickle.loads(pickle.dumps(gait))
    assert again == gait
    assert (again.commands == gait.commands).all()


@pytest.mark.parametrize(
    "form",
    [
        np.ndarray.tolist,
        np.asfortranarray,
        lambda commands: commands[:, ::-1][:, ::-1],
        lambda commands: iter(commands),
        lambda commands: commands.astype(object),
    ],
)
def test_commands_of_every_form_are_the_same_numbers(gait, form):
    assert joint_commands(form(gait.commands)).tolist() == gait.commands.tolist()


def test_commands_that_end_at_a_servo_s_stops_can_be_followed():
    at_the_stops = np.where(np.indices((FRAMES + 1, 10)).sum(axis=0) % 2, TRAVEL, -TRAVEL)
    assert joint_commands(at_the_stops).tolist() == at_the_stops.tolist()
    assert not joint_commands(np.zeros((FRAMES + 1, 10), dtype=np.int8)).any()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c[:1], r"\(frames \+ 1, 10\) in shape, .*got \(1, 10\)$"),
        (lambda c: c[:, :9], r"got \(241, 9\)$"),
        (lambda c: c.T, r"got \(10, 241\); transpose them"),
        (lambda c: c.ravel(), r"got \(2410,\)"),
        (lambda c: c[None], r"got \(1, 241, 10\)"),
        (lambda c: 0.0, r"got \(\)"),
        (lambda c: c.astype(str), "commands must be real numbers"),
        (lambda c: c + 0j, "commands must be real numbers"),
        (lambda c: None, "commands must be real numbers"),
        (lambda c: [[0.0], [0.0, 1.0]], "commands must be real numbers"),
    ],
)
def test_commands_of_another_shape_or_type_are_refused(gait, change, words):
    with pytest.raises(SettingsError, match=words):
        joint_commands(change(gait.commands))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2.36, -90.0])
@pytest.mark.parametrize(("frame", "joint"), [(0, 0), (77, 3), (240, 9)])
def test_a_command_that_no_servo_can_follow_is_named(gait, value, frame, joint):
    commands = gait.commands.copy()
    commands[frame, joint] = value
    with pytest.raises(SettingsError) as refused:
        joint_commands(commands)
    text = str(refused.value)
    assert text.startswith(f"commands[{frame}, {joint}], of {JOINTS[joint]}")
    assert f"is {value:g} rad" in text
    assert "\n" not in text


def test_degrees_in_the_place_of_radians_are_refused_with_the_cure(gait):
    with pytest.raises(SettingsError, match="radians"):
        joint_commands(np.degrees(gait.commands))


# --- The start ------------------------------------------------------------------------------------


def test_the_paper_s_start_is_eqs_3_to_9(gait):
    assert gait.commands_from(Start.PAPER) is gait.commands


GROWTH = pytest.mark.parametrize(
    ("start", "of_roll", "of_legs"), [(Start.RAMP, 0.9, 0.9), (Start.SHIFT, 0.3, 0.75)]
)


@GROWTH
@given(coefficients=any_coefficients)
def test_a_growing_start_begins_upright_and_is_the_paper_s_schedule_once_it_is_whole(
    start, of_roll, of_legs, coefficients
):
    gait = Gait(coefficients=coefficients)
    grown, whole = gait.commands_from(start), round(max(of_roll, of_legs) / FRAME_TIME + 0.5)
    assert not grown[0].any()
    assert grown[whole:] == pytest.approx(gait.commands[whole:], abs=1e-12)


@GROWTH
@given(coefficients=any_coefficients)
def test_roll_and_legs_grow_by_raised_cosines(start, of_roll, of_legs, coefficients):
    gait = Gait(coefficients=coefficients)
    time = np.arange(46) * FRAME_TIME
    whole = gait.waveforms(time)
    grown = gait.commands_from(start)[:46]
    for joint, waveform, growth in (("hip_roll_l", 0, of_roll), ("knee_l", 2, of_legs)):
        part = np.sin(0.5 * np.pi * np.minimum(time / growth, 1.0)) ** 2  # a raised cosine
        sent = grown[:, JOINTS.index(joint)]
        assert sent == pytest.approx(part * whole[:, waveform], abs=1e-12)


@pytest.mark.parametrize("start", Start)
def test_commands_cannot_be_changed(gait, start):
    with pytest.raises(ValueError, match="read-only"):
        gait.commands_from(start)[0, 0] = 1.0


@pytest.mark.parametrize("start", [Start.RAMP, Start.SHIFT])
def test_a_growing_start_has_the_jump_at_the_end_only(gait, start):
    first, last = gait.jumps_from(start)
    assert not first.any()
    assert (last == gait.jumps[1]).all()
    assert (gait.jumps_from(Start.PAPER) == gait.jumps).all()
    # No joint is sent further in a frame of the ramp than the gait function itself goes.
    ramped = np.abs(np.diff(gait.commands_from(Start.RAMP)[:45], axis=0)).max()
    assert ramped < 1.5 * np.abs(np.diff(gait.commands[45:160], axis=0)).max()


# --- The stop -------------------------------------------------------------------------------------


def settling(coefficients, **settings):
    return Gait(coefficients=coefficients, family=PaperFamily(stop=Stop.SETTLE, **settings))


@pytest.mark.parametrize("start", Start)
@given(coefficients=any_coefficients)
def test_a_settling_walk_is_the_paper_s_until_3_3_seconds_and_stands_in_the_end(
    start, coefficients
):
    settled = settling(coefficients).commands_from(start)
    ended = Gait(coefficients=coefficients).commands_from(start)
    assert settled.shape == ended.shape
    assert (settled[:165] == ended[:165]).all()
    assert settled[-1] == pytest.approx(np.zeros(10), abs=1e-12)


@pytest.mark.parametrize("start", Start)
@given(coefficients=any_coefficients)
def test_every_settling_command_stays_within_table_i(start, coefficients):
    lower, upper = np.repeat(ANGLE_LIMITS[[0, 1, 2, 3, 0]], 1, axis=0).T
    sent = settling(coefficients).commands_from(start).reshape(-1, 2, 5)
    assert (sent >= lower - 1e-12).all()
    assert (sent <= upper + 1e-12).all()


def test_roll_and_legs_shrink_by_raised_cosines_and_the_mean_last(gait):
    settled = settling(gait.coefficients).commands_from(Start.SHIFT)
    time = np.arange(165, FRAMES + 1) * FRAME_TIME

    def part(begin, end):  # of a raised cosine that is left
        return np.cos(0.5 * np.pi * np.clip((time - begin) / (end - begin), 0.0, 1.0)) ** 2

    whole = gait.waveforms(time)
    roll, knee = (settled[165:, JOINTS.index(name)] for name in ("hip_roll_l", "knee_l"))
    assert roll == pytest.approx(part(3.3, 4.2) * whole[:, 0])
    mean = np.radians(EXAMPLE[2][0])
    expected = part(3.45, 4.2) * (whole[:, 2] - mean) + part(4.2, 4.8) * mean
    assert knee == pytest.approx(expected)


def test_a_settling_walk_does_not_jump(gait):
    settled = settling(gait.coefficients)
    assert not settled.jumps_from(Start.SHIFT).any()
    assert settled.jumps_from(Start.PAPER)[0].any()
    steps = np.abs(np.diff(settled.commands_from(Start.SHIFT), axis=0)).max(axis=1)
    assert steps[164:].max() < 1.1 * steps[45:164].max()


def test_a_mirrored_settling_gait_mirrors_at_its_end(gait):
    # The last half cycle: right and left change places half a cycle later.
    sent = settling(gait.coefficients, cycles=3).commands_from(Start.SHIFT)
    longer = settling(gait.coefficients, cycles=4).commands_from(Start.SHIFT)
    assert longer[165 + 60 :] == pytest.approx(sent[165:])


@pytest.mark.parametrize(
    ("settings", "named"),
    [({"stop": "fall"}, ["fall", "settle"]), ({"stop": "settle", "standing": 1.0}, ["1.2", "1"])],
)
def test_a_stop_that_cannot_be_is_named_with_the_cure(settings, named):
    with pytest.raises(SettingsError) as error:
        PaperFamily(**settings)
    assert all(word in str(error.value) for word in named)


def test_a_settling_gait_survives_the_way_to_another_process_and_to_a_file(gait):
    settled = settling(gait.coefficients)
    assert pickle.loads(pickle.dumps(settled)) == settled
    assert gait_of(plain_gait(settled)) == settled
    assert settled != gait
