"""Results of a grid of feet: which of two design variables matters, and where the best is."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.files.destination import check, write
from drake_gait.files.strict_json import to_json
from drake_gait.gait import FloatArray
from drake_gait.report.tables import Table, number
from drake_gait.sweep.anova import Effect, two_way
from drake_gait.sweep.settings import Grid
from drake_gait.visualization import sweep as sweep_figures
from drake_gait.walk import Outcome, Walk

Place = tuple[int, int, int, int]
"""Level of the first and of the second axis, gait, replica; each from 0."""

WALKS, ANALYSIS, FIGURE = "grid.csv", "anova.json", "grid.png"
OUTPUTS = (WALKS, ANALYSIS, FIGURE)
"""Files that a grid writes beside study.db."""

_OF_PLACE = ("first", "second", "gait", "replica")
_OF_WALK = ("outcome", "frames", "forward_mm", "lateral_mm", "yaw_deg")


@dataclass(frozen=True, kw_only=True, eq=False)
class Results:
    """Results of a grid; lengths in mm."""

    grid: Grid
    """The grid."""
    walks: int
    """Walks."""
    survivors: int
    """Walks that ended on their feet."""
    effects: Sequence[Effect]
    """The analysis of variance of the survivors' distances; empty where there is none."""
    obstacle: str | None
    """A sentence that says why there is none."""
    mean: FloatArray
    """Mean distance on every foot [mm], shape (n, m); nan where no walk survived."""
    survivors_by_cell: FloatArray
    """Survivors on every foot, whole numbers of shape (n, m)."""

    @property
    def best(self) -> tuple[int, int] | None:
        """Levels of the foot with the furthest mean, of those where half of the walks survived."""
        wanted = self.grid.replicas * len(self.grid.gaits) / 2.0
        ranked = np.where(self.survivors_by_cell >= wanted, self.mean, -np.inf)
        if not np.isfinite(ranked).any():
            return None
        first, second = divmod(int(ranked.argmax()), self.mean.shape[1])
        return first, second

    def best_in_words(self) -> str:
        """Return the best foot as a sentence."""
        if self.best is None:
            return "furthest: none, as on no foot half of the walks survived"
        named = ", ".join(
            f"{axis.name} {label(axis.levels[level])}"
            for axis, level in zip(self.grid.axes, self.best, strict=True)
        )
        return f"furthest: {named}, {self.mean[self.best]:.1f} mm"


def check_outputs(out: Path) -> None:
    """Refuse a folder that the results could not be written into, before anything walks.

    Raises:
        GaitError: names the file.
    """
    for name in OUTPUTS:
        check(out / name)


def analysed(grid: Grid, walks: Mapping[Place, Walk]) -> Results:
    """Return the analysis of all walks of a grid."""
    places = [place for place, walk in walks.items() if walk.outcome is Outcome.WALKED]
    distance = np.array([1e3 * walks[place].forward for place in places])
    first, second, gait, _ = np.array(places, dtype=int).reshape(-1, 4).T
    effects, obstacle = _effects(distance, first, second, gait, [axis.name for axis in grid.axes])
    shape = tuple(len(axis.levels) for axis in grid.axes)
    mean, survivors = np.full(shape, np.nan), np.zeros(shape, dtype=int)
    # Gaits differ more than feet: a cell is compared by how far it is from its gaits' means.
    expected = np.array([distance[gait == own].mean() for own in gait])
    for cell in np.ndindex(shape):
        here = (first == cell[0]) & (second == cell[1])
        survivors[cell] = here.sum()
        if here.any():
            mean[cell] = (distance - expected)[here].mean() + distance.mean()
    return Results(
        grid=grid,
        walks=len(walks),
        survivors=len(places),
        effects=effects,
        obstacle=obstacle,
        mean=mean,
        survivors_by_cell=survivors,
    )


def _effects(
    distance: FloatArray,
    first: FloatArray,
    second: FloatArray,
    gait: FloatArray,
    names: Sequence[str],
) -> tuple[Sequence[Effect], str | None]:
    """Return the analysis of variance, or a sentence that says why there is none."""
    try:
        return two_way(distance, first, second, gait, names), None
    except SettingsError:
        return (), (
            f"no analysis of variance: the {len(distance)} walks that survived leave no scatter "
            "between walks of one gait on one foot"
        )


def write_results(grid: Grid, walks: Mapping[Place, Walk], out: Path) -> Results:
    """Write grid.csv, anova.json and grid.png from all walks of a grid, and return the analysis.

    Raises:
        GaitError: a file cannot be written.
    """
    found = analysed(grid, walks)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_OF_PLACE, *_OF_WALK])
    writer.writerows([*place, *_row(walk)] for place, walk in walks.items())
    write(out / WALKS, text.getvalue())
    content = {
        "walks": found.walks,
        "survivors": found.survivors,
        "effects": [asdict(effect) for effect in found.effects],
        "no_effects_because": found.obstacle,
        "mean_forward_mm": found.mean,
        "survivors_by_cell": found.survivors_by_cell.tolist(),
    }
    write(out / ANALYSIS, to_json(content) + "\n")
    labels = [[label(level) for level in axis.levels] for axis in grid.axes]
    names = [axis.name for axis in grid.axes]
    sweep_figures.grid(found.mean, labels, names, out / FIGURE)
    return found


def _row(walk: Walk) -> tuple[str, int, float, float, float]:
    yaw = float(np.degrees(walk.yaw))
    return str(walk.outcome), walk.frames, 1e3 * walk.forward, 1e3 * walk.lateral, yaw


def label(level: Mapping[str, float]) -> str:
    """Return the values of a level, as text."""
    return " / ".join(f"{value:g}" for value in level.values())


def effects_table(found: Results) -> Table:
    """Return the table of the analysis of variance."""
    return Table(
        caption="Effects on Z",
        columns=["effect", "degrees of freedom", "share [%]", "F", "p"],
        rows=[
            [
                effect.name,
                str(effect.degrees),
                number(100.0 * effect.share, 1),
                number(effect.ratio, 2),
                "–" if effect.p_value is None else f"{effect.p_value:.2g}",
            ]
            for effect in found.effects
        ],
    )


def means_table(found: Results) -> Table:
    """Return the mean distance on every foot."""
    first, second = found.grid.axes
    return Table(
        caption=f"Mean Z of the survivors [mm]; rows: {first.name}, columns: {second.name}",
        columns=["", *map(label, second.levels)],
        rows=[
            [label(level), *(number(value, 1) for value in row)]
            for level, row in zip(first.levels, found.mean, strict=True)
        ],
    )
