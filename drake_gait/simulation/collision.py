"""The shapes of a robot: where their corners are, and which can touch the ground in a walk."""

import itertools

import numpy as np
from pydrake.geometry import Box, GeometryId, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, RigidBody, WeldJoint

from drake_gait.gait import FloatArray
from drake_gait.robot.robot_file import RobotFile

_SIGNS: FloatArray = np.array(list(itertools.product((-0.5, 0.5), repeat=3))).T


def box_corners(
    plant: MultibodyPlant, scene_graph: SceneGraph, body: RigidBody
) -> dict[GeometryId, FloatArray]:
    """Corners of a body's collision boxes in its frame p_BC [m], shape (3, 8) each."""
    inspector = scene_graph.model_inspector()
    corners: dict[GeometryId, FloatArray] = {}
    for geometry in plant.GetCollisionGeometriesForBody(body):
        box = inspector.GetShape(geometry)
        if isinstance(box, Box):
            corners[geometry] = inspector.GetPoseInFrame(geometry) @ (_SIGNS * box.size()[:, None])
    return corners


def out_of_reach(
    plant: MultibodyPlant, scene_graph: SceneGraph, robot: RobotFile
) -> list[GeometryId]:
    """The boxes that cannot touch the ground before the robot has fallen, whatever it does.

    Until then the torso leans no further than `fall_lean`, and is no lower than `fall_height` of
    its height when it stands. Hinges do not change how far a box is from the hinge that carries its
    link.

    Args:
        plant: A finalized one with a torso over a horizontal plane.
        scene_graph: Its shapes.
        robot: Its file.
    """
    context = plant.CreateDefaultContext()
    torso = plant.GetBodyByName(robot.torso)
    X_WT = plant.EvalBodyPoseInWorld(context, torso)
    boxes: list[tuple[GeometryId, RigidBody, FloatArray]] = []  # With their corners p_WC.
    for index in plant.GetBodyIndices(torso.model_instance()):
        body = plant.get_body(index)
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        for geometry, p_BC in box_corners(plant, scene_graph, body).items():
            boxes.append((geometry, body, X_WB @ p_BC))
    ground = min((float(p_WC[2].min()) for _, _, p_WC in boxes), default=0.0)
    torso_height = robot.fall_height * (X_WT.translation()[2] - ground)
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    carrying = {joint.child_body().index(): joint for joint in joints}

    def lowest(body: RigidBody, p_WP: FloatArray) -> float:
        """Return how near the ground points of a body can be [m]; by default at p_WP, (3, n)."""
        if body.index() == torso.index():
            x, y, z = X_WT.inverse() @ p_WP
            outward = np.hypot(x, y)
            lean = np.minimum(robot.fall_lean, np.arctan2(outward, -z))
            return float(np.min(torso_height + z * np.cos(lean) - outward * np.sin(lean)))
        joint = carrying[body.index()]
        if not isinstance(joint, RevoluteJoint | WeldJoint):
            return -np.inf
        p_WJ = joint.frame_on_child().CalcPoseInWorld(context).translation()[:, None]
        distance = float(np.linalg.norm(p_WP - p_WJ, axis=0).max())
        return lowest(joint.parent_body(), p_WJ) - distance

    return [geometry for geometry, body, p_WC in boxes if lowest(body, p_WC) > 0.0]
