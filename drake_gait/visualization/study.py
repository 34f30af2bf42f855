"""Figures of a study: the paper's Figs. 8 and 9, and what decides the distance.

Each function draws one figure and writes it to `path`: see `figures.save_figure`.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import ArrayLike, NDArray

from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.surrogates.sensitivity import Sensitivity
from drake_gait.visualization.palette import BLUE, GREEN, GREY, INK, SHADE, SKY, VERMILION
from drake_gait.visualization.style import COLUMN, PAGE, new_figure, save_figure, style

_MANY = 400  # walks, from which on their marks are smaller
_MOST_MARKS = 5000
"""Walks from which on their marks are pixels in a drawing, whose file else grows with them."""
_MAP = "cividis"  # even in lightness, and alike for all kinds of colour vision


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
    many = forward.size > _MOST_MARKS
    with style():
        figure = new_figure(COLUMN, 2.7)
        axes = figure.subplots()
        rejected = ~fell & ~holds
        axes.plot(
            number[rejected],
            forward[rejected],
            ".",
            color=GREY,
            markersize=3.0,
            alpha=0.7,
            label="not feasible",
            rasterized=many,
        )
        axes.plot(
            number[holds],
            forward[holds],
            ".",
            color=GREEN,
            markersize=5.0,
            label="feasible",
            rasterized=many,
        )
        axes.step(number, best, where="post", color=BLUE, label="best feasible")
        if fell.any():
            # At the lower edge, whatever the scale.
            axes.plot(
                number[fell],
                np.full(fell.sum(), 0.015),
                "|",
                color=VERMILION,
                markersize=4.0,
                alpha=0.7,
                transform=axes.get_xaxis_transform(),
                label="fell",
                rasterized=many,
            )
        if 0 < samples < forward.size:
            axes.axvline(samples + 0.5, color=INK, linewidth=0.7, linestyle=":")
            axes.annotate(
                "samples | search",
                (samples + 0.5, 1.0),
                xycoords=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=7.0,
            )
        axes.set_xlim(0, max(forward.size, 1) + 1)
        axes.set_xlabel("walk")
        axes.set_ylabel("distance walked [mm]")
        figure.legend(loc="outside lower center", ncols=4, columnspacing=1.0, handlelength=1.2)
        save_figure(figure, path)


def predicted_against_simulated(
    simulated: ArrayLike,
    predicted_train: ArrayLike,
    predicted_heldout: ArrayLike,
    r2_train: Sequence[float],
    r2_heldout: Sequence[float],
    names_units: Sequence[tuple[str, str]],
    path: Path,
) -> None:
    """Fig. 8: the network's predictions, a column for each output, a row for each kind of walk.

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
    size = 2.8 if len(truth) < _MANY else 1.8
    with style():
        figure = new_figure(PAGE * len(names_units) / 3.0, 2.35 * len(groups))
        panels = figure.subplots(
            len(groups), len(names_units), sharex="col", sharey="col", squeeze=False
        )
        for row, (label, colour, marker, predicted) in zip(panels, groups, strict=True):
            scores = r2_train if label == "training" else r2_heldout
            for output, (name, unit) in enumerate(names_units):
                axes = row[output]
                axes.plot(
                    truth[:, output],
                    predicted[:, output],
                    marker,
                    color=colour,
                    markersize=size,
                    markeredgewidth=0.0,
                    alpha=0.6,
                )
                axes.set_title(f"{name}, {label}: R² {scores[output]:.2f}")
                axes.set_ylabel(f"predicted [{unit}]")
                if label == "held out":
                    axes.set_xlabel(f"simulated [{unit}]")
        for column in panels.T:
            _identity(column)
        save_figure(figure, path)


def sensitivity(found: Sensitivity, path: Path) -> None:
    """Draw the shares of the design variables in the distance's variance, the largest on top."""
    order = np.argsort(found.total)
    place = np.arange(len(order))
    further = found.slope[order] >= 0.0
    with style():
        figure = new_figure(COLUMN, 0.9 + 0.17 * len(order))
        axes = figure.subplots()
        for chosen, colour, label in (
            (further, BLUE, "more of it: further"),
            (~further, VERMILION, "more of it: less far"),
        ):
            axes.barh(
                place[chosen],
                100.0 * found.total[order][chosen],
                color=colour,
                alpha=0.45,
                label=label,
            )
            axes.barh(
                place[chosen],
                100.0 * np.maximum(found.alone[order][chosen], 0.0),
                color=colour,
                height=0.35,
            )
        axes.barh([0], [0.0], color=INK, height=0.35, label="narrow: by itself")
        axes.set_yticks(place, [found.names[index].replace("_", " ") for index in order])
        axes.set_ylim(-0.7, len(order) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0.0)
        axes.set_xlabel("share of the variance of Z in the box [%]")
        figure.legend(loc="outside lower center", ncols=3, columnspacing=1.0, handlelength=1.2)
        save_figure(figure, path)


def parallel_coordinates(
    x: ArrayLike,
    forward_mm: ArrayLike,
    feasible: ArrayLike,
    best: ArrayLike,
    names: Sequence[str],
    path: Path,
    *,
    label: str = "best walk",
) -> None:
    """Every walk that survived as a line through its design variables; feasible ones in colour.

    Args:
        x: Design vectors in units of the box, shape (n, d).
        forward_mm: Distance walked [mm], shape (n,).
        feasible: Whether each walk holds all constraints, shape (n,).
        best: Design vector of the walk to draw on top, shape (d,).
        names: The design variables, d of them.
        path: The file to write.
        label: What the walk on top is called.
    """
    points, forward = np.asarray(x, dtype=float), np.asarray(forward_mm, dtype=float)
    holds = np.asarray(feasible, dtype=bool)
    place = np.arange(len(names))
    lines = np.stack([np.broadcast_to(place, points.shape), points], axis=2)
    order = np.flatnonzero(holds)[np.argsort(forward[holds])]
    many = len(points) > _MOST_MARKS
    with style():
        figure = new_figure(PAGE, 3.0)
        axes = figure.subplots()
        axes.axhspan(-1.0, 1.0, color=SHADE, zorder=0)
        axes.add_collection(
            LineCollection(
                list(lines[~holds]), colors=GREY, linewidths=0.4, alpha=0.25, rasterized=many
            )
        )
        coloured = LineCollection(
            list(lines[order]), cmap=_MAP, linewidths=0.9, alpha=0.9, rasterized=many
        )
        coloured.set_array(forward[order])
        axes.add_collection(coloured)
        axes.plot(
            place,
            np.asarray(best),
            "o-",
            color=VERMILION,
            linewidth=1.6,
            markersize=3.5,
            label=label,
        )
        axes.plot([], [], color=GREY, linewidth=0.8, label="not feasible")
        axes.fill_between([], [], color=SHADE, label="box of the samples")
        if len(order):
            figure.colorbar(coloured, ax=axes, label="distance of feasible walks [mm]", pad=0.01)
        reach = 1.08 * max(1.0, float(np.abs(points).max(initial=0.0)))
        axes.set(xlim=(-0.3, len(names) - 0.7), ylim=(-reach, reach))
        axes.set_xticks(
            place,
            [name.replace("_", " ") for name in names],
            rotation=45,
            ha="right",
            rotation_mode="anchor",
        )
        axes.grid(visible=False, axis="y")
        axes.set_ylabel("value [half widths of the box]")
        figure.legend(loc="outside upper center", ncols=3)
        save_figure(figure, path)


def pareto(
    forward_mm: ArrayLike, cost_of_transport: ArrayLike, feasible: ArrayLike, path: Path
) -> None:
    """Distance walked against what it costs, and the walks that none betters in both.

    Args:
        forward_mm: Distance walked [mm] of the walks that survived, shape (n,).
        cost_of_transport: Of the same walks, shape (n,).
        feasible: Whether each walk holds all constraints, shape (n,).
        path: The file to write.
    """
    forward, cost = (np.asarray(values, dtype=float) for values in (forward_mm, cost_of_transport))
    holds = np.asarray(feasible, dtype=bool)
    front = pareto_front(forward[holds], cost[holds])
    with style():
        figure = new_figure(COLUMN, 2.7)
        axes = figure.subplots()
        if np.isfinite(cost[~holds]).any():
            axes.plot(
                forward[~holds],
                cost[~holds],
                ".",
                color=GREY,
                markersize=3.0,
                alpha=0.7,
                label="not feasible",
            )
        axes.plot(forward[holds], cost[holds], ".", color=GREEN, markersize=5.0, label="feasible")
        axes.plot(
            forward[holds][front],
            cost[holds][front],
            "o-",
            color=BLUE,
            markersize=4.0,
            label="Pareto front",
        )
        usual = cost[np.isfinite(cost) & (cost > 0.0)]
        if usual.size:
            # A walk that hardly advances costs without bound.
            axes.set_ylim(0.0, 1.05 * np.quantile(usual, 0.95))
        axes.set_xlabel("distance walked [mm]")
        axes.set_ylabel("cost of transport [1]")
        figure.legend(loc="outside lower center", ncols=3, columnspacing=1.0, handlelength=1.2)
        save_figure(figure, path)


def pareto_front(gain: FloatArray, cost: FloatArray) -> NDArray[np.intp]:
    """Indices of the points that no other betters in gain and cost, by rising gain.

    What has no cost, or an infinite one, is not among them.
    """
    cost = np.nan_to_num(cost, nan=np.inf, posinf=np.inf)
    order = np.lexsort((cost, -gain))
    cheapest = np.minimum.accumulate(np.append(np.inf, cost[order]))[:-1]
    front: NDArray[np.intp] = order[cost[order] < cheapest][::-1]
    return front


def _best_so_far(forward: FloatArray, feasible: NDArray[np.bool_]) -> FloatArray:
    """The longest feasible walk up to each one, shape (n,); NaN before the first."""
    best: FloatArray = np.fmax.accumulate(np.where(feasible, forward, np.nan))
    return best


def _identity(shared: Sequence[Axes]) -> None:
    """The same square range on both axes, and the line where prediction and simulation agree."""
    low = min(shared[0].get_xlim()[0], shared[0].get_ylim()[0])
    high = max(shared[0].get_xlim()[1], shared[0].get_ylim()[1])
    for axes in shared:
        axes.plot([low, high], [low, high], color=INK, linewidth=0.7, zorder=0)
        axes.set(xlim=(low, high), ylim=(low, high), aspect="equal")
