"""The robot that a study's file names: by [robot], or by `walk.model` as older files do.

`robot.file` is a robot's file. `robot.model` is a model, an edited KHR-3HV or, beside `robot.file`,
an edit of that robot. `walk.model` may be either.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.robot.description import located
from drake_gait.robot.robot_file import RobotFile, default_robot, is_robot_file
from drake_gait.study._toml import text

FILE, MODEL, OLDER = ("robot", "file"), ("robot", "model"), ("walk", "model")
NAMES = (FILE, MODEL, OLDER)
"""Settings that name a robot, by section and key."""


def override(content: dict[str, Any], name: tuple[str, str], folder: Path) -> None:
    """Let a robot that is named beside a file take the place of the file's.

    Args:
        content: Sections of the file, in which the override is already; it is changed.
        name: Section and key of the override.
        folder: Where its path begins.
    """
    section, key = name
    value = content[section][key]
    if not isinstance(value, str):
        return
    content[section][key] = located(value, folder, f"{section}.{key}")
    others = {
        FILE: (MODEL, OLDER),
        # Another model of the same robot.
        MODEL: () if is_robot_file(content.get("walk", {}).get("model")) else (OLDER,),
        OLDER: (MODEL, FILE) if is_robot_file(value) else (MODEL,),
    }
    for other, inner in others[name]:
        values = content.get(other, {})
        if isinstance(values, dict):
            values.pop(inner, None)


def named(content: Mapping[str, Any], folder: Path) -> dict[str, str]:
    """Return the fields of `WalkSettings` that name the robot of a study's file.

    Args:
        content: Sections of the file.
        folder: Where its paths begin.

    Raises:
        SettingsError: it names two.
    """
    given: dict[tuple[str, str], str] = {}
    for name in NAMES:
        section, key = name
        value = content.get(section, {}).get(key)
        if value is not None:
            given[name] = located(text(f"{section}.{key}", value), folder, f"{section}.{key}")
    files = [name for name in (FILE, OLDER) if is_robot_file(given.get(name))]
    models = [name for name in (MODEL, OLDER) if name in given and name not in files]
    for what, names in (("robot's files", files), ("models", models)):
        if len(names) > 1:
            told = " and ".join(f"{'.'.join(name)} = '{given[name]}'" for name in names)
            raise SettingsError(f"{told} are two {what}; keep one of them")
    if FILE in given and FILE not in files:
        raise SettingsError(f"robot.file must be a robot's file, .toml, got '{given[FILE]}'; give "
                            "a model as robot.model")  # fmt: skip
    if MODEL in given and is_robot_file(given[MODEL]):
        raise SettingsError(f"robot.model must be a model, got '{given[MODEL]}'; give a robot's "
                            "file as robot.file")  # fmt: skip
    if not models:
        return {"model": given[files[0]]} if files else {}
    return {"model": given[models[0]], **({"robot": given[files[0]]} if files else {})}


def check_foot(robot: RobotFile, foot: FootDesign, opened: Mapping[str, Any]) -> None:
    """Refuse fields of the foot that mean nothing on a robot.

    Args:
        robot: The robot's file.
        foot: The foot of all candidates.
        opened: Fields of [design] by their names.

    Raises:
        SettingsError: one of them is set or open.
    """
    usual = FootDesign()
    for name in (*opened, "rigid_toes", *vars(usual)):
        known = name in robot.foot_fields
        if not known and (name in opened or getattr(foot, name) != getattr(usual, name)):
            there = ", ".join(sorted(robot.foot_fields)) or "none: its file has no [toes]"
            raise SettingsError(
                f"{name} of the foot means nothing on {robot.name}; leave it out. What is designed "
                f"there is {there}"
            )


def com_height(robot: RobotFile) -> dict[str, float]:
    """Return the limit of the centre of mass's height that a robot brings, by its quantity.

    Raises:
        SettingsError: it brings none.
    """
    if robot.identity == default_robot().identity:
        return {}
    if robot.com_height is None:
        raise SettingsError(
            f"{robot.name} has no limit for the height of the centre of mass; give "
            "constraints.com_height_mm, or limits.com_height_mm in the robot's file, as "
            "`drake-gait check` suggests"
        )
    return {"com_height": robot.com_height}
