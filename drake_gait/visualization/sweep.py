"""Figures of a sweep: variants beside each other, and a grid of feet.

Each function draws one figure and writes it to `path`: see `figures.save_figure`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.visualization.palette import BLUE, VERMILION
from drake_gait.visualization.style import COLUMN, new_figure, save_figure, style

_MAP = "cividis"  # even in lightness, and alike for all kinds of colour vision


def variants(forward_mm: Mapping[str, Sequence[float]], path: Path) -> None:
    """The best feasible walks of every variant, one dot for each seed, and their median.

    Args:
        forward_mm: Distances walked [mm] of each variant, by its name.
        path: The file to write.
    """
    with style():
        figure = new_figure(COLUMN, 2.7)
        axes = figure.subplots()
        for place, distances in enumerate(forward_mm.values()):
            count = len(distances)
            # Beside each other, so that equal ones are seen.
            offsets = 0.06 * (np.arange(count) - (count - 1) / 2.0)
            axes.plot(
                place + offsets,
                sorted(distances),
                ".",
                color=BLUE,
                markersize=6.0,
                label="one seed" if place == 0 else "",
            )
            if distances:
                axes.hlines(
                    np.median(distances),
                    place - 0.3,
                    place + 0.3,
                    color=VERMILION,
                    linewidth=1.6,
                    label="median" if place == 0 else "",
                )
        axes.set_xticks(range(len(forward_mm)), [name.replace("_", " ") for name in forward_mm])
        if len(forward_mm) > 4:
            axes.tick_params(axis="x", rotation=30.0)
        axes.set_xlim(-0.6, len(forward_mm) - 0.4)
        furthest = max(
            (max(distances, default=0.0) for distances in forward_mm.values()), default=0
        )
        axes.set_ylim(0.0, 1.08 * furthest or 1.0)
        axes.grid(visible=False, axis="x")
        axes.set_ylabel("best feasible walk [mm]")
        figure.legend(loc="outside lower center", ncols=2)
        save_figure(figure, path)


def grid(
    forward_mm: ArrayLike, levels: Sequence[Sequence[str]], names: Sequence[str], path: Path
) -> None:
    """Mean distance on every foot of a grid; blank where no walk survived.

    Args:
        forward_mm: Means [mm], shape (n, m).
        levels: Labels of the n and of the m levels.
        names: What the two axes are called.
        path: The file to write.
    """
    mean = np.asarray(forward_mm, dtype=float)
    with style():
        figure = new_figure(COLUMN, 2.9)
        axes = figure.subplots()
        image = axes.imshow(mean, origin="lower", aspect="auto", cmap=_MAP)
        axes.set_xticks(
            range(len(levels[1])), levels[1], rotation=45, ha="right", rotation_mode="anchor"
        )
        axes.set_yticks(range(len(levels[0])), levels[0])
        axes.set(xlabel=names[1], ylabel=names[0])
        axes.grid(visible=False)
        figure.colorbar(image, ax=axes, label="mean distance [mm]")
        save_figure(figure, path)
