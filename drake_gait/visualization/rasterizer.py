"""Draws solids without a graphics card: triangles with a depth buffer, shaded by one lamp.

Orthographic, with ink along the edges of every part. Figures measure in millimetres, which only a
view without perspective allows; and a machine that computes has often no graphics driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

_SMALL = 1000
"""Windows of triangles that are entered together [pixel]."""
_LEAST_AREA = 1e-9
"""Twice the area of a triangle that is seen [pixel²]."""


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
    face = np.full((rows, columns), -1)  # What is seen, as a row of `shades`.
    shades, owners = [], []
    lamp = _LAMP / np.linalg.norm(_LAMP)
    count = 0
    for number, (triangles, colour) in enumerate(zip(parts, colours, strict=True)):
        a, b, c = np.moveaxis(triangles, 1, 0)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-30
        ahead = normals[:, 2] > 1e-6
        corners = triangles[ahead]
        corners[:, :, :2] = (corners[:, :, :2] - lower) / pixel
        light = _DIMMEST + (1.0 - _DIMMEST) * np.maximum(normals[ahead] @ lamp, 0.0)
        shades.append(light[:, None] * colour)
        owners.append(np.full(len(corners), number))
        _enter(corners, depth, face, count)
        count += len(corners)
    owner = np.concatenate([*owners, [-1]])[face]  # The last one is what face -1 shows: nothing.
    edges = np.zeros((rows, columns), dtype=bool)
    edges[1:] |= owner[1:] != owner[:-1]
    edges[:, 1:] |= owner[:, 1:] != owner[:, :-1]
    table = np.concatenate([*shades, np.zeros((1, 3))])
    dark = _INK_DENSITY * _INK + (1.0 - _INK_DENSITY) * table
    # Each face in its colour, then in that under ink; the last row of all is transparent.
    painted = np.concatenate([np.insert(table, 3, 1.0, 1), np.insert(dark, 3, 1.0, 1)])
    painted[len(table) - 1] = 0.0
    face[face < 0] = len(table) - 1
    face[edges] += len(table)
    blocks = np.zeros((kept[1], kept[0], 4))
    for row, column in np.ndindex(_FINENESS, _FINENESS):
        blocks += painted[face[row::_FINENESS, column::_FINENESS]]
    blocks /= _FINENESS**2
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


def _enter(corners: FloatArray, depth: FloatArray, face: NDArray[np.int_], first: int) -> None:
    """Enter the triangles of one solid into the depth buffer, and their numbers into `face`.

    Args:
        corners: Triangles [pixel, pixel, m], shape (n, 3, 3).
        depth: Nearness of what is seen so far [m], shape (rows, columns).
        face: Number of what is seen so far, of the same shape.
        first: Number of the first triangle.
    """
    low = np.floor(corners[:, :, :2].min(axis=1)).astype(int)
    size = np.ceil(corners[:, :, :2].max(axis=1)).astype(int) + 1 - low
    edge = corners[:, 1:, :2] - corners[:, :1, :2]
    area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    small = size.prod(axis=1) < _SMALL
    for number in np.flatnonzero(~small & (area > _LEAST_AREA)):
        (x, y), (width, height) = low[number], size[number]
        window = slice(y, y + height), slice(x, x + width)
        across, up = np.arange(x, x + width), np.arange(y, y + height)[:, None]
        nearness, inside = _nearness(across, up, corners[number].T, area[number])
        inside &= nearness > depth[window] + _CLEARLY
        depth[window][inside] = nearness[inside]
        face[window][inside] = first + number
    # The windows of all small ones in one row: a call for each would cost more than its pixels.
    chosen = np.flatnonzero(small & (area > _LEAST_AREA))
    if not len(chosen):
        return
    pixels = size[chosen].prod(axis=1)
    of = np.repeat(chosen, pixels)
    place = np.arange(len(of)) - np.repeat(pixels.cumsum() - pixels, pixels)
    row, column = np.divmod(place, size[of, 0])
    x, y = low[of, 0] + column, low[of, 1] + row
    nearness, inside = _nearness(x, y, corners[of].transpose(2, 1, 0), area[of])
    inside &= nearness > depth[y, x] + _CLEARLY
    # Where two meet, the first one stays: of equal indices numpy keeps the last.
    kept = np.flatnonzero(inside)[::-1]
    x, y = x[kept], y[kept]
    depth[y, x] = nearness[kept]
    face[y, x] = first + of[kept]


def _nearness(
    column: NDArray[np.int_], row: NDArray[np.int_], corners: FloatArray, area: Any
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return how near a triangle is at pixels' centres [m], and whether they lie in it.

    Args:
        column: Of the pixels.
        row: Of the pixels.
        corners: x, y [pixel] and nearness [m] of the corners, shape (3, 3) or (3, 3, pixels).
        area: Twice that of the triangle [pixel²].
    """
    x, y = column + 0.5, row + 0.5
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = corners
    # Barycentric coordinates.
    of_b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
    of_c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
    of_a = 1.0 - of_b - of_c
    return of_a * az + of_b * bz + of_c * cz, (of_a >= 0.0) & (of_b >= 0.0) & (of_c >= 0.0)
