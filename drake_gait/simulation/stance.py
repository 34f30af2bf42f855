"""A robot's stance, checked: where the soles are, and that a foot design fits them.

The axes of links and the places of their boxes may be written in many ways; what counts is where
Drake puts them.
"""

from functools import lru_cache

import numpy as np
from pydrake.systems.framework import Context

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FloatArray
from drake_gait.robot.description import RobotModel
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
