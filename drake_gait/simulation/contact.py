"""The ground, and the soles that stand on it.

The plates of a foot are the boxes of its description. On the soles `area` and `points` they touch
the robot's other limbs only; a shape under each of them touches the ground, and nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddCompliantHydroelasticPropertiesForHalfSpace,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    HalfSpace,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    RoleAssign,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from drake_gait.errors import ModelError
from drake_gait.gait import FloatArray
from drake_gait.robot.robot_file import RobotFile
from drake_gait.sole import Contact, Sole

GROUND_FRICTION = 1.0
"""Both coefficients of the ground; Drake combines two surfaces as 2ab / (a + b)."""

_FALLEN_STIFFNESS = 2e5
"""Of points of other limbs with the ground of `area`, which only a fallen robot has [N/m]."""
_BOX_MODULUS, _BOX_DISSIPATION, _BOX_SIZE = 1e6, 5.0, 0.01
"""Of boxes whose model tells none, as the KHR-3HV's [Pa], [s/m]; a box is meshed without [m]."""
_RADIUS = 5e-4
"""Of a sphere at a plate's corner [m]."""
_PROUD = 1e-6
"""By which a rim is lower than its plate [m]: Drake aborts if a flat mesh is exactly at z = 0."""
_ALONG_HEEL, _ALONG_TOE = (2, 2), (1, 2)
"""Pieces of a rim's strips, along x and along y: as many as make an edge turn as a line does."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plate:
    """The under side of a box of a foot; its frame P is in its middle, x forward and z up."""

    link: str
    """Name of the link that it is under."""
    X_LP: RigidTransform
    """Where it is in the link."""
    length: float
    """Size along x [m]."""
    width: float
    """Size along y [m]."""
    friction: CoulombFriction
    """Of its surface."""
    is_left: bool
    """Whether it is of the left foot."""
    is_toe: bool
    """Whether it is a toe, whose rear edge is a hinge."""


def plates(plant: MultibodyPlant, scene_graph: SceneGraph, robot: RobotFile) -> list[Plate]:
    """Find the under sides of a robot's feet, as its description puts them over the ground.

    Args:
        plant: A finalized one.
        scene_graph: Its shapes.
        robot: Its file, which names the feet.
    """
    inspector, context = scene_graph.model_inspector(), plant.CreateDefaultContext()
    found = []
    for link in robot.plates:
        body = plant.GetBodyByName(link)
        X_WL = plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            box = inspector.GetShape(geometry)
            if not isinstance(box, Box):
                continue
            X_WG = X_WL @ inspector.GetPoseInFrame(geometry)
            axes, (length, width, thickness) = _upright(X_WG.rotation(), np.array(box.size()))
            down = np.array([0.0, 0.0, -thickness / 2.0])
            X_WP = RigidTransform(axes, X_WG.translation() + axes @ down)
            found.append(
                Plate(
                    link=link,
                    X_LP=X_WL.inverse() @ X_WP,
                    length=length,
                    width=width,
                    friction=_friction(inspector.GetProximityProperties(geometry)),
                    is_left=robot.is_left(link),
                    is_toe=robot.is_toe(link),
                )
            )
    return found


def _friction(properties: Any) -> CoulombFriction:
    """Friction of a shape; 1 where its description tells none."""
    known = properties.HasProperty("material", "coulomb_friction")
    found = properties.GetProperty("material", "coulomb_friction") if known else None
    return found or CoulombFriction(1.0, 1.0)


def soften_boxes(plant: MultibodyPlant, scene_graph: SceneGraph, robot: RobotFile) -> None:
    """Make boxes of the feet compliant that are not, as those of URDF and MJCF mostly are.

    Args:
        plant: One with the robot alone.
        scene_graph: Its shapes.
        robot: The robot's file, which names the feet.
    """
    source, inspector = plant.get_source_id(), scene_graph.model_inspector()
    for link in robot.plates:
        for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link)):
            properties = ProximityProperties(cast(Any, inspector.GetProximityProperties(geometry)))
            box = isinstance(inspector.GetShape(geometry), Box)
            if box and not properties.HasProperty("hydroelastic", "hydroelastic_modulus"):
                AddCompliantHydroelasticProperties(_BOX_SIZE, _BOX_MODULUS, properties)
                cast(Any, properties).UpdateProperty(
                    "material", "hunt_crossley_dissipation", _BOX_DISSIPATION
                )
                scene_graph.AssignRole(cast(Any, source), geometry, properties, RoleAssign.kReplace)


def scale_friction(
    plant: MultibodyPlant, scene_graph: SceneGraph, robot: RobotFile, factor: float
) -> None:
    """Give the contact of all shapes of a robot with the ground `factor` times its friction.

    Args:
        plant: One with the robot alone.
        scene_graph: Its shapes.
        robot: The robot's file.
        factor: On the friction of each pair of shape and ground.

    Raises:
        ModelError: a friction cannot be multiplied by so much.
    """
    if factor == 1.0:
        return
    source, inspector = plant.get_source_id(), scene_graph.model_inspector()
    for index in plant.GetBodyIndices(plant.GetBodyByName(robot.torso).model_instance()):
        body = plant.get_body(index)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            properties = ProximityProperties(cast(Any, inspector.GetProximityProperties(geometry)))
            own = _friction(properties)
            scaled = CoulombFriction(
                _scaled(own.static_friction(), factor, body.name()),
                _scaled(own.dynamic_friction(), factor, body.name()),
            )
            cast(Any, properties).UpdateProperty("material", "coulomb_friction", scaled)
            scene_graph.AssignRole(cast(Any, source), geometry, properties, RoleAssign.kReplace)


def _scaled(surface: float, factor: float, link: str) -> float:
    """Coefficient of a surface whose contact with the ground has `factor` times its friction."""
    ground = GROUND_FRICTION
    contact = factor * 2.0 * surface * ground / (surface + ground)
    if not contact < 2.0 * ground:
        raise ModelError(
            f": no surface has {factor:g} times the friction {surface:g} of link '{link}' on the "
            "ground; lower walk.friction"
        )
    return contact * ground / (2.0 * ground - contact)


def _upright(R_WG: RotationMatrix, size: FloatArray) -> tuple[RotationMatrix, FloatArray]:
    """Axes of a box that are nearest to x forward and z up in the world, and its size along them.

    A box may be written on any of its sides: it is the same box.
    """
    columns: FloatArray = R_WG.matrix()
    up = int(np.abs(columns[2]).argmax())
    others = [axis for axis in range(3) if axis != up]
    ahead = max(others, key=lambda axis: abs(columns[0, axis]))
    (beside,) = set(others) - {ahead}
    z, x = (columns[:, axis] * np.sign(columns[row, axis]) for row, axis in ((2, up), (0, ahead)))
    order = [ahead, beside, up]
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z])), size[order]


def add_ground(
    plant: MultibodyPlant, sole: Sole = Sole.BOXES, contact: Contact | None = None
) -> None:
    """Add a half space under z = 0, as a sole needs it: rigid under boxes."""
    contact = contact or Contact()
    properties = ProximityProperties()
    friction = CoulombFriction(GROUND_FRICTION, GROUND_FRICTION)
    match sole:
        case Sole.BOXES:
            AddRigidHydroelasticProperties(properties)
            AddContactMaterial(friction=friction, properties=properties)
        case Sole.AREA:
            AddContactMaterial(
                dissipation=contact.dissipation,
                point_stiffness=_FALLEN_STIFFNESS,
                friction=friction,
                properties=properties,
            )
            AddCompliantHydroelasticPropertiesForHalfSpace(
                contact.slab, contact.modulus, properties
            )
        case Sole.POINTS:
            _add_point_material(properties, contact, friction)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "ground", properties
    )


def add_soles(
    plant: MultibodyPlant, feet: Sequence[Plate], sole: Sole, contact: Contact | None = None
) -> None:
    """Add what touches the ground under the plates of a robot's feet; boxes are there already.

    Args:
        plant: One that is not finalized yet.
        feet: The plates, see `plates`.
        sole: What to add.
        contact: Its size and softness.
    """
    contact = contact or Contact()
    for number, plate in enumerate(feet if sole is not Sole.BOXES else ()):
        properties = ProximityProperties()
        shapes: list[tuple[FloatArray, Shape]]
        if sole is Sole.AREA:
            AddContactMaterial(friction=plate.friction, properties=properties)
            AddRigidHydroelasticProperties(properties)
            file = MemoryFile(_rim(plate, contact), ".obj", f"{plate.link}_sole")
            shapes = [(np.array([0.0, 0.0, -_PROUD]), Mesh(InMemoryMesh(mesh_file=file)))]
        else:
            _add_point_material(properties, contact, plate.friction)
            x, y = plate.length / 2.0, plate.width / 2.0
            corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
            shapes = [(np.array([*corner, _RADIUS]), Sphere(_RADIUS)) for corner in corners]
        body = plant.GetBodyByName(plate.link)
        for index, (place, shape) in enumerate(shapes):
            name = f"{plate.link}_sole_{number}_{index}"
            X_LS = plate.X_LP @ RigidTransform(place)
            plant.RegisterCollisionGeometry(body, X_LS, shape, name, properties)


def _add_point_material(
    properties: ProximityProperties, contact: Contact, friction: CoulombFriction
) -> None:
    """Add what a point and the ground have alike: two springs in series are half as stiff."""
    AddContactMaterial(
        dissipation=contact.dissipation,
        point_stiffness=2.0 * contact.stiffness,
        friction=friction,
        properties=properties,
    )


def ground_of(plant: MultibodyPlant) -> GeometryId:
    """The half space that `add_ground` has added."""
    (ground,) = plant.GetCollisionGeometriesForBody(plant.world_body())
    return ground


def part_soles(plant: MultibodyPlant, scene_graph: SceneGraph, robot: RobotFile) -> None:
    """Let soles touch nothing but the ground, and the boxes over them all but the ground.

    Args:
        plant: A finalized one with soles.
        scene_graph: Its shapes.
        robot: Its file, which names the feet.
    """
    inspector, ground = scene_graph.model_inspector(), ground_of(plant)
    boxes: list[GeometryId] = []
    soles: list[GeometryId] = []
    for link in robot.plates:
        for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link)):
            box = isinstance(inspector.GetShape(geometry), Box)
            (boxes if box else soles).append(geometry)
    others = [one for one in inspector.GetAllGeometryIds() if one not in (ground, *soles)]
    filters = CollisionFilterDeclaration()
    filters.ExcludeBetween(GeometrySet(boxes), GeometrySet(ground))
    filters.ExcludeBetween(GeometrySet(soles), GeometrySet(others))
    filters.ExcludeWithin(GeometrySet(soles))
    scene_graph.collision_filter_manager().Apply(filters)


def _rim(plate: Plate, contact: Contact) -> str:
    along = _ALONG_TOE if plate.is_toe else _ALONG_HEEL
    return sole_mesh(
        plate.length,
        plate.width,
        rim=contact.rim,
        along=(contact.finer * along[0], contact.finer * along[1]),
        hinge=plate.is_toe,
        left=plate.is_left,
    )


def sole_mesh(
    length: float,
    width: float,
    *,
    rim: float,
    along: tuple[int, int] = _ALONG_HEEL,
    hinge: bool = False,
    left: bool = True,
) -> str:
    """Return the rim of a plate's under side as .obj text, its normals down.

    Strips run along the edges and meet in mitres. Each is cut into pieces, and each piece into two
    triangles, whose diagonals mirror about the middle of the plate. A face's force acts at its
    centroid: pieces make an edge resist turning as a line does.

    Args:
        length: Size along x, forward [m].
        width: Size along y, left [m].
        rim: Width of the strips [m]; at most a third of the plate is taken.
        along: Pieces of each strip along x and along y.
        hinge: Whether the rear edge is a toe's hinge, which has no strip.
        left: Whether the foot is the left one; the right one's mesh is its mirror image.
    """
    a, b, w = length / 2.0, width / 2.0, min(rim, length / 3.0, width / 3.0)
    rear = -a if hinge else -a + w
    outer: FloatArray = np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
    inner: FloatArray = np.array([(rear, w - b), (a - w, w - b), (a - w, b - w), (rear, b - w)])
    vertices: list[FloatArray] = []
    faces: list[tuple[int, int, int]] = []
    for side in range(3 if hinge else 4):  # Right, front, left, rear.
        ends, pieces = [side, (side + 1) % 4], along[side % 2]
        edges = [_between(line[ends], pieces) for line in (outer, inner)]
        for k in range(pieces):
            p, q, r, s = range(len(vertices) + 1, len(vertices) + 5)
            vertices += [edges[0][k], edges[0][k + 1], edges[1][k + 1], edges[1][k]]
            faces += [(p, q, r), (p, r, s)] if k < pieces / 2 else [(p, q, s), (q, r, s)]
    if left:  # The corners run counterclockwise seen from above, the mirrored ones clockwise.
        faces = [(p, r, q) for p, q, r in faces]
    mirror = 1.0 if left else -1.0
    lines = [f"v {float(x)!r} {float(mirror * y)!r} 0.0" for x, y in vertices]
    return "\n".join([*lines, *(f"f {p} {q} {r}" for p, q, r in faces)]) + "\n"


def _between(ends: FloatArray, pieces: int) -> FloatArray:
    """Points that cut a line into pieces, its ends included, shape (pieces + 1, 2)."""
    points: FloatArray = ends[0] + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (ends[1] - ends[0])
    return points
