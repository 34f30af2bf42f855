"""Servos with friction, backlash, delay and another supply keep the laws of such servos."""

import dataclasses

import numpy as np
import pytest
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import RevoluteJoint, RevoluteSpring, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

from drake_gait.gait import FRAMES, JOINTS
from drake_gait.problem import Candidate
from drake_gait.servo import CREEP, Servo
from drake_gait.simulation.command_source import GaitSystem
from drake_gait.simulation.servo_effects import DryFriction
from drake_gait.simulation.simulate import follow, measured_at_every_step, simulate, start
from drake_gait.study.reading import default_study, read_study
from drake_gait.walk import Disturbance, Integrator, WalkSettings

INERTIA = 0.004  # kg·m²
FRICTION = 0.05  # N·m
WALKING = Candidate(gait=read_study(default_study()).space.decode(np.zeros(16)).gait)
STANDING = np.zeros((FRAMES + 1, len(JOINTS)))


def turned(servo, *, torque=0.0, speed=0.0, angle=0.0, stiffness=0.0, step=0.004, until=0.4):
    """Instants, angles and speeds of one joint that a constant torque, or a spring, turns."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.0), builder)
    plant.set_name("plant")
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    unit = UnitInertia(INERTIA, INERTIA, INERTIA)
    body = plant.AddRigidBody("arm", SpatialInertia(1.0, [0.0, 0.0, 0.0], unit))
    world = plant.world_frame()
    joint = plant.AddJoint(RevoluteJoint("hinge", world, body.body_frame(), [0.0, 0.0, 1.0]))
    plant.AddJointActuator("motor", joint)
    if stiffness:
        plant.AddForceElement(RevoluteSpring(joint, 0.0, stiffness))
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.get_actuation_input_port().FixValue(plant_context, [torque])
    joint.set_angle(plant_context, angle)
    joint.set_angular_rate(plant_context, speed)
    friction = DryFriction(plant, ["hinge"], servo, lambda _: np.array([torque]))
    friction.update(context)
    simulator = start(diagram, context, Integrator(step=step))
    found = []

    def monitor(root):
        state = joint.get_angle(plant_context), joint.get_angular_rate(plant_context)
        found.append((root.get_time(), *state))
        return friction.update(root)

    simulator.set_monitor(monitor)
    # In one go: a sliver of a step has no solution.
    simulator.AdvanceTo(until)
    return np.array(found).T


@pytest.mark.parametrize("step", [0.004, 0.001])
@pytest.mark.parametrize("torque", [0.8 * FRICTION, -0.8 * FRICTION])
def test_dry_friction_holds_a_smaller_torque_but_for_a_creep(torque, step):
    _, angles, speeds = turned(Servo(coulomb_friction=FRICTION), torque=torque, step=step)
    assert np.abs(speeds).max() < CREEP
    assert np.abs(angles[-1]) < 0.4 * CREEP


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_larger_torque_accelerates_a_joint_by_what_it_has_beyond_friction(sign):
    times, _, speeds = turned(Servo(coulomb_friction=FRICTION), torque=sign * 3.0 * FRICTION)
    late = times > 0.15
    slope, _ = np.polyfit(times[late], speeds[late], 1)
    assert slope == pytest.approx(sign * 2.0 * FRICTION / INERTIA, rel=0.02)


def test_friction_slows_a_joint_evenly_and_never_turns_it_around():
    times, angles, speeds = turned(Servo(coulomb_friction=FRICTION), speed=3.0)
    moving = speeds > 0.5
    slope, _ = np.polyfit(times[moving], speeds[moving], 1)
    assert slope == pytest.approx(-FRICTION / INERTIA, rel=0.05)
    assert speeds.min() >= 0.0
    # The energy is used up by friction along the way.
    assert FRICTION * angles[-1] == pytest.approx(0.5 * INERTIA * 3.0**2, rel=0.05)


def test_friction_brakes_a_spring_by_four_times_friction_over_stiffness_in_a_cycle():
    # Friction takes 4 x friction x amplitude of energy in a cycle. The rest is the integrator's.
    def swing(friction):
        servo = Servo(coulomb_friction=friction)
        times, angles, _ = turned(servo, angle=0.5, stiffness=4.0, step=0.001, until=0.7)
        period = 2.0 * np.pi * np.sqrt(INERTIA / 4.0)
        return [angles[np.abs(times - cycle * period) < 0.1].max() for cycle in (1, 2, 3)]

    free, braked = np.array(swing(0.0)), np.array(swing(0.01))
    expected = 4.0 * 0.01 / 4.0 * np.array([1, 2, 3])
    np.testing.assert_allclose(free - braked, expected, rtol=0.15)


def test_friction_of_a_loaded_gear_takes_its_share_of_the_motor():
    times, _, speeds = turned(Servo(load_friction=0.25), torque=0.1)
    late = times > 0.15
    slope, _ = np.polyfit(times[late], speeds[late], 1)
    assert slope == pytest.approx(0.75 * 0.1 / INERTIA, rel=0.02)


def test_a_walk_with_late_servos_is_that_of_late_commands():
    late = WalkSettings(servo=Servo(delay=0.02))
    frame = WALKING.gait.commands_from(late.start)
    shifted = np.vstack([frame[:1], frame[:-1]])
    found = simulate(WALKING, late)
    same = simulate(WALKING, WalkSettings(disturbance=Disturbance(delay=0.02)))
    own = follow(shifted)
    assert (found.forward, found.lateral) == (same.forward, same.lateral)
    assert found.measures == same.measures
    assert found.forward == pytest.approx(own.forward, rel=1e-3)
    assert found.measures.peak_torque == pytest.approx(own.measures.peak_torque, rel=1e-2)


def test_a_servo_s_supply_is_that_of_a_disturbance():
    found = simulate(WALKING, WalkSettings(servo=Servo(voltage=0.8)))
    same = simulate(WALKING, WalkSettings(disturbance=Disturbance(voltage=0.8)))
    assert (found.forward, found.measures) == (same.forward, same.measures)


REAL = Servo(coulomb_friction=0.03, load_friction=0.1, backlash=0.005, delay=0.013, voltage=0.9)


@pytest.mark.parametrize(
    "servo",
    [
        pytest.param(REAL, id="all"),
        pytest.param(dataclasses.replace(Servo(), delay=0.013), id="delay"),
    ],
)
def test_torques_from_the_log_are_those_that_drake_tells(servo):
    settings = WalkSettings(servo=servo)
    walk, measures = measured_at_every_step(WALKING, settings)
    for name in ("peak_torque", "driving_torque", "braking_torque", "driving_speed"):
        assert getattr(walk.measures, name) == pytest.approx(getattr(measures, name), rel=1e-6)
    assert walk.measures.braking_speed == pytest.approx(measures.braking_speed, rel=1e-6)
    assert walk.measures.line_share == pytest.approx(measures.line_share, rel=1e-6)
    # The motor's line: a servo that drives its joint cannot pass it.
    assert 0.5 < measures.line_share <= 1.0
    apart = max(measures.driving_torque, measures.braking_torque)
    assert measures.peak_torque == pytest.approx(apart)
    assert walk.measures.positive_energy == pytest.approx(measures.positive_energy, rel=1e-3)
    assert walk.measures.saturated_fraction == pytest.approx(measures.saturated_fraction, abs=1e-3)


def test_within_its_play_a_joint_is_let_be_and_beyond_it_the_spring_winds_up():
    gait = GaitSystem(Servo(backlash=0.02))
    context = gait.CreateDefaultContext()
    gait.set_commands(context, STANDING + 0.1)
    angles = np.array([0.1, 0.095, 0.105, 0.05, 0.15, 0.1, 0.1, 0.1, 0.1, 0.1])
    gait.set_angles(context, angles)
    sent = gait.GetOutputPort("desired_state").Eval(context)[:10]
    np.testing.assert_allclose((sent - angles)[:5], [0.0, 0.0, 0.0, 0.04, -0.04], atol=1e-12)


def test_play_lets_a_loaded_joint_sag_by_half_of_it():
    # Squat slowly: the knees carry the robot.
    depth = np.minimum(np.arange(FRAMES + 1) / 100.0, 1.0) * np.radians(30.0)
    bends = {"hip_pitch": 1.0, "knee": 2.0, "ankle_pitch": 1.0}
    commands = np.array([depth * bends.get(name[:-2], 0.0) for name in JOINTS]).T

    def sag(servo):
        walk = follow(commands, settings=WalkSettings(servo=servo), history=True)
        assert walk.survived
        return np.abs(walk.history.angles - commands)[-1, JOINTS.index("knee_r")]

    assert sag(Servo(backlash=0.01)) - sag(Servo()) == pytest.approx(0.005, rel=0.2)
