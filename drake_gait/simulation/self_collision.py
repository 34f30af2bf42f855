"""Distance between the two legs of a robot that holds its commanded joint angles."""

import itertools
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Box, GeometryId, QueryObject
from pydrake.systems.framework import DiagramBuilder

from drake_gait.arrays import numbers
from drake_gait.foot import FootDesign
from drake_gait.gait import JOINTS, FloatArray
from drake_gait.robot.description import Model
from drake_gait.robot.sdf import FOOT_LINKS, SIDES, TOE_HINGES
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.sole import Sole
from drake_gait.walk import DEFAULT_MODEL

_LEG_LINKS = ("thigh", "shin", "ankle", *FOOT_LINKS)
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
    config = PlantConfig(model=model, foot=foot or FootDesign(), sole=Sole.BOXES)
    plant, scene_graph = add_robot(builder, config)
    diagram = builder.Build()
    context = default_context(diagram)
    plant_context = plant.GetMyMutableContextFromRoot(context)
    scene_context = scene_graph.GetMyContextFromRoot(context)
    inspector = scene_graph.model_inspector()

    def boxes(side: str) -> list[tuple[str, GeometryId]]:
        links = [f"{link}_{side}" for link in _LEG_LINKS if plant.HasBodyNamed(f"{link}_{side}")]
        return [
            (link, geometry)
            for link in links
            for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link))
            if isinstance(inspector.GetShape(geometry), Box)
        ]

    pairs = list(itertools.product(*(boxes(side) for side in SIDES)))
    places = [plant.GetJointByName(name).position_start() for name in JOINTS]
    positions: FloatArray = np.array(plant.GetPositions(plant_context))
    for hinge in TOE_HINGES:
        toe = plant.GetJointByName(hinge)
        positions[toe.position_start() : toe.position_start() + toe.num_positions()] = 0.0
    gaps, nearest = np.full(len(angles), _FAR), [("", "")] * len(angles)
    for frame, row in enumerate(angles):
        positions[places] = row
        plant.SetPositions(plant_context, positions)
        query = cast(QueryObject, scene_graph.get_query_output_port().Eval(scene_context))
        for (right, one), (left, other) in pairs:
            found = query.ComputeSignedDistancePairClosestPoints(one, other).distance
            if found < gaps[frame]:
                gaps[frame], nearest[frame] = found, (right, left)
    return gaps, nearest
