"""A robot that differs from its description: joint zeros, supply voltage and mass."""

import dataclasses
import math

import numpy as np
import pytest

from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAMES, JOINTS
from drake_gait.simulation.simulate import follow, prepare
from drake_gait.walk import Disturbance, WalkSettings

STANDING = np.zeros((FRAMES + 1, len(JOINTS)))


def standing(**changes):
    settings = WalkSettings(disturbance=Disturbance(**changes))
    return prepare(STANDING, FootDesign(), settings)


def mass_of(robot, context):
    plant_context = robot.plant.GetMyContextFromRoot(context)
    return robot.plant.CalcTotalMass(plant_context)


def test_the_mass_of_every_link_scales_and_the_next_walk_has_its_own():
    own = mass_of(*standing())
    assert mass_of(*standing(mass=1.03)) == pytest.approx(1.03 * own)
    assert mass_of(*standing()) == own


def test_a_heavier_robot_presses_harder_on_the_ground():
    def weight(mass):
        settings = WalkSettings(disturbance=Disturbance(mass=mass))
        history = follow(STANDING, settings=settings, history=True).history
        return history.ground_reaction[-1, :, 2].sum()

    assert weight(1.03) == pytest.approx(1.03 * weight(1.0), rel=1e-3)


def test_inertia_scales_with_mass():
    def inertia(mass):
        robot, context = standing(mass=mass)
        plant_context = robot.plant.GetMyContextFromRoot(context)
        body = robot.plant.GetBodyByName("torso")
        return body.CalcSpatialInertiaInBodyFrame(plant_context).CopyToFullMatrix6()

    np.testing.assert_allclose(inertia(0.97), 0.97 * inertia(1.0), rtol=1e-12)


def test_voltage_scales_what_a_servo_can_hold():
    def limits(voltage):
        robot, _ = standing(voltage=voltage)
        return [robot.plant.GetJointActuatorByName(name).effort_limit() for name in JOINTS]

    np.testing.assert_allclose(limits(0.9), 0.9 * np.array(limits(1.0)))


def test_a_joint_s_zero_is_added_to_its_commands_in_every_frame():
    zeros = tuple(math.radians(0.1) * (-1.0) ** place for place in range(len(JOINTS)))
    settings = WalkSettings(disturbance=Disturbance(joint_zeros=zeros))
    found, own = follow(STANDING, settings=settings), follow(STANDING + zeros)
    assert (found.forward, found.lateral, found.yaw) == (own.forward, own.lateral, own.yaw)
    assert found.forward != follow(STANDING).forward


def test_no_disturbance_changes_no_number():
    settings = WalkSettings(disturbance=Disturbance())
    found, own = follow(STANDING, settings=settings), follow(STANDING)
    assert (found.forward, found.lateral, found.yaw) == (own.forward, own.lateral, own.yaw)


@pytest.mark.parametrize(
    "changes",
    [
        {"joint_zeros": (0.0,) * 9},
        {"joint_zeros": (1.0,) * 10},
        {"voltage": 0.0},
        {"mass": np.nan},
        {"delay": -0.01},
        {"delay": 0.2},
    ],
)
def test_a_disturbance_that_no_robot_has_is_refused(changes):
    (name,) = changes
    with pytest.raises(SettingsError, match=name):
        dataclasses.replace(Disturbance(), **changes)
