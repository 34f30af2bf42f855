"""A walk as one web page: the robot in three dimensions, replayed by Meshcat.

The page needs no network and no server. It plays in a loop, in real time; `walk.html#t=1.5` opens
it at rest at 1.5 s.
"""

import html
import logging
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import (
    Box,
    Cylinder,
    Meshcat,
    MeshcatAnimation,
    MeshcatCone,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import FRAME_TIME, FloatArray
from drake_gait.problem import Candidate
from drake_gait.robot import add_robot
from drake_gait.servo import Servo
from drake_gait.walk import DEFAULT_MODEL, History, Walk

FORCE_SCALE = 0.010
"""Length of a ground reaction arrow [m/N]: the robot's weight is 147 mm long."""

# Okabe and Ito's palette, as in figures.py; right is blue and left is vermilion in both.
_COM, _RIGHT, _LEFT = Rgba(0.0, 0.62, 0.45), Rgba(0.0, 0.45, 0.70), Rgba(0.84, 0.37, 0.0)
_FLOOR, _FINE_LINE, _COARSE_LINE = (
    Rgba(0.80, 0.82, 0.84),
    Rgba(0.73, 0.75, 0.77),
    Rgba(0.52, 0.55, 0.6),
)
_START, _FINISH = Rgba(0.25, 0.27, 0.30), Rgba(0.80, 0.47, 0.65)

_FIELD_OF_VIEW = np.radians(24.0)  # narrow: little perspective, so that lengths can be compared
_VIEW: FloatArray = np.array([0.75, -1.0, 0.36])  # from the robot's right, ahead and above
_MARGIN = 0.10  # room round the walk: the feet reach 80 mm beyond the ankles [m]
_ROBOT_HEIGHT = 0.41
_PATH_RADIUS = 0.0012
_ARROW_RADIUS, _ARROW_HEAD = 0.0030, 0.018
_ARROW_OFFSET = 0.055  # outwards from the ankle, or the leg would hide it [m]


def record(
    walk: Walk,
    candidate: Candidate,
    path: Path,
    *,
    model: str | Path = DEFAULT_MODEL,
    caption: str = "",
) -> None:
    """Write a walk as one self-contained HTML page.

    Args:
        walk: A walk with its history: `simulate(candidate, history=True)`.
        candidate: What walked; its foot gives the toes their width.
        path: The file to write.
        model: The robot description that walked.
        caption: One line of text for the page.

    Raises:
        SettingsError: the walk has no history, or another robot walked it.
        GaitError: no port is free for Meshcat, or the file cannot be written.
    """
    if walk.history is None:
        raise SettingsError("this walk has no history to record; simulate(candidate, history=True)")
    meshcat = _start_meshcat()
    meshcat.StartRecording(frames_per_second=1.0 / FRAME_TIME)
    _draw_floor(meshcat, walk.history)
    _draw_paths(meshcat, walk.history)
    _place_camera_and_lights(meshcat, walk.history)
    _animate_robot(meshcat, walk.history, candidate, model)
    _animate_ground_reaction(meshcat, walk.history)
    animation = meshcat.get_mutable_recording()
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(1_000_000)
    meshcat.PublishRecording()
    page = _with_panel(meshcat.StaticHtml(), caption)
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise GaitError(f"cannot write the recording {path}: {error.strerror}") from None


def _start_meshcat() -> Meshcat:
    """A Meshcat on the first free port from 7000 on; nothing needs to connect to it."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)  # or it invites to an address where nothing is to be seen
    try:
        return Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    except RuntimeError as error:
        first_line = str(error).strip().splitlines()[0]
        raise GaitError(
            f"Meshcat found no free port from 7000 to 7999 for a recording: {first_line}"
        ) from None
    finally:
        log.setLevel(level)


def _instant(frame: int) -> float:
    """A time inside a frame [s]; on its edge, rounding would give some the frame before."""
    return (frame + 0.5) * FRAME_TIME


def _vector(values: ArrayLike) -> Any:
    """An array as Drake takes it; its type information has no name for one."""
    return np.asarray(values, dtype=float)


def _animate_robot(
    meshcat: Meshcat, history: History, candidate: Candidate, model: str | Path
) -> None:
    """Pose the links at every frame."""
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(builder, model, candidate.foot, Servo())
    _check_positions(history, plant, model)
    MeshcatVisualizer.AddToBuilder(
        builder,
        scene_graph,
        meshcat,
        MeshcatVisualizerParams(prefix="robot", publish_period=FRAME_TIME),
    )
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for frame, positions in enumerate(history.positions):
        context.SetTime(_instant(frame))
        plant.SetPositions(plant_context, positions)
        diagram.ForcedPublish(context)


def _check_positions(history: History, plant: MultibodyPlant, model: str | Path) -> None:
    if history.positions.shape[1] != plant.num_positions():
        raise SettingsError(
            f"the walk has {history.positions.shape[1]} positions, the robot {model} has "
            f"{plant.num_positions()}; give the model that walked"
        )


def _animate_ground_reaction(meshcat: Meshcat, history: History) -> None:
    """One arrow a foot, beside the ankle, along the force and FORCE_SCALE long."""
    for foot, (side, colour, outwards) in enumerate(
        (("right", _RIGHT, -_ARROW_OFFSET), ("left", _LEFT, _ARROW_OFFSET))
    ):
        shaft, head = f"ground reaction/{side}/shaft", f"ground reaction/{side}/head"
        meshcat.SetObject(f"{shaft}/cylinder", Cylinder(_ARROW_RADIUS, 1.0), colour)
        meshcat.SetTransform(f"{shaft}/cylinder", RigidTransform(_vector([0.0, 0.0, 0.5])))
        width = 2.5 * _ARROW_RADIUS
        meshcat.SetObject(f"{head}/cone", MeshcatCone(_ARROW_HEAD, width, width), colour)
        upside_down = RotationMatrix.MakeXRotation(np.pi)
        meshcat.SetTransform(f"{head}/cone", RigidTransform(upside_down))
        for frame, force in enumerate(history.ground_reaction[:, foot]):
            length = FORCE_SCALE * float(np.linalg.norm(force))
            # A foot in the air has no arrow; an object cannot be scaled to nothing.
            head_scale = max(min(1.0, length / (2.0 * _ARROW_HEAD)), 1e-3)
            direction = force if length > 1e-6 else np.array([0.0, 0.0, 1.0])
            p_WA = history.ankles[frame, foot] * (1.0, 1.0, 0.0) + (0.0, outwards, 0.0)
            R_WA = RotationMatrix.MakeFromOneVector(_vector(direction), 2)
            p_WH = p_WA + length * _vector(R_WA.col(2))
            time, shaft_length = _instant(frame), max(length - head_scale * _ARROW_HEAD, 1e-6)
            meshcat.SetTransform(shaft, RigidTransform(R_WA, p_WA), time)
            meshcat.SetProperty(shaft, "scale", [head_scale, head_scale, shaft_length], time)
            meshcat.SetTransform(head, RigidTransform(R_WA, p_WH), time)
            meshcat.SetProperty(head, "scale", [head_scale] * 3, time)


def _extent(history: History) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest x and y of the walk [m], shape (2,) each, with room for the feet."""
    tracks = np.vstack([history.com, history.ankles[:, 0], history.ankles[:, 1]])[:, :2]
    return tracks.min(axis=0) - _MARGIN, tracks.max(axis=0) + _MARGIN


def _draw_floor(meshcat: Meshcat, history: History) -> None:
    """A slab with lines every 10 and 100 mm from the start, and the start and finish lines."""
    origin = np.array([history.com[0, 0], 0.0])
    lower, upper = (np.round((edge - origin) / 0.1) for edge in _extent(history))
    lower, upper = 0.1 * lower - 0.1 + origin, 0.1 * upper + 0.1 + origin
    size, centre = upper - lower, (upper + lower) / 2.0
    meshcat.SetObject("floor/slab", Box(size[0], size[1], 0.004), _FLOOR)
    meshcat.SetTransform("floor/slab", RigidTransform(_vector([*centre, -0.0023])))
    for name, spacing, height, colour in (
        ("10 mm", 0.01, 0.0000, _FINE_LINE),
        ("100 mm", 0.1, 0.0002, _COARSE_LINE),
    ):
        begin, end = _grid(lower, upper, spacing, height)
        meshcat.SetLineSegments(f"floor/{name}", _vector(begin), _vector(end), 1.0, colour)
    for name, x, colour in (
        ("start", history.com[0, 0], _START),
        ("finish", history.com[-1, 0], _FINISH),
    ):
        meshcat.SetObject(f"floor/{name}", Box(0.003, size[1], 0.0004), colour)
        meshcat.SetTransform(f"floor/{name}", RigidTransform(_vector([x, centre[1], 0.0002])))


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


def _draw_paths(meshcat: Meshcat, history: History) -> None:
    """Centre of mass, its trace on the floor, and the ankles."""
    trace = history.com * (1.0, 1.0, 0.0) + (0.0, 0.0, 0.0006)
    for name, points, colour in (
        ("centre of mass", history.com, _COM),
        ("centre of mass on the floor", trace, _COM),
        ("right ankle", history.ankles[:, 0], _RIGHT),
        ("left ankle", history.ankles[:, 1], _LEFT),
    ):
        vertices, faces = _tube(points, _PATH_RADIUS)
        meshcat.SetTriangleMesh(f"paths/{name}", vertices, faces, colour)


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


def _place_camera_and_lights(meshcat: Meshcat, history: History) -> None:
    """Frame the whole walk; one lamp from above that casts shadows, and soft light around."""
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.80, 0.87, 0.93])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.97, 0.97, 0.96])
    lower, upper = _extent(history)
    target = np.array([*((lower + upper) / 2.0), 0.41 * _ROBOT_HEIGHT])
    # Half the diagonal of what is to be seen, as it appears from the side.
    reach = 0.5 * float(np.hypot(_ROBOT_HEIGHT, 0.6 * (upper - lower)[0]))
    distance = reach / np.tan(_FIELD_OF_VIEW / 2.0) + 0.15
    meshcat.SetProperty(
        "/Cameras/default/rotated/<object>", "fov", float(np.degrees(_FIELD_OF_VIEW))
    )
    meshcat.SetCameraPose(
        _vector(target + distance * _VIEW / np.linalg.norm(_VIEW)), _vector(target)
    )
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


def _with_panel(page: str, caption: str) -> str:
    """Add title, caption, legend, pause button and time slider to Meshcat's page."""
    title = html.escape(caption or "A walk")
    panel = (files("drake_gait") / "recording_panel.html").read_text(encoding="utf-8")
    panel = panel.replace("@scale@", f"{1e3 * FORCE_SCALE:g}").replace("@caption@", title)
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    before, closing, after = page.rpartition("</body>")
    return before + panel + closing + after
