"""Gives a robot description the toes of a foot design: shapes, masses, inertias and hinges."""

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FloatArray
from drake_gait.robot.robot_file import Outline, RobotFile
from drake_gait.robot.sdf import find_link

_BOX = "geometry/box/size"
_AXES = "xyz"
_NOWHERE = "0 0 0 0 0 0"

_SAME = 1e-9
"""Lengths that differ by less are the same [m]."""
_LIKE_A_PLATE = 1e-5
"""Part by which a toe's moments may differ from those of its plate."""


def with_toes(root: Element, foot: FootDesign, robot: RobotFile) -> None:
    """Give a robot description the toes of `foot`; its springs and dampers are not written.

    The outline of the foot stays: both toes keep their tips and their outer edges. The heel part
    begins where it did and ends at the hinges. Thickness and areal density stay too, so that
    boxes, masses and inertias follow width and length. Toes that are rigid are welded to the heel.

    Args:
        root: The description, which is changed.
        foot: The design.
        robot: The robot's file, with the outline of its feet.

    Raises:
        ModelError: the foot of the description cannot be given this design.
    """
    outline = robot.outline
    if outline is None:
        raise ModelError(": its toes are not designed; give the robot's file [toes]")
    for leg, inward in zip(robot.legs, (1.0, -1.0), strict=True):
        heel, big, *others = (find_link(root, name) for name in leg.plates)
        length, width, _ = _numbers(big, f"collision/{_BOX}")
        _check_plates([big, *others], outline)
        growth = length - foot.toe_length  # of the heel part
        if growth:
            density = float(_text(big, "inertial/mass")) / (length * width)  # kg/m²
            _lengthen_heel(heel, growth, density)
        if not others:  # One toe is as wide as the foot.
            _resize_toe(big, outline.width, growth, inward)
        else:
            _resize_toe(big, foot.big_toe_width, growth, inward)
            rest = outline.width - foot.big_toe_width - outline.gap
            if not rest > 0.0:
                raise ModelError(
                    f": a big toe of {1e3 * foot.big_toe_width:g} mm leaves nothing of the foot's "
                    f"{1e3 * outline.width:g} mm for the lesser toes; make it narrower"
                )
            _resize_toe(others[0], rest, growth, -inward)
        if foot.rigid_toes:
            for link in (big, *others):
                _weld(root, link)


def _check_plates(toes: Sequence[Element], outline: Outline) -> None:
    """Refuse toes that are not as wide and as long as those of the designs are."""
    sizes = [_numbers(toe, f"collision/{_BOX}") for toe in toes]
    named = " and ".join(f"'{toe.get('name')}'" for toe in toes)
    total = sum(width for _, width, _ in sizes) + outline.gap * (len(toes) - 1)
    if abs(total - outline.width) > _SAME:
        raise ModelError(
            f": the toes {named} are {1e3 * total:g} mm wide with their gap of "
            f"{1e3 * outline.gap:g} mm; a designed foot is {1e3 * outline.width:g} mm wide: give "
            "their boxes the rest of it"
        )
    lengths = [length for length, _, _ in sizes]
    if max(lengths) - min(lengths) > _SAME:
        raise ModelError(
            f": the toes {named} are {' and '.join(f'{1e3 * one:g}' for one in lengths)} mm long; "
            "make their boxes equally long"
        )


def _resize_toe(link: Element, width: float, growth: float, fixed_edge: float) -> None:
    """Give one toe a new width and take `growth` [m] of its length, the rear end.

    Its edge towards `fixed_edge` * y stays where it is, and its tip; its link begins at the hinge.
    """
    old = _numbers(link, f"collision/{_BOX}")
    old_length, old_width, thickness = old
    length = old_length - growth
    shift = (-growth / 2.0, fixed_edge * (old_width - width) / 2.0, 0.0)
    _resize_inertia(link, old, (length, width, thickness), shift)
    for kind in ("visual", "collision"):
        for item in link.findall(kind):
            size = item.find(_BOX)
            # What is seen of the plate goes with it.
            if size is not None and np.allclose(_values(size), old, rtol=0.0, atol=_SAME):
                size.text = " ".join(map(repr, (length, width, thickness)))
                _move(_pose(item), shift)
    _move(_pose(link), (growth, 0.0, 0.0))


def _resize_inertia(
    link: Element,
    old: list[float],
    new: tuple[float, float, float],
    shift: tuple[float, float, float],
) -> None:
    """Give a toe mass and inertia of its plate, which has another size [m] and was moved [m]."""
    mass = float(_text(link, "inertial/mass"))
    if not _is_plate(link, mass, old):
        raise ModelError(
            f": link '{link.get('name')}': <inertial> must be that of a plate of its mass and box, "
            "in the box's middle, so that it is known of other sizes; give it that"
        )
    length, width, _ = new
    mass = mass * (width / old[1]) * (length / old[0])
    _move(_pose(_find(link, "inertial")), shift)
    _write(link, "inertial/mass", (mass,))
    squares = np.array(new) ** 2
    for axis, moment in zip(_AXES, mass / 12.0 * (squares.sum() - squares), strict=True):
        _write(link, f"inertial/inertia/i{axis}{axis}", (float(moment),))


def _is_plate(link: Element, mass: float, size: list[float]) -> bool:
    """Return whether a link has the inertia of a plate of its mass and size."""
    squares = np.array(size) ** 2
    wanted = mass / 12.0 * (squares.sum() - squares)
    found = [float(_text(link, f"inertial/inertia/i{axis}{axis}")) for axis in _AXES]
    products = [_product(link, pair) for pair in ("xy", "xz", "yz")]
    middle = _values(_pose(_find(link, "collision")))
    com = _values(_pose(_find(link, "inertial")))
    return (
        np.allclose(found, wanted, rtol=_LIKE_A_PLATE, atol=0.0)
        and np.abs(products).max() <= _LIKE_A_PLATE * min(wanted)
        and np.allclose(com[:3], middle[:3], rtol=0.0, atol=_SAME)
        and not any(com[3:])
    )


def _lengthen_heel(link: Element, growth: float, density: float) -> None:
    """Move the front edge of the heel part by `growth` [m], with a strip of `density` [kg/m²]."""
    if len(link.findall("collision")) != 1:
        raise ModelError(
            f": link '{link.get('name')}' has {len(link.findall('collision'))} collisions, so that "
            "it is not known which ends at the toes; give it one box"
        )
    length, width, thickness = _numbers(link, f"collision/{_BOX}")
    centre: FloatArray = np.array(_values(_pose(_find(link, "collision")))[:3])
    rear = centre[0] - length / 2.0
    front = rear + length
    for kind in ("visual", "collision"):
        for item in link.findall(kind):
            size = item.find(_BOX)
            if size is None:
                continue
            box, pose = _values(size), _pose(item)
            x = _values(pose)[0]
            # The plate, and the rim that runs along it.
            if abs(x - box[0] / 2.0 - rear) < 1e-6 and box[0] > length / 2.0:
                size.text = " ".join(map(repr, [box[0] + growth, *box[1:]]))
                _move(pose, (growth / 2.0, 0.0, 0.0))
    strip_mass = density * growth * width  # negative where the heel part becomes shorter
    squares = np.array([growth, width, thickness]) ** 2
    strip_inertia: FloatArray = np.diag(strip_mass / 12.0 * (squares.sum() - squares))
    strip_com: FloatArray = np.array([front + growth / 2.0, *centre[1:]])
    _join(link, strip_mass, strip_com, strip_inertia)


def _join(link: Element, mass: float, com: FloatArray, inertia: FloatArray) -> None:
    """Add a mass [kg] at `com` [m] with a central inertia [kg·m²] to a link."""
    own_mass = float(_text(link, "inertial/mass"))
    own = _values(_pose(_find(link, "inertial")))
    if any(own[3:6]):
        raise ModelError(
            f": link '{link.get('name')}' has an <inertial/pose> that is turned; give its inertia "
            "along the link's axes"
        )
    own_com: FloatArray = np.array(own[:3])
    total = own_mass + mass
    joint_com = (own_mass * own_com + mass * com) / total
    tensor: FloatArray = inertia.copy()
    for row, column in zip(*np.triu_indices(3), strict=True):
        value = _product(link, f"{_AXES[row]}{_AXES[column]}")
        tensor[row, column] += value
        if row != column:
            tensor[column, row] += value
    for part_mass, part_com in ((own_mass, own_com), (mass, com)):
        arm = part_com - joint_com
        tensor += part_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))  # parallel axes
    _write(link, "inertial/mass", (total,))
    _move(_pose(_find(link, "inertial")), tuple((joint_com - own_com).tolist()))
    for row, column in zip(*np.triu_indices(3), strict=True):
        name = f"i{_AXES[row]}{_AXES[column]}"
        _child(_find(link, "inertial/inertia"), name, "0").text = repr(float(tensor[row, column]))


def _weld(root: Element, toe: Element) -> None:
    """Make the hinge of a toe a fixed joint of the same name."""
    for joint in root.iter("joint"):
        if (joint.findtext("child") or "").strip() == toe.get("name"):
            joint.set("type", "fixed")
            for axis in joint.findall("axis"):
                joint.remove(axis)


def _find(link: Element, path: str) -> Element:
    found = link.find(path)
    if found is None:
        raise ModelError(f": link '{link.get('name')}' has no <{path}>; add it")
    return found


def _text(link: Element, path: str) -> str:
    return _find(link, path).text or ""


def _numbers(link: Element, path: str) -> list[float]:
    return _values(_find(link, path))


def _values(element: Element) -> list[float]:
    return [float(value) for value in (element.text or "").split()]


def _product(link: Element, pair: str) -> float:
    """A moment or product of inertia of a link [kg·m²]; 0 where none is written."""
    return float(link.findtext(f"inertial/inertia/i{pair}") or 0.0)


def _child(parent: Element, tag: str, text: str) -> Element:
    """An element inside another; made where it is missing or empty, as it is by default."""
    found = parent.find(tag)
    if found is None:
        found = ElementTree.SubElement(parent, tag)
    if not (found.text or "").strip():
        found.text = text
    return found


def _pose(parent: Element) -> Element:
    return _child(parent, "pose", _NOWHERE)


def _write(link: Element, path: str, values: tuple[float, ...]) -> None:
    _find(link, path).text = " ".join(map(repr, values))


def _move(pose: Element, shift: tuple[float, ...]) -> None:
    """Add a shift [m] to the place in a pose."""
    place, angles = (pose.text or "").split()[:3], (pose.text or "").split()[3:]
    moved = [float(value) + by for value, by in zip(place, shift, strict=True)]
    pose.text = " ".join([*map(repr, moved), *angles])
