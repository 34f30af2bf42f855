"""The one style of all figures: sizes, fonts, and how a figure becomes a file.

Figures are a journal's column wide, and have a unit on every axis. `palette` has the colours.
"""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from drake_gait.errors import SettingsError
from drake_gait.files.destination import write
from drake_gait.visualization.palette import LINE
from drake_gait.visualization.rasterizer import Picture

COLUMN = 3.5
"""Width of a figure of one column [inch]."""
PAGE = 7.2
"""Width of a figure of two columns [inch]."""
PNG_RESOLUTION = 200
"""Dots per inch of a PNG."""
FORMATS = (".png", ".svg")
"""What a figure is written as when its path names no format."""

# Without a date or a version inside, the same data give the same file.
_NAMELESS: dict[str, Any] = {".svg": {"Date": None}, ".png": {"Software": None}}

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
    "grid.color": LINE,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "drake_gait",  # the same figure gives the same file
    "text.parse_math": False,  # a dollar in a name is a dollar
}

# They decide where windows open, and not what a file looks like.
_OF_WINDOWS = ("backend", "backend_fallback", "interactive", "toolbar")

GAIT_PHASES = (
    (0.0, "initial contact"),
    (0.25, "mid-stance"),
    (0.5, "terminal stance"),
    (0.75, "initial swing"),
    (1.0, "terminal swing"),
)
"""Parts of the second gait cycle in the paper's Fig. 12 and what the right leg is doing."""


@contextmanager
def style() -> Iterator[None]:
    """Inside, figures are drawn in STYLE on matplotlib's own defaults, whatever a user's are."""
    standard = {
        name: value for name, value in mpl.rcParamsDefault.items() if name not in _OF_WINDOWS
    }
    with warnings.catch_warnings(), mpl.rc_context():
        warnings.simplefilter("ignore", mpl.MatplotlibDeprecationWarning)  # Of old defaults.
        warnings.filterwarnings("ignore", r"Glyph \d+")  # A name's character that no font has.
        mpl.rcParams.update(standard)
        mpl.rcParams.update(STYLE)
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch], to be filled within `style()`."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure in the format of the path's ending, or, where it has none, in FORMATS.

    The same data give the same file.

    Raises:
        SettingsError: no figure can be written in this format.
        GaitError: the file cannot be written.
    """
    path = Path(path)
    figure.dpi = PNG_RESOLUTION
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # Each format would lay the same figure out anew.
    for file in [path] if path.suffix else [path.with_suffix(ending) for ending in FORMATS]:
        drawn, kind = io.BytesIO(), file.suffix
        try:
            figure.savefig(drawn, format=kind[1:], dpi=PNG_RESOLUTION, metadata=_NAMELESS.get(kind))
        except ValueError as error:
            raise SettingsError(f"cannot write the figure {file}: {error}") from None
        write(file, drawn.getvalue(), what="the figure ")


def save_picture(picture: Picture, path: Path) -> None:
    """Write a picture by itself, without axes, as a PNG.

    Raises:
        GaitError: the file cannot be written.
    """
    drawn = io.BytesIO()
    with style():
        pixels = np.clip(picture.pixels, 0.0, 1.0)
        imsave(drawn, pixels, format="png", metadata=_NAMELESS[".png"])
    write(path, drawn.getvalue(), what="the picture ")
