"""Motions of a study's walks for a robot: made, checked, written."""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from drake_gait.cli._replay import choose
from drake_gait.errors import SettingsError
from drake_gait.files.destination import check, messages, write
from drake_gait.gait import FRAME_TIME, JOINTS
from drake_gait.hardware.checks import violations
from drake_gait.hardware.motion import Motion, table_as_csv, to_csv
from drake_gait.hardware.servo_map import ServoMap, read_servo_map
from drake_gait.report.result import in_words
from drake_gait.robot.description import servo_of
from drake_gait.simulation.self_collision import leg_gaps
from drake_gait.simulation.simulate import follow


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A motion that was checked for a robot."""

    motion: Motion
    """Joint angles by frame."""
    servos: ServoMap
    """Servos of the robot."""
    caption: str
    """Name of the study and number of the walk."""


def prepare_motion(options: argparse.Namespace, told: TextIO) -> Prepared:
    """Return the motion that a command line asks for.

    Args:
        options: Folder of the study as `run`, and the options of `add_motion_options`.
        told: Takes what the motion is and what softening costs.

    Raises:
        SettingsError: the robot cannot play it; every violation has been told before.
        StudyError: there is no such walk.
    """
    servos = read_servo_map(options.robot)
    frame_time = _frame_time(options.frame_ms, servos)
    settings, chosen, as_then = choose(options.run, options.walk)
    caption = f"{settings.name}, walk {chosen.id}"
    gait = chosen.candidate.gait
    commands = gait.commands_from(as_then.start)
    motion = Motion(angles=commands)
    print(f"{caption}: {_jumps(motion, gait.walking)}", file=told)
    speed = servo_of(as_then).no_load_speed
    if options.soften is not None:
        if not 0.0 < options.soften <= 1.0:
            raise SettingsError(
                f"argument --soften: must be > 0 and at most 1, got {options.soften:g}"
            )
        motion = motion.softened(options.soften * speed)
        foot = chosen.candidate.foot
        print(f"softened: {_jumps(motion, gait.walking)}", file=told)
        for label, angles in (("as it is", commands), ("softened", motion.angles)):
            walk = follow(angles, foot, as_then, schedule=gait.schedule)
            does = "walks" if walk.survived else "falls:"
            print(f"{label}, it {does} {in_words(walk)}", file=told)
    motion = motion if frame_time == FRAME_TIME else motion.resampled(frame_time)
    gaps = leg_gaps(motion.angles, chosen.candidate.foot, settings.walk.model)
    print(f"smallest gap between the legs: {1e3 * gaps[0].min():.1f} mm", file=told)
    found = violations(motion, servos, speed, gaps)
    for one in found:
        print(f"{one.kind}: {one}", file=sys.stderr)
    kinds = sorted({str(one.kind) for one in found} - set(options.allow or ()))
    if kinds:
        first = next(one for one in found if one.kind in kinds)
        cure = "--soften slows it down" if "speed" in kinds else "look at the robot's file"
        allow = " ".join(f"--allow {kind}" for kind in kinds)
        raise SettingsError(
            f"{caption} cannot be played: {first}; {cure}, {allow} takes it as it is"
        )
    return Prepared(motion=motion, servos=servos, caption=caption)


def write_motion(options: argparse.Namespace) -> None:
    """Write the motion of a walk as a table."""
    out: Path = options.motion
    check(out, what="the motion ")
    told = messages(out)
    prepared = prepare_motion(options, told)
    write(out, _in_units(prepared, options.units or "degrees"))
    motion = prepared.motion
    print(f"{out}: {len(motion.angles)} frames of {1e3 * motion.frame_time:g} ms", file=told)


def _in_units(prepared: Prepared, units: str) -> str:
    if units == "degrees":
        return to_csv(prepared.motion)
    motion, servos = prepared.motion, prepared.servos
    header = ["time_ms", *(f"servo_{number}" for number in servos.ids)]
    times = (1e3 * motion.times).round(3)
    rows = [
        [f"{time:g}", *row]
        for time, row in zip(times, servos.positions(motion.angles).tolist(), strict=True)
    ]
    return table_as_csv(header, rows)


def _frame_time(milliseconds: float | None, servos: ServoMap) -> float:
    if milliseconds is None:
        return FRAME_TIME
    for time in servos.frame_times:
        if np.isclose(milliseconds, 1e3 * time):
            return time
    allowed = ", ".join(f"{1e3 * time:g}" for time in servos.frame_times)
    raise SettingsError(
        f"argument --frame-ms: the controller keeps frames of {allowed} ms, got {milliseconds:g}"
    )


def _jumps(motion: Motion, walking: tuple[int, int]) -> str:
    """Return the largest change in one frame where walking begins and where it ends, as text."""
    found = []
    of_all = np.degrees(np.abs(np.diff(motion.angles, axis=0)))
    for frame in (min(max(one, 1), len(of_all) - 1) for one in walking):
        changes = of_all[frame - 1 : frame + 1]
        step, column = np.unravel_index(changes.argmax(), changes.shape)
        found.append(
            f"{changes.max():.1f} degrees at {frame * FRAME_TIME:.1f} s ({JOINTS[column]}, frame "
            f"{frame + step})"
        )
    return "largest change in a frame " + ", ".join(found)
