"""The servos' settings."""

import dataclasses
import inspect
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_gait.errors import SettingsError
from drake_gait.servo import CREEP, Servo

FIELDS = [field.name for field in dataclasses.fields(Servo)]

STALL_TORQUE = 1.373
"""14.0 kgf·cm [N·m]: the joints' effort limit."""


def test_the_no_load_speed_is_that_of_the_data_sheet():
    # KRS-2552: 60 degrees in 0.14 s.
    assert Servo().no_load_speed == pytest.approx(np.radians(60.0) / 0.14, abs=0.005)


def test_the_default_servo_gives_its_stall_torque_as_far_off_the_command_as_its_page_says():
    said = re.search(r"stall torque is reached ([\d.]+) degrees", inspect.getsource(Servo))
    assert np.degrees(STALL_TORQUE / Servo().stiffness) == pytest.approx(float(said[1]), abs=0.05)


@pytest.mark.parametrize("name", ["stiffness", "damping", "no_load_speed"])
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf, 1e6])
def test_an_unusable_gain_of_a_servo_is_refused_by_its_name(name, value):
    with pytest.raises(SettingsError, match=rf"servo {name} must be > 0.*got {value}"):
        Servo(**{name: value})


@pytest.mark.parametrize("name", FIELDS[3:])
@pytest.mark.parametrize("value", [np.nan, -0.01, np.inf, 11.0])
def test_an_unusable_imperfection_of_a_servo_is_refused_by_its_name(name, value):
    with pytest.raises(SettingsError, match=rf"servo {name} must be \S+ to .*got {value}"):
        Servo(**{name: value})


def test_a_servo_is_ideal_unless_it_is_told_otherwise():
    speeds, motors = np.linspace(-9.0, 9.0, 19), np.linspace(-2.0, 2.0, 19)
    assert not Servo().has_friction
    assert (Servo().friction_torque(motors, speeds) == 0.0).all()
    assert (Servo().engaged(motors) == motors).all()
    assert (Servo().delay, Servo().voltage) == (0.0, 1.0)


@given(supply=st.floats(0.5, 2.0), share=st.floats(-1.0, 1.0))
def test_a_motor_s_torque_falls_from_the_stall_torque_to_nothing_at_its_no_load_speed(
    supply, share
):
    servo, stall = Servo(), np.array([supply * STALL_TORQUE])
    speed = share * supply * servo.no_load_speed
    back_emf = servo.back_emf(stall, supply)
    full = servo.controller_torque(np.array([10.0]), speed, stall)
    assert full == pytest.approx(stall)
    # Driven in its own direction it has less, turned against it more than its stall torque.
    assert servo.motor_torque(full, speed, back_emf) == pytest.approx((1.0 - share) * stall)


@given(
    error=st.floats(-1.0, 1.0),
    speed=st.floats(-9.0, 9.0),
    friction=st.floats(0.0, 0.2),
    share=st.floats(0.0, 0.5),
)
def test_the_law_of_a_servo_is_that_of_its_page(error, speed, friction, share):
    # torque = motor - (coulomb_friction + load_friction * |motor|) * clip(v / CREEP, ± 1)
    servo, stall = Servo(coulomb_friction=friction, load_friction=share), np.array(STALL_TORQUE)
    controller = servo.controller_torque(error, speed, stall)
    motor = servo.motor_torque(controller, speed, servo.back_emf(stall))
    spring = max(-STALL_TORQUE, min(STALL_TORQUE, 20.0 * error - 0.2 * speed))
    expected = spring - STALL_TORQUE * speed / 7.48
    assert float(controller) == pytest.approx(spring)
    assert float(motor) == pytest.approx(expected)
    held = (friction + share * abs(expected)) * max(-1.0, min(1.0, speed / CREEP))
    assert float(servo.joint_torque(motor, np.array(speed))) == pytest.approx(expected - held)


@given(
    friction=st.floats(0.0, 10.0),
    share=st.floats(0.0, 0.9),
    motor=st.floats(-5.0, 5.0),
    speed=st.floats(-20.0, 20.0),
)
def test_friction_never_drives_and_never_turns_a_motor_s_torque_beyond_its_own(
    friction, share, motor, speed
):
    servo = Servo(coulomb_friction=friction, load_friction=share)
    torque = float(servo.friction_torque(np.array(motor), np.array(speed)))
    assert torque * speed <= 0.0
    assert abs(torque) <= friction + share * abs(motor)


@given(error=st.floats(-1.0, 1.0), backlash=st.floats(0.0, 0.17))
def test_play_takes_half_of_it_from_an_error_and_leaves_its_sign(error, backlash):
    found = Servo(backlash=backlash).engaged(error)
    assert abs(found) == pytest.approx(max(abs(error) - 0.5 * backlash, 0.0), abs=1e-12)
    assert found * error >= 0.0


def test_servos_hash_alike_when_their_fields_are():
    # One plant is kept for each servo.
    assert len({Servo(), Servo(), Servo(damping=0.05)}) == 2
