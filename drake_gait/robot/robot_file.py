"""A robot's file: the names, signs and numbers that a walk needs beside the robot's model.

A gait gives angles of ten roles, `gait.JOINTS`, in the KHR-3HV's signs. The file says which joint
of the model plays each role.
"""

import json
import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import StrEnum
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from drake_gait.errors import ModelError, SettingsError
from drake_gait.files.text import read_text
from drake_gait.foot import N_MM_PER_DEG
from drake_gait.gait import JOINTS
from drake_gait.ranges import DEGREES, MM, NONE, OutOfRangeError, Range, Unit, check
from drake_gait.servo import KEYS as SERVO
from drake_gait.servo import TRAVEL, Servo
from drake_gait.walk import DEFAULT_ROBOT

SUFFIX = ".toml"
"""Ending of the name of a robot's file."""
SIDES = ("right", "left")
"""Legs of a robot, in the order of every array of pairs."""
ROLES = tuple(name.removesuffix("_r") for name in JOINTS[: len(JOINTS) // 2])
"""Roles of the joints of a leg, ordered as in `gait.JOINTS`."""
TOES = ("big_toe", "lesser_toes")
"""Toes that a foot may have, in the order of every array of toe values."""


class Others(StrEnum):
    """How joints are held that play no role, as those of arms, a head, or hips that yaw."""

    SERVO = "servo"
    """By servos that are sent the standing pose."""
    WELD = "weld"
    """They are welded in the standing pose, which walks faster."""
    FREE = "free"
    """They swing as the model says, and have no servos."""


@dataclass(frozen=True, kw_only=True)
class Toe:
    """A passive toe, whose link turns about a hinge with a spring."""

    link: str
    """Name of its link."""
    hinge: str
    """Name of its joint."""
    stiffness: float | None = None
    """Stiffness of its spring [N·m/rad]; None: the model has one, or toes are designed."""
    damping: float | None = None
    """Damping of its hinge [N·m·s/rad]; None: the model's."""


@dataclass(frozen=True, kw_only=True)
class Leg:
    """The joints and links of one leg."""

    joints: tuple[str | None, ...]
    """Joint of each of ROLES; None: the robot has none."""
    signs: tuple[int, ...]
    """1 where that joint turns as the KHR-3HV's, -1 where it turns against it; as ROLES."""
    ankle: str
    """Link whose origin stands for the ankle."""
    foot: str
    """Link that touches the ground: the whole foot, or its heel part where there are toes."""
    toes: tuple[Toe | None, ...]
    """Toes, ordered as TOES; None: the foot has none."""

    @property
    def plates(self) -> tuple[str, ...]:
        """Return the links of the foot: first the heel part, then the toes."""
        return (self.foot, *(toe.link for toe in self.toes if toe))

    @property
    def hinges(self) -> tuple[str | None, ...]:
        """Return the hinge of each of TOES."""
        return tuple(toe.hinge if toe else None for toe in self.toes)


@dataclass(frozen=True, kw_only=True)
class Outline:
    """Outline of a foot whose toes are designed; it stays, whatever they are."""

    width: float
    """Width of the whole foot [m]."""
    gap: float
    """Gap between its toes [m]."""


@dataclass(frozen=True, kw_only=True)
class ServoGroup:
    """Servos of a group of joints, beside those of the others.

    A study that has other servos than the robot's file scales those of all groups alike.
    """

    stiffness: float = 1.0
    """Their stiffness / that of the others."""
    damping: float = 1.0
    """Their damping / that of the others."""
    no_load_speed: float = 1.0
    """Their no-load speed / that of the others."""
    stall_torque: float | None = None
    """Their stall torque [N·m]; None: as the others."""


OTHER_JOINTS = "others"
"""Group of the joints without a role; other groups have the names of ROLES."""


@dataclass(frozen=True, kw_only=True)
class RobotFile:
    """All that a robot's file says; two are equal if they mean the same robot."""

    name: str = field(compare=False)
    """Name of the robot for people."""
    model: str = field(compare=False)
    """Path of its model, from the file's folder: SDFormat, URDF or MJCF."""
    text: str = field(compare=False, repr=False)
    """The file's text."""
    torso: str
    """Link that floats, whose posture is that of the robot."""
    legs: tuple[Leg, Leg]
    """Right leg, left leg."""
    outline: Outline | None = None
    """Outline of the feet whose toes are designed; None: toes are as the model has them."""
    standing: tuple[tuple[str, float], ...] | None = None
    """Joints with their angles [rad] in the standing pose, others are at 0.

    Such a robot is put on the ground in this pose. None: it stands as its model says.
    """
    others: Others = Others.WELD
    """How joints without a role are held."""
    servo: Servo = field(default_factory=Servo)
    """Servos of all joints, but for what `groups` says."""
    stall_torque: float | None = None
    """Stall torque of the servos [N·m]; None: the model's own effort limits."""
    groups: tuple[tuple[str, ServoGroup], ...] = ()
    """Groups of joints that have servos of their own, by the names of ROLES, or OTHER_JOINTS."""
    fall_lean: float = math.radians(45.0)
    """The robot has fallen when its torso leans further than this from upright [rad]."""
    fall_height: float = 0.8
    """The robot has fallen when its torso is below this part of its standing height."""
    com_height: float | None = None
    """Smallest height of the centre of mass at the end of a feasible walk [m], Eq. 13."""
    load: float | None = None
    """Vertical force from which a foot counts as carrying load [N]; None: 3 % of the weight."""

    @property
    def joints(self) -> tuple[str | None, ...]:
        """Return the joint of each role, ordered as `gait.JOINTS`."""
        return tuple(name for leg in self.legs for name in leg.joints)

    @property
    def signs(self) -> tuple[int, ...]:
        """Return the sign of each role, ordered as `gait.JOINTS`."""
        return tuple(sign for leg in self.legs for sign in leg.signs)

    @property
    def plates(self) -> tuple[str, ...]:
        """Return the links of the feet: those of the right one, then those of the left one."""
        return tuple(link for leg in self.legs for link in leg.plates)

    @property
    def hinges(self) -> tuple[str | None, ...]:
        """Return the hinge of each toe: right big, right lesser, left big, left lesser."""
        return tuple(hinge for leg in self.legs for hinge in leg.hinges)

    @property
    def links(self) -> tuple[str, ...]:
        """Return all links that a walk, its measures and its recording know by name."""
        named = (self.torso, *(leg.ankle for leg in self.legs), *self.plates)
        return tuple(dict.fromkeys(named))

    @property
    def named_joints(self) -> tuple[str, ...]:
        """Return all joints that it names: those with a role, hinges, and those that stand bent."""
        named = (*self.joints, *self.hinges, *dict(self.standing or ()))
        return tuple(dict.fromkeys(name for name in named if name is not None))

    def group_of(self, joint: str) -> ServoGroup:
        """Return what the servo of a joint has of its own."""
        role = ROLES[self.joints.index(joint) % len(ROLES)] if joint in self.joints else None
        return dict(self.groups).get(role or OTHER_JOINTS, ServoGroup())

    def stall_of(self, joint: str) -> float | None:
        """Return the stall torque of a joint's servo [N·m]; None: the model's effort limit."""
        own = self.group_of(joint).stall_torque
        return self.stall_torque if own is None else own

    def is_left(self, link: str) -> bool:
        """Return whether a link is one of the left foot."""
        return link in self.legs[1].plates

    def is_toe(self, link: str) -> bool:
        """Return whether a link is a toe."""
        return link not in (leg.foot for leg in self.legs)

    @property
    def foot_fields(self) -> frozenset[str]:
        """Return the fields of `FootDesign` that mean something on its feet."""
        if self.outline is None:
            return frozenset()
        one = {"big_toe_stiffness", "toe_damping", "toe_length", "rigid_toes"}
        both = {"lesser_toes_stiffness", "big_toe_width"}
        return frozenset(one | both if self.legs[0].toes[1] else one)

    @property
    def identity(self) -> str:
        """Return the meaning of its text: all of its keys but the names, and no comments."""
        content = tomllib.loads(self.text)
        said = {key: value for key, value in content.items() if key not in ("name", "model")}
        return json.dumps(said, sort_keys=True)


def robots_folder() -> Path:
    """Return the folder of the shipped robots' files: in an installed package, or beside it."""
    inside = Path(str(files("drake_gait"))) / "robots"
    return inside if inside.is_dir() else inside.parents[1] / "robots"


def is_robot_file(name: object) -> bool:
    """Return whether a path or a name is that of a robot's file, not of a model."""
    return isinstance(name, str | Path) and Path(name).suffix.lower() == SUFFIX


def shipped_robots() -> list[str]:
    """Return the names of the shipped robots' files."""
    return sorted(path.name for path in robots_folder().glob(f"*{SUFFIX}"))


def robot_path(name: str | Path) -> Path:
    """Return the path of a robot's file, given as a path or as the name of a shipped one.

    Raises:
        ModelError: there is no such file.
    """
    path = robots_folder() / name if str(name) in shipped_robots() else Path(name)
    if not path.is_file():
        raise ModelError(
            f"no robot's file '{name}'; give a path to one, or one of {', '.join(shipped_robots())}"
        )
    return path


def read_robot_file(name: str | Path = DEFAULT_ROBOT) -> RobotFile:
    """Read a robot's file.

    Raises:
        ModelError: there is none, or a key or a value of it cannot be used.
    """
    path = robot_path(name)
    try:
        text = read_text(path, "robot's file")
    except SettingsError as error:
        raise ModelError(str(error)) from None
    return parsed(text, str(name))


def default_robot() -> RobotFile:
    """Return the robot of models that come without a robot's file."""
    return _default()


@lru_cache(maxsize=1)
def _default() -> RobotFile:
    return read_robot_file(DEFAULT_ROBOT)


@lru_cache(maxsize=16)
def parsed(text: str, name: str) -> RobotFile:
    """Return the robot that a text tells of.

    Args:
        text: Content of a robot's file.
        name: How the user names the file, for messages.

    Raises:
        ModelError: a key or a value of it cannot be used.
    """
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ModelError(f"{name} is not TOML: {error}") from None
    try:
        return _robot(content, text)
    except (ModelError, SettingsError) as error:
        raise ModelError(f"{name}: {error}") from None


_TABLES = {
    "right": (*ROLES, "ankle_link", "foot_link", *TOES),
    "left": (*ROLES, "ankle_link", "foot_link", *TOES),
    "toes": ("width_mm", "gap_mm"),
    "standing_deg": None,
    "servo": (*SERVO, "stall_torque_n_m", *ROLES, OTHER_JOINTS),
    "fall": ("lean_deg", "height"),
    "limits": ("com_height_mm", "load_n"),
}
"""Tables of a robot's file, with their keys; those of the standing pose are joints."""
_WORDS = ("name", "model", "torso", "others")
_SIZE = Range(lower=0.0, upper=10.0, open=True)  # m
_LEAN = Range(lower=math.radians(5.0), upper=math.radians(90.0))
_PART = Range(lower=0.1, upper=1.0, open=True)
_TORQUE = Range(lower=0.0, upper=1e4, open=True)
_STALL = "stall_torque_n_m"
_OF_GROUPS = tuple(
    key for key, (name, _) in SERVO.items() if name in ("stiffness", "damping", "no_load_speed")
)
_STIFFNESS, _DAMPING = "stiffness_n_mm_per_deg", "damping_n_m_s_per_rad"
_N_MM_DEG = Unit(name="N·mm/deg", si=N_MM_PER_DEG)
_N_M, _N = Unit(name="N·m"), Unit(name="N")


def _robot(content: Mapping[str, Any], text: str) -> RobotFile:
    _known("key", content, (*_WORDS, *_TABLES))
    for name, keys in _TABLES.items():
        table = content.get(name, {})
        if not isinstance(table, Mapping):
            raise ModelError(f"[{name}] must be a table, got {table!r}")
        if keys is not None:
            _known(f"key of [{name}]", table, keys)
    others = content.get("others", Others.WELD)
    if others not in tuple(Others):
        raise ModelError(f"others must be one of {', '.join(Others)}, got {others!r}")
    legs = _leg("right", content), _leg("left", content)
    _check_legs(*legs)
    fall, limits = content.get("fall", {}), content.get("limits", {})
    table = dict(content.get("servo", {}))
    stall = table.pop(_STALL, None)
    of_groups = {name: table.pop(name) for name in (*ROLES, OTHER_JOINTS) if name in table}
    servo = _servo(table)
    return RobotFile(
        name=_word("name", content.get("name", "robot")),
        model=_word("model", content.get("model")),
        text=text,
        torso=_word("torso", content.get("torso")),
        legs=legs,
        outline=_outline(content, legs[0]),
        standing=_standing(content),
        others=Others(others),
        servo=servo,
        stall_torque=_number(f"servo.{_STALL}", stall, _N_M, _TORQUE),
        groups=tuple((name, _group(name, own, servo)) for name, own in of_groups.items()),
        fall_lean=_number("fall.lean_deg", fall.get("lean_deg", 45.0), DEGREES, _LEAN) or 0.0,
        fall_height=_number("fall.height", fall.get("height", 0.8), NONE, _PART) or 0.0,
        com_height=_number("limits.com_height_mm", limits.get("com_height_mm"), MM, _SIZE),
        load=_number("limits.load_n", limits.get("load_n"), _N, _TORQUE),
    )


def _leg(side: str, content: Mapping[str, Any]) -> Leg:
    table = content.get(side, {})
    joints: list[str | None] = []
    signs = []
    for role in ROLES:
        joint, sign = _joint(f"{side}.{role}", table.get(role))
        joints.append(joint)
        signs.append(sign)
    foot = _word(f"{side}.foot_link", table.get("foot_link"))
    return Leg(
        joints=tuple(joints),
        signs=tuple(signs),
        ankle=_word(f"{side}.ankle_link", table.get("ankle_link", foot)),
        foot=foot,
        toes=tuple(_toe(f"{side}.{toe}", table.get(toe)) for toe in TOES),
    )


def _joint(key: str, value: Any) -> tuple[str | None, int]:
    """Return name and sign of a joint: `"knee"`, or `{ joint = "knee", sign = -1 }`."""
    if value is None or isinstance(value, str):
        return (None if value is None else _word(key, value)), 1
    if not isinstance(value, Mapping):
        raise ModelError(f'{key} must be a joint\'s name or {{ joint = "...", sign = -1 }}, got '
                         f"{value!r}")  # fmt: skip
    _known(f"key of {key}", value, ("joint", "sign"))
    sign = value.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise ModelError(f"{key}: sign must be 1 or -1, got {sign!r}")
    return _word(f"{key}.joint", value.get("joint")), int(sign)


def _toe(key: str, value: Any) -> Toe | None:
    if value is None:
        return None
    if not isinstance(value, Mapping):
        raise ModelError(f'{key} must be {{ link = "...", hinge = "..." }}, got {value!r}')
    _known(f"key of {key}", value, ("link", "hinge", _STIFFNESS, _DAMPING))
    return Toe(
        stiffness=_number(f"{key}.{_STIFFNESS}", value.get(_STIFFNESS), _N_MM_DEG, _TORQUE),
        damping=_number(f"{key}.{_DAMPING}", value.get(_DAMPING), NONE, Range(lower=0.0)),
        link=_word(f"{key}.link", value.get("link")),
        hinge=_word(f"{key}.hinge", value.get("hinge")),
    )


def _check_legs(right: Leg, left: Leg) -> None:
    """Refuse legs that differ, or that name something twice."""
    for role, one, other in zip(ROLES, right.joints, left.joints, strict=True):
        if (one is None) != (other is None):
            with_it, without = ("left", "right") if one is None else ("right", "left")
            raise ModelError(
                f"[{with_it}] has a {role} and [{without}] has none; a gait moves both legs: name "
                "both, or neither"
            )
    for toe, here, there in zip(TOES, right.toes, left.toes, strict=True):
        if (here is None) != (there is None):
            raise ModelError(f"one foot has a {toe} and the other one none; name both, or neither")
    if right.toes[0] is None and right.toes[1] is not None:
        raise ModelError("a foot with one toe has a big_toe; rename lesser_toes")
    if not any(right.joints):
        raise ModelError(f"[right] names no joint; a leg has some of {', '.join(ROLES)}")
    called: dict[str, str] = {}
    for side, leg in zip(SIDES, (right, left), strict=True):
        named = dict(zip(ROLES, leg.joints, strict=True))
        named |= dict(zip((f"{toe}.hinge" for toe in TOES), leg.hinges, strict=True))
        for role, name in named.items():
            key = f"{side}.{role}"
            if name is not None and called.setdefault(name, key) != key:
                raise ModelError(
                    f"joint '{name}' is {called[name]} and {key}; each joint plays one role"
                )
    links = [*right.plates, *left.plates]
    for link in links:
        if links.count(link) > 1:
            raise ModelError(f"link '{link}' is named twice among the feet; each part has its own")


def _outline(content: Mapping[str, Any], leg: Leg) -> Outline | None:
    table = content.get("toes")
    if table is None:
        return None
    if leg.toes[0] is None:
        raise ModelError("[toes] designs toes, and no foot has a big_toe; remove it, or name toes")
    gap = _number("toes.gap_mm", table.get("gap_mm", 0.0), MM, Range(lower=0.0, upper=0.1))
    width = _number("toes.width_mm", table.get("width_mm"), MM, _SIZE)
    if width is None:
        raise ModelError("[toes] needs width_mm, the width of the whole foot")
    return Outline(width=width, gap=gap or 0.0)


def _standing(content: Mapping[str, Any]) -> tuple[tuple[str, float], ...] | None:
    table = content.get("standing_deg")
    if table is None:
        return None
    turn = Range(lower=-TRAVEL, upper=TRAVEL)
    angles = (
        (name, _number(f"standing_deg.{name}", value, DEGREES, turn) or 0.0)
        for name, value in table.items()
    )
    return tuple(angles)


def _servo(table: Mapping[str, Any]) -> Servo:
    values = {}
    for key, value in table.items():
        name, unit = SERVO[key]
        values[name] = _number(f"servo.{key}", value, unit) or 0.0
    try:
        return Servo(**values)
    except OutOfRangeError as error:
        key = next(key for key, (name, _) in SERVO.items() if name == error.field)
        told = error.told(f"servo.{key}", repr(table[key]), SERVO[key][1])
        raise ModelError(told) from None


def _group(name: str, table: Any, servo: Servo) -> ServoGroup:
    """Return the servos of a group, of which a file tells the numbers themselves."""
    if not isinstance(table, Mapping):
        raise ModelError(f"[servo.{name}] must be a table, got {table!r}")
    _known(f"key of [servo.{name}]", table, (*_OF_GROUPS, _STALL))
    parts = {}
    for key, value in table.items():
        if key != _STALL:
            field_name, unit = SERVO[key]
            found = _number(f"servo.{name}.{key}", value, unit, _TORQUE) or 0.0
            parts[field_name] = found / getattr(servo, field_name)
    stall = _number(f"servo.{name}.{_STALL}", table.get(_STALL), _N_M, _TORQUE)
    return ServoGroup(**parts, stall_torque=stall)


def _known(what: str, given: Mapping[str, Any], names: Collection[str]) -> None:
    """Refuse a name that is not one of `names`, with the nearest one."""
    for name in given:
        if name not in names:
            near = get_close_matches(name, list(names), n=1, cutoff=0.0)[0]
            raise ModelError(
                f"no {what} is called '{name}'; the nearest is '{near}' of {', '.join(names)}"
            )


def _word(key: str, value: Any) -> str:
    if value is None:
        raise ModelError(f'{key} is missing; give it: {key.rpartition(".")[2]} = "..."')
    if not isinstance(value, str) or not value.strip() or "\n" in value:
        raise ModelError(f"{key} must be a name, got {value!r}")
    return value


def _number(key: str, value: Any, unit: Unit = NONE, allowed: Range | None = None) -> float | None:
    """Return a number in SI units; None where there is none."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ModelError(
            f"{key} must be a finite number with a point, without a unit, got {value!r}"
        )
    found = float(value) * unit.si
    try:
        if allowed is not None:
            check(key, found, allowed)
    except OutOfRangeError as error:
        raise ModelError(error.told(key, repr(value), unit)) from None
    return found
