"""The paper's figures, from walks and studies.

Each function draws one figure and writes it to `path`: a PNG, or the format that the path's ending
names. One style: a journal's column wide, a unit on every axis, colours that remain apart for
colour-blind readers; right is blue and left is vermilion everywhere.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from drake_gait.errors import GaitError, SettingsError
from drake_gait.gait import CYCLE_TIME, FRAME_TIME, JOINTS, WAVEFORMS, FloatArray
from drake_gait.walk import History

COLUMN = 3.5
"""Width of a figure of one column [inch]."""
PAGE = 7.2
"""Width of a figure of two columns [inch]."""
PNG_RESOLUTION = 200
"""Dots per inch of a PNG."""

# Okabe and Ito's palette.
BLUE, VERMILION, GREEN = "#0072b2", "#d55e00", "#009e73"
ORANGE, PURPLE, SKY, GREY = "#e69f00", "#cc79a7", "#56b4e9", "#8a8f98"
RIGHT, LEFT, COM = BLUE, VERMILION, GREEN
SIDES = (("right", RIGHT), ("left", LEFT))
"""Name and colour of each side, in the order of every array with two feet."""

# Its keys have no type that every release of matplotlib shares.
STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "legend.fontsize": 7.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.linewidth": 0.6,
    "grid.color": "#dfe2e6",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "drake_gait",  # the same figure gives the same file
}

GAIT_PHASES = (
    (1.2, "initial contact"),
    (1.5, "mid-stance"),
    (1.8, "terminal stance"),
    (2.1, "initial swing"),
    (2.4, "terminal swing"),
)
"""Instants [s] of the paper's Fig. 12 and what one leg is doing."""

_IMPACT = 4.0  # times the usual force: beyond this, an impact is cut off
CONTACT_FORCE = 0.1
"""A foot stands on the ground when it is pressed with more than this [N]."""

_HEAD_ABOVE_TORSO = 0.166  # from the torso's origin to the top of the head [m]

_LEG_JOINTS = {
    "roll": "hip_roll",
    "hip": "hip_pitch",
    "knee": "knee",
    "ankle": "ankle_pitch",
}
_NATURAL_CYCLE = (CYCLE_TIME, 2.0 * CYCLE_TIME)  # 'the most natural' of the three


def _figure(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _save(figure: Figure, path: Path) -> None:
    # Without a date or a version inside, the same data give the same file.
    nameless = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    metadata = nameless if path.suffix in (".svg", ".png") else None
    try:
        figure.savefig(path, dpi=PNG_RESOLUTION, metadata=metadata)
    except OSError as error:
        raise GaitError(f"cannot write the figure {path}: {error.strerror}") from None
    except ValueError as error:
        raise SettingsError(f"cannot write the figure {path}: {error}") from None


def waveforms(history: History, path: Path) -> None:
    """Fig. 13: roll, hip, knee and ankle of both legs in the second cycle, command and measured."""
    with rc_context(STYLE):
        figure = _figure(COLUMN, 5.4)
        panels = figure.subplots(len(WAVEFORMS), 1, sharex=True)
        shown = _between(history.time, *_NATURAL_CYCLE)
        time = history.time[shown]
        for axes, waveform in zip(panels, WAVEFORMS, strict=True):
            for side, colour in SIDES:
                column = JOINTS.index(f"{_LEG_JOINTS[waveform]}_{side[0]}")
                command = np.degrees(history.commands[shown, column])
                measured = np.degrees(history.angles[shown, column])
                axes.plot(time, command, "--", color=colour, linewidth=0.9, alpha=0.8)
                axes.plot(time, measured, color=colour)
            axes.set_ylabel(f"{waveform} [deg]")
        panels[-1].set_xlabel("time [s]")
        panels[-1].set_xlim(*_NATURAL_CYCLE)
        for side, colour in SIDES:
            panels[0].plot([], [], color=colour, label=f"{side} leg")
        panels[0].plot([], [], "--", color=GREY, linewidth=0.9, label="command")
        panels[0].plot([], [], color=GREY, label="measured")
        figure.legend(loc="outside upper center", ncols=4, columnspacing=1.2, handlelength=1.6)
        figure.align_ylabels()
        _save(figure, path)


def paths(history: History, path: Path) -> None:
    """Fig. 11: centre of mass and both ankles from above, from the start of the centre of mass."""
    origin = history.com[0, :2]
    tracks = (
        ("right ankle", RIGHT, history.ankles[:, 0, :2]),
        ("left ankle", LEFT, history.ankles[:, 1, :2]),
        ("centre of mass", COM, history.com[:, :2]),
    )
    with rc_context(STYLE):
        figure = _figure(COLUMN, 2.9)
        axes = figure.subplots()
        for name, colour, points in tracks:
            forward, lateral = 1e3 * (points - origin).T
            axes.plot(forward, lateral, color=colour, label=name)
            axes.plot(forward[0], lateral[0], "o", color=colour, markersize=3.5)
            axes.plot(forward[-1], lateral[-1], "s", color=colour, markersize=3.5)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("forward [mm]")
        axes.set_ylabel("lateral, left positive [mm]")
        axes.plot([], [], "o", color=GREY, markersize=3.5, label="start")
        axes.plot([], [], "s", color=GREY, markersize=3.5, label="finish")
        figure.legend(loc="outside upper center", ncols=5, columnspacing=0.8, handlelength=1.2)
        _save(figure, path)


def convergence(forward_mm: ArrayLike, feasible: ArrayLike, path: Path, *, samples: int) -> None:
    """Fig. 9: every walk of a study, and the best feasible one so far.

    Args:
        forward_mm: Distance walked [mm], shape (n,), in the order of the walks; NaN: it fell.
        feasible: Whether each walk holds all constraints, shape (n,).
        path: The file to write.
        samples: How many walks at the beginning are the design of experiments.
    """
    forward = np.asarray(forward_mm, dtype=float)
    holds = np.asarray(feasible, dtype=bool)
    if forward.shape != holds.shape or forward.ndim != 1:
        raise SettingsError(
            f"convergence needs one flag for each walk, got {forward.shape} and {holds.shape}"
        )
    number = np.arange(1, forward.size + 1)
    fell = np.isnan(forward)
    best = _best_so_far(forward, holds)
    with rc_context(STYLE):
        figure = _figure(COLUMN, 2.7)
        axes = figure.subplots()
        rejected = ~fell & ~holds
        axes.plot(number[rejected], forward[rejected], ".", color=GREY, markersize=3.0,
                  alpha=0.7, label="not feasible")  # fmt: skip
        axes.plot(number[holds], forward[holds], ".", color=GREEN, markersize=5.0, label="feasible")
        axes.step(number, best, where="post", color=BLUE, label="best feasible")
        if fell.any():
            # At the lower edge, whatever the scale.
            axes.plot(number[fell], np.full(fell.sum(), 0.015), "|", color=VERMILION,
                      markersize=4.0, alpha=0.7, transform=axes.get_xaxis_transform(),
                      label="fell")  # fmt: skip
        if 0 < samples < forward.size:
            axes.axvline(samples + 0.5, color="black", linewidth=0.7, linestyle=":")
            axes.annotate("samples | search", (samples + 0.5, 1.0),
                          xycoords=axes.get_xaxis_transform(), ha="center", va="bottom",
                          fontsize=7.0)  # fmt: skip
        axes.set_xlim(0, max(forward.size, 1) + 1)
        axes.set_xlabel("walk")
        axes.set_ylabel("distance walked [mm]")
        figure.legend(loc="outside lower center", ncols=4, columnspacing=1.0, handlelength=1.2)
        _save(figure, path)


def predicted_against_simulated(
    simulated: ArrayLike,
    predicted_train: ArrayLike,
    predicted_heldout: ArrayLike,
    r2_train: Sequence[float],
    r2_heldout: Sequence[float],
    names_units: Sequence[tuple[str, str]],
    path: Path,
) -> None:
    """Fig. 8: the network's predictions, one panel for each output.

    Args:
        simulated: Outputs of the walks, shape (n, k).
        predicted_train: Predictions by a network that was fitted to the walk, shape (n, k); rows
            of NaN for walks without one.
        predicted_heldout: Predictions by a network that has not seen the walk, likewise.
        r2_train: Coefficient of determination of each output on fitted walks, k numbers.
        r2_heldout: The same on walks held out.
        names_units: Name and unit of each output, k pairs.
        path: The file to write.
    """
    truth = np.asarray(simulated, dtype=float)
    groups = (
        ("training", SKY, "o", np.asarray(predicted_train, dtype=float)),
        ("held out", VERMILION, "^", np.asarray(predicted_heldout, dtype=float)),
    )
    for label, _, _, predicted in groups:
        if predicted.shape != truth.shape or truth.shape[1:] != (len(names_units),):
            raise SettingsError(
                f"{len(names_units)} outputs were simulated with shape {truth.shape} and "
                f"predicted ({label}) with shape {predicted.shape}; all must be alike"
            )
    columns = 2 if len(names_units) in (2, 4) else min(len(names_units), 3)
    rows = -(-len(names_units) // columns)
    with rc_context(STYLE):
        figure = _figure(PAGE * columns / 3.0, 2.5 * rows + 0.3)
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes in panels[len(names_units) :]:
            axes.set_axis_off()
        for output, (name, unit) in enumerate(names_units):
            axes = panels[output]
            for label, colour, marker, predicted in groups:
                axes.plot(truth[:, output], predicted[:, output], marker, color=colour,
                          markersize=2.8, markeredgewidth=0.0, alpha=0.75,
                          label=label if output == 0 else None)  # fmt: skip
            _identity(axes)
            axes.set_title(name)
            axes.set_xlabel(f"simulated [{unit}]")
            axes.set_ylabel(f"predicted [{unit}]")
            axes.text(0.04, 0.96, f"R² training {r2_train[output]:.2f}\n"
                      f"R² held out {r2_heldout[output]:.2f}", transform=axes.transAxes,
                      va="top", fontsize=7.0)  # fmt: skip
        figure.legend(loc="outside lower center", ncols=2, markerscale=1.6)
        _save(figure, path)


def postures(history: History, legs: FloatArray, path: Path) -> None:
    """Fig. 12: the robot at five instants of the second cycle, from its right side.

    Args:
        history: A walk.
        legs: Points of both legs p_WP [m], shape (n, 2, 7, 3): `recording.leg_points`.
        path: The file to write.
    """
    with rc_context(STYLE):
        figure = _figure(PAGE, 3.1)
        panels = figure.subplots(1, len(GAIT_PHASES), sharey=True)
        for axes, (instant, phase) in zip(panels, GAIT_PHASES, strict=True):
            frame = min(round(instant / FRAME_TIME), len(history.time) - 1)
            centre = history.com[frame, 0]
            axes.axhline(0.0, color="black", linewidth=0.8)
            for foot in (1, 0):  # the right leg is the nearer one
                colour = SIDES[foot][1]
                hip, knee, ankle, heel, ball, big_toe, lesser_toes = legs[frame, foot]
                limb = np.array([hip, knee, ankle])
                plate = np.array([ankle, heel, ball, ankle])
                for points, width in ((limb, 2.2), (plate, 1.2)):
                    _side_view(axes, points, centre, color=colour, linewidth=width)
                _side_view(axes, limb, centre, color=colour, marker="o", markersize=3.5,
                           linewidth=0.0)  # fmt: skip
                for toe in (lesser_toes, big_toe):
                    _side_view(axes, np.array([ball, toe]), centre, color=ORANGE, linewidth=2.2)
            hips = legs[frame, :, 0].mean(axis=0)
            _side_view(axes, np.array([hips, _head(history, frame)]), centre, color=GREY,
                       linewidth=3.0)  # fmt: skip
            _side_view(axes, history.com[frame : frame + 1], centre, color=COM, marker="o",
                       markersize=5.0)  # fmt: skip
            axes.set_aspect("equal")
            axes.set(xlim=(-120.0, 120.0), ylim=(-15.0, 415.0))
            axes.set_title(f"{instant:.1f} s, {phase}")
        panels[0].set_ylabel("height [mm]")
        panels[len(panels) // 2].set_xlabel("forward of the centre of mass [mm]")
        for label, colour in (*((f"{side} leg", colour) for side, colour in SIDES),
                              ("toes", ORANGE), ("upper body", GREY)):  # fmt: skip
            panels[0].plot([], [], color=colour, linewidth=2.2, label=label)
        panels[0].plot([], [], "o", color=COM, label="centre of mass")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        _save(figure, path)


def ground_reaction(history: History, path: Path) -> None:
    """Vertical force on each foot, and when each foot stands on the ground."""
    vertical = history.ground_reaction[:, :, 2]
    with rc_context(STYLE):
        figure = _figure(COLUMN, 3.2)
        force, contact = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        for foot, (side, colour) in enumerate(SIDES):
            force.plot(history.time, vertical[:, foot], color=colour, label=f"{side} foot")
            stands = vertical[:, foot] > CONTACT_FORCE
            contact.fill_between(history.time, 0.9 - foot, 0.1 - foot, where=stands.tolist(),
                                 step="post", color=colour, linewidth=0.0)  # fmt: skip
        force.plot(history.time, vertical.sum(axis=1), color=GREY, linewidth=0.7, label="both")
        force.set_ylabel("vertical force [N]")
        # A frame that meets an impact reads its peak; the axis is for what carries the robot.
        both = vertical.sum(axis=1)
        force.set_ylim(0.0, 1.05 * min(both.max(), _IMPACT * np.median(both)))
        share = (vertical > CONTACT_FORCE).all(axis=1).mean()
        contact.set_yticks([0.5, -0.5], [side for side, _ in SIDES])
        contact.set_ylabel("contact")
        contact.grid(visible=False)
        contact.set_xlabel(f"time [s]; both feet on the ground for {100.0 * share:.0f} %")
        contact.set_xlim(0.0, history.time[-1])
        figure.legend(loc="outside upper center", ncols=3)
        figure.align_ylabels()
        _save(figure, path)


def torques(history: History, path: Path, limit: float) -> None:
    """Torque of every servo against its stall torque `limit` [N·m]."""
    with rc_context(STYLE):
        figure = _figure(COLUMN, 6.2)
        panels = figure.subplots(len(JOINTS) // 2, 1, sharex=True, sharey=True)
        for axes, name in zip(panels, JOINTS[: len(JOINTS) // 2], strict=True):
            joint = name.removesuffix("_r")
            for side, colour in SIDES:
                column = JOINTS.index(f"{joint}_{side[0]}")
                axes.plot(history.time, history.torques[:, column], color=colour, linewidth=0.9)
            for bound in (-limit, limit):
                axes.axhline(bound, color="black", linestyle=":", linewidth=0.8)
            axes.set_title(joint.replace("_", " "), loc="left")
        figure.supylabel("torque [N·m]", fontsize=8.0)
        panels[-1].set_xlabel("time [s]")
        panels[-1].set_xlim(0.0, history.time[-1])
        for side, colour in SIDES:
            panels[0].plot([], [], color=colour, label=f"{side} leg")
        panels[0].plot([], [], color="black", linestyle=":", linewidth=0.8, label="stall torque")
        figure.legend(loc="outside upper center", ncols=3)
        _save(figure, path)


def _head(history: History, frame: int) -> FloatArray:
    """Top of the head [m], from the pose of the torso."""
    roll, pitch = history.torso[frame, 3:5]
    yaw = history.torso[frame, 5]
    # The third column of the rotation matrix of roll, pitch, yaw.
    up = np.array(
        [
            np.cos(yaw) * np.sin(pitch) * np.cos(roll) + np.sin(yaw) * np.sin(roll),
            np.sin(yaw) * np.sin(pitch) * np.cos(roll) - np.cos(yaw) * np.sin(roll),
            np.cos(pitch) * np.cos(roll),
        ]
    )
    top: FloatArray = history.torso[frame, :3] + _HEAD_ABOVE_TORSO * up
    return top


def _side_view(axes: Axes, points: FloatArray, centre: float, **style: Any) -> None:
    """Draw points (n, 3) [m] from the right side in millimetres, x measured from `centre` [m]."""
    axes.plot(1e3 * (points[:, 0] - centre), 1e3 * points[:, 2], solid_capstyle="round", **style)


def _best_so_far(forward: FloatArray, feasible: NDArray[np.bool_]) -> FloatArray:
    """The longest feasible walk up to each one, shape (n,); NaN before the first."""
    best: FloatArray = np.fmax.accumulate(np.where(feasible, forward, np.nan))
    return best


def _between(time: FloatArray, begin: float, end: float) -> NDArray[np.bool_]:
    """Which frames lie in begin <= t < end, shape (n,)."""
    half = FRAME_TIME / 2.0
    return (time > begin - half) & (time < end - half)


def _identity(axes: Axes) -> None:
    """The same square range on both axes, and the line where prediction and simulation agree."""
    low = min(axes.get_xlim()[0], axes.get_ylim()[0])
    high = max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([low, high], [low, high], color="black", linewidth=0.7, zorder=0)
    axes.set(xlim=(low, high), ylim=(low, high), aspect="equal")
