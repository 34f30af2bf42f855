"""Walks as one web page: robots in three dimensions, replayed by Meshcat.

The page needs no network and no server. It plays in a loop, in real time; `walk.html#t=1.5` opens
it at rest at 1.5 s.
"""

import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation
from pydrake.math import RigidTransform

from drake_gait.errors import SettingsError
from drake_gait.files.destination import write
from drake_gait.gait import FRAME_TIME
from drake_gait.problem import Candidate
from drake_gait.robot.description import Model
from drake_gait.visualization import palette
from drake_gait.visualization.meshcat import (
    Shown,
    animate_ground_reaction,
    animate_robot,
    draw_floor,
    draw_paths,
    floor_extent,
    place_camera,
    set_lights,
    with_meshcat,
)
from drake_gait.walk import DEFAULT_MODEL, History, Walk

_GALLERY_VIEW = (0.55, -1.0, 0.75)  # higher, so that no robot hides the one behind it


@dataclass(frozen=True, kw_only=True, eq=False)
class Exhibit:
    """One walk of a gallery."""

    walk: Walk
    """A walk with its history."""
    candidate: Candidate
    """What walked."""
    label: str
    """What is written beside it."""
    model: Model = DEFAULT_MODEL
    """The robot description that walked."""


def record(
    walk: Walk,
    candidate: Candidate,
    path: str | Path,
    *,
    model: Model = DEFAULT_MODEL,
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
    history = _history(walk)

    def draw(meshcat: Meshcat) -> str:
        _begin(meshcat)
        (seen,) = _show(meshcat, [(history, candidate, model, "")])
        lower, upper = floor_extent(history)
        place_camera(meshcat, [*lower, 0.0], [*upper, seen.height])
        return _page(meshcat, caption or "A walk", [], seen.force_scale)

    _write(with_meshcat(draw), Path(path))


def record_gallery(exhibits: Sequence[Exhibit], path: str | Path, *, caption: str = "") -> None:
    """Write several walks as one page, side by side and at the same time.

    The first one is the nearest; all start at one line.

    Args:
        exhibits: The walks.
        path: The file to write.
        caption: One line of text for the page.

    Raises:
        SettingsError: there is none, one has no history, or another robot walked it.
        GaitError: no port is free for Meshcat, or the file cannot be written.
    """
    if not exhibits:
        raise SettingsError("a gallery needs at least one walk")
    histories = [_history(exhibit.walk) for exhibit in exhibits]

    def draw(meshcat: Meshcat) -> str:
        return _gallery(meshcat, exhibits, histories, caption or "Walks side by side")

    _write(with_meshcat(draw), Path(path))


def _gallery(
    meshcat: Meshcat, exhibits: Sequence[Exhibit], histories: Sequence[History], caption: str
) -> str:
    """Draw walks side by side; returns their page."""
    _begin(meshcat)
    labels: list[dict[str, Any]] = []
    walks = [
        (history, exhibit.candidate, exhibit.model, f"walk {number}/")
        for number, (exhibit, history) in enumerate(zip(exhibits, histories, strict=True))
    ]
    seen = _show(meshcat, walks)
    near, corners = 0.0, []
    for number, (exhibit, history) in enumerate(zip(exhibits, histories, strict=True)):
        lane = f"walk {number}"
        lower, upper = floor_extent(history)
        offset: Any = np.array([-history.com[0, 0], near - lower[1], 0.0])
        meshcat.SetTransform(lane, RigidTransform(offset))
        lower, upper = lower + offset[:2], upper + offset[:2]
        middle = (lower[1] + upper[1]) / 2.0
        labels.append({"text": exhibit.label, "at": [float(upper[0]), float(middle), 0.0]})
        corners += [lower, upper]
        near = float(upper[1])
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    place_camera(meshcat, [*low, 0.0], [*high, max(one.height for one in seen)], _GALLERY_VIEW)
    return _page(meshcat, caption, labels, min(one.force_scale for one in seen))


def _history(walk: Walk) -> History:
    if walk.history is None:
        raise SettingsError("this walk has no history to record; simulate(candidate, history=True)")
    return walk.history


def _begin(meshcat: Meshcat) -> None:
    meshcat.StartRecording(frames_per_second=1.0 / FRAME_TIME)
    set_lights(meshcat)


def _show(meshcat: Meshcat, walks: Sequence[tuple[History, Candidate, Model, str]]) -> list[Shown]:
    """Put walks into the scene, everything of each below its prefix; forces have one scale."""
    found = []
    for history, candidate, model, prefix in walks:
        draw_floor(meshcat, history, prefix)
        draw_paths(meshcat, history, prefix)
        found.append(animate_robot(meshcat, history, candidate, model, prefix))
    scale = min(one.force_scale for one in found)
    for history, _, _, prefix in walks:
        animate_ground_reaction(meshcat, history, prefix, scale=scale)
    return found


def _page(meshcat: Meshcat, caption: str, labels: Sequence[dict[str, Any]], scale: float) -> str:
    animation = meshcat.get_mutable_recording()
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(1_000_000)
    meshcat.PublishRecording()
    return _with_panel(meshcat.StaticHtml(), caption, labels, scale)


def _write(page: str, path: Path) -> None:
    write(path, page.encode("utf-8", "replace"), what="the recording ")


def _with_panel(page: str, caption: str, labels: Sequence[dict[str, Any]], scale: float) -> str:
    """Add title, caption, legend, labels, pause button and time slider to Meshcat's page.

    In a browser that cannot draw it, the page is one sentence.
    """
    title = html.escape(caption)
    panel = (files("drake_gait.visualization") / "recording_panel.html").read_text(encoding="utf-8")
    # No label can end the script that holds it.
    listed = json.dumps(labels).replace("<", "\\u003c")
    texts = {"scale": f"{1e3 * scale:g}", "labels": listed}
    colours = ("COM", "RIGHT", "LEFT", "START", "FINISH", "INK", "FOCUS", "WARNING", "WHITE")
    texts |= {"caption": title, **{name: getattr(palette, name) for name in colours}}
    panel = re.sub("@([a-zA-Z]+)@", lambda named: texts[named[1]], panel)
    guard = (files("drake_gait.visualization") / "recording_guard.html").read_text(encoding="utf-8")
    head = f'<title>{title}</title>\n<link rel="icon" href="data:,">'  # A server has no other.
    page = page.replace("<title>Drake MeshCat</title>", head, 1)
    page = page.replace("<body>", f"<body>\n{guard}", 1)
    before, closing, after = page.rpartition("</body>")
    return before + panel + closing + after
