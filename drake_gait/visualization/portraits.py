"""Pictures of the robot in a walk, for print."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    Mesh,
    Rgba,
    Role,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull, QhullError

from drake_gait.errors import ModelError, SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import FloatArray
from drake_gait.problem import Candidate
from drake_gait.robot.description import Model
from drake_gait.simulation.messages import drake_messages, without_folders
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.visualization.rasterizer import (
    FROM_AHEAD,
    FROM_THE_RIGHT,
    Direction,
    Picture,
    render,
)
from drake_gait.walk import DEFAULT_MODEL, History

_ROUND = 32  # sides of a drawn cylinder
_UNPAINTED = Rgba(0.7, 0.7, 0.7)
_POINTS = 200  # of a drawn ball


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """One visible shape of a link."""

    link: Any
    triangles: FloatArray
    """Corners in the link's frame [m], shape (n, 3, 3), counter-clockwise from outside."""
    colour: FloatArray
    """Red, green, blue, 0 to 1, shape (3,)."""


def pictures(
    history: History,
    frames: Sequence[int],
    candidate: Candidate,
    *,
    model: Model = DEFAULT_MODEL,
    towards: Direction = FROM_THE_RIGHT,
) -> list[Picture]:
    """The robot at some frames of a walk.

    Args:
        history: The walk.
        frames: Which of its frames.
        candidate: What walked; its foot gives the toes their width.
        model: The robot description that walked.
        towards: Direction from the robot to who looks at it; not along z.

    Raises:
        SettingsError: another robot walked this walk, or the direction is vertical.
    """
    return [
        render(corners, colours, towards)
        for corners, colours in _solids(history, frames, candidate, model)
    ]


def chronophotograph(
    history: History,
    frames: Sequence[int],
    candidate: Candidate,
    *,
    model: Model = DEFAULT_MODEL,
    towards: Direction = FROM_AHEAD,
) -> Picture:
    """The robot at some frames of a walk, in one picture, as Marey photographed walkers.

    Takes what `pictures` takes, and raises what it raises.
    """
    solids = [
        (part, colour)
        for corners, colours in _solids(history, frames, candidate, model)
        for part, colour in zip(corners, colours, strict=True)
    ]
    return render([part for part, _ in solids], [colour for _, colour in solids], towards)


def _solids(
    history: History, frames: Sequence[int], candidate: Candidate, model: Model
) -> Iterator[tuple[list[FloatArray], list[FloatArray]]]:
    """Triangles (n, 3, 3) [m] in the world, and colours, of every part at every frame."""
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(builder, PlantConfig(model=model, foot=candidate.foot))
    if history.positions.shape[1] != plant.num_positions():
        raise SettingsError(
            f"the walk has {history.positions.shape[1]} positions, the robot {model} has "
            f"{plant.num_positions()}; give the model that walked"
        )
    parts = list(_parts(plant, scene_graph.model_inspector()))
    context = plant.CreateDefaultContext()
    for frame in frames:
        plant.SetPositions(context, history.positions[frame])
        corners = []
        for part in parts:
            X_WL = plant.EvalBodyPoseInWorld(context, part.link)
            p_WC = part.triangles @ X_WL.rotation().matrix().T + X_WL.translation()
            corners.append(p_WC)
        yield corners, [part.colour for part in parts]


def _parts(plant: MultibodyPlant, inspector: SceneGraphInspector) -> Iterator[_Part]:
    """What is seen of the robot; shapes of other kinds than box and cylinder as their hulls."""
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        shape = inspector.GetShape(geometry)
        if isinstance(shape, Box):
            triangles = _prism([(-1, -1), (1, -1), (1, 1), (-1, 1)], 1.0) * (
                np.asarray(shape.size()) / 2.0
            )
        elif isinstance(shape, Cylinder):
            angle = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
            outline = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            radius, half = shape.radius(), shape.length() / 2.0
            triangles = _prism(outline, 1.0) * (radius, radius, half)
        else:
            triangles = _hull(shape)
        X_LG = inspector.GetPoseInFrame(geometry)
        properties: Any = inspector.GetIllustrationProperties(geometry)
        painted = properties.HasProperty("phong", "diffuse")
        rgba = properties.GetProperty("phong", "diffuse") if painted else _UNPAINTED
        yield _Part(
            link=plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)),
            triangles=triangles @ X_LG.rotation().matrix().T + X_LG.translation(),
            colour=np.array([rgba.r(), rgba.g(), rgba.b()]),
        )


def check_looks(model: Model, foot: FootDesign) -> None:
    """Refuse a robot whose shapes cannot be shown.

    Raises:
        ModelError: it has one.
    """
    plant, scene_graph = add_robot(DiagramBuilder(), PlantConfig(model=model, foot=foot))
    with drake_messages() as messages:
        try:
            shown = list(_parts(plant, scene_graph.model_inspector()))
        except RuntimeError as error:
            messages.append(str(error).strip().splitlines()[0])
    if messages:
        complaint = without_folders(messages[0])
        raise ModelError(f"{model}: a shape of it cannot be shown: {complaint}; mend its mesh")
    if not any(len(part.triangles) for part in shown):
        raise ModelError(f"{model}: nothing of it can be seen; give its links a <visual>")


def _hull(shape: Any) -> FloatArray:
    """Triangles of a shape's convex hull, shape (n, 3, 3), counter-clockwise from outside."""
    # Points all over a ball, evenly: Fibonacci's spiral.
    number = np.arange(_POINTS) + 0.5
    height, turn = 1.0 - 2.0 * number / _POINTS, np.pi * (1.0 + 5.0**0.5) * number
    ring = np.sqrt(1.0 - height**2)
    ball = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
    if isinstance(shape, Mesh | Convex):
        mesh = shape.GetConvexHull()
        points = np.array([mesh.vertex(index) for index in range(mesh.num_vertices())])
    elif isinstance(shape, Sphere):
        points = shape.radius() * ball
    elif isinstance(shape, Ellipsoid):
        points = ball * (shape.a(), shape.b(), shape.c())
    elif isinstance(shape, Capsule):
        end = np.array([0.0, 0.0, shape.length() / 2.0])
        points = np.concatenate([shape.radius() * ball + end, shape.radius() * ball - end])
    else:
        return np.zeros((0, 3, 3))
    try:
        hull = ConvexHull(points)
    except QhullError:
        return np.zeros((0, 3, 3))  # It is flat.
    triangles: FloatArray = points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inside_out = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    triangles[inside_out] = triangles[inside_out][:, ::-1]
    return triangles


def _prism(outline: Any, half_height: float) -> FloatArray:
    """Triangles of an upright prism, shape (4 n - 4, 3, 3), outline (n, 2) counter-clockwise."""
    ring = np.asarray(outline, dtype=float)
    low = np.column_stack([ring, np.full(len(ring), -half_height)])
    high = np.column_stack([ring, np.full(len(ring), half_height)])
    low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    sides = [np.stack([low, low_next, high], 1), np.stack([low_next, high_next, high], 1)]
    fan = np.arange(1, len(ring) - 1)
    first = np.zeros_like(fan)
    lids = [high[np.stack([first, fan, fan + 1], 1)], low[np.stack([first, fan + 1, fan], 1)]]
    return np.concatenate([*sides, *lids])
