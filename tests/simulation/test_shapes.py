"""Which shapes a walk can do without: those that reach no ground before the robot has fallen."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from drake_gait.gait import JOINTS
from drake_gait.robot.description import model_path
from drake_gait.robot.robot_file import default_robot
from drake_gait.simulation.collision import box_corners, out_of_reach
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig

MODELS = ("khr3hv.sdf", "khr3hv_cad.sdf")


def shapes_of(model):
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(builder, PlantConfig(model=model))
    return plant, scene_graph, out_of_reach(plant, scene_graph, default_robot())


def names(model):
    _, scene_graph, found = shapes_of(model)
    return {scene_graph.model_inspector().GetName(one).split("::")[1] for one in found}


@pytest.mark.parametrize("model", MODELS)
def test_trunk_arms_and_thighs_are_out_of_reach_and_what_stands_is_not(model):
    found = names(model)
    assert {"chest_collision", "hand_l_collision", "thigh_plate_collision"} <= found
    assert not {"heel_collision", "big_toe_collision", "shin_servo_collision"} & found


@pytest.mark.parametrize("model", MODELS)
def test_no_posture_before_a_fall_brings_them_to_the_ground(model):
    plant, scene_graph, found = shapes_of(model)
    inspector = scene_graph.model_inspector()
    context = plant.CreateDefaultContext()
    torso = plant.GetBodyByName("torso")
    lowest_torso = (
        default_robot().fall_height * plant.EvalBodyPoseInWorld(context, torso).translation()[2]
    )
    rng = np.random.default_rng(0)
    heights = []
    for _ in range(500):
        # Any heading, and the furthest lean to any side.
        turned, towards = rng.uniform(-np.pi, np.pi, 2)
        axis = np.array([np.cos(towards), np.sin(towards), 0.0])
        lean = RotationMatrix(AngleAxis(default_robot().fall_lean, axis))
        pose = RigidTransform(lean @ RotationMatrix.MakeZRotation(turned), [0.0, 0.0, lowest_torso])
        plant.SetFreeBodyPose(context, torso, pose)
        for name in (*JOINTS, *default_robot().hinges):
            plant.GetJointByName(name).set_angle(context, rng.uniform(-np.pi, np.pi))
        for geometry in found:
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            p_BC = box_corners(plant, scene_graph, body)[geometry]
            heights.append((plant.EvalBodyPoseInWorld(context, body) @ p_BC)[2].min())
    assert min(heights) > 0.0


@pytest.mark.parametrize(
    ("shape", "before", "after"),
    [
        # A hand that hangs 11 cm lower.
        ("hand_l_collision", "-0.0444 0 0 0", "-0.1544 0 0 0"),
        # The same file, put in the air by a metre: the floor is where its soles are.
        (None, '<model name="khr3hv">', '<model name="khr3hv"><pose>0 0 1 0 0 0</pose>'),
    ],
)
def test_what_counts_is_the_file_that_is_walked(tmp_path: Path, shape, before, after):
    text = model_path("khr3hv.sdf").read_text()
    changed = tmp_path / "robot.sdf"
    place = text.index(before, text.index(f'"{shape}"') if shape else 0)
    changed.write_text(text[:place] + after + text[place + len(before) :])
    assert names("khr3hv.sdf") - names(str(changed)) == ({shape} if shape else set())
