"""The robot of a Drake plant, written as a MuJoCo model: no number of it is kept twice.

Links, joints, springs, dampers, servos and what may touch what are read from the plant and its
context, after everything that settings change. Two things cannot be the same in both engines.
A contact's damping grows with the force in Drake (Hunt and Crossley), and is linear in MuJoCo.
A pair has a static and a kinetic friction in Drake, and one in MuJoCo.

Other laws of contact than those of soles and ground, as of a fallen robot's limbs, are MuJoCo's.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Mesh,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.tree import (
    ForceElementIndex,
    Joint,
    PrismaticJoint,
    PrismaticSpring,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    UniformGravityFieldElement,
    WeldJoint,
)
from pydrake.systems.framework import Context

from drake_gait.errors import ModelError
from drake_gait.gait import FloatArray
from drake_gait.simulation.contact import ground_of
from drake_gait.simulation.plant import Robot
from drake_gait.simulation.servo_joints import actuators as servos_of

_POINT = 5e-4
"""Radius of a point of a sole that Drake has as a mesh [m]."""

_STIFF = 0.004
"""Time constant of joints' stops, and of contacts that are no sole's [s], critically damped."""

_RESOLVED = 0.5
"""Part of a step's stability that a contact may use: of rate x step, and of frequency x step."""

_SAME_POINT = 1e-9
"""Vertices of a mesh that differ by less are one point [m]."""

GROUND = "ground"
"""Name of the plane under the robot."""


@dataclass(frozen=True, kw_only=True)
class Hardness:
    """The properties of MuJoCo's contacts that Drake's have not.

    Chosen by measurement (docs/experiments/2026-11-27-engines.md); others are for comparisons.
    """

    time: float | None = None
    """Time constant of the soles' contacts, critically damped [s]; None: Drake's softness."""
    sideways: float = 100.0
    """Stiffness along the ground over that across: at 1, feet under load creep."""
    pyramid: bool = False
    """Whether friction is a pyramid of four sides instead of Drake's cone."""


@dataclass(frozen=True, kw_only=True)
class _Link:
    """A link of the tree, and the joint that it hangs on its parent by."""

    body: RigidBody
    """The link."""
    parent: RigidBody
    """What it hangs on."""
    joint: Joint
    """What it hangs by."""
    X_PB: RigidTransform
    """Where it is in its parent, while the joint is at zero."""
    X_BJ: RigidTransform
    """Where the joint is in it."""


def compiled(
    robot: Robot, plant_context: Context, step: float, hardness: Hardness | None = None
) -> mujoco.MjModel:
    """Write a robot on the ground as a MuJoCo model, its soles as soft as they are in Drake.

    Args:
        robot: Its diagram.
        plant_context: A context of its plant, with the foot and the masses to be written.
        step: Time step [s].
        hardness: Of its contacts.

    Raises:
        ModelError: it has a joint, a spring or a shape that is not written; the text begins where
            the name of the file ends.
        ValueError: MuJoCo refuses it.
    """
    model = mujoco.MjModel.from_xml_string(mjcf(robot, plant_context, step, hardness))
    if hardness is None or hardness.time is None:
        _soften(model, robot, plant_context)
    return model


def _soften(model: mujoco.MjModel, robot: Robot, plant_context: Context) -> None:
    """Give the contacts of soles and ground the stiffness and the damping of Drake's.

    MuJoCo's law is f = D (a_ref - a), a_ref = -b v - k r. Its D comes from an impedance and from
    the inertia at the contact. D k is the stiffness and D b the damping. D itself acts like a mass
    at the contact: it is the least with which steps of this length are stable.
    """
    plant = robot.plant
    ground = ground_of(plant)
    weight = plant.CalcTotalMass(plant_context) * np.linalg.norm(
        plant.gravity_field().gravity_vector()
    )
    stiffness: FloatArray = np.zeros(model.npair)
    damping: FloatArray = np.zeros(model.npair)
    for link in robot.model.robot.plates:
        shapes = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link))
        points = [(shape, _ground_springs(robot, shape, ground)) for shape in shapes]
        whole = sum(spring for _, springs in points for spring in springs)
        for shape, springs in points:
            for number, spring in enumerate(springs):
                name = f"{_name(shape)} {number}" if len(springs) > 1 else _name(shape)
                geom = model.geom(name).id
                pairs = (model.pair_geom1 == geom) | (model.pair_geom2 == geom)
                stiffness[pairs] = spring
                # Hunt and Crossley's: dissipation x force, as when this plate bears the weight.
                damping[pairs] = _dissipation(robot, ground) * weight * spring / whole
    step = model.opt.timestep
    for pair in np.flatnonzero(stiffness):
        bodies = model.geom_bodyid[[model.pair_geom1[pair], model.pair_geom2[pair]]]
        lightness = model.body_invweight0[bodies, 0].sum()  # 1 / kg
        inertia = max(damping[pair] * step / _RESOLVED, stiffness[pair] * (step / _RESOLVED) ** 2)
        impedance = inertia * lightness / (1.0 + inertia * lightness)
        scale = lightness / (1.0 + inertia * lightness)
        model.pair_solref[pair] = -scale * stiffness[pair], -scale * damping[pair]
        model.pair_solimp[pair] = impedance, impedance, 1.0, 0.5, 2.0


def _ground_springs(robot: Robot, shape: GeometryId, ground: GeometryId) -> list[float]:
    """Return the stiffness on the ground of each point of a sole [N/m]; none of other shapes."""
    inspector = robot.scene_graph.model_inspector()

    def known(geometry: GeometryId, group: str, name: str) -> float:
        properties = cast(Any, inspector.GetProximityProperties(geometry))
        return float(properties.GetProperty(group, name))

    found = inspector.GetShape(shape)
    if isinstance(found, Sphere):
        # Two springs in series, as Drake joins them.
        one, other = (known(each, "material", _POINT_STIFFNESS) for each in (shape, ground))
        return [one * other / (one + other)]
    if not isinstance(found, Mesh):
        return []
    per_area = known(ground, "hydroelastic", "hydroelastic_modulus")
    per_area /= known(ground, "hydroelastic", "slab_thickness")
    vertices, faces = _points(found)
    areas: FloatArray = np.zeros(len(vertices))
    for face in faces:
        a, b, c = vertices[face]
        areas[face] += np.linalg.norm(np.cross(b - a, c - a)) / 6.0
    return [float(per_area * area) for area in areas]


def _dissipation(robot: Robot, ground: GeometryId) -> float:
    """Return Hunt and Crossley's dissipation of a sole on the ground [s/m]: the ground's own."""
    properties = cast(Any, robot.scene_graph.model_inspector().GetProximityProperties(ground))
    return float(properties.GetProperty("material", "hunt_crossley_dissipation"))


_POINT_STIFFNESS = "point_contact_stiffness"


def mjcf(
    robot: Robot, plant_context: Context, step: float, hardness: Hardness | None = None
) -> str:
    """Write a robot on the ground as MJCF text.

    Args:
        robot: Its diagram.
        plant_context: A context of its plant, with the foot and the masses to be written.
        step: Time step [s].
        hardness: Of its contacts.

    Raises:
        ModelError: it has a joint, a spring or a shape that is not written; the text begins where
            the name of the file ends.
    """
    plant, hardness = robot.plant, hardness or Hardness()
    root = Element("mujoco", model="robot")
    SubElement(root, "compiler", angle="radian", inertiafromgeom="false", autolimits="true")
    option = SubElement(
        root, "option", timestep=repr(step), integrator="implicitfast",
        cone="pyramidal" if hardness.pyramid else "elliptic",
        impratio=repr(hardness.sideways), gravity=_numbers(plant.gravity_field().gravity_vector()),
    )  # fmt: skip
    SubElement(option, "flag", autoreset="disable")  # A walk that diverges must not begin anew.
    default = SubElement(root, "default")
    soft = f"{hardness.time or _STIFF!r} 1"
    # Pairs alone decide what touches.
    SubElement(default, "geom", contype="0", conaffinity="0")
    # Points apart resist turning by their friction: no torsional one.
    SubElement(default, "pair", condim="3", solref=soft)
    SubElement(default, "joint", solreflimit=f"{_STIFF!r} 1")
    parts = {tag: SubElement(root, tag) for tag in ("asset", "worldbody", "contact", "actuator")}

    torso = plant.GetBodyByName(robot.model.robot.torso)
    base = _body(parts["worldbody"], torso, plant.EvalBodyPoseInWorld(plant_context, torso))
    SubElement(base, "freejoint", name=torso.name())
    _add_inertia(base, torso, plant_context)
    elements = {torso.index(): base}
    hinges: dict[str, Element] = {}
    springs = _springs(robot, plant_context)
    for link in _links(robot):
        element = _body(elements[link.parent.index()], link.body, link.X_PB)
        elements[link.body.index()] = element
        if (hinge := _add_joint(element, link, springs, plant_context)) is not None:
            hinges[link.joint.name()] = hinge
        _add_inertia(element, link.body, plant_context)
    _add_servos(parts["actuator"], hinges, robot, plant_context)
    _add_contacts(parts, elements, robot)
    return ElementTree.tostring(root, encoding="unicode")


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def _place(element: Element, X_PB: RigidTransform) -> None:
    element.set("pos", _numbers(X_PB.translation()))
    element.set("quat", _numbers(X_PB.rotation().ToQuaternion().wxyz()))


def _body(parent: Element, body: RigidBody, X_PB: RigidTransform) -> Element:
    element = SubElement(parent, "body", name=body.name())
    _place(element, X_PB)
    return element


def _links(robot: Robot) -> Iterator[_Link]:
    """Yield the links that hang on the torso, each after the one that it hangs on."""
    plant = robot.plant
    torso = plant.GetBodyByName(robot.model.robot.torso)
    known = {torso.index()}
    waiting = [plant.get_joint(index) for index in plant.GetJointIndices()]
    waiting = [joint for joint in waiting if joint.child_body().index() != torso.index()]
    while waiting:
        ready = [joint for joint in waiting if joint.parent_body().index() in known]
        if not ready:
            raise ModelError(
                f": joint '{waiting[0].name()}' does not lead away from the '{torso.name()}'; let "
                "its <parent> be the link that is nearer to it"
            )
        for joint in ready:
            waiting.remove(joint)
            known.add(joint.child_body().index())
            X_PF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
            X_BJ = joint.frame_on_child().GetFixedPoseInBodyFrame()
            yield _Link(
                body=joint.child_body(),
                parent=joint.parent_body(),
                joint=joint,
                X_PB=X_PF @ X_BJ.inverse(),
                X_BJ=X_BJ,
            )


def _add_joint(
    element: Element, link: _Link, springs: dict[str, tuple[float, float]], plant_context: Context
) -> Element | None:
    """Write the joint of a link; a weld is none."""
    joint = link.joint
    match joint:
        case WeldJoint():
            return None
        case RevoluteJoint():
            kind, axis = "hinge", joint.revolute_axis()
        case PrismaticJoint():
            kind, axis = "slide", joint.translation_axis()
        case _:
            raise ModelError(
                f": joint '{joint.name()}' is {joint.type_name()}; in MuJoCo a joint must be "
                "revolute, prismatic or fixed"
            )
    hinge = SubElement(
        element,
        "joint",
        name=joint.name(),
        type=kind,
        pos=_numbers(link.X_BJ.translation()),
        axis=_numbers(link.X_BJ.rotation() @ axis),
        damping=repr(float(cast(Any, joint).GetDampingVector(plant_context)[0])),
    )
    lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
    if np.isfinite([lower, upper]).any():
        # MuJoCo has both stops or none.
        hinge.set("range", _numbers([max(lower, -_FAR), min(upper, _FAR)]))
    if joint.name() in springs:
        stiffness, rest = springs[joint.name()]
        hinge.set("stiffness", repr(stiffness))
        hinge.set("springref", repr(rest))
    return hinge


_FAR = 1e3
"""A stop where there is none [rad or m]."""


def _springs(robot: Robot, plant_context: Context) -> dict[str, tuple[float, float]]:
    """Stiffness [N·m/rad] and angle of rest [rad] of each joint that has a spring."""
    plant = robot.plant
    found: dict[str, tuple[float, float]] = {}
    for index in range(plant.num_force_elements()):
        spring = plant.get_force_element(ForceElementIndex(index))
        match spring:
            case UniformGravityFieldElement():
                continue
            case RevoluteSpring():
                stiffness = spring.GetStiffness(plant_context)
                rest = spring.GetNominalAngle(plant_context)
            case PrismaticSpring():
                stiffness, rest = spring.stiffness(), spring.nominal_position()
            case _:
                raise ModelError(
                    f": it has a {type(spring).__name__}, which is not written for MuJoCo; "
                    "remove it, or use the springs of joints"
                )
        name = spring.joint().name()
        other, other_rest = found.get(name, (0.0, 0.0))
        total = stiffness + other
        mean = (stiffness * rest + other * other_rest) / total if total else rest
        found[name] = total, mean
    return found


def _add_inertia(element: Element, body: RigidBody, plant_context: Context) -> None:
    """Give a body its mass and its inertia about its centre of mass."""
    spatial = body.CalcSpatialInertiaInBodyFrame(plant_context)
    com = spatial.get_com()
    central = spatial.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
    order = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    SubElement(
        element,
        "inertial",
        pos=_numbers(com),
        mass=repr(float(spatial.get_mass())),
        fullinertia=_numbers(central[order]),
    )


def _add_servos(
    actuators: Element, hinges: dict[str, Element], robot: Robot, plant_context: Context
) -> None:
    """Write the servos' controllers, rotors and friction; joints' damping has the back-EMF."""
    servo = robot.config.servo
    for actuator in servos_of(robot.plant):
        name = actuator.joint().name()
        hinges[name].set("armature", repr(float(actuator.calc_reflected_inertia(plant_context))))
        if servo.has_friction:
            hinges[name].set("frictionloss", repr(servo.coulomb_friction))
        gains, stall = actuator.get_controller_gains(), float(actuator.effort_limit())
        SubElement(
            actuators,
            "position",
            joint=name,
            kp=repr(float(gains.p)),
            kv=repr(float(gains.d)),
            forcerange=_numbers([-stall, stall]),
        )


def _add_contacts(parts: dict[str, Element], elements: dict[Any, Element], robot: Robot) -> None:
    """Write the shapes that may touch each other in Drake, and these pairs."""
    plant, inspector = robot.plant, robot.scene_graph.model_inspector()
    ground = ground_of(plant)
    SubElement(parts["worldbody"], "geom", name=GROUND, type="plane", size="0 0 1")
    names = {ground: [GROUND]}
    bodies = [plant.get_body(index) for index in elements]
    owners = {shape: body for body in bodies for shape in plant.GetCollisionGeometriesForBody(body)}
    # In the order of their making: a set's own differs from process to process.
    candidates = inspector.GetCollisionCandidates()
    pairs = sorted((sorted(pair, key=_number) for pair in candidates), key=_numbers_of)
    for pair in pairs:
        for shape in pair:
            if shape not in names:
                body = owners[shape]
                element = elements[body.index()]
                names[shape] = _add_shape(parts["asset"], element, robot, body, shape)
        friction = _friction(robot, pair)
        for one, other in itertools.product(*(names[shape] for shape in pair)):
            SubElement(
                parts["contact"], "pair", geom1=one, geom2=other, friction=_numbers([friction] * 2)
            )


def _number(shape: GeometryId) -> int:
    return int(shape.get_value())


def _name(shape: GeometryId) -> str:
    return f"shape {_number(shape)}"


def _numbers_of(pair: Sequence[GeometryId]) -> list[int]:
    return [_number(shape) for shape in pair]


def _friction(robot: Robot, pair: Sequence[GeometryId]) -> float:
    """Return the kinetic friction of two shapes, as Drake combines them."""
    inspector = robot.scene_graph.model_inspector()
    one, other = (
        cast(Any, inspector.GetProximityProperties(shape))
        .GetProperty("material", "coulomb_friction")
        .dynamic_friction()
        for shape in pair
    )
    return 2.0 * one * other / (one + other) if one + other > 0.0 else 0.0


def _add_shape(
    assets: Element, element: Element, robot: Robot, body: RigidBody, geometry: GeometryId
) -> list[str]:
    """Write a shape, or the points of a sole; returns their names."""
    inspector = robot.scene_graph.model_inspector()
    shape, X_BG = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
    name = _name(geometry)
    sizes: FloatArray
    match shape:
        case Mesh() if body.name() in robot.model.robot.plates:
            return _add_points(element, shape, X_BG, name)
        case Box():
            kind, sizes = "box", np.array(shape.size()) / 2.0
        case Sphere():
            kind, sizes = "sphere", np.array([shape.radius()])
        case Cylinder():
            kind, sizes = "cylinder", np.array([shape.radius(), shape.length() / 2.0])
        case Capsule():
            kind, sizes = "capsule", np.array([shape.radius(), shape.length() / 2.0])
        case Ellipsoid():
            kind, sizes = "ellipsoid", np.array([shape.a(), shape.b(), shape.c()])
        case Mesh() | Convex():
            kind, sizes = "mesh", np.array([])
        case _:
            raise ModelError(
                f": collision '{inspector.GetName(geometry)}' is a {type(shape).__name__}, which "
                "is not written for MuJoCo; use a box, sphere, cylinder, capsule or mesh"
            )
    geom = SubElement(element, "geom", name=name, type=kind)
    if kind == "mesh":
        hull = inspector.GetConvexHull(geometry)
        vertices = np.array([hull.vertex(index) for index in range(hull.num_vertices())])
        SubElement(assets, "mesh", name=name, vertex=_numbers(vertices.ravel()))
        geom.set("mesh", name)
    else:
        geom.set("size", _numbers(sizes))
    _place(geom, X_BG)
    return [name]


def _add_points(element: Element, mesh: Mesh, X_BG: RigidTransform, name: str) -> list[str]:
    """Write a sphere at each vertex of a sole's mesh, its lowest point there."""
    names = []
    for number, vertex in enumerate(_points(mesh)[0]):
        names.append(f"{name} {number}")
        p_BP = X_BG @ np.add(vertex, (0.0, 0.0, _POINT))
        SubElement(
            element, "geom", name=names[-1], type="sphere", size=repr(_POINT), pos=_numbers(p_BP)
        )
    return names


def _points(mesh: Mesh) -> tuple[FloatArray, np.ndarray]:
    """Return the vertices of a sole's mesh [m], shape (n, 3), and its triangles, shape (m, 3).

    What pieces share is one vertex.
    """
    text = mesh.source().in_memory().mesh_file.contents()
    lines = [line.split() for line in text.decode().splitlines()]
    vertices: FloatArray = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    faces = np.array([line[1:] for line in lines if line[0] == "f"], dtype=int) - 1
    _, first, numbers = np.unique(
        np.round(vertices / _SAME_POINT), axis=0, return_index=True, return_inverse=True
    )
    return vertices[first], numbers.ravel()[faces]
