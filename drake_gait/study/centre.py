"""The middle of a box that lies around the winner of an earlier study, and the foot beside it.

The study's file names the earlier one (`box.centre_from`). Once a study has begun, its own file
says around which gait: it goes on whatever has become of the earlier one.
"""

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drake_gait.errors import SettingsError, StudyError
from drake_gait.foot import FootDesign
from drake_gait.gait import PAPER, Gait, GaitFamily, PaperFamily
from drake_gait.problem import ROUNDING
from drake_gait.ranges import DEGREES
from drake_gait.study._toml import as_toml, texts
from drake_gait.study.earlier_study import EarlierWinner, earlier_winner, foot_in_file
from drake_gait.study.keys import FOOT
from drake_gait.study.store import Study

if TYPE_CHECKING:
    from drake_gait.study.settings import StudySettings

_Middle = tuple[Any, dict[str, Any]]
"""Rows of degrees, or keys of [box.centre] with their values; keys of [foot] with theirs."""


def whole_path(folder: Path, written: str) -> Path:
    """Return the path that somebody has written, from the root and without "..".

    A symbolic link in it stays one: it is the name that counts, not where the link leads today.
    """
    return Path(os.path.abspath(folder / Path(written).expanduser()))  # noqa: PTH100


def resolve_centre(
    content: Mapping[str, Any],
    folder: Path,
    begun: Path | None,
    settings_of: Callable[[Mapping[str, Any]], "StudySettings"],
    family: GaitFamily = PAPER,
) -> tuple[dict[str, Any], dict[str, Any] | None, tuple[str, ...]]:
    """Put the gait and the foot of an earlier study into the content of a study's file.

    The foot comes along but for the keys that the file gives itself.

    Args:
        content: Sections of the file; `box.centre_from` is used if it is there.
        folder: What the earlier study's path is relative to.
        begun: Folder of the study that is read, which may have begun already.
        settings_of: Makes settings of a study's description.
        family: The family of the gaits that are to be searched.

    Returns:
        The content with `box.centre_deg`, or [box.centre], and [foot] as they are to be, what to
        keep of where they came from, and sentences for a person.

    Raises:
        SettingsError: the earlier study cannot be read, and the study has not begun.
    """
    box = content.get("box", {})
    if not isinstance(box, Mapping) or "centre_from" not in box:
        return dict(content), None, ()
    texts("box", box, ("centre_from",))
    if "centre_deg" in box:
        raise SettingsError("[box] has either centre_deg or centre_from")
    written = box["centre_from"]
    path = whole_path(folder, written)
    kept = _kept(begun, written, path, family, content)
    given = content.get("foot", {})
    notes: list[str] = []
    try:
        found = earlier_winner(path, settings_of)
        centre, foot = _centre(found, path, family, content), found.foot
    except SettingsError as error:
        if kept is None:
            raise SettingsError(f"box.centre_from: {error}") from None
        centre, foot = kept
        notes = [f"{error}; the study in {begun} goes on around what it began with"]
    if kept is not None:
        if not _is_alike(kept, (centre, foot)):
            notes = [f"{path} has changed; the study in {begun} goes on around what it began with"]
        centre, foot = kept
    taken = {key: value for key, value in (foot or {}).items() if key not in given}
    notes += _about_the_foot(path, foot, taken, given, content.get("design", {}))
    origin = {"written": written, "path": str(path), "foot": sorted(taken)}
    rest = {key: value for key, value in box.items() if key != "centre_from"}
    corner = "centre_deg" if isinstance(family, PaperFamily) else "centre"
    new = {**content, "box": {**rest, corner: centre}, "foot": {**taken, **given}}
    return new, origin, tuple(notes)


def _centre(
    found: EarlierWinner, path: Path, family: GaitFamily, content: Mapping[str, Any]
) -> Any:
    """Return the centre of a box around an earlier winner, as a file has it."""
    if isinstance(family, PaperFamily):
        if found.coefficients_deg is None and found.gait is not None:
            raise SettingsError(
                f"the winner of {path} is of the gait family {found.gait.family.label}, and the "
                "study's is paper; give gait.family"
            )
        return found.coefficients_deg
    gait = found.gait or Gait.from_degrees(found.coefficients_deg)
    return _as_written(family.like(gait), family, content)


def _as_written(
    values: Mapping[str, float], family: GaitFamily, content: Mapping[str, Any]
) -> dict[str, Any]:
    """Return values of variables [SI] by name as keys of [box.centre], with their values.

    What the file says of a variable itself, in [box.centre] or in [gait], counts.
    """
    own, fixed = content["box"].get("centre", {}), content.get("gait", {})
    told = {
        one.key: float(as_toml(float(values[one.name]), one.unit))
        for one in family.variables
        if one.name in values and one.key not in fixed
    }
    return {**told, **own} if isinstance(own, Mapping) else told


def _is_alike(kept: _Middle, found: tuple[Any, Mapping[str, Any] | None]) -> bool:
    """Return whether an earlier study still has the gait and the foot that were taken from it."""
    centre, foot = found
    if isinstance(kept[0], Mapping):
        return all(
            math.isclose(kept[0].get(key, math.nan), value, rel_tol=1e-9, abs_tol=1e-9)
            for key, value in centre.items()
        )
    try:
        differ = np.radians(np.array(centre, dtype=float)) - np.radians(kept[0])
    except (TypeError, ValueError):
        return False
    same_foot = all(
        math.isclose(value, (foot or {}).get(key, math.nan), rel_tol=1e-9)
        for key, value in kept[1].items()
    )
    return same_foot and bool((np.abs(differ) <= ROUNDING).all())


def _kept(
    begun: Path | None,
    written: str,
    path: Path,
    family: GaitFamily,
    content: Mapping[str, Any],
) -> _Middle | None:
    """Return centre and foot of the study if it has begun around this earlier one, else None."""
    file = None if begun is None else begun / "study.db"
    if file is None or not file.is_file():
        return None
    try:
        with Study.open(file) as study:
            description = study.description()
        origin = (description.get("source") or {}).get("centre_from") or {}
        if written != origin.get("written") and str(path) != origin.get("path"):
            return None
        settings = description["settings"]
        was = settings["box.centre"]
        centre: Any = (
            _as_written(was, family, content)
            if isinstance(was, Mapping)
            else [[float(as_toml(one, DEGREES)) for one in row] for row in was]
        )
        foot = foot_in_file({name: settings[f"foot.{name}"] for name in (*_FIELDS, "rigid_toes")})
    except (StudyError, KeyError, TypeError, AttributeError):
        return None  # Who opens it to go on says what is wrong.
    return centre, {key: foot[key] for key in origin.get("foot", ()) if key in foot}


_FIELDS = tuple(field for field, _ in FOOT.values())


def _about_the_foot(
    path: Path,
    foot: Mapping[str, Any] | None,
    taken: Mapping[str, Any],
    given: Mapping[str, Any],
    opened: Mapping[str, Any],
) -> list[str]:
    """Return what a person should know of the foot, in at most one sentence."""
    if foot is None:
        return [f"{path} tells of no foot; the study has that of its own file"]
    standard = foot_in_file(
        {**{field: getattr(FootDesign(), field) for field in _FIELDS}, "rigid_toes": False}
    )
    along = [
        f"{key} = {_text(value)}"
        for key, value in taken.items()
        if value != standard[key] and key not in opened
    ]
    lost = [
        f"{key} = {_text(value)}, not {_text(given[key])}"
        for key, value in foot.items()
        if key in given and given[key] != value
    ]
    told = []
    if along:
        told.append(f"the foot of {path} comes along: {', '.join(along)}")
    if lost:
        told.append(f"the foot of {path} had {', '.join(lost)} of [foot]")
    return ["; ".join(told)] if told else []


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else as_toml(value)
