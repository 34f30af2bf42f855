"""A robot's stance, checked: where the soles are, and that a foot design fits them.

The axes of links and the places of their boxes may be written in many ways; what counts is where
Drake puts them.
"""

from functools import lru_cache
from typing import cast

import numpy as np
from pydrake.multibody.tree import RevoluteJoint
from pydrake.systems.framework import Context

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FloatArray
from drake_gait.robot.description import RobotModel
from drake_gait.robot.robot_file import ROLES, SIDES
from drake_gait.simulation.contact import plates
from drake_gait.simulation.plant import Robot, build_robot, sole_corners
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.sole import Sole

_HIGHEST_START = 0.02
"""How far from the ground the soles may be in the file [m]."""
_LEVEL = np.cos(np.radians(5.0))
_SAME = 1e-6
"""Places that differ by less are the same [m]."""

_PROBE = FootDesign(big_toe_width=0.030, toe_length=0.020)
"""A foot that is like no file's."""

Extent = tuple[FloatArray, FloatArray]
"""Smallest and largest x, y, z [m], shape (3,) each."""


def check_placed(robot: Robot, plant_context: Context, model: RobotModel) -> None:
    """Refuse a robot whose soles are not on the ground, or that does not face along x.

    Raises:
        ModelError: it is so.
    """
    plant, torso, feet = robot.plant, model.robot.torso, model.robot.plates
    R_WT = plant.EvalBodyPoseInWorld(plant_context, plant.GetBodyByName(torso)).rotation().matrix()
    if not (R_WT[2, 2] > _LEVEL and R_WT[0, 0] > _LEVEL):
        raise ModelError(
            f"{model}: the axes of '{torso}' must be x forward, y left and z up in the world; turn "
            "the link or the model"
        )
    lowest = min(
        float((plant.EvalBodyPoseInWorld(plant_context, body) @ sole_corners(robot, body))[2].min())
        for body in (plant.GetBodyByName(name) for name in feet)
    )
    if not abs(lowest) <= _HIGHEST_START:
        raise ModelError(
            f"{model}: its soles must be within {1e3 * _HIGHEST_START:g} mm of the ground, z = 0, "
            f"got {1e3 * lowest:.4g} mm; move the model by its <pose>"
        )

    _check_feet(robot, plant_context, model)
    _check_signs(robot, plant_context, model)


def _check_feet(robot: Robot, plant_context: Context, model: RobotModel) -> None:
    """Refuse feet of which one is up, tilted, or on the other's side."""
    plant = robot.plant
    sides = {}
    for leg in model.robot.legs:
        bodies = [plant.GetBodyByName(name) for name in leg.plates]
        corners = [
            plant.EvalBodyPoseInWorld(plant_context, body) @ sole_corners(robot, body)
            for body in bodies
        ]
        lowest = float(min(one[2].min() for one in corners))
        if not lowest <= _HIGHEST_START:
            raise ModelError(
                f"{model}: the foot '{leg.foot}' is {1e3 * lowest:.4g} mm above the ground while "
                "the other one stands; bend both legs alike in the standing pose"
            )
        sides[leg.foot] = float(np.hstack(corners)[1].mean())
    for plate in plates(plant, robot.scene_graph, model.robot):
        X_WL = plant.EvalBodyPoseInWorld(plant_context, plant.GetBodyByName(plate.link))
        cosine = float((X_WL @ plate.X_LP).rotation().matrix()[2, 2])
        if not cosine > _LEVEL:
            tilt = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
            raise ModelError(
                f"{model}: the sole of '{plate.link}' is tilted by {tilt:.1f} degrees in the "
                "standing pose; change the angles of standing_deg until it is level"
            )
    (right, right_y), (left, left_y) = sides.items()
    if not right_y < left_y:
        raise ModelError(
            f"{model}: the right foot '{right}' is to the left of the left one '{left}'; exchange "
            "[right] and [left] of the robot's file, or let the model's y axis point left"
        )


_AXES: dict[str, tuple[FloatArray, str]] = {
    "hip_roll": (np.array([1.0, 0.0, 0.0]), "moves the foot to the left"),
    "hip_pitch": (np.array([0.0, -1.0, 0.0]), "moves the foot forward"),
    "knee": (np.array([0.0, 1.0, 0.0]), "moves the foot backward"),
    "ankle_pitch": (np.array([0.0, -1.0, 0.0]), "lifts the toes"),
    "ankle_roll": (np.array([-1.0, 0.0, 0.0]), "lowers the left edge of the sole"),
}
"""Axis of each role of the KHR-3HV in the world, and what a positive angle does."""
_ALIKE = np.cos(np.radians(45.0))


def _check_signs(robot: Robot, plant_context: Context, model: RobotModel) -> None:
    """Refuse joints that turn about another axis than their role, or the other way round."""
    for side, leg in zip(SIDES, model.robot.legs, strict=True):
        for role, name, sign in zip(ROLES, leg.joints, leg.signs, strict=True):
            if name is None:
                continue
            joint = cast(RevoluteJoint, robot.plant.GetJointByName(name))
            R_WF = joint.frame_on_parent().CalcPoseInWorld(plant_context).rotation()
            axis, does = _AXES[role]
            along = sign * float(axis @ (R_WF @ joint.revolute_axis()))
            if abs(along) < _ALIKE:
                raise ModelError(
                    f"{model}: joint '{name}' is the {role} of the {side} leg and turns about "
                    f"another axis, {np.round(R_WF @ joint.revolute_axis(), 2).tolist()} in the "
                    f"world; name the joint that {does}"
                )
            if along < 0.0:
                raise ModelError(
                    f"{model}: joint '{name}' is the {role} of the {side} leg, where a positive "
                    f"angle {does}, and does the opposite; give it sign = {-sign}"
                )


@lru_cache(maxsize=8)
def check_toes(model: RobotModel) -> None:
    """Refuse a robot whose feet do not become what a foot design says.

    Raises:
        ModelError: a foot of another design has another outline, or toes of another size.
    """
    outline = model.robot.outline
    if outline is None:
        return
    before = _extents(build_robot(PlantConfig(model=model, foot=None, sole=Sole.BOXES)))
    after = _extents(build_robot(PlantConfig(model=model, foot=_PROBE, sole=Sole.BOXES)))
    for leg, inward in zip(model.robot.legs, (1.0, -1.0), strict=True):
        was, now = ([found[link] for link in leg.plates] for found in (before, after))
        heel, big, *lesser = now
        gaps = [(big[0] - one[1])[1] if inward > 0.0 else (one[0] - big[1])[1] for one in lesser]
        width = _PROBE.big_toe_width if lesser else outline.width
        fits = (
            np.allclose(_around(was), _around(now), rtol=0.0, atol=_SAME)
            and np.allclose([toe[1][0] - toe[0][0] for toe in (big, *lesser)], _PROBE.toe_length)
            and np.allclose(big[1][1] - big[0][1], width)
            and all(abs(gap - outline.gap) < _SAME for gap in gaps)
            and max(abs(toe[0][0] - heel[1][0]) for toe in now[1:]) < 0.5 * outline.gap + _SAME
        )
        if not fits:
            raise ModelError(
                f"{model}: {leg.foot} with its toes cannot be given another design; their boxes "
                "must lie along x and y, the big toe inside, and each toe's link at its hinge, as "
                "in khr3hv.sdf"
            )


def _extents(robot: Robot) -> dict[str, Extent]:
    """Return the extent of each foot link's boxes in the world, as the file puts them."""
    plant = robot.plant
    context = plant.CreateDefaultContext()
    found = {}
    for name in robot.model.robot.plates:
        body = plant.GetBodyByName(name)
        corners = plant.EvalBodyPoseInWorld(context, body) @ sole_corners(robot, body)
        found[name] = corners.min(axis=1), corners.max(axis=1)
    return found


def _around(extents: list[Extent]) -> FloatArray:
    """The extent of all of them, shape (2, 3)."""
    around: FloatArray = np.array(
        [np.min([low for low, _ in extents], axis=0), np.max([high for _, high in extents], axis=0)]
    )
    return around
