"""Look at studies: `python -m drake_gait studies list|show|compare`.

list tells what is in a folder of studies, show where one stands, and compare puts several side by
side, with the settings that differ. Running studies can be looked at as well. --json prints the
same for other programs, in SI units.
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
from drake_gait.report.status import Standing, standing, studies_in

_WIDEST = 48  # Of a value in a table [characters]; --json has all of it.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    return conduct(lambda: _tell(_parse(arguments)))


def _tell(options: argparse.Namespace) -> None:
    commands: dict[str, Callable[[Any], tuple[str, Any]]]
    commands = {"list": _list, "show": _show, "compare": _compare}
    text, plain = commands[options.command](options.paths)
    print(to_json(plain) if options.json else text)


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


def _list(folder: Path) -> tuple[str, Any]:
    """What is in a folder of studies; one that cannot be read does not hide the others."""
    found: list[Standing] = []
    paths, unreadable = studies_in(folder)
    errors = {str(path): text for path, text in unreadable.items()}
    for path in paths:
        try:
            found.append(standing(path / "study.db"))
        except GaitError as error:
            errors[str(path)] = " ".join(str(error).split("\n"))
    rows = [["folder", "study", "seed", "mode", "state", "walks", "survivors", "feasible", "best"]]
    for one in found:
        walks, survivors = f"{one.walks}/{one.total}", str(one.survivors)
        where, seed, mode = str(one.folder.relative_to(folder)), str(one.seed), one.mode or "-"
        rows.append(
            [
                where,
                one.name,
                seed,
                mode,
                one.state,
                walks,
                survivors,
                str(one.feasible),
                _best(one),
            ]
        )
    lines = [_aligned(rows)] if found else []
    lines += [f"{one.folder}: {one.remark}" for one in found if one.remark]
    lines += [f"cannot be read: {error}" for error in errors.values()]
    broken = [{"folder": path, "error": text} for path, text in errors.items()]
    return "\n".join(lines), [*(one.plain() for one in found), *broken]


def _show(path: Path) -> tuple[str, Any]:
    """Where one study stands."""
    one = standing(find(path))
    question = one.settings.get("study.question")
    lines = [f"{one.folder}: study {one.name}, seed {one.seed}, {one.state}"]
    lines += [question, ""] if question else [""]
    lines += [f"{one.remark}.", ""] if one.remark else []
    lines.append(_aligned([*_numbers([one]), ["failures", _counts(one.failures)]]))
    if one.best:
        lines += ["", "the best feasible walks", _walks(one)]
    lines += ["", "settings (SI units)"]
    lines.append(_aligned([[key, _short(one.settings[key])] for key in sorted(one.settings)]))
    lines += ["", "versions", _aligned(list(one.versions.items()))]
    return "\n".join(lines), one.plain()


def _compare(paths: Sequence[Path]) -> tuple[str, Any]:
    """Several studies side by side, with what differs in how they were made."""
    if len(paths) < 2:
        raise StudyError(f"compare needs two studies; `show {paths[0]}` tells of one")
    found = [standing(find(path)) for path in paths]
    rows = [["", *(str(one.folder) for one in found)]]
    rows += [["state", *(one.state for one in found)], *_numbers(found)]
    causes = dict.fromkeys(cause for one in found for cause in one.failures)
    rows += [[cause, *(str(one.failures.get(cause, 0)) for one in found)] for cause in causes]
    lines = [_aligned(rows), ""]
    remarks = [f"{one.folder}: {one.remark}" for one in found if one.remark]
    lines += [*remarks, ""] if remarks else []
    differing = _differing([{**_versions(one), **one.settings} for one in found])
    if differing:
        lines += ["made with (SI units)", _aligned([["", *rows[0][1:]], *differing])]
    else:
        lines += ["all were made with the same settings, versions and robot"]
    return "\n".join(lines), [one.plain() for one in found]


def _numbers(found: Sequence[Standing]) -> list[list[str]]:
    """The figures of studies, one row each."""
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


def _walks(one: Standing) -> str:
    rows = [["walk", "Z [mm]", "X [mm]", "R [deg]", "Y [mm]", "N", "stage"]]
    for entry in one.best:
        walk = entry.walk
        millimetres = [f"{1e3 * value:.1f}" for value in (walk.forward, walk.lateral)]
        yaw, height = f"{np.degrees(walk.yaw):.2f}", f"{1e3 * walk.com_height:.1f}"
        rows.append([str(entry.id), *millimetres, yaw, height, str(walk.frames), entry.stage])
    return _aligned(rows)


def _versions(one: Standing) -> dict[str, Any]:
    return {
        "robot's file (sha256)": one.model_sha256[:12],
        **{f"version of {name}": number for name, number in one.versions.items()},
    }


def _differing(described: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Rows of what is not the same in all."""
    keys = dict.fromkeys(key for one in described for key in sorted(one))
    return [
        [key, *(_short(one.get(key)) for one in described)]
        for key in keys
        if any(one.get(key) != described[0].get(key) for one in described)
    ]


def _best(one: Standing) -> str:
    return f"{1e3 * one.best[0].walk.forward:.1f} mm" if one.best else "none"


def _counts(counted: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counted.items()) or "none"


def _short(value: Any) -> str:
    """A setting in at most so many characters as a table has room for."""
    text = "-" if value is None else _rounded(value)
    return text if len(text) <= _WIDEST else f"{text[: _WIDEST - 1]}…"


def _rounded(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_rounded(item) for item in value)}]"
    return f"{value:.6g}" if isinstance(value, float) else " ".join(str(value).split())


def _aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows as text, with their columns below each other."""
    if not rows:
        return ""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
