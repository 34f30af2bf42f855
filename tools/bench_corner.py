"""Print how the corner of a foot resists turning, by its faces: `python tools/bench_corner.py`.

A heel plate on the sole `area` is tilted by 5 degrees about both axes, and sinks until its load is
borne. Statics alone: the force of a face is its area times the pressure at its centroid, and acts
there, as in Drake. The resistance is the mean distance of the forces from an axis: torque / (µ N).
"""

import argparse
from itertools import pairwise

import numpy as np
from pydrake.math import RollPitchYaw

from drake_gait.gait import FloatArray
from drake_gait.simulation.contact import sole_mesh
from drake_gait.sole import Contact

LENGTH, WIDTH = 0.095, 0.078  # m, as in tests/simulation/test_contact.py
WEIGHT = 1.6 * 9.81  # N
TILT = (-5.0, 5.0)  # Roll and pitch [deg]: on the front left corner.
PIECES = 2  # of each strip along an edge: 16 triangles a heel
DEEPEST = 0.004  # m; faces that are higher than this over the lowest point never touch


def mesh(finer: int, halvings: int) -> FloatArray:
    """Corners of the faces near the ground, tilted [m], shape (n, 3, 3)."""
    text = sole_mesh(LENGTH, WIDTH, rim=Contact().rim, along=(finer * PIECES, finer * PIECES))
    lines = [line.split() for line in text.splitlines()]
    vertices: FloatArray = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    numbers = np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1
    faces = vertices[numbers] @ rotation().T
    for number in range(halvings + 1):
        if number:
            a, b, c = faces.swapaxes(0, 1)
            ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
            parts = (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)
            faces = np.concatenate([np.stack(part, axis=1) for part in parts])
        height = faces[:, :, 2]
        faces = faces[height.min(axis=1) < height.min() + DEEPEST]
    return faces


def rotation() -> FloatArray:
    """R_WP of the tilted plate, shape (3, 3)."""
    found: FloatArray = RollPitchYaw(*np.radians(TILT), 0.0).ToRotationMatrix().matrix()
    return found


def touching(faces: FloatArray, ground: float) -> FloatArray:
    """Centroid [m] and area [m²] of each face's part under the ground, shape (n, 4)."""
    rows = []
    for face in faces[faces[:, :, 2].min(axis=1) < ground]:
        corners = []
        for a, b in zip(face, np.roll(face, -1, axis=0), strict=True):
            if a[2] < ground:
                corners.append(a)
            if (a[2] < ground) != (b[2] < ground):
                corners.append(a + (ground - a[2]) / (b[2] - a[2]) * (b - a))
        first, *others = corners
        fan = [(first, b, c) for b, c in pairwise(others)]
        areas = np.array([np.linalg.norm(np.cross(b - a, c - a)) / 2.0 for a, b, c in fan])
        middles = np.array([(a + b + c) / 3.0 for a, b, c in fan])
        if areas.sum() > 1e-16:
            rows.append([*(areas @ middles / areas.sum()), areas.sum()])
    return np.array(rows)


def borne(faces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of the load [1] and place [m] of each face that touches, shapes (n,) and (n, 2)."""
    contact, upright = Contact(), rotation()[2, 2]
    low = faces[:, :, 2].min()
    high = low + DEEPEST
    for _ in range(40):
        ground = (low + high) / 2.0
        found = touching(faces, ground)
        depth = ground - found[:, 2]
        forces = contact.modulus / contact.slab * depth * found[:, 3] * upright
        low, high = (low, ground) if forces.sum() > WEIGHT else (ground, high)
    return forces / forces.sum(), found[:, :2]


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    share, place = borne(mesh(1, 5))
    springs = share @ place
    print(
        "| pieces along an edge | parts of each face | faces that touch | about the centre of "
        "springs [mm] | about its own [mm] | between both [mm] |\n|---|---|---|---|---|---|"
    )
    for finer, halvings in ((1, 0), (2, 0), (4, 0), (8, 0), (1, 1), (1, 2), (1, 3), (1, 4)):
        share, place = borne(mesh(finer, halvings))
        own = share @ place
        arms = [1e3 * share @ np.hypot(*(place - centre).T) for centre in (springs, own)]
        apart = 1e3 * np.hypot(*(own - springs))
        cells = [finer * PIECES, 4**halvings, len(share), *(f"{arm:.2f}" for arm in arms)]
        print(f"| {' | '.join(map(str, cells))} | {apart:.1f} |", flush=True)


if __name__ == "__main__":
    main()
