"""Checks of a robot description: text that Drake would misread is refused with its line.

Drake takes the beginning of `1,373` or `1.4 N m` for a number, and a default for what is missing.
"""

import copy
import re
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from xml.etree.ElementTree import Element

import numpy as np

from drake_gait.errors import ModelError
from drake_gait.robot.robot_file import RobotFile, default_robot
from drake_gait.robot.sdf import (
    MU_DYNAMIC,
    MU_STATIC,
    PROXIMITY,
    Description,
    Format,
    find_link,
    frictions,
    uris,
)

_COMPLIANT = ("drake:compliant_hydroelastic", "drake:hydroelastic_modulus")

_ONE = frozenset(
    {
        *("mass", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "radius", "length"),
        *("lower", "upper", "effort", "velocity", "stiffness", "dissipation"),
        *("damping", "friction", "spring_reference", "spring_stiffness", "mu", "mu2"),
        *(MU_STATIC, MU_DYNAMIC, "drake:hydroelastic_modulus", "drake:hunt_crossley_dissipation"),
        *("drake:relaxation_time", "drake:point_contact_stiffness", "drake:mesh_resolution_hint"),
        *("drake:hydroelastic_margin", "drake:rotor_inertia", "drake:gear_ratio"),
        "drake:acceleration",
    }
)
"""Elements that hold one number."""
_THREE = frozenset({"size", "xyz", "radii", "scale", "normal"})
"""Elements that hold three."""
_COUNTS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    dict.fromkeys(_ONE, (1,)) | dict.fromkeys(_THREE, (3,)) | {"pose": (6, 7)}
)
_POSITIVE = frozenset({"mass", "size", "radius", "length", "radii", "drake:hydroelastic_modulus"})
_NOT_NEGATIVE = frozenset(
    {
        *("damping", "friction", "spring_stiffness", "mu", "mu2", MU_STATIC, MU_DYNAMIC),
        *("drake:hunt_crossley_dissipation", "drake:relaxation_time", "drake:rotor_inertia"),
        *("drake:point_contact_stiffness", "drake:gear_ratio"),
    }
)
_MAY_BE_INFINITE = frozenset({"lower", "upper", "velocity", "effort"})
_NAMES = frozenset(
    {
        *("parent", "child", "uri", "name", "relative_to", "attached_to", "frame", "joint"),
        *("link", "filename", "version", "encoding", "type", "drake:member"),
        *("drake:ignored_collision_filter_group", "drake:diffuse_map"),
    }
)
"""Elements and attributes that hold words, which may begin with a digit."""
_WORDS = _NAMES | {
    *("class", "childclass", "file", "meshdir", "texturedir", "mesh", "material", "joint1"),
    *("joint2", "body1", "body2", "body", "site", "texture", "model", "builtin", "content"),
    *("xyz_units", "dclass", "geom1", "geom2", "target"),
}
"""Attributes of URDF and MJCF that hold words."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
_BEGINS_LIKE_ONE = re.compile(r"[+-]?[.,]?\d")


@lru_cache(maxsize=8)
def checked(content: bytes, robot: RobotFile) -> Description:
    """The elements of a description that walks as it says.

    Not to be changed: `tree` gives elements that may be.

    Args:
        content: The description.
        robot: Names its links and joints.

    Raises:
        ModelError: a link, a joint, a number or the format cannot be used. The text lacks the name
            of the file.
    """
    description = Description(content)
    if description.format is Format.SDF:
        description.model()
        _check_numbers(description)
    else:
        _check_attributes(description, robot)
    _check_names(description, robot)
    if description.format is Format.SDF:
        for link in description.elements("link"):
            _check_link(description, link)
        for joint in description.elements("joint"):
            _check_joint(description, joint, robot)
        for name in robot.plates:
            alone = robot.outline is not None and robot.is_toe(name)
            _check_boxes(description, find_link(description.root, name), alone=alone)
    return description


def tree(content: bytes, robot: RobotFile) -> Element:
    """The elements of a description, to be changed.

    Raises:
        ModelError: see `checked`.
    """
    return copy.deepcopy(checked(content, robot).root)


def named_files(content: bytes, robot: RobotFile) -> dict[str, tuple[str, bool]]:
    """The files that a description names: by URI, where, in words, and whether a shape collides.

    Raises:
        ModelError: see `checked`.
    """
    description = checked(content, robot)
    return {
        one.uri: (str(description.refusal(one.element, one.what)), one.collides)
        for one in uris(description.root)
    }


def efforts(content: bytes, robot: RobotFile) -> dict[str, float]:
    """The effort limits of a URDF's joints [N·m]; Drake reads them of joints with a transmission.

    Raises:
        ModelError: see `checked`.
    """
    description = checked(content, robot)
    if description.format is not Format.URDF:
        return {}
    limits = {one.get("name") or "": one.find("limit") for one in description.elements("joint")}
    return {
        name: float(limit.get("effort", "0")) for name, limit in limits.items() if limit is not None
    }


def _check_attributes(description: Description, robot: RobotFile) -> None:
    """Refuse an attribute of which one word is a number and another begins like one."""
    for element in description.root.iter():
        for key, value in element.attrib.items():
            if key in _WORDS or key.startswith("xmlns"):
                continue
            _check_text(description, element, f"{key} of <{element.tag}>", value, ())
            if key == "stiffness" and element.get("name") not in (None, *robot.hinges):
                raise description.refusal(
                    element,
                    f"joint '{element.get('name')}' has a stiffness, which Drake does not read; "
                    "remove it",
                )
            # In an MJCF, sizes of planes may be 0.
            name = element.tag if key == "value" else key
            if description.format is Format.URDF or name not in ("size", "length", "radius"):
                _check_sign(description, element, name, value)


def _check_numbers(description: Description) -> None:
    """Refuse text that begins like a number and is none: Drake would take its beginning."""
    for parent in description.root.iter():
        for key, value in parent.attrib.items():
            if key not in _NAMES and not key.startswith("xmlns"):
                _check_text(description, parent, f"{key} of <{parent.tag}>", value, ())
        for element in parent:
            # An element with others inside holds no number.
            if len(element) or element.tag in _NAMES:
                continue
            empty = not (element.text or "").strip()
            if empty and (element.tag == "pose" or parent.tag == "surface"):
                continue
            counts = _COUNTS.get(element.tag, ())
            _check_text(description, element, f"<{element.tag}>", element.text or "", counts)


def _check_text(
    description: Description, element: Element, what: str, text: str, counts: tuple[int, ...]
) -> None:
    words = text.split()
    if not counts and not _BEGINS_LIKE_ONE.match(text.strip()):
        return
    infinite = element.tag in _MAY_BE_INFINITE
    good = all(
        _NUMBER.fullmatch(word) or (infinite and _INFINITE.fullmatch(word)) for word in words
    )
    if good and (not counts or len(words) in counts):
        if counts:
            _check_sign(description, element, element.tag, text)
        return
    wanted = {(): "numbers", (1,): "a number", (3,): "three numbers"}.get(counts, "six numbers")
    raise description.refusal(
        element,
        f"{_owner(description, element)}{what} must be {wanted}, got '{text}'; write finite "
        "numbers with a point, without a unit",
    )


def _check_sign(description: Description, element: Element, name: str, text: str) -> None:
    positive, not_negative = name in _POSITIVE, name in _NOT_NEGATIVE
    for word in text.split():
        if (positive and not float(word) > 0.0) or (not_negative and not float(word) >= 0.0):
            raise description.refusal(
                element,
                f"{_owner(description, element)}<{name}> must be "
                f"{'> 0' if positive else '>= 0'}, got '{text}'",
            )


def _owner(description: Description, wanted: Element) -> str:
    """The link or the joint that an element is of, in words."""
    for tag in ("link", "joint"):
        # The innermost: bodies of an MJCF hold each other.
        for owner in reversed(description.elements(tag)):
            if any(element is wanted for element in owner.iter()):
                return f"{tag} '{owner.get('name')}': "
    return ""


def _check_names(description: Description, robot: RobotFile) -> None:
    for kind, wanted in (("link", robot.links), ("joint", robot.named_joints)):
        there = description.names(kind)
        for name in wanted:
            if name not in there:
                told = f": no {kind} '{name}'; it has {', '.join(there) or 'none'}"
                edited = robot.identity == default_robot().identity
                cure = "; a robot that is no KHR-3HV needs a robot's file, robot.file"
                raise ModelError(f"{told}{cure if edited else ''}")
    called: dict[str, Element] = {}
    elements = [*description.elements("link"), *description.elements("joint")]
    if description.format is Format.SDF:
        elements += description.elements("frame")
    for element in elements:
        # In URDF and MJCF a link and a joint may have one name.
        name, kind = element.get("name") or "", element.tag
        key = name if description.format is Format.SDF else f"{kind} {name}"
        if name and called.setdefault(key, element) is not element:
            raise description.refusal(
                element, f"two elements are called '{name}'; rename this <{element.tag}>"
            )


def _check_link(description: Description, link: Element) -> None:
    """Refuse masses that Drake would take a default for, and impossible inertia or friction."""
    name = link.get("name")
    for path, default in (("mass", "1 kg"), *((f"inertia/{one}", "1 kg·m²") for one in _MOMENTS)):
        if link.find(f"inertial/{path}") is None:
            raise description.refusal(
                link, f"link '{name}' has no <inertial/{path}>, and would have {default}; add it"
            )
    inertia = link.find("inertial/inertia")
    if inertia is not None and not _is_physical(inertia):
        raise description.refusal(
            inertia,
            f"link '{name}': <inertia> is that of no body; its principal moments must be > 0, and "
            "none larger than the other two together",
        )
    for collision in link.findall("collision"):
        static, dynamic = frictions(collision)
        if not dynamic <= static:
            raise description.refusal(
                collision,
                f"link '{name}', collision '{collision.get('name')}': dynamic friction must be at "
                f"most the static one, got {dynamic:g} and {static:g}",
            )


_MOMENTS = ("ixx", "iyy", "izz")
_ROUNDING = 1e-6


def _is_physical(inertia: Element) -> bool:
    """Tell whether a body can have such an inertia, but for rounding; Drake looks more closely."""
    xx, yy, zz, xy, xz, yz = (
        float(inertia.findtext(f"i{pair}") or 0.0) for pair in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(moments[0] > 0.0 and moments[0] + moments[1] > (1.0 - _ROUNDING) * moments[2])


def _check_joint(description: Description, joint: Element, robot: RobotFile) -> None:
    name = joint.get("name") or ""
    effort = joint.find("axis/limit/effort")
    value = None if effort is None else float(effort.text or "")
    where = joint if effort is None else effort
    usable = value is not None and 0.0 < value < float("inf")
    if name in robot.joints and robot.stall_of(name) is None and not usable:
        raise description.refusal(
            where,
            f"joint '{name}': <effort> must be the stall torque of its servo, > 0 N·m, got "
            f"{'none' if value is None else f'{value:g}'}",
        )
    if name in robot.hinges and joint.get("type") != "fixed" and value != 0.0:
        raise description.refusal(
            where,
            f"joint '{name}': <effort> must be 0, as a toe has no servo, got "
            f"{'none' if value is None else f'{value:g}'}",
        )
    axis = joint.find("axis/xyz")
    if axis is not None and not any(float(word) for word in (axis.text or "").split()):
        raise description.refusal(
            axis, f"joint '{name}': <xyz> must be a direction, got {axis.text}"
        )
    if (gains := joint.find("drake:controller_gains")) is not None:
        raise description.refusal(
            gains, f"joint '{name}': <drake:controller_gains> are those of [servo]; remove them"
        )


def _check_boxes(description: Description, link: Element, *, alone: bool) -> None:
    """Refuse a foot whose soles are no boxes: what they touch and reach is read from those."""
    name, collisions = link.get("name"), link.findall("collision")
    for collision in collisions:
        if collision.find("geometry/box/size") is None:
            shape = collision.find("geometry/*")
            raise description.refusal(
                collision,
                f"link '{name}' must touch the ground with a <box>, got "
                f"<{'nothing' if shape is None else shape.tag}>; use a box",
            )
        properties = collision.find(PROXIMITY)
        if properties is None or any(properties.find(one) is None for one in _COMPLIANT):
            raise description.refusal(
                collision,
                f"link '{name}' must touch the ground with a compliant surface, of which slip and "
                f"duty are measured; give its <{PROXIMITY}> {' and '.join(_COMPLIANT)}",
            )
    if not collisions or (len(collisions) > 1 and alone):
        raise description.refusal(
            collisions[1] if collisions else link,
            f"link '{name}' must have one <collision>, a box, got {len(collisions)}",
        )
