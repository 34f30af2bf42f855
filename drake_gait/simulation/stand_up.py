"""A robot that stands, examined: what somebody should know of it before a search."""

from dataclasses import dataclass
from typing import cast

import numpy as np
from pydrake.geometry import QueryObject, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiagramBuilder

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import JOINTS, STANDING, FloatArray
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.simulation.collision import box_corners
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.servo_joints import actuators, servo_joints
from drake_gait.simulation.simulate import follow
from drake_gait.sole import Sole
from drake_gait.walk import Walk, WalkSettings

_UPRIGHT = 0.994
"""Height of the centre of mass that a walk is to end with, as part of that of who stands.

The paper's 243.53 mm (Eq. 13) are so much of the KHR-3HV's 245.0 mm.
"""
_DEEP = 1e-4
"""Shapes that are this deep in each other touch [m]."""


@dataclass(frozen=True, kw_only=True)
class ServoLoad:
    """One joint with a role, while the robot stands."""

    role: str
    """Its role, of `gait.JOINTS`."""
    joint: str
    """Its name in the model."""
    torque: float
    """Torque that standing needs, in the sign of the role [N·m]."""
    stall: float
    """Stall torque of its servo [N·m]."""
    range: tuple[float, float]
    """Angles that a gait may take it to, counted from the standing pose [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stood:
    """A robot that has stood for as long as a walk."""

    model: RobotModel
    """The robot."""
    walk: Walk
    """The walk that it has made on the spot, with its history."""
    mass: float
    """Of all of it [kg]."""
    height: float
    """Of its highest point [m]."""
    torso_height: float
    """Of its torso's origin [m]."""
    centre: FloatArray
    """Centre of mass p_WC, from the middle between the ankles [m], shape (3,)."""
    support: tuple[float, float]
    """Distance of its centre of mass from the rear and the front edge of the soles [m]."""
    foot_gap: float
    """Distance between the soles of both feet across [m]; below 0 where they overlap."""
    touching: tuple[tuple[str, str], ...]
    """Links whose shapes are in each other."""
    servos: tuple[ServoLoad, ...]
    """Joints with a role, ordered as `gait.JOINTS`."""

    @property
    def com_limit(self) -> float:
        """Return a limit for the centre of mass at the end of a walk [m]."""
        return _UPRIGHT * float(self.centre[2])

    @property
    def lowest_torso(self) -> float:
        """Return the height of the torso below which the robot has fallen [m]."""
        return self.model.robot.fall_height * self.torso_height

    @property
    def bend(self) -> FloatArray:
        """Return how far hips, knees and ankles are bent in the standing pose [rad], shape (3,).

        In the signs of a gait, mean of both legs; 0 of joints that the robot has not.
        """
        robot = self.model.robot
        standing = dict(robot.standing or ())
        angles = [
            sign * standing.get(name or "", 0.0)
            for name, sign in zip(robot.joints, robot.signs, strict=True)
        ]
        legs: FloatArray = np.array(angles).reshape(2, -1)
        return cast(FloatArray, legs.mean(axis=0)[1:4])


def stand_up(settings: WalkSettings) -> Stood:
    """Stand a robot up, and let it stand for as long as a walk.

    Args:
        settings: How to simulate, with the robot.

    Raises:
        ModelError: the robot cannot be used, or does not stand.
    """
    model = read_model(settings.model, settings.robot)
    walk = follow(np.zeros_like(STANDING.commands), None, settings, history=True)
    if walk.history is None or not walk.survived:
        raise ModelError(f"{model}: the robot does not stand for the time of a walk: "
                         f"{walk.reason}; look at its masses, servos and soles")  # fmt: skip
    builder = DiagramBuilder()
    # Boxes: other soles are rims and points.
    config = PlantConfig(model=model, foot=FootDesign(), sole=Sole.BOXES)
    plant, scene_graph = add_robot(builder, config)
    diagram = builder.Build()
    context = default_context(diagram)
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(plant_context, walk.history.positions[-1])
    torso = plant.GetBodyByName(model.robot.torso)
    X_WT = plant.EvalBodyPoseInWorld(plant_context, torso)
    boxes = _boxes(plant, scene_graph, plant_context, model)
    right, left = (np.hstack([boxes[link] for link in leg.plates]) for leg in model.robot.legs)
    feet, centre = np.hstack([right, left]), walk.history.com[-1]
    middle = walk.history.ankles[-1].mean(axis=0) * (1.0, 1.0, 0.0)
    scene_context = scene_graph.GetMyContextFromRoot(context)
    query = cast(QueryObject, scene_graph.get_query_output_port().Eval(scene_context))
    return Stood(
        model=model,
        walk=walk,
        mass=float(plant.CalcTotalMass(plant_context)),
        height=max(float(one[2].max()) for one in boxes.values()),
        torso_height=float(X_WT.translation()[2]),
        centre=centre - middle,
        support=(float(centre[0] - feet[0].min()), float(feet[0].max() - centre[0])),
        foot_gap=float(left[1].min() - right[1].max()),
        touching=_touching(plant, scene_graph, query),
        servos=_servos(plant, model, walk),
    )


def _boxes(
    plant: MultibodyPlant, scene_graph: SceneGraph, plant_context: Context, model: RobotModel
) -> dict[str, FloatArray]:
    """Return the corners of the boxes of each link p_WC [m], shape (3, n), by the link's name."""
    found = {}
    instance = plant.GetBodyByName(model.robot.torso).model_instance()
    for index in plant.GetBodyIndices(instance):
        body = plant.get_body(index)
        if own := box_corners(plant, scene_graph, body):
            X_WB = plant.EvalBodyPoseInWorld(plant_context, body)
            found[body.name()] = cast(FloatArray, X_WB @ np.hstack(list(own.values())))
    return found


def _touching(
    plant: MultibodyPlant, scene_graph: SceneGraph, query: QueryObject
) -> tuple[tuple[str, str], ...]:
    """Return the links of a robot whose shapes are in each other."""
    inspector, found = scene_graph.model_inspector(), set()
    for pair in query.ComputePointPairPenetration():
        bodies = [
            plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
            for shape in (pair.id_A, pair.id_B)
        ]
        names = sorted(body.name() for body in bodies if body is not None)
        if pair.depth > _DEEP and plant.world_body().name() not in names:
            found.add((names[0], names[-1]))
    return tuple(sorted(found))


def _servos(plant: MultibodyPlant, model: RobotModel, walk: Walk) -> tuple[ServoLoad, ...]:
    """Return the joints with a role, with what standing needs of them."""
    if walk.history is None:
        return ()
    robot, joints = model.robot, servo_joints(plant, model.robot)
    torques = walk.history.torques[len(walk.history.torques) // 2 :].mean(axis=0)
    stalls: FloatArray = np.array([one.effort_limit() for one in actuators(plant)])
    stall, standing = joints.limits_by_role(stalls), dict(robot.standing or ())
    found = []
    for role, name, sign, torque, most in zip(
        JOINTS, robot.joints, robot.signs, torques, stall, strict=True
    ):
        if name is None:
            continue
        joint = plant.GetJointByName(name)
        ends = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        low, high = sorted(sign * (end - standing.get(name, 0.0)) for end in ends)
        found.append(
            ServoLoad(
                role=role, joint=name, torque=float(torque), stall=float(most),
                range=(float(low), float(high)),
            )
        )  # fmt: skip
    return tuple(found)
