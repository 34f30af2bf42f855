"""Figures of one walk: the paper's Figs. 11 to 13, and what it could not show.

Each function draws one figure and writes it to `path`: see `figures.save_figure`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drake_gait.errors import SettingsError
from drake_gait.gait import CYCLE_TIME, FRAME_TIME, JOINTS, WAVEFORMS, FloatArray
from drake_gait.visualization import human
from drake_gait.visualization.palette import COM, GREY, INK, SIDES
from drake_gait.visualization.rasterizer import Picture
from drake_gait.visualization.style import (
    COLUMN,
    GAIT_PHASES,
    PAGE,
    new_figure,
    save_figure,
    style,
)
from drake_gait.walk import History

CONTACT_FORCE = 0.1
"""A foot stands on the ground when it is pressed with more than this [N]."""

_ROOM_BEHIND, _ROOM_AHEAD, _EDGE = 120.0, 145.0, 5.0  # round the centre of mass, at least [mm]
_OVERHEAD, _UNDER = 17.0, 12.0  # over the robot, and under the ground [mm]
_IMPACT = 4.0  # times the usual force: beyond this, an impact is cut off
_LEG_JOINTS = {
    "roll": "hip_roll",
    "hip": "hip_pitch",
    "knee": "knee",
    "ankle": "ankle_pitch",
}


def waveforms(history: History, path: str | Path) -> None:
    """Fig. 13: roll, hip, knee and ankle of both legs in the second cycle, command and measured.

    Behind them a human's right leg, whose initial contact is where the cycle begins as in Fig. 12.
    The second cycle is 'the most natural' of the paper's three.
    """
    begin, end = history.schedule.second_cycle
    with style():
        figure = new_figure(COLUMN, 5.4)
        known = [one for one in WAVEFORMS if _is_there(history, f"{_LEG_JOINTS[one]}_r")]
        panels = figure.subplots(len(known), 1, sharex=True, squeeze=False)[:, 0]
        shown = _between(history.time, begin, end)
        time = history.time[shown]
        for axes, waveform in zip(panels, known, strict=True):
            for side, colour in SIDES:
                column = JOINTS.index(f"{_LEG_JOINTS[waveform]}_{side[0]}")
                command = np.degrees(history.commands[shown, column])
                measured = np.degrees(history.angles[shown, column])
                axes.plot(time, command, "--", color=colour, linewidth=0.9, alpha=0.8)
                axes.plot(time, measured, color=colour)
            if waveform in human.JOINTS:
                phase = np.linspace(0.0, 1.0, 121)
                mean, deviation = human.angles(waveform, phase)
                cycle = begin + (end - begin) * phase
                axes.fill_between(
                    cycle,
                    mean - deviation,
                    mean + deviation,
                    color=GREY,
                    alpha=0.25,
                    linewidth=0.0,
                    zorder=1,
                )
                axes.plot(cycle, mean, color=INK, linewidth=0.9, zorder=1.5)
            axes.set_ylabel(f"{waveform} [deg]")
        panels[-1].set_xlabel("time [s]")
        panels[-1].set_xlim(begin, end)
        for side, colour in SIDES:
            panels[0].plot([], [], color=colour, label=f"{side} leg")
        panels[0].plot([], [], "--", color=GREY, linewidth=0.9, label="command")
        panels[0].plot([], [], color=GREY, label="measured")
        panels[0].plot([], [], color=INK, linewidth=0.9, label="human, right leg")
        handles, labels = panels[0].get_legend_handles_labels()
        order = [0, 2, 1, 3, 4]  # of a legend in columns
        figure.legend(
            [handles[place] for place in order],
            [labels[place] for place in order],
            loc="outside upper center",
            ncols=3,
            columnspacing=1.2,
            handlelength=1.6,
        )
        figure.align_ylabels()
        save_figure(figure, path)


def _is_there(history: History, role: str) -> bool:
    """Return whether a robot has a joint of a role: it has angles."""
    return not np.isnan(history.angles[:, JOINTS.index(role)]).all()


def paths(history: History, path: str | Path) -> None:
    """Fig. 11: centre of mass and both ankles from above, from the start of the centre of mass.

    With the sinusoid of one stride that is nearest to the sway of the centre of mass.
    """
    origin = history.com[0, :2]
    tracks = (
        ("right ankle", SIDES[0][1], history.ankles[:, 0, :2]),
        ("left ankle", SIDES[1][1], history.ankles[:, 1, :2]),
        ("centre of mass", COM, history.com[:, :2]),
    )
    with style():
        figure = new_figure(COLUMN, 2.6)
        axes = figure.subplots()
        for name, colour, points in tracks:
            forward, lateral = 1e3 * (points - origin).T
            axes.plot(forward, lateral, color=colour, label=name)
            axes.plot(forward[0], lateral[0], "o", color=colour, markersize=3.5)
            axes.plot(forward[-1], lateral[-1], "s", color=colour, markersize=3.5)
        schedule = history.schedule
        walking = _between(history.time, schedule.begin * FRAME_TIME, schedule.end * FRAME_TIME)
        if walking.sum() * FRAME_TIME > schedule.period:
            lateral = history.com[walking, 1]
            fitted, amplitude = sway(history.time[walking], lateral, schedule.period)
            axes.plot(
                1e3 * (history.com[walking, 0] - origin[0]),
                1e3 * (fitted - origin[1]),
                ":",
                color=INK,
                linewidth=1.1,
                label=f"sinusoid, ±{1e3 * amplitude:.0f} mm",
            )
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("forward [mm]")
        axes.set_ylabel("lateral, left positive [mm]")
        axes.plot([], [], "o", color=GREY, markersize=3.5, label="start")
        axes.plot([], [], "s", color=GREY, markersize=3.5, label="finish")
        figure.legend(loc="outside upper center", ncols=3, columnspacing=1.2, handlelength=1.4)
        save_figure(figure, path)


def sway(
    time: FloatArray, lateral: FloatArray, period: float = CYCLE_TIME
) -> tuple[FloatArray, float]:
    """The sinusoid of one gait cycle on a straight line that is nearest to a lateral path.

    Args:
        time: Instants [s], shape (n,).
        lateral: Lateral positions [m], shape (n,).
        period: The gait cycle [s]; the paper's by default.

    Returns:
        Its lateral positions [m], shape (n,), and its amplitude [m].
    """
    angle = 2.0 * np.pi / period * time
    basis = np.stack([np.ones_like(time), time, np.cos(angle), np.sin(angle)], axis=1)
    weights = np.linalg.lstsq(basis, lateral)[0]
    return basis @ weights, float(np.hypot(*weights[2:]))


def postures(history: History, pictures: Sequence[Picture], path: Path) -> None:
    """Fig. 12: the robot in the five GAIT_PHASES from its right side, and its toes.

    Big and lesser toes are named with their angles, of the foot whose toes are bent more.

    Args:
        history: A walk.
        pictures: The robot at these instants: `rendering.pictures` of `posture_frames`.
        path: The file to write.

    Raises:
        SettingsError: there is not one picture for each instant.
    """
    frames, instants = posture_frames(history), _instants(history)
    if len(pictures) != len(frames):
        raise SettingsError(f"postures needs {len(frames)} pictures, got {len(pictures)}")
    # All of the robot, however long its step; a panel is one of five across the page.
    reach = [
        (
            1e3 * (picture.extent[0] - history.com[frame, 0]),
            1e3 * (picture.extent[1] - history.com[frame, 0]),
        )
        for frame, picture in zip(frames, pictures, strict=True)
    ]
    behind = min(-_ROOM_BEHIND, *(begin - _EDGE for begin, _ in reach))
    ahead = max(_ROOM_AHEAD, *(end + _EDGE for _, end in reach))
    scale = (_ROOM_BEHIND + _ROOM_AHEAD) / (ahead - behind)
    top = _OVERHEAD + 1e3 * max(picture.extent[3] for picture in pictures)
    tall = scale * (top + _UNDER)
    with style():
        figure = new_figure(PAGE, 1.4 + tall / 172.0)
        rows = figure.subplots(2, len(frames), sharey="row", height_ratios=(tall, 110))
        for column, (frame, picture) in enumerate(zip(frames, pictures, strict=True)):
            instant, phase = instants[column], GAIT_PHASES[column][1]
            whole, toes = rows[:, column]
            centre = history.com[frame, 0]
            left, right, lower, upper = (1e3 * edge for edge in picture.extent)
            # Bytes, which matplotlib scales in half the time.
            pixels = np.round(255.0 * np.clip(picture.pixels, 0.0, 1.0)).astype(np.uint8)
            for axes in (whole, toes):
                axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
                axes.imshow(
                    pixels,
                    interpolation="antialiased",
                    extent=(left - 1e3 * centre, right - 1e3 * centre, lower, upper),
                    zorder=2,
                )
                axes.set_aspect("equal")
            for foot, (_, colour) in enumerate(SIDES):
                ankle = history.ankles[frame, foot]
                whole.plot(
                    1e3 * (ankle[0] - centre),
                    1e3 * ankle[2],
                    "o",
                    color=colour,
                    markersize=4.5,
                    markeredgecolor="white",
                    zorder=3,
                )
            whole.plot(
                0.0,
                1e3 * history.com[frame, 2],
                "o",
                color=COM,
                markersize=5.5,
                markeredgecolor="white",
                zorder=3,
            )
            whole.set(xlim=(behind, ahead), ylim=(-_UNDER, top))
            whole.set_title(f"{instant:.1f} s, {phase}")
            # Of the foot whose toes are bent more; in front of its ankle, at twice the scale.
            bent = np.nan_to_num(history.toes[frame]).reshape(2, 2)
            foot = int(np.argmax(bent.max(axis=1)))
            begin = 1e3 * (history.ankles[frame, foot, 0] - centre) - 30.0
            toes.set(xlim=(begin, begin + 132.5), ylim=(-9.0, 46.0), yticks=(0.0, 25.0))
            own = history.toes[frame, 2 * foot : 2 * foot + 2]
            toes.set_title(f"{SIDES[foot][0]} {_toes_in_words(own)}", fontsize=7.0)
        rows[0, 0].set_ylabel("height [mm]")
        rows[1, 0].set_ylabel("toes [mm]")
        rows[1, len(frames) // 2].set_xlabel("forward of the centre of mass [mm]")
        for side, colour in SIDES:
            rows[0, 0].plot([], [], "o", color=colour, label=f"{side} ankle")
        rows[0, 0].plot([], [], "o", color=COM, label="centre of mass")
        handles, labels = rows[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        save_figure(figure, path)


def _toes_in_words(angles: FloatArray) -> str:
    """Return the angles of a foot's toes [rad], shape (2,), for a title; NaN is no toe."""
    # Adding zero makes a plain one of minus zero.
    told = [f"{round(float(np.degrees(one))) + 0:.0f}°" for one in angles if np.isfinite(one)]
    return f"{'toes' if len(told) > 1 else 'toe'} {' and '.join(told)}" if told else "foot"


def posture_frames(history: History) -> list[int]:
    """Frames of a walk in its GAIT_PHASES; its last one where it fell before."""
    last = len(history.time) - 1
    return [min(round(instant / FRAME_TIME), last) for instant in _instants(history)]


def _instants(history: History) -> list[float]:
    """Instants of GAIT_PHASES in the second cycle of a walk [s]."""
    begin, end = history.schedule.second_cycle
    return [begin + part * (end - begin) for part, _ in GAIT_PHASES]


def ground_reaction(history: History, path: str | Path) -> None:
    """Vertical force on each foot, and when each foot, or both, stands on the ground."""
    vertical = history.ground_reaction[:, :, 2]
    stands = vertical > CONTACT_FORCE
    both: NDArray[np.bool_] = stands[:, 0] & stands[:, 1]
    with style():
        figure = new_figure(COLUMN, 3.4)
        force, contact = figure.subplots(2, 1, sharex=True, height_ratios=(5, 2))
        for foot, (side, colour) in enumerate(SIDES):
            force.plot(history.time, vertical[:, foot], color=colour, label=f"{side} foot")
        total = vertical.sum(axis=1)
        force.plot(history.time, total, color=GREY, linewidth=0.7, label="sum")
        force.set_ylabel("vertical force [N]")
        # A frame that meets an impact reads its peak; the axis is for what carries the robot.
        force.set_ylim(0.0, 1.05 * min(total.max(), _IMPACT * np.median(total)))
        rows = [
            (f"{side}, {100.0 * stands[:, foot].mean():.0f} %", colour, stands[:, foot])
            for foot, (side, colour) in enumerate(SIDES)
        ]
        rows.append((f"both, {100.0 * both.mean():.0f} %", GREY, both))
        for row, (_, colour, down) in enumerate(rows):
            contact.fill_between(
                history.time,
                0.38 - row,
                -0.38 - row,
                where=down.tolist(),
                step="post",
                color=colour,
                linewidth=0.0,
            )
        contact.set_yticks([0, -1, -2], [name for name, _, _ in rows])
        contact.set_ylabel("on the ground")
        contact.grid(visible=False)
        contact.set_xlabel("time [s]")
        contact.set_xlim(0.0, history.time[-1])
        figure.legend(loc="outside upper center", ncols=3)
        save_figure(figure, path)


def torques(history: History, path: Path, limits: FloatArray) -> None:
    """Torque of every servo against its stall torque.

    Args:
        history: A walk.
        path: The file to write.
        limits: Stall torques [N·m], shape (10,), ordered as gait.JOINTS.
    """
    pairs = len(JOINTS) // 2
    known = [joint for joint in range(pairs) if _is_there(history, JOINTS[joint])]
    with style():
        figure = new_figure(COLUMN, 0.6 + len(known))
        panels = figure.subplots(len(known), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, joint in zip(panels, known, strict=True):
            name = JOINTS[joint]
            for foot, (_, colour) in enumerate(SIDES):
                column = joint + foot * pairs
                axes.plot(history.time, history.torques[:, column], color=colour, linewidth=0.9)
            for bound in (-limits[joint], limits[joint]):
                axes.axhline(bound, color=INK, linestyle=":", linewidth=0.9)
            both = [joint, joint + pairs]
            driving, braking = peaks_apart(history.torques[:, both], history.speeds[:, both])
            axes.set_title(
                f"{name.removesuffix('_r').replace('_', ' ')}: at most "
                f"{100.0 * driving / limits[joint]:.0f} % of the stall torque driving, "
                f"{100.0 * braking / limits[joint]:.0f} % braking",
                loc="left",
            )
        figure.supylabel("torque [N·m]", fontsize=8.0)
        panels[-1].set_xlabel("time [s]")
        panels[-1].set_xlim(0.0, history.time[-1])
        for side, colour in SIDES:
            panels[0].plot([], [], color=colour, label=f"{side} leg")
        panels[0].plot([], [], color=INK, linestyle=":", linewidth=0.9, label="stall torque")
        figure.legend(loc="outside upper center", ncols=3)
        save_figure(figure, path)


def peaks_apart(torques: FloatArray, speeds: FloatArray) -> tuple[float, float]:
    """Return the largest torque [N·m] while servos drive their joints, and while they brake them.

    A motor that is turned against its torque may brake with more than its stall torque.

    Args:
        torques: Torques on the joints [N·m], any shape.
        speeds: Speeds of the joints [rad/s], the same shape.
    """
    sizes, drives = np.abs(torques), torques * speeds >= 0.0
    return float(sizes[drives].max(initial=0.0)), float(sizes[~drives].max(initial=0.0))


def _between(time: FloatArray, begin: float, end: float) -> NDArray[np.bool_]:
    """Return whether each frame lies in begin <= t < end, shape (n,)."""
    half = FRAME_TIME / 2.0
    return (time > begin - half) & (time < end - half)


def joint_angles(
    history: History, times: FloatArray, measured: Mapping[str, FloatArray], path: str | Path
) -> None:
    """Draw measured joint angles over the simulated ones and their commands, a panel a joint.

    Args:
        history: The simulated walk.
        times: Times of the measured angles [s], shape (n,).
        measured: Angles by joint [rad], shape (n,) each.
        path: The figure.
    """
    with style():
        rows = (len(measured) + 1) // 2
        figure = new_figure(PAGE, 0.6 + 1.3 * rows)
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False)
        for axes, (name, angles) in zip(panels.flat, measured.items(), strict=False):
            column = JOINTS.index(name)
            command = np.degrees(history.commands[:, column])
            axes.plot(history.time, command, "--", color=GREY, linewidth=0.9, label="command")
            simulated = np.degrees(history.angles[:, column])
            axes.plot(history.time, simulated, color=SIDES[0][1], label="simulated")
            axes.plot(times, np.degrees(angles), color=SIDES[1][1], label="measured")
            axes.set_ylabel(f"{name.replace('_', ' ')} [deg]")
        for axes in panels.flat[len(measured) :]:
            axes.set_visible(False)
        for axes in panels[-1]:
            axes.set_xlabel("time [s]")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=3)
        save_figure(figure, path)
