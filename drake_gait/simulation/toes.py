"""Gives a robot description the toes of a foot design: shapes, masses, inertias and hinges."""

from xml.etree import ElementTree

import numpy as np

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FloatArray

_BOX = "geometry/box/size"
_AXES = "xyz"


def with_toes(sdf: str, foot: FootDesign, *, looks: bool = True) -> str:
    """A robot description with the toes of `foot`; its springs and dampers are not written.

    The outline of the foot stays: both toes keep their tips and their outer edges, and the heel
    part begins where it did and ends at the hinges. Thickness and areal density stay too, so that
    boxes, masses and inertias follow width and length. Toes that are rigid are welded to the heel.

    Args:
        sdf: The description.
        foot: The design.
        looks: Whether to keep what is seen only; a walk does without.

    Raises:
        ModelError: a link of the foot, its box or its inertia is missing.
    """
    # Drake knows its own elements by this prefix alone.
    ElementTree.register_namespace("drake", "http://drake.mit.edu")
    root = ElementTree.fromstring(sdf)
    for side, inward in (("r", 1.0), ("l", -1.0)):
        heel, big, lesser = (
            _link(root, f"{name}_{side}") for name in ("foot", "big_toe", "lesser_toes")
        )
        length, width, _ = _numbers(big, f"collision/{_BOX}")
        growth = length - foot.toe_length  # of the heel part
        if growth:
            density = float(_text(big, "inertial/mass")) / (length * width)  # kg/m²
            _lengthen_heel(heel, growth, density)
        _resize_toe(big, foot.big_toe_width, growth, inward)
        _resize_toe(lesser, foot.lesser_toes_width, growth, -inward)
        if foot.rigid_toes:
            for link in (big, lesser):
                _weld(root, link)
    if not looks:
        for link in root.iter("link"):
            for visual in link.findall("visual"):
                link.remove(visual)
    return ElementTree.tostring(root, encoding="unicode")


def _resize_toe(link: ElementTree.Element, width: float, growth: float, fixed_edge: float) -> None:
    """Give one toe a new width and take `growth` [m] of its length, the rear end.

    Its edge towards `fixed_edge` * y stays where it is, and its tip; its link begins at the hinge.
    """
    old_length, old_width, thickness = _numbers(link, f"collision/{_BOX}")
    length = old_length - growth
    shift = (-growth / 2.0, fixed_edge * (old_width - width) / 2.0, 0.0)
    for kind in ("visual", "collision"):
        _write(link, f"{kind}/{_BOX}", (length, width, thickness))
    for place in ("visual/pose", "collision/pose", "inertial/pose"):
        _move(_find(link, place), shift)
    _move(_find(link, "pose"), (growth, 0.0, 0.0))
    mass = float(_text(link, "inertial/mass")) * (width / old_width) * (length / old_length)
    _write(link, "inertial/mass", (mass,))
    squares = np.array([length, width, thickness]) ** 2
    for axis, moment in zip(_AXES, mass / 12.0 * (squares.sum() - squares), strict=True):
        _write(link, f"inertial/inertia/i{axis}{axis}", (float(moment),))


def _lengthen_heel(link: ElementTree.Element, growth: float, density: float) -> None:
    """Move the front edge of the heel part by `growth` [m], with a strip of `density` [kg/m²]."""
    length, width, thickness = _numbers(link, f"collision/{_BOX}")
    centre: FloatArray = np.array(_numbers(link, "collision/pose")[:3])
    rear = centre[0] - length / 2.0
    front = rear + length
    for kind in ("visual", "collision"):
        for item in link.findall(kind):
            size, pose = item.find(_BOX), item.find("pose")
            if size is None or pose is None:
                continue
            box = [float(value) for value in (size.text or "").split()]
            x = float((pose.text or "").split()[0])
            # The plate, and the rim that runs along it.
            if abs(x - box[0] / 2.0 - rear) < 1e-6 and box[0] > length / 2.0:
                size.text = " ".join(map(repr, [box[0] + growth, *box[1:]]))
                _move(pose, (growth / 2.0, 0.0, 0.0))
    strip_mass = density * growth * width  # negative where the heel part becomes shorter
    squares = np.array([growth, width, thickness]) ** 2
    strip_inertia: FloatArray = np.diag(strip_mass / 12.0 * (squares.sum() - squares))
    strip_com: FloatArray = np.array([front + growth / 2.0, *centre[1:]])
    _join(link, strip_mass, strip_com, strip_inertia)


def _join(link: ElementTree.Element, mass: float, com: FloatArray, inertia: FloatArray) -> None:
    """Add a mass [kg] at `com` [m] with a central inertia [kg·m²] to a link."""
    own_mass = float(_text(link, "inertial/mass"))
    own_com: FloatArray = np.array(_numbers(link, "inertial/pose")[:3])
    total = own_mass + mass
    joint_com = (own_mass * own_com + mass * com) / total
    tensor: FloatArray = inertia.copy()
    for row, column in zip(*np.triu_indices(3), strict=True):
        value = float(_text(link, f"inertial/inertia/i{_AXES[row]}{_AXES[column]}"))
        tensor[row, column] += value
        if row != column:
            tensor[column, row] += value
    for part_mass, part_com in ((own_mass, own_com), (mass, com)):
        arm = part_com - joint_com
        tensor += part_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))  # parallel axes
    _write(link, "inertial/mass", (total,))
    _move(_find(link, "inertial/pose"), tuple((joint_com - own_com).tolist()))
    for row, column in zip(*np.triu_indices(3), strict=True):
        name = f"inertial/inertia/i{_AXES[row]}{_AXES[column]}"
        _write(link, name, (float(tensor[row, column]),))


def _weld(root: ElementTree.Element, toe: ElementTree.Element) -> None:
    """Make the hinge of a toe a fixed joint of the same name."""
    for joint in root.iter("joint"):
        if joint.findtext("child") == toe.get("name"):
            joint.set("type", "fixed")
            for axis in joint.findall("axis"):
                joint.remove(axis)


def _link(root: ElementTree.Element, name: str) -> ElementTree.Element:
    link = root.find(f".//link[@name='{name}']")
    if link is None:
        raise ModelError(f"no link '{name}'")
    return link


def _find(link: ElementTree.Element, path: str) -> ElementTree.Element:
    found = link.find(path)
    if found is None:
        raise ModelError(f"link '{link.get('name')}' has no <{path}>")
    return found


def _text(link: ElementTree.Element, path: str) -> str:
    return _find(link, path).text or ""


def _numbers(link: ElementTree.Element, path: str) -> list[float]:
    return [float(value) for value in _text(link, path).split()]


def _write(link: ElementTree.Element, path: str, values: tuple[float, ...]) -> None:
    _find(link, path).text = " ".join(map(repr, values))


def _move(pose: ElementTree.Element, shift: tuple[float, ...]) -> None:
    """Add a shift [m] to the place in a pose."""
    place, angles = (pose.text or "").split()[:3], (pose.text or "").split()[3:]
    moved = [float(value) + by for value, by in zip(place, shift, strict=True)]
    pose.text = " ".join([*map(repr, moved), *angles])
