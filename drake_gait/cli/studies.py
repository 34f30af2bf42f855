"""Look at studies: `python -m drake_gait studies list|show|compare`.

`list` has a line for each study in a folder, and `show` tells of one. `compare` puts several side
by side, with the settings that differ. Running studies can be looked at as well. `--json` prints
the same for other programs, in SI units.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.cli._command import conduct
from drake_gait.errors import GaitError, StudyError
from drake_gait.files.shipped import find
from drake_gait.files.strict_json import to_json
from drake_gait.report.status import Status, read_status, studies_in
from drake_gait.report.tables import Table

Part = str | Table
"""A part of what a command prints: lines, or a table."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _tell(_parse(arguments)))


def _tell(options: argparse.Namespace) -> None:
    commands: dict[str, Callable[[Any], tuple[Sequence[Part], Any]]]
    commands = {"list": _list, "show": _show, "compare": _compare}
    parts, plain = commands[options.command](options.paths)
    if options.json:
        print(to_json(plain))
        return
    from drake_gait.cli._table import show

    for part in parts:
        if isinstance(part, Table):
            show(part)
        else:
            print(part)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(
        prog="python -m drake_gait studies", description=summary.split(":")[0], epilog=rest
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name, text, number, path in (
        ("list", "what is in a folder of studies", "?", "FOLDER"),
        ("show", "where one study stands", None, "RUN"),
        ("compare", "several studies side by side", "+", "RUN"),
    ):
        command = commands.add_parser(name, help=text, description=text)
        what = "where studies are (runs)" if name == "list" else "a study's folder"
        runs = Path("runs")
        command.add_argument(
            "paths", type=Path, nargs=number, default=runs, metavar=path, help=what
        )
        command.add_argument("--json", action="store_true", help="print JSON")
    return parser.parse_args(arguments)


def _list(folder: Path) -> tuple[Sequence[Part], Any]:
    """Tell of all studies in a folder; one that cannot be read does not hide the others."""
    found: list[Status] = []
    paths, unreadable = studies_in(folder)
    errors = {str(path): text for path, text in unreadable.items()}
    for path in paths:
        try:
            found.append(read_status(path / "study.db"))
        except GaitError as error:
            errors[str(path)] = " ".join(str(error).split("\n"))
    rows = [
        [
            str(one.folder.relative_to(folder)),
            one.name,
            str(one.seed),
            one.mode or "-",
            one.state,
            f"{one.walks}/{one.total}",
            str(one.survivors),
            str(one.feasible),
            _best(one),
        ]
        for one in found
    ]
    heads = ["folder", "study", "seed", "mode", "state", "walks", "survivors", "feasible", "best"]
    parts: list[Part] = [_words(rows, heads)] if rows else []
    parts += [f"{one.folder}: {one.remark}" for one in found if one.remark]
    parts += [f"cannot be read: {error}" for error in errors.values()]
    broken = [{"folder": path, "error": text} for path, text in errors.items()]
    return parts, [*(one.plain() for one in found), *broken]


def _show(path: Path) -> tuple[Sequence[Part], Any]:
    """Tell of one study."""
    one = read_status(find(path))
    question = one.settings.get("study.question")
    parts: list[Part] = [f"{one.folder}: study {one.name}, seed {one.seed}, {one.state}"]
    parts += [question, ""] if question else [""]
    parts += [f"{one.remark}.", ""] if one.remark else []
    parts.append(_words([*_numbers([one]), ["failures", _counts(one.failures)]]))
    if one.best:
        parts += ["", _walks(one)]
    settings = [[key, _rounded(one.settings[key])] for key in sorted(one.settings)]
    parts += ["", _words(settings, caption="settings (SI units)")]
    versions = [list(item) for item in one.versions.items()]
    parts += ["", _words(versions, caption="versions")]
    return parts, one.plain()


def _compare(paths: Sequence[Path]) -> tuple[Sequence[Part], Any]:
    """Tell of several studies side by side, with what differs in how they were made."""
    if len(paths) < 2:
        raise StudyError(f"compare needs two studies; `show {paths[0]}` tells of one")
    found = [read_status(find(path)) for path in paths]
    heads = ["", *(str(one.folder) for one in found)]
    rows = [["state", *(one.state for one in found)], *_numbers(found)]
    causes = dict.fromkeys(cause for one in found for cause in one.failures)
    rows += [[cause, *(str(one.failures.get(cause, 0)) for one in found)] for cause in causes]
    parts: list[Part] = [_words(rows, heads), ""]
    remarks = [f"{one.folder}: {one.remark}" for one in found if one.remark]
    parts += [*remarks, ""] if remarks else []
    differing = _differing([{**_versions(one), **one.settings} for one in found])
    if differing:
        parts.append(_words(differing, heads, caption="made with (SI units)"))
    else:
        parts.append("all were made with the same settings, versions and robot")
    return parts, [one.plain() for one in found]


def _numbers(found: Sequence[Status]) -> list[list[str]]:
    """Return the figures of studies, one row each."""
    rows = [
        ["walks", *(f"{one.walks} of {one.total}" for one in found)],
        ["by stage", *(_counts(one.stages) for one in found)],
        ["survivors", *(str(one.survivors) for one in found)],
        ["feasible", *(str(one.feasible) for one in found)],
        ["best feasible", *(_best(one) for one in found)],
        ["time", *("-" if one.wall_s is None else f"{one.wall_s:.0f} s" for one in found)],
    ]
    outputs = dict.fromkeys(name for one in found for name in one.r2_heldout)
    for name in outputs:
        values = [one.r2_heldout.get(name) for one in found]
        rows.append(
            [f"held-out R² of {name}", *("-" if r2 is None else f"{r2:.2f}" for r2 in values)]
        )
    return rows


def _walks(one: Status) -> Table:
    rows = []
    for entry in one.best:
        walk = entry.walk
        millimetres = [f"{1e3 * value:.1f}" for value in (walk.forward, walk.lateral)]
        yaw, height = f"{np.degrees(walk.yaw):.2f}", f"{1e3 * walk.com_height:.1f}"
        rows.append([str(entry.id), *millimetres, yaw, height, str(walk.frames), entry.stage])
    return Table(
        caption="the best feasible walks",
        columns=["walk", "Z [mm]", "X [mm]", "R [deg]", "Y [mm]", "N", "stage"],
        rows=rows,
    )


def _versions(one: Status) -> dict[str, Any]:
    return {
        "robot's file (sha256)": one.model_sha256[:12],
        **{f"version of {name}": number for name, number in one.versions.items()},
    }


def _differing(described: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the settings that differ, a row each."""
    keys = dict.fromkeys(key for one in described for key in sorted(one))
    return [
        [key, *(_rounded(one.get(key)) for one in described)]
        for key in keys
        if any(one.get(key) != described[0].get(key) for one in described)
    ]


def _best(one: Status) -> str:
    return f"{1e3 * one.best[0].walk.forward:.1f} mm" if one.best else "none"


def _counts(counted: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counted.items()) or "none"


def _rounded(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, list):
        return f"[{', '.join(_rounded(item) for item in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else " ".join(str(value).split())


def _words(rows: Sequence[Sequence[str]], heads: Sequence[str] = (), caption: str = "") -> Table:
    """Return a table of words, with or without heads."""
    columns = heads or [""] * max(map(len, rows), default=1)
    return Table(caption=caption, columns=columns, rows=rows, numbers=False)
