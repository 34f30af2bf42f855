"""The gait as a Drake system."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from drake_gait.gait import FRAME_TIME, FRAMES, STANDING, Gait
from drake_gait.simulation.command_source import GaitSystem, desired_state

GAIT = Gait.from_degrees([[0, -1.5, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]])

frames = st.integers(0, FRAMES - 1)
parts = st.floats(1e-6, 1.0 - 1e-6)


@pytest.fixture
def system():
    return GaitSystem()


def context_of(system, commands, time=0.0):
    context = system.CreateDefaultContext()
    system.set_commands(context, commands)
    context.SetTime(time)
    return context


def output(system, context):
    return system.GetOutputPort("desired_state").Eval(context)


@given(frames)
def test_on_a_frame_the_desired_angles_are_its_commands(frame):
    angles = desired_state(GAIT.commands, frame * FRAME_TIME)[:10]
    assert angles == pytest.approx(GAIT.commands[frame], abs=1e-12)


@given(st.floats(0.0, 6.0))
def test_the_desired_rates_are_zero_because_a_servo_is_sent_positions_only(time):
    assert not desired_state(GAIT.commands, time)[10:].any()


@given(frames, parts)
def test_between_frames_the_desired_angles_run_straight(frame, part):
    state = desired_state(GAIT.commands, (frame + part) * FRAME_TIME)
    start, end = GAIT.commands[frame : frame + 2]
    assert state[:10] == pytest.approx(start + part * (end - start), abs=1e-9)


@given(st.floats(0.0, 1.0))
def test_before_the_first_frame_the_first_command_is_held(before):
    assert (desired_state(GAIT.commands, -before)[:10] == GAIT.commands[0]).all()


@given(st.floats(0.0, 4.0), st.floats(0.0, 0.1))
def test_commands_with_a_delay_are_those_of_an_earlier_instant(time, delay):
    system = GaitSystem()
    context = context_of(system, GAIT.commands, time)
    system.set_commands(context, GAIT.commands, lead=-delay)
    assert (output(system, context) == desired_state(GAIT.commands, time - delay)).all()


@given(frames)
def test_a_time_one_rounding_before_a_frame_counts_as_the_frame(frame):
    # Sums of time steps miss the instants of frames by their last digits.
    before = np.nextafter(frame * FRAME_TIME, -1.0) if frame else 0.0
    exact = desired_state(GAIT.commands, frame * FRAME_TIME)
    assert desired_state(GAIT.commands, before) == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("time", [FRAMES * FRAME_TIME, 4.81, 100.0])
def test_after_the_last_frame_its_command_is_held(time):
    commands = GAIT.commands[:100]  # This part of the walk ends with bent joints.
    state = desired_state(commands, time)
    assert (state[:10] == commands[-1]).all()
    assert commands[-1].any()
    assert not state[10:].any()


@given(st.floats(0.0, 6.0))
def test_the_port_gives_the_desired_state_at_the_context_s_time(time):
    system = GaitSystem()
    context = context_of(system, GAIT.commands, time)
    assert (output(system, context) == desired_state(GAIT.commands, time)).all()


def test_a_system_without_commands_stands_still(system):
    context = system.CreateDefaultContext()
    context.SetTime(0.31)
    assert output(system, context).shape == (20,)
    assert not output(system, context).any()


def test_two_contexts_of_one_system_hold_two_gaits(system):
    first = context_of(system, GAIT.commands, 0.5)
    second = context_of(system, STANDING.commands, 0.5)
    assert (output(system, first) == desired_state(GAIT.commands, 0.5)).all()
    assert (output(system, second) == desired_state(STANDING.commands, 0.5)).all()
    assert output(system, first).any()
    assert not output(system, second).any()


@given(time=st.floats(0.0, 6.0), lead=st.floats(0.0, 0.1))
def test_a_lead_reads_the_commands_that_much_ahead(time, lead):
    system = GaitSystem()
    context = system.CreateDefaultContext()
    system.set_commands(context, GAIT.commands, lead=lead)
    context.SetTime(time)
    assert output(system, context) == pytest.approx(desired_state(GAIT.commands, time + lead))


def test_without_a_lead_commands_that_follow_others_have_none(system):
    context = system.CreateDefaultContext()
    system.set_commands(context, GAIT.commands, lead=0.05)
    system.set_commands(context, GAIT.commands)
    context.SetTime(0.5)
    assert (output(system, context) == desired_state(GAIT.commands, 0.5)).all()


def test_new_commands_take_the_place_of_the_old_at_once(system):
    context = context_of(system, STANDING.commands, 0.5)
    assert not output(system, context).any()
    system.set_commands(context, GAIT.commands)
    assert (output(system, context) == desired_state(GAIT.commands, 0.5)).all()


def test_commands_in_a_context_do_not_change_with_the_caller_s_array(system):
    commands = np.array(GAIT.commands)
    context = context_of(system, commands, 0.5)
    commands[:] = 0.0
    assert output(system, context).any()


def test_the_port_follows_the_clock_of_a_simulation():
    builder = DiagramBuilder()
    gait = builder.AddSystem(GaitSystem())
    logger = LogVectorOutput(gait.GetOutputPort("desired_state"), builder, FRAME_TIME)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    gait.set_commands(gait.GetMyMutableContextFromRoot(context), GAIT.commands)
    Simulator(diagram, context).AdvanceTo(4.8)
    logged = logger.FindLog(context).data().T
    assert logged.shape == (FRAMES + 1, 20)
    assert logged[:, :10] == pytest.approx(GAIT.commands, abs=1e-12)
