"""A robot that stands, in tables, and the study that a user may begin with."""

import os
from pathlib import Path

import numpy as np

from drake_gait.gait import FloatArray
from drake_gait.report.tables import Table, number
from drake_gait.simulation.stand_up import Stood
from drake_gait.study._toml import as_toml
from drake_gait.study.reading import default_study, read_study

_KHR_LEAN = 0.0355 / 0.245
"""Distance of a foot of the KHR-3HV from its middle / height of its centre of mass."""


def survey(stood: Stood) -> Table:
    """Return mass, sizes, and what touches."""
    x, y, z = (number(1e3 * float(value), 1) for value in stood.centre)
    rear, front = (number(1e3 * value, 0) for value in stood.support)
    touching = ", ".join(f"{one} in {other}" for one, other in stood.touching)
    lean, drift = _settled(stood)
    rows = [
        ["mass [kg]", number(stood.mass, 3)],
        ["height of its highest box [mm]", number(1e3 * stood.height, 1)],
        ["height of the torso's origin [mm]", number(1e3 * stood.torso_height, 1)],
        ["centre of mass from between the ankles, x, y, z [mm]", f"{x}, {y}, {z}"],
        ["it is before the heel, behind the toe [mm]", f"{rear}, {front}"],
        ["room between the feet [mm]", number(1e3 * stood.foot_gap, 1)],
        ["lean of the torso at most [deg], drift [mm]", f"{lean}, {drift}"],
        ["shapes in each other", touching or "none"],
    ]
    return Table(caption=f"{stood.model.robot.name} stands", columns=["", ""], rows=rows)


def _settled(stood: Stood) -> tuple[str, str]:
    walk = stood.walk
    tilt = walk.measures.torso_tilt if walk.measures else 0.0
    drift = float(np.hypot(walk.forward, walk.lateral))
    return number(float(np.degrees(tilt)), 1), number(1e3 * drift, 1)


def loads(stood: Stood) -> Table:
    """Return what standing needs of each servo, and where a gait may take it."""
    rows = []
    for one in stood.servos:
        share = 100.0 * abs(one.torque) / one.stall
        rows.append(
            [one.role, one.joint, number(one.torque, 2), number(one.stall, 2), number(share, 0),
             _range(one.range)]
        )  # fmt: skip
    return Table(
        caption="Servos while it stands; angles from the standing pose",
        columns=["role", "joint", "torque [N·m]", "stall torque [N·m]", "share [%]", "range [deg]"],
        rows=rows,
    )


def _range(ends: tuple[float, float]) -> str:
    if not np.isfinite(ends).any():
        return "any"
    return " to ".join(number(float(np.degrees(end)), 0) for end in ends)


def suggestions(stood: Stood) -> Table:
    """Return the settings that a search needs of a robot."""
    robot = stood.model.robot
    limit = robot.com_height
    given = "none yet" if limit is None else f"{1e3 * limit:.2f}"
    rows = [
        ["limits.com_height_mm", f"{1e3 * stood.com_limit:.2f}", given],
        ["fall.lean_deg", "45", f"{np.degrees(robot.fall_lean):g}"],
        ["fall.height", f"0.8 ({1e3 * stood.lowest_torso:.0f} mm)", f"{robot.fall_height:g}"],
    ]
    return Table(caption="What a search needs", columns=["key", "suggested", "given"], rows=rows)


def _centre(stood: Stood) -> FloatArray:
    """Return the middle of a box to begin with [deg], shape (4, 4).

    It is the default study's: legs as bent as there, and a roll as much as the feet are apart.
    """
    centre: FloatArray = np.degrees(read_study(default_study()).space.centre)
    centre[1:, 0] -= np.degrees(stood.bend)
    # A knee of the paper's family bends from the standing pose on; the sole stays level.
    further = max(0.0, -float(centre[2, 0]))
    centre[1:, 0] += np.array([0.5, 1.0, 0.5]) * further
    right, left = stood.walk.history.ankles[0] if stood.walk.history else np.zeros((2, 3))
    apart = 0.5 * float(left[1] - right[1])
    centre[0] *= apart / float(stood.centre[2]) / _KHR_LEAN
    return centre.round(2)


def box(stood: Stood) -> str:
    """Return the middle of a box to begin with, as a study's file has it."""
    return f"box.centre_deg = {_rows(_centre(stood))}"


def _rows(values: FloatArray) -> str:
    return as_toml([[float(value) for value in row] for row in values])


def study_to_begin_with(stood: Stood, robot: str, model: str) -> str:
    """Return the text of a study's file for a robot that stands.

    Args:
        stood: The robot.
        robot: Its file, or its model, as the user named it.
        model: Its model, where that is another than the file's.
    """
    space = read_study(default_study()).space
    lines = ["[study]", f"name = {as_toml(Path(robot).stem)}", "", "[robot]"]
    key = "file" if robot.endswith(".toml") else "model"
    lines.append(f"{key} = {as_toml(_absolute(robot))}")
    if model:
        lines.append(f"model = {as_toml(_absolute(model))}")
    if stood.model.robot.com_height is None:
        height = round(1e3 * stood.com_limit, 2)
        lines += ["", "[constraints]", f"com_height_mm = {height}"]
    lines += [
        "",
        "[box]",
        'chosen = "the default study\'s, for legs that are bent as this robot stands"',
        f"centre_deg = {_rows(_centre(stood))}",
        f"half_width_deg = {_rows(np.degrees(space.half_width).round(3))}",
        "",
    ]
    return "\n".join(lines)


def _absolute(name: str) -> str:
    return os.path.abspath(name) if Path(name).exists() else name  # noqa: PTH100
