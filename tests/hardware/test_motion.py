"""Motions for a robot: frames, speeds, servo positions, violations."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_gait.errors import SettingsError
from drake_gait.gait import FRAME_TIME, JOINTS, Gait, Start
from drake_gait.hardware.checks import Kind, violations
from drake_gait.hardware.motion import Motion, to_csv
from drake_gait.hardware.servo_map import read_servo_map
from drake_gait.simulation.self_collision import leg_gaps

NO_LOAD = 7.48


@pytest.fixture(scope="module")
def servos():
    return read_servo_map()


def walking(roll=0.05, hip=0.3):
    coefficients = np.zeros((4, 4))
    coefficients[0, 2], coefficients[1, 1], coefficients[2, 0] = roll, hip, 0.4
    return Motion(angles=Gait(coefficients=coefficients).commands_from(Start.PAPER))


def still(**angles):
    rows = np.zeros((20, len(JOINTS)))
    for name, angle in angles.items():
        rows[:, JOINTS.index(name)] = angle
    return Motion(angles=rows)


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 20.0))
def test_a_softened_motion_keeps_the_speed_and_both_ends(seed, speed):
    rng = np.random.default_rng(seed)
    angles = np.cumsum(rng.normal(0.0, 0.1, (60, len(JOINTS))), axis=0)
    angles = np.vstack([angles[:1].repeat(40, 0), angles, angles[-1:].repeat(400, 0)])
    soft = Motion(angles=angles).softened(speed)
    assert np.abs(soft.speeds).max() <= speed * (1.0 + 1e-9)
    reach = speed * FRAME_TIME * 40
    if np.abs(angles - angles[0]).max() < reach:
        np.testing.assert_allclose(soft.angles[[0, -1]], angles[[0, -1]], atol=1e-12)


def test_a_motion_that_is_slow_enough_is_not_softened():
    motion = walking()
    softened = motion.softened(np.abs(motion.speeds).max() * 1.0001)
    np.testing.assert_allclose(softened.angles, motion.angles, atol=1e-14)


@pytest.mark.parametrize("frame_time", [0.010, 0.015, 0.020, 0.025])
def test_resampled_frames_lie_on_the_same_motion(frame_time):
    motion = walking()
    found = motion.resampled(frame_time)
    for column in range(len(JOINTS)):
        expected = np.interp(found.times, motion.times, motion.angles[:, column])
        np.testing.assert_allclose(found.angles[:, column], expected, atol=1e-12)
    assert found.times[-1] == pytest.approx(motion.times[-1])


def test_the_table_of_a_motion_names_every_joint_in_degrees():
    motion = walking()
    header, *rows = to_csv(motion).splitlines()
    assert header.split(",") == ["time_s", *JOINTS]
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_allclose(values[:, 0], motion.times, atol=1e-9)
    np.testing.assert_allclose(np.radians(values[:, 1:]), motion.angles, atol=1e-5)


def test_positions_and_joint_angles_are_each_other_s_inverse(servos):
    trimmed = dataclasses.replace(servos, trims=tuple(np.radians(range(10)).tolist()))
    angles = walking().angles
    found = trimmed.joint_angles(trimmed.positions(angles))
    assert np.degrees(np.abs(found - angles)).max() <= 0.5 / trimmed.units_per_degree + 1e-9


def test_the_centre_is_7500_and_135_degrees_are_4000_positions(servos):
    quarter = still(knee_l=np.radians(135.0)).angles
    assert servos.positions(quarter)[0, JOINTS.index("knee_l")] == 11500
    assert servos.positions(quarter)[0, JOINTS.index("knee_r")] == 7500


def test_mirrored_legs_are_sent_mirrored_positions(servos):
    # The servos of the pitch joints are mounted mirrored, those of the roll joints alike.
    for joint, sign in (("hip_pitch", -1), ("knee", -1), ("ankle_pitch", -1), ("hip_roll", 1)):
        motion = still(**{f"{joint}_r": 0.1, f"{joint}_l": 0.1})
        row = servos.positions(motion.angles)[0] - 7500
        right, left = (row[JOINTS.index(f"{joint}_{side}")] for side in "rl")
        assert right == sign * left != 0


def test_a_servo_past_its_range_is_named_with_its_worst_frame(servos):
    angles = np.array(still().angles)
    column = JOINTS.index("hip_roll_l")
    angles[5:9, column] = np.radians([31.0, 35.0, 32.0, 31.0])
    (found,) = violations(Motion(angles=angles), servos, no_load_speed=1e3)
    assert (found.kind, found.frame, found.frames) == (Kind.RANGE, 6, 4)
    assert "hip_roll_l" in str(found)
    assert "35.0" in str(found)
    assert "30.0" in str(found)


def test_a_jump_is_named_with_its_joint_and_frame(servos):
    angles = np.array(still().angles)
    angles[10:, JOINTS.index("knee_r")] = np.radians(12.0)
    (found,) = violations(Motion(angles=angles), servos, NO_LOAD)
    assert (found.kind, found.frame, found.where) == (Kind.SPEED, 10, "knee_r")
    assert not violations(Motion(angles=angles).softened(NO_LOAD), servos, NO_LOAD)


def test_one_leg_that_rolls_inward_meets_the_other(servos):
    # The soles stand 5 mm apart; both legs together lean as far as they like.
    together = still(hip_roll_r=0.1, ankle_roll_r=0.1, hip_roll_l=0.1, ankle_roll_l=0.1)
    assert leg_gaps(together.angles)[0].min() > 0.004
    alone = still(hip_roll_l=-0.1, ankle_roll_l=-0.1)
    gaps = leg_gaps(alone.angles)
    (found,) = violations(alone, servos, NO_LOAD, gaps)
    assert found.kind is Kind.COLLISION
    assert "_r and " in found.where


def test_wider_feet_come_no_nearer_than_the_model_says():
    gaps, _ = leg_gaps(still().angles)
    assert gaps == pytest.approx(np.full(20, 0.0052), abs=1e-6)


@pytest.mark.parametrize(
    ("edit", "named"),
    [
        (("id = 13", "id = 12"), "hip_roll_l.id = 12"),
        (("id = 13", "id = 99"), "hip_roll_r.id"),
        (("id = 13", "id = 1.5"), "1.5"),
        (("id = 13", ""), "hip_roll_r.id"),
        (("sign = 1", "sign = 2"), "hip_roll_r.sign"),
        (("sign = 1", "sing = 1"), "'sing'"),
        (("trim_deg = 0.0", "trim_deg = nan"), "hip_roll_r.trim_deg"),
        (("range_deg = [-30.0, 30.0]", "range_deg = [30.0, -30.0]"), "hip_roll_r.range_deg"),
        (("range_deg = [-30.0, 30.0]", "range_deg = [-200, 30]"), "hip_roll_r.range_deg"),
        (("range_deg = [-30.0, 30.0]", "range_deg = 30"), "hip_roll_r.range_deg"),
        (("[joints.knee_l]", "[joints.kne_l]"), "'kne_l'"),
        (("centre = 7500", "centre = 75000"), "controller.centre"),
        (("centre = 7500", "centre = 3000"), "controller.lowest"),
        (("units_per_degree = 29.6", "units_per_degree = -29.6"), "units_per_degree"),
        (("frame_times_ms = [10, 15, 20, 25]", "frame_times_ms = []"), "frame_times_ms"),
        (("[controller]", "controller]"), "TOML"),
    ],
    ids=lambda one: one if isinstance(one, str) else one[1][:24],
)
def test_a_wrong_value_in_the_file_of_servos_is_named(repository, tmp_path, edit, named):
    path = tmp_path / "mine.toml"
    text = (repository / "models" / "khr3hv_servos.toml").read_text()
    head, _, tail = text.partition("[joints.hip_roll_r]")
    changed = head.replace(*edit, 1) + "[joints.hip_roll_r]" + tail.replace(*edit, 1)
    assert changed != text
    path.write_text(changed)
    with pytest.raises(SettingsError, match=str(path)) as error:
        read_servo_map(path)
    assert named in str(error.value)
    assert "\n" not in str(error.value)
