"""A study's settings as a TOML file that makes the same study again."""

import os
from collections.abc import Mapping
from pathlib import Path

from drake_gait.files.destination import write
from drake_gait.gait import PaperFamily
from drake_gait.study._toml import as_toml
from drake_gait.study.keys import KEYS, box_keys, in_file, keys
from drake_gait.study.settings import StudySettings

DEFAULT_NAME = "study.toml"
_NAMES = (DEFAULT_NAME, "study-settings.toml")
"""Its name in a study's folder; the second one where somebody keeps a file of the first name."""
_HEADER = "# Settings of the study in this folder"


def study_toml(settings: StudySettings) -> str:
    """Return the text of a study's file: every setting that has a value, whatever it came from.

    A limit that was removed is not there. The robot is named by its shipped name or by its path
    from the root, so that the file is good in every folder.
    """
    family = settings.space.family
    known = keys(settings.quantities, type(family))
    # A number that is a setting and a variable has one place in a file: [gait] or [box.centre].
    in_corner = set(family.names) - _said_by_setting(settings)
    elsewhere = {f"gait.{name}" for name in family.setting_units().keys() & in_corner}
    corners: list[str] = []
    sections: dict[str, list[str]] = {section: [] for section in KEYS}
    for name, value in settings.description().items():
        if value is None or (name == "study.quantities" and not value):
            continue
        if name == "study.quantities":
            value = str(Path(value).absolute())
        if name in ("walk.model", "robot.file") and os.sep in value:
            value = str(Path(value).absolute())
        if (name == "robot.file" and not value) or name in elsewhere:
            continue
        if name in ("box.centre", "box.half_width") and isinstance(value, dict):
            corners += ["", *_corner(name, value, settings)]
            continue
        key, unit = in_file(name, settings.quantities, type(family))
        section, _, short = key.partition(".")
        if short not in known[section]:  # A user's own changes are objects.
            continue
        sections[section].append(f"{short} = {as_toml(value, unit)}")
    lines = [f"{_HEADER}{_origin(settings)}.", ""]
    for section, entries in sections.items():
        if entries:
            lines += [f"[{section}]", *entries, *(corners if section == "box" else ()), ""]
    return "\n".join(lines)


def _said_by_setting(settings: StudySettings) -> set[str]:
    """Return the names of variables whose centre a setting of the family says already."""
    family = settings.space.family
    if isinstance(family, PaperFamily):
        return set()
    centre, known = family.named(settings.space.centre), family.setting_units()
    return {
        one.name
        for one in family.variables
        if one.name in known and centre[one.name] == one.default == getattr(family, one.name)
    }


def _corner(name: str, values: Mapping[str, float], settings: StudySettings) -> list[str]:
    """Return the lines of [box.centre] or [box.half_width]."""
    _, _, corner = name.partition(".")
    table = box_keys(settings.space.family, corner)
    left_out = _said_by_setting(settings) if corner == "centre" else set()
    found = [
        f"{key} = {as_toml(values[variable], unit)}"
        for key, (field, unit) in table.items()
        for _, _, variable in (field.partition("."),)
        if variable in values.keys() - left_out
    ]
    return [f"[{name}]", *found]


def write_study_toml(settings: StudySettings, folder: Path) -> Path:
    """Write the file into a study's folder; a file of somebody else is left alone.

    Raises:
        GaitError: it cannot be written.
    """
    path = next(
        (path for path in _paths(folder) if not path.exists() or _is_ours(path)), _paths(folder)[-1]
    )
    write(path, study_toml(settings))
    return path


def written_study_toml(folder: Path) -> Path | None:
    """Return the file in a study's folder; None where there is none yet."""
    return next((path for path in _paths(folder) if _is_ours(path)), None)


def _paths(folder: Path) -> list[Path]:
    return [folder / name for name in _NAMES]


def _is_ours(path: Path) -> bool:
    try:
        return path.read_bytes().startswith(_HEADER.encode())
    except OSError:
        return False


def _origin(settings: StudySettings) -> str:
    source = settings.source
    if source is None:
        return ""
    told = f", read from {as_toml(source.path)}"
    if source.overrides:
        told += f" with {', '.join(as_toml(text) for text in source.overrides)} set"
    return told
