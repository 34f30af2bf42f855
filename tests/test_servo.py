"""The servos' settings."""

import dataclasses
import inspect
import re

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.servo import Servo

FIELDS = [field.name for field in dataclasses.fields(Servo)]

STALL_TORQUE = 1.373
"""14.0 kgf·cm [N·m]: the joints' effort limit."""


def test_the_no_load_speed_is_that_of_the_data_sheet():
    # KRS-2552: 60 degrees in 0.14 s.
    assert Servo().no_load_speed == pytest.approx(np.radians(60.0) / 0.14, abs=0.005)


def test_the_default_servo_gives_its_stall_torque_as_far_off_the_command_as_its_page_says():
    said = re.search(r"stall torque is reached ([\d.]+) degrees", inspect.getsource(Servo))
    assert np.degrees(STALL_TORQUE / Servo().stiffness) == pytest.approx(float(said[1]), abs=0.05)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf, 1e6])
def test_an_unusable_value_of_a_servo_is_refused_by_its_name(name, value):
    with pytest.raises(SettingsError, match=rf"servo {name} must be > 0.*got {value}"):
        Servo(**{name: value})


def test_servos_hash_alike_when_their_fields_are():
    # One plant is kept for each servo.
    assert len({Servo(), Servo(), Servo(damping=0.05)}) == 2
