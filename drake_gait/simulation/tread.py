"""The load under a link of a foot, from where it is: the contact's own law over arrays.

A sole presses by how deep it is in the ground, and more while it sinks. Soles are known to Drake;
its law of a single instant (hydroelastic pressure, or points; Hunt and Crossley's dissipation) is
the same here for all instants at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from pydrake.geometry import Box, GeometryId, SceneGraph, Sphere, TriangleSurfaceMesh
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from drake_gait.gait import FloatArray
from drake_gait.robot.robot_file import RobotFile
from drake_gait.simulation.contact import ground_of, plates
from drake_gait.simulation.kinematics import Floats, Motion
from drake_gait.sole import Sole

_FACE: FloatArray = 0.5 * np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
_HALVES: np.ndarray = np.array([(0, 1, 2), (0, 2, 3)])
"""A plate as two triangles."""


_THIRD = 1.0 / 3.0
_TINY = 1e-4
_LIGHTEST = 1e-6
"""A load whose centre is not looked for [N]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tread:
    """Parts under one link L of a foot that touch the ground: k corners, t faces or none."""

    corners: Floats
    """p_LC [m], shape (k, 3)."""
    faces: np.ndarray
    """Numbers of the three corners of each face, shape (t, 3); none where corners are points."""
    stiffness: Floats
    """Force per depth of each face [N/m], shape (t,): pressure per depth x area; or of points."""
    dissipation: Floats
    """Hunt and Crossley's of each face, shape (t,), or of each point [s/m]."""
    normal: FloatArray | None = None
    """Direction in which faces are pressed, in L, shape (3,); None: up in the world.

    Drake takes that of the rigid one of two surfaces.
    """
    radius: float = 0.0
    """Of spheres around points [m]."""

    def within(self, X_KL: RigidTransform, dtype: type[np.floating]) -> "Tread":
        """Return the same in a frame K that its link is fixed to, as precise as `dtype`."""
        normal = None if self.normal is None else X_KL.rotation() @ self.normal
        return replace(
            self,
            corners=(X_KL @ self.corners.T).T.astype(dtype),
            stiffness=self.stiffness.astype(dtype),
            dissipation=self.dissipation.astype(dtype),
            normal=normal,
        )

    def load(self, motion: Motion) -> tuple[Floats, Floats]:
        """Return the load of the ground on the link, and how fast it slides.

        Args:
            motion: Of the link, at n instants.

        Returns:
            The vertical force [N], and the horizontal speed of the link at the centre of its load
            [m/s], 0 without a load; shape (n,) each.
        """
        depths = self.radius - motion.heights(self.corners)
        rising = motion.rising(self.corners, self.normal)
        if len(self.faces):
            force, moment = self._faces_pressed(depths, rising)
            if self.normal is not None:
                steep = motion.direction(self.normal)[2]
                force, moment = force * steep, moment * steep
        else:
            # Hunt and Crossley: f = k x (1 + d dx/dt), never pulling.
            damping = 1.0 - self.dissipation[:, None] * rising
            forces = self.stiffness[:, None] * np.maximum(depths, 0.0) * np.maximum(damping, 0.0)
            force, moment = forces.sum(axis=0), self.corners.T @ forces
        velocity = motion.velocity_at(moment / np.maximum(force, _LIGHTEST))
        return force, np.hypot(velocity[0], velocity[1]) * (force > 0.0)

    def _faces_pressed(self, depths: Floats, rising: Floats) -> tuple[Floats, Floats]:
        """Return the force along the normal [N], shape (n,), and the sum of force x place in L."""
        depth, speed = ([array[at] for at in self.faces.T] for array in (depths, rising))
        mean, weights = wet_part(depth)
        # Drake evaluates pressure and damping at the centroid of what is wet of a face.
        sinking = weights[0] * speed[0] + weights[1] * speed[1] + weights[2] * speed[2]
        damping = np.maximum(1.0 - self.dissipation[:, None] * sinking, 0.0)
        forces = self.stiffness[:, None] * mean
        forces *= damping
        moment = sum(
            self.corners[at].T @ (weight * forces)
            for at, weight in zip(self.faces.T, weights, strict=True)
        )
        return forces.sum(axis=0), cast(Floats, moment)


def wet_part(depth: Sequence[Floats]) -> tuple[Floats, list[Floats]]:
    """Return what of triangles is in the ground.

    Args:
        depth: Depth of each corner [m], three arrays of any shape.

    Returns:
        The mean over the triangle of the depth where it is positive [m], and the weights of the
        three corners whose mean is the centroid of that part.
    """
    # Choices are products with 0 or 1: numpy's own take ten times as long.
    single = depth[0].dtype
    low = np.minimum(np.minimum(depth[0], depth[1]), depth[2])
    high = np.maximum(np.maximum(depth[0], depth[1]), depth[2])
    total = depth[0] + depth[1] + depth[2]
    one_wet = (total < low + high).astype(single)
    two_wet = 1.0 - one_wet
    # The waterline cuts off the corner that is alone on its side: a smaller triangle, of whose
    # sides `cut` is the part of the whole ones, and 1 at the corner itself.
    alone = one_wet * high + two_wet * low  # To the last digit.
    away = [alone - one for one in depth]
    here = [(one == 0.0).astype(single) for one in away]
    less = alone - 1.0
    cut = [(alone - at * less) / (one + at) for one, at in zip(away, here, strict=True)]
    area = cut[0] * cut[1] * cut[2]
    area *= (low < 0.0).astype(single)  # Of the small triangle; there is none where all is wet.
    dry = two_wet * area
    mean = (two_wet * total + (one_wet - two_wet) * area * alone) * _THIRD
    # The centroid is that of the small triangle, or that of the whole one without it.
    scale = _THIRD / np.maximum(1.0 - dry, _TINY)
    whole, small = two_wet * scale, (one_wet - dry) * scale
    weights = [whole + small * part for part in cut]
    rest = 1.0 - (weights[0] + weights[1] + weights[2])
    for weight, at in zip(weights, here, strict=True):
        weight += at * rest
    return np.maximum(mean, 0.0), weights


def treads(
    plant: MultibodyPlant, scene_graph: SceneGraph, sole: Sole, robot: RobotFile
) -> dict[str, Tread]:
    """Return what touches the ground under each link of the feet, by the link's name.

    A box of the sole `boxes` is taken as its under side: its own pressure field falls off towards
    its edges.
    """
    inspector = scene_graph.model_inspector()

    def known(geometry: GeometryId, group: str, name: str) -> float:
        properties: Any = inspector.GetProximityProperties(geometry)
        return float(properties.GetProperty(group, name))

    def dissipation(geometry: GeometryId) -> float:
        return known(geometry, "material", "hunt_crossley_dissipation")

    def modulus(geometry: GeometryId) -> float:
        return known(geometry, "hydroelastic", "hydroelastic_modulus")

    ground = ground_of(plant)
    under_sides = iter(
        plates(plant, scene_graph, robot)
    )  # In the order of links and boxes, as here.
    found: dict[str, Tread] = {}
    for link in robot.plates:
        parts: list[Tread] = []
        for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link)):
            shape, X_LG = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
            if isinstance(shape, Box):
                plate = next(under_sides)
                if sole is Sole.BOXES:
                    # The pressure grows from the surface to the middle of the box.
                    per_depth = modulus(geometry) / (0.5 * min(shape.size()))
                    corners = _FACE * (plate.length, plate.width, 0.0)
                    damping = dissipation(geometry)
                    parts.append(_faces(plate.X_LP, corners, _HALVES, per_depth, damping))
            elif isinstance(shape, Sphere):
                # Two springs in series, as Drake joins them.
                own, other = (
                    known(one, "material", "point_contact_stiffness") for one in (geometry, ground)
                )
                damping = other / (own + other) * dissipation(geometry)
                damping += own / (own + other) * dissipation(ground)
                parts.append(
                    Tread(
                        corners=X_LG.translation()[None],
                        faces=np.zeros((0, 3), dtype=int),
                        stiffness=np.array([own * other / (own + other)]),
                        dissipation=np.array([damping]),
                        radius=shape.radius(),
                    )
                )
            else:
                mesh = cast(TriangleSurfaceMesh, inspector.maybe_get_hydroelastic_mesh(geometry))
                per_depth = modulus(ground) / known(ground, "hydroelastic", "slab_thickness")
                corners = np.array([mesh.vertex(i) for i in range(mesh.num_vertices())])
                triangles = [mesh.element(i) for i in range(mesh.num_elements())]
                faces = np.array([[one.vertex(k) for k in range(3)] for one in triangles])
                parts.append(
                    _faces(X_LG, corners, faces, per_depth, dissipation(ground), rigid=True)
                )
        found[link] = _joined(parts)
    return found


def _faces(
    X_LG: RigidTransform,
    corners: FloatArray,
    faces: np.ndarray,
    per_depth: float,
    dissipation: float,
    *,
    rigid: bool = False,
) -> Tread:
    """Return faces under pressure [Pa/m]; corners p_GC [m], shape (k, 3)."""
    corners, numbers = np.unique(corners, axis=0, return_inverse=True)  # Pieces share theirs.
    faces = numbers.ravel()[faces]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    areas = 0.5 * np.linalg.norm(across, axis=1)
    # The faces of a sole look down, all of them.
    upward = X_LG.rotation() @ (-across.sum(axis=0) / np.linalg.norm(across.sum(axis=0)))
    return Tread(
        corners=(X_LG @ corners.T).T,
        faces=faces,
        stiffness=per_depth * areas,
        dissipation=np.full(len(faces), dissipation),
        normal=upward if rigid else None,
    )


def _joined(parts: Sequence[Tread]) -> Tread:
    """Return the parts under one link as one."""
    offsets = np.cumsum([0, *(len(part.corners) for part in parts)])
    return Tread(
        corners=np.vstack([part.corners for part in parts]),
        faces=np.vstack([part.faces + at for part, at in zip(parts, offsets, strict=False)]),
        stiffness=np.concatenate([part.stiffness for part in parts]),
        dissipation=np.concatenate([part.dissipation for part in parts]),
        normal=parts[0].normal,
        radius=parts[0].radius,
    )
