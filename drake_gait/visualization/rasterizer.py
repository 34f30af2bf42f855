"""Draws solids without a graphics card: triangles with a depth buffer, shaded by one lamp.

Orthographic, with ink along the edges of every part. Figures measure in millimetres, which only a
view without perspective allows; and a machine that computes has often no graphics driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray

Direction = tuple[float, float, float]
"""From what is drawn to who looks at it, in the world's axes; not along z."""

FROM_THE_RIGHT: Direction = (0.0, -1.0, 0.0)
"""A side view."""
FROM_AHEAD: Direction = (0.80, -1.00, 0.32)
"""A portrait."""

_PIXEL = 0.5e-3  # [m]
_FINENESS = 2  # pixels drawn for each one kept, along both sides
_LAMP = np.array([0.30, 0.50, 0.81])  # in the picture: from the right, from above, from the front
_DIMMEST = 0.60
_INK = np.array([0.10, 0.11, 0.13])
_INK_DENSITY = 0.55
_CLEARLY = 5e-5  # in front: of faces that coincide, the first one drawn stays [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """Solids as they are seen from one side."""

    pixels: FloatArray
    """Red, green, blue and opacity, 0 to 1, shape (rows, columns, 4); the top row first."""
    left: float
    """Where its left edge is along the picture's axis to the right, from the world's origin [m]."""
    bottom: float
    """Where its lower edge is along the picture's axis upwards, from the world's origin [m]."""

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper edge [m]."""
        rows, columns, _ = self.pixels.shape
        return (
            self.left,
            self.left + columns * _PIXEL,
            self.bottom,
            self.bottom + rows * _PIXEL,
        )


def render(
    parts: Sequence[FloatArray], colours: Sequence[FloatArray], towards: Direction
) -> Picture:
    """Draw solids.

    Args:
        parts: Triangles of each solid [m], shape (n, 3, 3): corners, counter-clockwise from
            outside, in the world's axes.
        colours: Red, green, blue of each, 0 to 1, shape (3,).
        towards: Where they are looked at from.

    Raises:
        SettingsError: the direction is vertical.
    """
    R_VW = _view(towards)
    parts = [triangles @ R_VW.T for triangles in parts]
    every = np.concatenate(parts).reshape(-1, 3)
    pixel = _PIXEL / _FINENESS
    lower = np.floor(every[:, :2].min(axis=0) / _PIXEL - 2.0) * _PIXEL
    kept = np.ceil((every[:, :2].max(axis=0) - lower) / _PIXEL + 2.0).astype(int)
    columns, rows = kept * _FINENESS
    depth = np.full((rows, columns), -np.inf)
    surface = np.zeros((rows, columns, 3))
    owner = np.full((rows, columns), -1)
    lamp = _LAMP / np.linalg.norm(_LAMP)
    for number, (triangles, colour) in enumerate(zip(parts, colours, strict=True)):
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-30
        light = _DIMMEST + (1.0 - _DIMMEST) * np.maximum(normals @ lamp, 0.0)
        for index in np.flatnonzero(normals[:, 2] > 1e-6):
            corners = triangles[index].copy()
            corners[:, :2] = (corners[:, :2] - lower) / pixel
            seen = _fill(corners, depth)
            if seen is not None:
                window, inside = seen
                surface[window][inside] = light[index] * colour
                owner[window][inside] = number
    edges = np.zeros((rows, columns), dtype=bool)
    for axis in (0, 1):
        edges |= owner != np.roll(owner, 1, axis=axis)
    surface[edges] = _INK_DENSITY * _INK + (1.0 - _INK_DENSITY) * surface[edges]
    opaque = ((owner >= 0) | edges).astype(float)
    premultiplied = np.dstack([surface * opaque[:, :, None], opaque])
    blocks = premultiplied.reshape(kept[1], _FINENESS, kept[0], _FINENESS, 4).mean(axis=(1, 3))
    blocks[:, :, :3] /= np.maximum(blocks[:, :, 3:], 1e-9)
    return Picture(pixels=blocks[::-1], left=float(lower[0]), bottom=float(lower[1]))


def _view(towards: Direction) -> FloatArray:
    """Rotation R_VW into the view: right, up, towards who looks."""
    front = np.asarray(towards, dtype=float)
    right = np.cross((0.0, 0.0, 1.0), front)
    if not np.linalg.norm(right) > 1e-9:
        raise SettingsError(f"a picture needs a direction that is not vertical, got {towards}")
    rows = [right, np.cross(front, right), front]
    return np.array([row / np.linalg.norm(row) for row in rows])


def _fill(corners: FloatArray, depth: FloatArray) -> tuple[tuple[slice, slice], Any] | None:
    """Enter one triangle [pixel, pixel, m] into the depth buffer; returns what of it is in front.

    As the window it lies in, and the pixels of the window (rows, columns) that it takes.
    """
    low = np.floor(corners[:, :2].min(axis=0)).astype(int)
    high = np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1
    window = slice(low[1], high[1]), slice(low[0], high[0])
    x, y = np.arange(low[0], high[0]) + 0.5, (np.arange(low[1], high[1]) + 0.5)[:, None]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if not area > 1e-9:
        return None
    # Barycentric coordinates of every pixel's centre.
    of_b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
    of_c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
    of_a = 1.0 - of_b - of_c
    nearness = of_a * az + of_b * bz + of_c * cz
    inside = (of_a >= 0.0) & (of_b >= 0.0) & (of_c >= 0.0) & (nearness > depth[window] + _CLEARLY)
    depth[window][inside] = nearness[inside]
    return window, inside
