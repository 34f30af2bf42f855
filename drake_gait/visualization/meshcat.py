"""Scene of a walk in Meshcat: robot, floor, paths, ground reaction, light, camera."""

import ctypes
import gc
import itertools
import logging
import sys
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import (
    Box,
    Cylinder,
    Meshcat,
    MeshcatCone,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import FRAME_TIME, FloatArray
from drake_gait.problem import Candidate
from drake_gait.robot.description import Model, read_model
from drake_gait.simulation.collision import box_corners
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import add_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.visualization.palette import (
    COARSE_LINE,
    COM,
    FINE_LINE,
    FINISH,
    FLOOR,
    LEFT,
    RIGHT,
    SKY_ABOVE,
    SKY_BELOW,
    START,
    rgb,
)
from drake_gait.walk import History

_WEIGHT = 0.147
"""Length of a ground reaction arrow that is the robot's weight [m]."""
_OVERHEAD = 0.009
"""What is shown above the robot [m]."""

_COM, _RIGHT, _LEFT = (Rgba(*rgb(colour)) for colour in (COM, RIGHT, LEFT))
_FLOOR, _FINE_LINE, _COARSE_LINE = (
    Rgba(*rgb(colour)) for colour in (FLOOR, FINE_LINE, COARSE_LINE)
)
_START, _FINISH = Rgba(*rgb(START)), Rgba(*rgb(FINISH))

_FIELD_OF_VIEW = np.radians(24.0)  # narrow: little perspective, so that lengths can be compared
VIEW = (0.62, -1.0, 0.42)
"""Direction of the camera: from the robot's right, ahead and above."""
_ASPECT = 1.5  # width over height of a page, at least; a narrower one shows all of it smaller
_FILLED, _PANEL = 0.94, 0.22  # parts of half the picture: filled by the walk, hidden by the panel
_MARGIN = 0.10  # room round the walk: the feet reach 80 mm beyond the ankles [m]
_TILE = 0.1  # the floor is laid in squares of the coarse grid [m]
_PATH_RADIUS = 0.0012
_ARROW_RADIUS, _ARROW_HEAD = 0.0030, 0.018
_ARROW_OFFSET = 0.055  # outwards from the ankle, or the leg would hide it [m]


_Result = TypeVar("_Result")
_log_level = threading.Lock()
_shown = threading.local()
"""Diagrams that this thread draws in a Meshcat."""
_PATIENCE = 5.0
"""How long a Meshcat waits for its diagrams to end, before it is left to the process's end [s]."""


def with_meshcat(work: Callable[[Meshcat], _Result], port: int | None = None) -> _Result:
    """Call a function with a Meshcat that begins and ends here; returns what it returns.

    Drake ends the whole process where a Meshcat is used or destroyed in another thread than the
    one that made it. Diagrams that draw in it belong to cycles, which Python collects later, in
    whichever thread it likes. So all that the function made is collected before this returns.

    Args:
        work: Takes the Meshcat, and keeps nothing that refers to it.
        port: As for `start_meshcat`.

    Raises:
        GaitError: the port, or every one of them, is taken.
    """
    meshcat = start_meshcat(port)
    outer, _shown.diagrams = getattr(_shown, "diagrams", None), []
    try:
        return work(meshcat)
    except BaseException as error:
        _clear_frames(error)
        raise
    finally:
        if _ended(_shown.diagrams) and sys.getrefcount(meshcat) <= _OURS:
            ctypes.pythonapi.Py_DecRef(ctypes.py_object(meshcat))
        _shown.diagrams = outer
        del meshcat


def start_meshcat(port: int | None = None) -> Meshcat:
    """A Meshcat on a port, or on the first free one from 7000 on; use it in this thread only.

    It lasts until the process ends, as no thread but this one could destroy it; `with_meshcat` has
    one that ends.

    Raises:
        GaitError: the port, or every one of them, is taken.
    """
    log = logging.getLogger("drake")
    try:
        with _log_level:
            level = log.level
            log.setLevel(logging.WARNING)  # Or it invites to an empty page.
            try:
                meshcat = Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))
            finally:
                log.setLevel(level)
    except RuntimeError as error:
        if port is not None:
            raise GaitError(
                f"port {port} is taken; give another --port, or none for the first free one"
            ) from None
        first_line = str(error).strip().splitlines()[0]
        raise GaitError(
            f"Meshcat found no free port from 7000 to 7999 for a recording: {first_line}"
        ) from None
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(meshcat))
    return meshcat


def draws(diagram: Diagram) -> Diagram:
    """Note that a diagram draws in a Meshcat of this thread, which must outlive it."""
    diagrams = getattr(_shown, "diagrams", None)
    if diagrams is not None:
        diagrams.append(weakref.ref(diagram))
    return diagram


_OURS = 3
"""References to a Meshcat of `with_meshcat`: its own, the lasting one, and that of who counts."""


def _ended(diagrams: Sequence["weakref.ref[Diagram]"]) -> bool:
    """Collect diagrams; whether none is left."""
    deadline = time.monotonic() + _PATIENCE
    gc.collect()
    while any(diagram() is not None for diagram in diagrams):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)  # Another thread may be collecting.
        gc.collect()
    return True


def _clear_frames(error: BaseException | None) -> None:
    """Have an error, and those behind it, hold no variables of the functions that it ended."""
    while error is not None:
        traceback.clear_frames(error.__traceback__)
        error = error.__cause__ or error.__context__


def instant(frame: int) -> float:
    """A time inside a frame [s]; on its edge, rounding would give some the frame before."""
    return (frame + 0.5) * FRAME_TIME


def _vector(values: ArrayLike) -> Any:
    """An array as Drake takes it; its type information has no name for one."""
    return np.asarray(values, dtype=float)


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A robot that is shown."""

    height: float
    """Height that is to be seen above the floor [m]."""
    force_scale: float
    """Length of a ground reaction arrow [m/N], in two digits."""


def shown(plant: MultibodyPlant, scene_graph: SceneGraph, model: Model) -> Shown:
    """Return how large a robot is."""
    context, torso = plant.CreateDefaultContext(), read_model(model).robot.torso
    instance = plant.GetBodyByName(torso).model_instance()
    highest = 0.0
    for index in plant.GetBodyIndices(instance):
        body = plant.get_body(index)
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        highest = max(highest, float(X_WB.translation()[2]))
        for corners in box_corners(plant, scene_graph, body).values():
            highest = max(highest, float((X_WB @ corners)[2].max()))
    weight = plant.CalcTotalMass(context) * np.abs(plant.gravity_field().gravity_vector()[2])
    return Shown(height=highest + _OVERHEAD, force_scale=float(f"{_WEIGHT / weight:.2g}"))


def animate_robot(
    meshcat: Meshcat,
    history: History,
    candidate: Candidate,
    model: Model,
    prefix: str = "",
) -> Shown:
    """Pose the links at every frame; returns how large the robot is.

    Raises:
        SettingsError: another robot walked this walk.
    """
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(builder, PlantConfig(model=model, foot=candidate.foot))
    _check_positions(history, plant, model)
    MeshcatVisualizer.AddToBuilder(
        builder,
        scene_graph,
        meshcat,
        MeshcatVisualizerParams(prefix=f"{prefix}robot", publish_period=FRAME_TIME),
    )
    diagram = draws(builder.Build())
    context = default_context(diagram)
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for frame, positions in enumerate(history.positions):
        context.SetTime(instant(frame))
        plant.SetPositions(plant_context, positions)
        diagram.ForcedPublish(context)
    return shown(plant, scene_graph, model)


def _check_positions(history: History, plant: MultibodyPlant, model: Model) -> None:
    if history.positions.shape[1] != plant.num_positions():
        raise SettingsError(
            f"the walk has {history.positions.shape[1]} positions, the robot {model} has "
            f"{plant.num_positions()}; give the model that walked"
        )


def animate_ground_reaction(
    meshcat: Meshcat, history: History, prefix: str = "", *, scale: float = 0.01
) -> None:
    """One arrow a foot, beside the ankle, along the force and `scale` long [m/N]."""
    for foot, (side, colour, outwards) in enumerate(
        (("right", _RIGHT, -_ARROW_OFFSET), ("left", _LEFT, _ARROW_OFFSET))
    ):
        arrow = f"{prefix}ground reaction/{side}"
        shaft, head = f"{arrow}/shaft", f"{arrow}/head"
        meshcat.SetObject(f"{shaft}/cylinder", Cylinder(_ARROW_RADIUS, 1.0), colour)
        meshcat.SetTransform(f"{shaft}/cylinder", RigidTransform(_vector([0.0, 0.0, 0.5])))
        width = 2.5 * _ARROW_RADIUS
        meshcat.SetObject(f"{head}/cone", MeshcatCone(_ARROW_HEAD, width, width), colour)
        upside_down = RotationMatrix.MakeXRotation(np.pi)
        meshcat.SetTransform(f"{head}/cone", RigidTransform(upside_down))
        for frame, force in enumerate(history.ground_reaction[:, foot]):
            length = scale * float(np.linalg.norm(force))
            # A foot in the air has no arrow; an object cannot be scaled to nothing.
            head_scale = max(min(1.0, length / (2.0 * _ARROW_HEAD)), 1e-3)
            direction = force if length > 1e-6 else np.array([0.0, 0.0, 1.0])
            p_WA = history.ankles[frame, foot] * (1.0, 1.0, 0.0) + (0.0, outwards, 0.0)
            R_WA = RotationMatrix.MakeFromOneVector(_vector(direction), 2)
            # The head is placed in the arrow's frame, or it would leave the shaft between frames.
            time, shaft_length = instant(frame), max(length - head_scale * _ARROW_HEAD, 1e-6)
            meshcat.SetTransform(arrow, RigidTransform(R_WA, p_WA), time)
            meshcat.SetProperty(shaft, "scale", [head_scale, head_scale, shaft_length], time)
            meshcat.SetTransform(head, RigidTransform(_vector([0.0, 0.0, length])), time)
            meshcat.SetProperty(head, "scale", [head_scale] * 3, time)


def floor_extent(history: History) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest x and y of a walk's floor [m], shape (2,) each.

    Whole tenths of a metre from the start of the centre of mass, with room for the feet.
    """
    tracks = np.vstack([history.com, history.ankles[:, 0], history.ankles[:, 1]])[:, :2]
    origin = np.array([history.com[0, 0], 0.0])
    lower = np.floor((tracks.min(axis=0) - _MARGIN - origin) / _TILE + 0.5)
    upper = np.ceil((tracks.max(axis=0) + _MARGIN - origin) / _TILE - 0.5)
    return _TILE * lower + origin, _TILE * upper + origin


def draw_floor(meshcat: Meshcat, history: History, prefix: str = "") -> None:
    """The ground of a walk, with its start and finish lines."""
    lower, upper = floor_extent(history)
    draw_ground(meshcat, lower, upper, prefix)
    for name, x, colour in (
        ("start", history.com[0, 0], _START),
        ("finish", history.com[-1, 0], _FINISH),
    ):
        line = f"{prefix}floor/{name}"
        meshcat.SetObject(line, Box(0.003, upper[1] - lower[1], 0.0004), colour)
        p_WF = [x, (upper[1] + lower[1]) / 2.0, 0.0002]
        meshcat.SetTransform(line, RigidTransform(_vector(p_WF)))


def draw_ground(meshcat: Meshcat, lower: FloatArray, upper: FloatArray, prefix: str = "") -> None:
    """A slab with lines every 10 and 100 mm, from x, y (2,) to x, y (2,) [m]."""
    size, centre = upper - lower, (upper + lower) / 2.0
    meshcat.SetObject(f"{prefix}floor/slab", Box(size[0], size[1], 0.004), _FLOOR)
    X_WS = RigidTransform(_vector([*centre, -0.0023]))
    meshcat.SetTransform(f"{prefix}floor/slab", X_WS)
    for name, spacing, height, colour in (
        ("10 mm", 0.01, 0.0000, _FINE_LINE),
        ("100 mm", 0.1, 0.0002, _COARSE_LINE),
    ):
        begin, end = _grid(lower, upper, spacing, height)
        line = f"{prefix}floor/{name}"
        meshcat.SetLineSegments(line, _vector(begin), _vector(end), 1.0, colour)


def _grid(
    lower: FloatArray, upper: FloatArray, spacing: float, height: float
) -> tuple[FloatArray, FloatArray]:
    """First and last points [m], shape (3, n) each, of lines over a rectangle."""
    xs, ys = (
        np.linspace(low, high, round((high - low) / spacing) + 1)
        for low, high in zip(lower, upper, strict=True)
    )
    across_x = [[(x, y, height) for x in xs] for y in (lower[1], upper[1])]
    across_y = [[(x, y, height) for y in ys] for x in (lower[0], upper[0])]
    begin, end = (
        np.array(first + second).T for first, second in zip(across_x, across_y, strict=True)
    )
    return begin, end


def draw_paths(meshcat: Meshcat, history: History, prefix: str = "") -> None:
    """Centre of mass, its trace on the floor, and the ankles."""
    trace = history.com * (1.0, 1.0, 0.0) + (0.0, 0.0, 0.0006)
    for name, points, colour in (
        ("centre of mass", history.com, _COM),
        ("centre of mass on the floor", trace, _COM),
        ("right ankle", history.ankles[:, 0], _RIGHT),
        ("left ankle", history.ankles[:, 1], _LEFT),
    ):
        vertices, faces = _tube(points, _PATH_RADIUS)
        meshcat.SetTriangleMesh(f"{prefix}paths/{name}", vertices, faces, colour)


def _tube(points: FloatArray, radius: float) -> tuple[Any, Any]:
    """A square tube along points (n, 3): browsers draw a line one pixel wide, whatever is asked.

    Returns:
        Vertices [m], shape (3, 4 n), and triangles of vertex indices, shape (3, m).
    """
    forward = np.gradient(points, axis=0)
    forward[:, 0] += 1e-9  # a robot at rest has no direction
    left = np.cross((0.0, 0.0, 1.0), forward)
    up = np.cross(forward, left)
    left, up = (
        radius * side / (np.linalg.norm(side, axis=1, keepdims=True) + 1e-12) for side in (left, up)
    )
    corners = np.stack([points + side for side in (left, up, -left, -up)], axis=1)
    here = 4 * np.arange(len(points) - 1)[:, None] + np.arange(4)
    beside = 4 * np.arange(len(points) - 1)[:, None] + (np.arange(4) + 1) % 4
    triangles = [[here, beside, here + 4], [beside, beside + 4, here + 4]]
    faces = np.moveaxis(np.array(triangles, dtype=np.int32), 1, 0).reshape(3, -1)
    return np.asfortranarray(corners.reshape(-1, 3).T), np.asfortranarray(faces)


def place_camera(
    meshcat: Meshcat,
    lower: Sequence[float],
    upper: Sequence[float],
    view: Sequence[float] = VIEW,
) -> None:
    """Put the camera where it sees all of a box above the panel, as near as it can be.

    Args:
        meshcat: The scene.
        lower: Smallest x, y, z of what is to be seen [m].
        upper: The largest.
        view: Direction from what is seen to the camera.
    """
    axes = _axes_of_view(np.asarray(view, dtype=float))
    corners = np.array(list(itertools.product(*zip(lower, upper, strict=True))))
    centre = corners.mean(axis=0)
    right, up, front = axes @ (corners - centre).T
    half = np.tan(_FIELD_OF_VIEW / 2.0)
    across = front + np.abs(right) / (half * _ASPECT * _FILLED)
    # How far the camera is lifted decides how far it must be away: the panel covers the bottom.
    lifts = np.linspace(2.0 * up.min(), 2.0 * up.max(), 201)
    away = [
        max(
            across.max(),
            (front + (up - lift) / (half * _FILLED)).max(),
            (front + (lift - up) / (half * (_FILLED - _PANEL))).max(),
        )
        for lift in lifts
    ]
    best = int(np.argmin(away))
    target = centre + lifts[best] * axes[1]
    meshcat.SetProperty(
        "/Cameras/default/rotated/<object>", "fov", float(np.degrees(_FIELD_OF_VIEW))
    )
    meshcat.SetCameraPose(_vector(target + away[best] * axes[2]), _vector(target))


def _axes_of_view(view: FloatArray) -> FloatArray:
    """Right, up and towards the camera, as rows."""
    right = np.cross((0.0, 0.0, 1.0), view)
    rows = (right, np.cross(view, right), view)
    return np.array([row / np.linalg.norm(row) for row in rows])


def set_lights(meshcat: Meshcat) -> None:
    """One lamp from above that casts shadows, soft light around, and a sky."""
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", list(rgb(SKY_ABOVE)))
    meshcat.SetProperty("/Background/<object>", "bottom_color", list(rgb(SKY_BELOW)))
    meshcat.SetProperty("/Lights/SpotLight", "visible", True)
    meshcat.SetProperty("/Lights/SpotLight/<object>", "castShadow", True)
    meshcat.SetProperty("/Lights/SpotLight/<object>", "position", [0.9, -1.1, 2.2])
    for light, quantity, value in (
        ("SpotLight", "intensity", 18.0),
        ("SpotLight", "angle", 0.35),
        ("SpotLight", "penumbra", 0.6),
        ("SpotLight", "shadow.mapSize.width", 2048.0),
        ("SpotLight", "shadow.mapSize.height", 2048.0),
        ("PointLightNegativeX", "intensity", 8.0),
        ("PointLightPositiveX", "intensity", 8.0),
        ("AmbientLight", "intensity", 0.9),
    ):
        meshcat.SetProperty(f"/Lights/{light}/<object>", quantity, value)
