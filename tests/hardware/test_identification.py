"""A servo is found again in a log that was made with it."""

import dataclasses
import re

import numpy as np
import pytest
from conftest import MINIMAL
from scipy.integrate import solve_ivp

from drake_gait.cli import identify as command
from drake_gait.errors import SettingsError
from drake_gait.hardware.identification import identify, simulated
from drake_gait.hardware.servo_log import Load, ServoLog, read_servo_log
from drake_gait.servo import Servo

LOAD = Load(inertia=0.004, gravity_torque=0.35, hanging=np.radians(10.0))
TRUE = Servo(stiffness=17.0, damping=0.25, coulomb_friction=0.04, delay=0.024)
NOISE = np.radians(0.05)
QUANTUM = np.radians(135.0 / 4000.0)
"""What the position of a KRS servo is told to."""


def profile(times):
    """Commands [rad]: steps, then sines of three frequencies."""
    steps = 0.3 * np.sign(np.sin(2.0 * np.pi * times / 1.6)) * (times > 0.3) * (times < 3.4)
    sines = sum(0.12 * np.sin(2.0 * np.pi * rate * (times - 3.4)) for rate in (0.4, 1.3, 2.9))
    return np.where(times < 3.4, steps, sines)


def made(servo, seed, load=LOAD, noise=NOISE, zero=0.0):
    """A log of a servo: integrated by scipy to high accuracy, with noise and whole positions."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 7.0, 0.01)
    commands, stall = profile(times), load.stall_torque
    inertia = load.inertia + load.rotor_inertia

    def motion(time, state):
        angle, speed = state
        target = np.interp(time - servo.delay, times, commands) + zero
        controller = servo.controller_torque(servo.engaged(target - angle), speed, stall)
        motor = servo.motor_torque(controller, speed, stall / load.no_load_speed)
        torque = servo.joint_torque(motor, speed)
        gravity = load.gravity_torque * np.sin(angle - load.hanging)
        return [speed, (torque - gravity) / inertia]

    solved = solve_ivp(
        motion, (0.0, times[-1]), [0.0, 0.0], "LSODA", times, rtol=1e-6, atol=1e-8, max_step=0.01
    )
    measured = solved.y[0] + rng.normal(0.0, noise, len(times))
    return ServoLog(times=times, commands=commands, angles=np.round(measured / QUANTUM) * QUANTUM)


@pytest.fixture(scope="module")
def log():
    return made(TRUE, 0)


def written(log, path):
    rows = np.array([log.times, np.degrees(log.commands), np.degrees(log.angles)]).T
    lines = ["time_s,command_deg,angle_deg", *(",".join(map(repr, row)) for row in rows.tolist())]
    path.write_text("\n".join(lines))
    return path


def test_the_model_of_the_fit_moves_as_the_equations_of_the_servo_do():
    log = made(TRUE, 0, noise=0.0)
    unknowns = np.array([TRUE.stiffness, TRUE.damping, TRUE.coulomb_friction, TRUE.delay, 0.0, 0.0])
    # Half a position of the log, and the steps of the model.
    assert np.abs(simulated(log, LOAD, unknowns) - log.angles).max() < np.radians(0.1)


@pytest.mark.parametrize(
    "servo",
    [TRUE, Servo(stiffness=35.0, damping=0.5, coulomb_friction=0.0, delay=0.0)],
    ids=["with friction", "without"],
)
def test_a_servo_is_found_within_its_intervals(servo):
    misses = 0
    for seed in (1, 2):
        found = identify(made(servo, seed, zero=np.radians(0.4)), LOAD)
        for name, one in found.estimates.items():
            true = getattr(servo, name)
            width = one.upper - one.value
            misses += not one.lower <= true <= one.upper
            # An interval that holds everything would say nothing.
            assert width < {"stiffness": 2.0, "damping": 0.1, "coulomb_friction": 0.02}.get(
                name, 0.004
            )
            assert abs(one.value - true) < 2.5 * width
        assert found.zero == pytest.approx(np.radians(0.4), abs=np.radians(0.2))
    # One of twenty is beyond an interval of 95 %: of eight there are seldom two.
    assert misses <= 1


def test_what_is_printed_is_a_section_of_a_study(log, tmp_path, capsys, read):
    path = written(log, tmp_path / "log.csv")
    options = ["--inertia", "0.004", "--gravity-torque", "0.35", "--hanging-deg", "10"]
    assert command.main([str(path), *options]) == 0
    section, remarks = capsys.readouterr()
    servo = read(MINIMAL + section).walk.servo
    assert servo.stiffness == pytest.approx(TRUE.stiffness, rel=0.05)
    assert servo.delay == pytest.approx(TRUE.delay, abs=0.002)
    assert servo.coulomb_friction == pytest.approx(TRUE.coulomb_friction, abs=0.01)
    assert len(re.findall(r"# 95 %: \S+ to \S+$", section, re.MULTILINE)) == 4
    assert "degrees" in remarks


def test_a_heavier_load_than_was_told_gives_another_servo(log):
    other = identify(log, dataclasses.replace(LOAD, gravity_torque=0.7))
    true = identify(log, LOAD)
    assert other.rms > 1.2 * true.rms


BAD = {
    "no column": ("time_s,command_deg\n0,1\n1,2\n", "angle_deg"),
    "no number": ("time_s,command_deg,angle_deg\n0,1,1\n1,x,2\n", "line 3: command_deg"),
    "short": ("time_s,command_deg,angle_deg\n0,0,0\n0.5,9,9\n", "0.5 s"),
    "gap": ("time_s,command_deg,angle_deg\n0,0,0\n3,9,9\n", "between 0 and 3"),
    "empty": ("", "time_s"),
    "falling times": ("time_s,command_deg,angle_deg\n1,0,0\n0,9,9\n", "time_s must rise"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_log_is_one_line_that_names_it(case, tmp_path, capsys):
    text, named = BAD[case]
    path = tmp_path / "log.csv"
    path.write_text(text)
    assert command.main([str(path), "--inertia", "0.004"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert told.count("\n") == 1
    assert str(path) in told
    assert named in told


@pytest.mark.parametrize(
    ("column", "change", "named"),
    [
        ("angles", lambda angles: 0.0 * angles, "angle_deg moves"),
        ("commands", lambda commands: 0.0 * commands, "command_deg moves"),
        ("angles", lambda angles: np.degrees(angles), "angles must be degrees"),
    ],
)
def test_a_log_that_says_nothing_is_refused_with_what_is_wrong(
    log, column, change, named, tmp_path
):
    wrong = dataclasses.replace(log, **{column: change(getattr(log, column))})
    with pytest.raises(SettingsError, match=named):
        read_servo_log(written(wrong, tmp_path / "log.csv"))


def test_a_servo_that_turns_the_other_way_is_told(log):
    with pytest.raises(SettingsError, match=r"walk\.csv: no servo moves so.*signs"):
        identify(dataclasses.replace(log, angles=-log.angles), LOAD, "walk.csv")


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--inertia", "0"),
        ("--inertia", "nan"),
        ("--gravity-torque", "-1"),
        ("--hanging-deg", "200"),
        ("--stall-torque", "0"),
    ],
)
def test_a_load_that_cannot_be_is_one_line(option, value, log, tmp_path, capsys):
    path = written(log, tmp_path / "log.csv")
    assert command.main([str(path), "--inertia", "0.004", option, value]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert told.startswith(f"error: {option} must be ")
    assert told.endswith(f"got {float(value)}\n")
