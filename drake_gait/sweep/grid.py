"""Given gaits on a grid of feet: which of two design variables matters, and where is the best.

Every gait walks several times on each foot, each time with its own small noise on the coefficients.
Walks are kept in grid.csv as they finish; an interrupted grid goes on with those that are missing.
"""

import csv
import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError, StudyError
from drake_gait.execution.local import LocalProcesses
from drake_gait.files.destination import make_folder, write
from drake_gait.files.strict_json import from_json, plain, to_json
from drake_gait.gait import FloatArray, Gait
from drake_gait.optimization import STARTING_TIME
from drake_gait.problem import Candidate, Trial
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.search.seeding import Purpose, generator
from drake_gait.simulation.simulate import try_out, walk_trial
from drake_gait.sweep.anova import Effect, two_way
from drake_gait.sweep.settings import Grid
from drake_gait.visualization import sweep as sweep_figures
from drake_gait.walk import Outcome, Walk

Place = tuple[int, int, int, int]
"""Level of the first and of the second axis, gait, replica; each from 0."""

_PLACE = ("first", "second", "gait", "replica")
_COLUMNS = (*_PLACE, "outcome", "frames", "forward_mm", "lateral_mm", "yaw_deg")


def places(grid: Grid) -> list[Place]:
    """Every walk of a grid; one replica of all comes before the next."""
    counts = [range(len(axis.levels)) for axis in grid.axes]
    return [
        (first, second, gait, replica)
        for replica, first, second, gait in product(
            range(grid.replicas), *counts, range(len(grid.gaits))
        )
    ]


def candidate(grid: Grid, place: Place) -> Candidate:
    """The foot and the noisy gait of one walk."""
    first, second, gait, _ = place
    rng = generator(grid.settings.seed, Purpose.GRID_NOISE, *place)
    noise = np.radians(grid.noise_deg) * rng.uniform(-1.0, 1.0, (4, 4))
    return Candidate(
        gait=Gait(coefficients=grid.gaits[gait].coefficients + noise),
        foot=grid.feet[first][second],
    )


def run_grid(grid: Grid, out: Path, workers: int) -> str:
    """Walk what is missing, write the analysis and the figure; returns a table for people.

    Where too few walks survive for an analysis, the files hold all but that, and the table says so.

    Raises:
        StudyError: the folder holds another grid, or a file cannot be written.
        ModelError: the robot cannot be used.
    """
    path, model = out / "grid.csv", read_model(grid.settings.walk.model)
    try:
        make_folder(out)
        _claim(grid, model, out / "grid.json")
        rows = _known(path)
        missing = [place for place in places(grid) if place not in rows]
        limit = grid.settings.walk.time_limit + STARTING_TIME
        if missing:
            try_out(candidate(grid, missing[0]), replace(grid.settings.walk, model=model))
            walk = functools.partial(walk_trial, model=model.for_walks())
            trials = [
                Trial(candidate=candidate(grid, place), settings=grid.settings.walk)
                for place in missing
            ]
            with (
                path.open("a", newline="", encoding="utf-8") as file,
                LocalProcesses(walk, count=workers, time_limit=limit) as processes,
            ):
                writer = csv.writer(file, lineterminator="\n")
                for finished in processes.run(trials):
                    place = missing[finished.index]
                    rows[place] = _row(finished.walk)
                    writer.writerow([*place, *rows[place].values()])
                    file.flush()
        return _analyse(grid, rows, out)
    except OSError as error:
        raise StudyError(f"cannot write into {out}: {error.strerror}") from None


def _claim(grid: Grid, model: RobotModel, path: Path) -> None:
    """Write what the grid is, or refuse a folder that holds another one."""
    wanted = plain(
        {
            "settings": grid.settings.description(),
            "axes": [asdict(axis) for axis in grid.axes],
            "gaits_deg": [gait.degrees.tolist() for gait in grid.gaits],
            "noise_deg": grid.noise_deg,
            "model_sha256": model.sha256,
        }
    )
    walks = path.with_suffix(".csv")
    if not path.exists():
        if _known(walks):
            raise StudyError(
                f"{walks} holds walks of a grid that is not known, as {path.name} is missing; "
                "remove it, or give --out for another folder"
            )
        write(path, to_json(wanted) + "\n")
        return
    try:
        found = from_json(path.read_bytes())
    except ValueError:
        raise StudyError(
            f"{path} is damaged, so that the grid of {walks.name} is not known; remove both, or "
            "give --out for another folder"
        ) from None
    if isinstance(found, dict):
        found.setdefault("model_sha256", model.sha256)  # Older grids do not say.
    if found != wanted:
        raise StudyError(f"{path.parent} holds another grid; give --out for another folder")


def _known(path: Path) -> dict[Place, Mapping[str, Any]]:
    """Return the walks in grid.csv. Damaged lines are dropped, to be walked again."""
    rows: dict[Place, Mapping[str, Any]] = {}
    before = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
    whole = [",".join(_COLUMNS)]
    for line in before.split("\n")[1:-1]:  # What follows the last line's end is no line.
        found = _from_line(line)
        if found is not None:
            place, row = found
            rows[place] = row
            whole.append(line)
    after = "\n".join(whole) + "\n"
    if after != before:
        write(path, after)
    return rows


def _from_line(line: str) -> tuple[Place, Mapping[str, Any]] | None:
    """Return the place and the walk of a line of grid.csv; None if it is none."""
    try:
        first, second, gait, replica, outcome, *numbers = line.split(",")
        place = int(first), int(second), int(gait), int(replica)
        values = [str(Outcome(outcome)), *map(float, numbers)]
        row = dict(zip(_COLUMNS[len(_PLACE) :], values, strict=True))
    except ValueError:
        return None
    return (place, row) if np.isfinite(values[1:]).all() else None  # type: ignore[arg-type]


def _row(walk: Walk) -> Mapping[str, Any]:
    return {
        "outcome": str(walk.outcome),
        "frames": walk.frames,
        "forward_mm": 1e3 * walk.forward,
        "lateral_mm": 1e3 * walk.lateral,
        "yaw_deg": float(np.degrees(walk.yaw)),
    }


def _analyse(grid: Grid, rows: Mapping[Place, Mapping[str, Any]], out: Path) -> str:
    """Write anova.json and grid.png from all walks of a grid."""
    walked = [place for place in places(grid) if rows[place]["outcome"] == "walked"]
    distance = np.array([rows[place]["forward_mm"] for place in walked])
    first, second, gait, _ = np.array(walked, dtype=int).reshape(-1, 4).T
    names = tuple(axis.name for axis in grid.axes)
    effects, obstacle = _effects(distance, first, second, gait, names)
    shape = tuple(len(axis.levels) for axis in grid.axes)
    mean, survivors = np.full(shape, np.nan), np.zeros(shape, dtype=int)
    # Gaits differ more than feet: a cell is compared by how far it is from its gaits' means.
    expected = np.array([distance[gait == own].mean() for own in gait])
    for cell in np.ndindex(shape):
        here = (first == cell[0]) & (second == cell[1])
        survivors[cell] = here.sum()
        if here.any():
            mean[cell] = (distance - expected)[here].mean() + distance.mean()
    labels = [[_label(level) for level in axis.levels] for axis in grid.axes]
    content = {
        "walks": len(places(grid)),
        "survivors": len(walked),
        "effects": [asdict(effect) for effect in effects],
        "no_effects_because": obstacle,
        "mean_forward_mm": mean,
        "survivors_by_cell": survivors.tolist(),
    }
    write(out / "anova.json", to_json(content) + "\n")
    sweep_figures.grid(mean, labels, names, out / "grid.png")
    cells = _cells(mean, survivors, labels, names, grid)
    return f"{obstacle or _table(effects)}\n\n{cells}\n{out}: grid.csv, anova.json, grid.png"


def _effects(
    distance: FloatArray, first: FloatArray, second: FloatArray, gait: FloatArray,
    names: Sequence[str],
) -> tuple[Sequence[Effect], str | None]:  # fmt: skip
    """Return the analysis of variance, or a sentence that says why there is none."""
    try:
        return two_way(distance, first, second, gait, names), None
    except SettingsError:
        return (), (
            f"no analysis of variance: the {len(distance)} walks that survived leave no scatter "
            "between walks of one gait on one foot"
        )


def _cell(value: float, width: int) -> str:
    return f"{'-':>{width}}" if np.isnan(value) else f"{value:{width}.1f}"


def _label(level: Mapping[str, float]) -> str:
    return " / ".join(f"{value:g}" for value in level.values())


def _table(effects: Sequence[Effect]) -> str:
    lines = [f"{'effect on Z':<22} {'df':>4} {'share':>8} {'F':>9} {'p':>9}"]
    for effect in effects:
        ratio = "" if effect.ratio is None else f"{effect.ratio:9.2f}"
        p_value = "" if effect.p_value is None else f"{effect.p_value:9.2g}"
        share = 100.0 * effect.share
        lines.append(f"{effect.name:<22} {effect.degrees:4d} {share:7.1f}% {ratio:>9} {p_value:>9}")
    return "\n".join(lines)


def _cells(
    mean: FloatArray,
    survivors: FloatArray,
    labels: Sequence[Sequence[str]],
    names: Sequence[str],
    grid: Grid,
) -> str:
    """The means of all cells, and the best of those where at least half of the walks survived."""
    wanted = grid.replicas * len(grid.gaits) / 2.0
    ranked = np.where(survivors >= wanted, mean, -np.inf)
    lines = [f"mean Z of survivors [mm]; rows {names[0]}, columns {names[1]}"]
    width = max(9, *(len(label) + 1 for label in labels[1]))
    lines.append(" " * 18 + "".join(f"{label:>{width}}" for label in labels[1]))
    for label, row in zip(labels[0], mean, strict=True):
        lines.append(f"{label:>18}" + "".join(_cell(value, width) for value in row))
    if not np.isfinite(ranked).any():
        lines.append("furthest: none, as on no foot half of the walks survived")
        return "\n".join(lines) + "\n"
    row_index, column_index = divmod(int(ranked.argmax()), mean.shape[1])
    lines.append(
        f"furthest: {names[0]} {labels[0][row_index]}, {names[1]} {labels[1][column_index]}, "
        f"{mean[row_index, column_index]:.1f} mm"
    )
    return "\n".join(lines) + "\n"
