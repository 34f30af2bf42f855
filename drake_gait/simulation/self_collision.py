"""Distance between the two legs of a robot that holds its commanded joint angles."""

import itertools
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Box, GeometryId, QueryObject
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from drake_gait.arrays import numbers
from drake_gait.foot import FootDesign
from drake_gait.gait import FloatArray
from drake_gait.robot.description import Model, read_model
from drake_gait.robot.robot_file import Leg
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.servo_joints import servo_joints, toe_positions
from drake_gait.sole import Sole
from drake_gait.walk import DEFAULT_MODEL

_THIGH = 1
"""Number among the roles of a leg of the joint that carries the thigh."""
_FAR = 0.03  # Boxes further apart than this are not looked at [m].


def leg_gaps(
    angles: ArrayLike, foot: FootDesign | None = None, model: Model = DEFAULT_MODEL
) -> tuple[FloatArray, list[tuple[str, str]]]:
    """Return the smallest distance between the legs in each of a motion's frames.

    The legs are the collision boxes of thighs, shins, ankles, feet and toes; the toes are straight.

    Args:
        angles: Joint angles [rad], shape (n, 10), columns as gait.JOINTS.
        foot: The foot; the paper's by default.
        model: The robot description.

    Returns:
        Distance [m], shape (n,), below 0 where boxes overlap, at most 0.03; and the two links.

    Raises:
        ModelError: the robot description cannot be used.
    """
    angles = numbers("angles", angles)
    builder = DiagramBuilder()
    # Boxes: other soles are rims and points, without a volume.
    model = read_model(model)
    config = PlantConfig(model=model, foot=foot or FootDesign(), sole=Sole.BOXES)
    plant, scene_graph = add_robot(builder, config)
    joints = servo_joints(plant, model.robot)
    diagram = builder.Build()
    context = default_context(diagram)
    plant_context = plant.GetMyMutableContextFromRoot(context)
    scene_context = scene_graph.GetMyContextFromRoot(context)
    inspector = scene_graph.model_inspector()

    def boxes(leg: Leg) -> list[tuple[str, GeometryId]]:
        return [
            (body.name(), geometry)
            for body in _moved_by(plant, leg)
            for geometry in plant.GetCollisionGeometriesForBody(body)
            if isinstance(inspector.GetShape(geometry), Box)
        ]

    pairs = list(itertools.product(*(boxes(leg) for leg in model.robot.legs)))
    places = [plant.GetJointByName(name).position_start() for name in joints.names]
    positions: FloatArray = np.array(plant.GetPositions(plant_context))
    positions[list(toe_positions(plant, model.robot).values())] = 0.0
    gaps, nearest = np.full(len(angles), _FAR), [("", "")] * len(angles)
    for frame, row in enumerate(joints.sent(angles)):
        positions[places] = row
        plant.SetPositions(plant_context, positions)
        query = cast(QueryObject, scene_graph.get_query_output_port().Eval(scene_context))
        for (right, one), (left, other) in pairs:
            found = query.ComputeSignedDistancePairClosestPoints(one, other).distance
            if found < gaps[frame]:
                gaps[frame], nearest[frame] = found, (right, left)
    return gaps, nearest


def _moved_by(plant: MultibodyPlant, leg: Leg) -> list[RigidBody]:
    """Return the links of a leg from the thigh on."""
    first = next(name for name in (*leg.joints[_THIGH:], *leg.joints) if name is not None)
    joint = plant.GetJointByName(first)
    found = plant.GetBodiesKinematicallyAffectedBy([joint.index()])
    return [plant.get_body(index) for index in found]
