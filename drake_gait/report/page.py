"""A study as one web page: question, winner, figures, how the search went; or several beside.

A page loads nothing: figures and recording are inside it.
"""

import base64
import gzip
import math
import re
import shlex
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from drake_gait.files.destination import write
from drake_gait.gait import FRAME_TIME, FRAMES
from drake_gait.report import tables as report_tables
from drake_gait.report.result import PAPER_TABLE
from drake_gait.report.tables import number, scaled
from drake_gait.study.finalists import shuffles
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.study.toml import DEFAULT_NAME, written_study_toml
from drake_gait.visualization import palette

FIGURES = "figures"
"""Folder of the figures, in a study's folder."""

PORTRAIT = "portrait.png"
"""The picture at the head of a report, beside the figures."""

_WIDE = 450  # a figure of two columns is wider than this [pixel]
_OF_THE_WALK = ("postures", "paths", "waveforms", "ground_reaction", "torques")
_OF_THE_SEARCH = ("convergence", "sensitivity", "pareto", "network", "coordinates")


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A study as its folder holds it."""

    folder: Path
    """The folder."""
    settings: StudySettings
    """What was searched."""
    result: Mapping[str, Any]
    """The content of result.json."""
    walks: Sequence[StudyWalk]
    """Every walk."""

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.resolve().name


def write_study_page(run: Run, path: Path) -> None:
    """Write the report of one study.

    Raises:
        GaitError: the file cannot be written.
    """
    result, limits = run.result, run.settings.constraints
    told = {one.quantity.name: report_tables.limit_in_words(one) for one in limits.given}
    template = _environment().get_template("report.html")
    page = template.render(
        run=run,
        result=result,
        settings=run.settings,
        paper_best=number(PAPER_TABLE[-1][1], 2),
        frames=_planned(run),
        seconds=number(_planned(run) * FRAME_TIME, 1),
        ratio=scaled(result["forward_mm"], 1.0 / PAPER_TABLE[-1][1], 1),
        degrees=math.degrees(1.0),
        shuffles=_shuffles(result),
        yaw_swing=report_tables.quantities(result).get("yaw_swing"),
        limits={
            "lateral": told["lateral"],
            "yaw": told["yaw"],
            "com_height": told["com_height"],
            # Those of a study's own, between Eqs. 11-13 and Eq. 14.
            "others": ", ".join(name.replace("_", " ") for name in limits.names[3:-1]),
            "yaw_swing": told.get("yaw_swing"),
        },
        unslipping=next(
            (walk for walk in run.walks if walk.id == result.get("best_unslipping")), None
        ),
        finalists=report_tables.finalists(result),
        tables={
            "paper": report_tables.beside_the_paper(run.walks, limits),
            "gait": report_tables.gait(result, run.settings.space.family),
            "foot": report_tables.foot(result["foot"] or {}),
            "dropped": report_tables.finalists(result, dropped=True),
            "finalists_manner": report_tables.manner_of_finalists(result),
            "manner": report_tables.manner(result, run.settings.quantities),
            "stages": report_tables.stages(run.walks, run.settings, result.get("proposer")),
            "failures": report_tables.failures(run.walks),
            "network": report_tables.network(result),
            "settings": report_tables.settings(run.settings.description()),
            "versions": report_tables.versions(result["versions"]),
        },
        portrait=_data_uri(run.folder / FIGURES / PORTRAIT),
        recording=_packed(run.folder / "walk.html"),
        of_the_walk=_figures(run, _OF_THE_WALK),
        of_the_search=_figures(run, _OF_THE_SEARCH),
        command=command(run),
    )
    _write(page, path)


def _planned(run: Run) -> int:
    """Return the frames of the best walk's gait, or of the one in the middle of the box."""
    if best := run.result.get("best"):
        return int(best["walk"].get("planned", FRAMES))
    return run.settings.space.middle.gait.frames


def write_comparison_page(runs: Sequence[Run], path: Path) -> None:
    """Write several studies side by side.

    Raises:
        GaitError: the file cannot be written.
    """
    names = [run.name for run in runs]
    shown = [
        {
            **_captions()[figure],
            "of": [shown for run in runs for shown in _figures(run, [figure], run.name)],
        }
        for figure in ("postures", "paths", "convergence", "sensitivity", "waveforms")
    ]
    template = _environment().get_template("comparison.html")
    page = template.render(
        runs=runs,
        numbers=report_tables.side_by_side(
            names,
            [run.result for run in runs],
            tuple({one.name: one for run in runs for one in run.settings.quantities}.values()),
        ),
        differences=report_tables.differences(names, [run.settings.description() for run in runs]),
        figures=[figure for figure in shown if figure["of"]],
        versions=[report_tables.versions(run.result["versions"]) for run in runs],
        commands=[(run.name, command(run)) for run in runs],
        furthest=max(runs, key=_place),
    )
    _write(page, path)


def _shuffles(result: Mapping[str, Any]) -> bool:
    """Return whether the walk of a result advances by sliding; False where it was not measured."""
    slip, forward = (result.get("measures") or {}).get("slip"), result["forward_mm"]
    if slip is None or None in slip or forward is None:
        return False
    return shuffles(slip, 1e-3 * forward)


def _place(run: Run) -> tuple[bool, float]:
    """Sorts studies, the one that went furthest last."""
    forward = run.result["forward_mm"]
    return bool(run.result["feasible"]), -math.inf if forward is None else float(forward)


def command(run: Run) -> str:
    """Return the command that makes the same study again, in a folder of its own.

    Its settings are in the study's folder; a study of an older version gets them with its report.
    """
    # A name that begins with a dash would be an option, and "." has no name to add to.
    named = run.folder if run.folder.name not in ("", "..") else run.folder.resolve()
    folder = f"./{named}" if str(named).startswith("-") else str(named)
    file = written_study_toml(run.folder)
    name = DEFAULT_NAME if file is None else file.name
    again = ["python", "-m", "drake_gait.optimize", f"{folder}/{name}", "--out", f"{folder}-again"]
    if file is not None:
        return shlex.join(again)
    return f"{shlex.join(['python', '-m', 'drake_gait', 'report', folder])} && {shlex.join(again)}"


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("drake_gait.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["palette"] = palette
    environment.filters["number"] = number
    environment.filters["scaled"] = scaled
    environment.filters["quoted"] = lambda path: shlex.quote(str(path))
    return environment


@lru_cache(maxsize=1)
def _captions() -> dict[str, dict[str, str]]:
    """Title and caption of each figure."""
    file = files("drake_gait.report") / "templates" / "captions.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def _figures(run: Run, names: Sequence[str], of: str = "") -> list[dict[str, Any]]:
    """Return the figures in a study's folder, with their captions."""
    found = []
    for name in names:
        path = run.folder / FIGURES / f"{name}.svg"
        if path.is_file():
            width, height = _size(path)
            shown = {"uri": _data_uri(path), "width": width, "height": height, "of": of}
            found.append({**_captions()[name], **shown, "wide": width > _WIDE})
    return found


def _size(svg: Path) -> tuple[int, int]:
    """Width and height of a drawing [pixel of 1/96 inch]."""
    head = svg.read_text(encoding="utf-8")[:2000]
    width, height = (
        float(match.group(1)) if (match := re.search(rf'\b{side}="([0-9.]+)pt"', head)) else 400.0
        for side in ("width", "height")
    )
    return round(width * 4.0 / 3.0), round(height * 4.0 / 3.0)


def _data_uri(path: Path) -> str | None:
    """A picture as an address that needs no file; None where there is none."""
    if not path.is_file():
        return None
    kind = {".svg": "image/svg+xml", ".png": "image/png"}[path.suffix]
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _packed(path: Path) -> str | None:
    """A recording, compressed, as text; None where there is none."""
    if not path.is_file():
        return None
    return base64.b64encode(gzip.compress(path.read_bytes(), mtime=0)).decode()


def _write(page: str, path: Path) -> None:
    write(path, page.encode("utf-8", "replace"), what="the report ")
