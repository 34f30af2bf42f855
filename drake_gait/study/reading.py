"""The TOML file of a study, read into its settings.

Every number in the file has its unit in its name, because people write it; what comes out of here
is SI. Unknown sections and keys are refused with the nearest one that exists.
"""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

from drake_gait.errors import SettingsError
from drake_gait.files.shipped import shipped_folder
from drake_gait.files.text import read_text
from drake_gait.foot import FootDesign
from drake_gait.gait import PAPER, GaitFamily, PaperFamily, Start
from drake_gait.gait.families import family_kind, is_file
from drake_gait.problem import (
    Constraints,
    DesignSpace,
    Objective,
    Quantity,
)
from drake_gait.ranges import check, choice
from drake_gait.robot.description import robot_of
from drake_gait.robot.robot_file import RobotFile
from drake_gait.sole import Sole
from drake_gait.study import robot_section
from drake_gait.study._toml import (
    as_toml,
    coefficients,
    known,
    made,
    number,
    parse_toml,
    text,
    texts,
    told_as_written,
)
from drake_gait.study.centre import resolve_centre, whole_path
from drake_gait.study.keys import (
    BOX,
    CONFIRMATION,
    CONSTRAINTS,
    DROPPED,
    FOOT,
    KEYS,
    MEASURED_CONFIRMATION,
    SERVO,
    WALK,
    Table,
    box_keys,
    keys,
    setting_keys,
)
from drake_gait.study.own_quantities import load_quantities
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.study.settings import (
    FRICTION,
    Source,
    StudySettings,
    limits_of,
    require_own,
    study_settings,
)
from drake_gait.walk import DEFAULT_MODEL, Engine, Fidelity, WalkSettings

_OTHER_CENTRE = {"centre_from": ("centre_deg", "centre"), "centre_deg": ("centre_from",)}
"""Keys of [box] that another one takes the place of, where it is given beside the file."""


def default_study() -> Path:
    """The study that nobody names: inside an installed package, or beside it in a checkout."""
    return shipped_folder() / "steady.toml"


def read_study(
    path: Path,
    overrides: Mapping[tuple[str, str], Any] | None = None,
    *,
    begun: Callable[[str], Path] | None = None,
    quantities: Sequence[Quantity] = (),
) -> StudySettings:
    """Read a study's TOML file.

    Args:
        path: The file.
        overrides: Values that take the place of those in the file, by section and key.
        begun: Folder of a study by its name: one that has begun there goes on around the gait that
            it began with, whatever has become of the study in `box.centre_from`.
        quantities: Quantities of a user's own, beside those of the file's `study.quantities`.

    Raises:
        SettingsError: the file cannot be read, or a section, key or value cannot be used.
    """
    try:
        content = parse_toml(written := read_text(path, "study"))
    except ValueError as error:
        raise SettingsError(f"study {path} is not TOML: {error}") from None
    told = tuple(f"{'.'.join(name)}={as_toml(value)}" for name, value in (overrides or {}).items())
    source = Source(path=str(path), text=written, overrides=told)
    for (section, key), value in (overrides or {}).items():
        if isinstance(values := content.setdefault(section, {}), dict):  # Others: see _study.
            corner, dot, variable = key.partition(".")
            if dot:  # One variable of [box.centre] or [box.half_width].
                inner = values.setdefault(corner, {})
                if isinstance(inner, dict):
                    inner[variable] = value
                    continue
            values[key] = value
            for other in _OTHER_CENTRE.get(key, ()):
                if (section, other) not in (overrides or {}):
                    values.pop(other, None)  # Said here and now: instead of the file's.
            if key == "centre_from" and isinstance(value, str):  # From this folder.
                values[key] = str(whole_path(Path(), value))
            elif (section, key) in robot_section.NAMES:
                robot_section.override(content, (section, key), Path.cwd())  # Likewise.
            elif (section, key) == ("gait", "family") and isinstance(value, str):
                values[key] = family_from(value, Path.cwd())
            elif (section, key) == ("study", "quantities") and value and isinstance(value, str):
                values[key] = str(Path(value).absolute())
    dropped = _drop(content)
    try:
        own = _own_quantities(content, path.parent, quantities)
        family = _family(content, path.parent)
        _check_sections(content, own, family)
        name = content.get("study", {}).get("name")
        folder = begun(name) if begun is not None and isinstance(name, str) else None
        content, origin, notes = resolve_centre(
            content, path.parent, folder, study_settings, family
        )
        source = replace(source, centre_from=origin)
        found = _study(content, path.parent, own, family)
        return replace(found, source=source, notes=(*dropped, *notes))
    except SettingsError as error:
        changed = "".join(f", {section}.{key} set" for section, key in overrides or {})
        raise SettingsError(f"study {path}{changed}: {error}") from None


def _drop(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Take settings that are without effect out of a study's content; return a line for each."""
    notes = []
    for (section, key), reason in DROPPED.items():
        values = content.get(section)
        if isinstance(values, dict) and key in values:
            del values[key]
            notes.append(f"{section}.{key} is without effect and can be left out: {reason}")
    return tuple(notes)


def read_override(text: str) -> tuple[tuple[str, str], Any]:
    """Return the section and key that `section.key=value` overrides, and the value.

    Values that are not valid TOML are read as strings, so that text needs no quotes.

    Raises:
        SettingsError: it is not of this form.
    """
    name, equals, value = (part.strip() for part in text.partition("="))
    section, dot, key = name.partition(".")
    if not (equals and dot and section and key):
        known = [f"{section}.{key}" for section, keys in KEYS.items() for key in keys]
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
        raise SettingsError(
            f"a setting is given as section.key=value, like {near}=..., got '{text}'"
        )
    try:
        found = parse_toml(f"value = {value}")
    except ValueError as error:
        if value.startswith(("[", "{", '"', "'")):
            raise SettingsError(f"the value of {name} is not TOML: {error}, got {value}") from None
        return (section, key), value
    # A line break would let a value set more than its own key.
    return (section, key), found["value"] if len(found) == 1 else value


def _own_quantities(
    content: Mapping[str, Any], folder: Path, given: Sequence[Quantity]
) -> tuple[Quantity, ...]:
    """Return the quantities of a study's own: those that are given, and those of its file."""
    study = content.get("study", {})
    file = study.get("quantities", "") if isinstance(study, Mapping) else ""
    text("study.quantities", file)
    found = load_quantities(folder / file) if file else ()
    own = tuple({one.name: one for one in (*found, *given)}.values())
    require_own(own)
    return own


def _check_sections(
    content: Mapping[str, Any], own: Sequence[Quantity], family: GaitFamily
) -> None:
    known("section", content, KEYS)
    for section, values in content.items():
        if not isinstance(values, Mapping):
            raise SettingsError(f"[{section}] must be a section, got {values!r}")
        known(f"key of [{section}]", values, keys(own, type(family))[section])


def family_from(reference: str, folder: Path) -> str:
    """Return the name of a gait family, the path of its file from the root."""
    if not is_file(reference):
        return reference
    file, dot, name = reference.rpartition(".py")
    return f"{whole_path(folder, file + dot)}{name}"


def _family(content: Mapping[str, Any], folder: Path) -> GaitFamily:
    """Return the gait family of a file, with its settings."""
    written = content.get("gait", {})
    if not isinstance(written, Mapping):
        raise SettingsError(f"[gait] must be a section, got {written!r}")
    texts("gait", written, ("family",))
    kind = family_kind(family_from(written.get("family", PAPER.name), folder))
    table = setting_keys(kind)
    start = ("start",) if kind is PaperFamily else ()
    known(
        f"key of [gait] with the family {kind.name or kind.__name__}",
        written,
        ("family", *start, *table),
    )
    given = {key: value for key, value in written.items() if key in table}
    settings = {table[key][0]: _in_si(key, value, table) for key, value in given.items()}
    with told_as_written("gait", written, table):
        return kind(**settings)


def _in_si(key: str, value: Any, table: Table) -> Any:
    """Return a setting of a gait family in SI units; its kind is checked by the family."""
    if isinstance(value, list):
        return tuple(_in_si(key, one, table) for one in value)
    if table[key][1].name:
        return number(f"gait.{key}", value) * table[key][1].si
    return value


def _study(
    content: Mapping[str, Any], folder: Path, own: Sequence[Quantity], family: GaitFamily
) -> StudySettings:
    study, box = dict(content.get("study", {})), _box(content.get("box", {}), family)
    file = study.pop("quantities", "")
    search = dict(content.get("search", {}))
    if "objective" in search:
        search["objective"] = Objective.read(search["objective"], own)
    texts("study", study, ("question",))
    if not isinstance(study.get("name"), str):
        raise SettingsError('[study] needs a name = "..."')
    named = robot_section.named(content, folder)
    robot = robot_of(named.get("model", DEFAULT_MODEL), named.get("robot", ""))
    space = _space(box, content, family)
    opened = {FOOT[key][0]: value for key, value in content.get("design", {}).items()}
    robot_section.check_foot(robot, space.foot, opened)
    return StudySettings(
        **study,
        quantities=tuple(own),
        quantities_from=str(folder / file) if file else "",
        search=SearchSettings(**search),
        confirmation=_confirmation(content.get("confirmation", {})),
        space=space,
        chosen=box.get("chosen", ""),
        constraints=_constraints(content.get("constraints", {}), own, robot),
        walk=_walk(content, named, robot),
    )


def _constraints(
    written: Mapping[str, Any], own: Sequence[Quantity], robot: RobotFile
) -> Constraints:
    table: Table = {**CONSTRAINTS, **{one.key: (one.name, one.unit) for one in own}}
    values: dict[str, float | list[float]] = {}
    for key, value in written.items():
        name, unit = table[key]
        if isinstance(value, list):
            if len(value) != 2:
                raise SettingsError(
                    f"constraints.{key} must be a finite number, or [smallest, largest], got "
                    f"{value!r}"
                )
            low, high = (number(f"constraints.{key}", end) for end in value)
            if not low < high:
                raise SettingsError(
                    f"constraints.{key} must rise from smallest to largest, got {value!r}"
                )
            values[name] = [low * unit.si, high * unit.si]
        else:
            values[name] = number(f"constraints.{key}", value) * unit.si
    if "com_height" not in values:
        values.update(robot_section.com_height(robot))
    with told_as_written("constraints", written, table):
        return limits_of(values, own)


def _box(values: Mapping[str, Any], family: GaitFamily) -> dict[str, Any]:
    """Return the box, with all that it must have."""
    box = dict(values)
    texts("box", box, ("chosen",))
    by_name, by_rows = ("centre", "half_width"), ("centre_deg", "half_width_deg")
    paper = isinstance(family, PaperFamily)
    for key in by_name if paper else by_rows:
        if key in box:
            shape = " and ".join(by_rows) if paper else "[box.centre] and [box.half_width]"
            raise SettingsError(
                f"the gait family {family.label} has a box of {shape}, got box.{key}"
            )
    if not paper:
        for key in by_name:
            if not isinstance(box.setdefault(key, {}), Mapping):
                raise SettingsError(f"[box.{key}] must be a section, got {box[key]!r}")
        return box
    for key in ("centre_deg", "half_width_deg"):
        if key not in box:
            raise SettingsError(f"[box] needs {key}: 4 rows (roll, hip, knee, ankle) of 4 degrees")
    return box


def _space(box: Mapping[str, Any], content: Mapping[str, Any], family: GaitFamily) -> DesignSpace:
    foot, ranges = _foot(content.get("foot", {})), _ranges(content.get("design", {}))
    if ranges and foot.rigid_toes:
        opened = next(iter(content["design"]))
        raise SettingsError(
            f"design.{opened} is open, but rigid toes have nothing to search; leave it out, or let "
            "foot.rigid_toes be false"
        )
    if not isinstance(family, PaperFamily):
        return _named_space(box, family, content, foot, ranges)
    written = {**content.get("design", {}), **{key: box[key] for key in BOX}}
    with told_as_written("design", written, FOOT), told_as_written("box", written, BOX):
        return DesignSpace(
            centre=coefficients("box.centre_deg", box["centre_deg"]),
            half_width=coefficients("box.half_width_deg", box["half_width_deg"]),
            foot=foot,
            foot_ranges=ranges,
            family=family,
        )


def _named_space(
    box: Mapping[str, Any],
    family: GaitFamily,
    content: Mapping[str, Any],
    foot: FootDesign,
    ranges: tuple[tuple[str, float, float], ...],
) -> DesignSpace:
    """Return the space of a box that is given by the names of variables."""
    tables = {corner: box_keys(family, corner) for corner in ("centre", "half_width")}
    values: dict[str, dict[str, float]] = {}
    for corner, table in tables.items():
        known(f"key of [box.{corner}]", box[corner], tuple(table))
        values[corner] = {
            table[key][0].partition(".")[2]: number(f"box.{corner}.{key}", value) * table[key][1].si
            for key, value in box[corner].items()
        }
    missing = [
        one.key
        for one in family.variables
        if one.default is None and one.name not in values["centre"]
    ]
    if missing:
        raise SettingsError(
            f"[box.centre] needs {', '.join(missing)} of the gait family {family.label}"
        )
    design = content.get("design", {})
    with (
        told_as_written("design", design, FOOT),
        told_as_written("box.centre", box["centre"], tables["centre"]),
        told_as_written("box.half_width", box["half_width"], tables["half_width"]),
    ):
        # What holds both corners; each is a value for every variable.
        return DesignSpace(
            centre=family.values(values["centre"]),
            half_width=family.values(dict.fromkeys(family.names, 0.0) | values["half_width"]),
            foot=foot,
            foot_ranges=ranges,
            family=family,
        )


def _walk(content: Mapping[str, Any], named: Mapping[str, str], robot: RobotFile) -> WalkSettings:
    values = {**content.get("walk", {}), **named}
    if "model" not in named:
        values.pop("model", None)
    measured = {key: values.pop(key) for key in WALK if key in values}
    kinds: dict[str, type[StrEnum]] = {"engine": Engine, "fidelity": Fidelity, "sole": Sole}
    for key in kinds.keys() & values.keys():
        values[key] = choice(kinds[key], f"walk.{key}", values[key])
    if "start" in (gait := content.get("gait", {})):
        values["start"] = choice(Start, "gait.start", gait["start"])
    if "friction" in measured:
        with told_as_written("walk", measured, WALK):
            check("friction", number("walk.friction", measured["friction"]), FRICTION)
    servo = made(partial(replace, robot.servo), "servo", content, SERVO)
    return made(WalkSettings, "walk", {"walk": measured}, WALK, servo=servo, **values)


def _foot(values: Mapping[str, Any]) -> FootDesign:
    measured = {key: value for key, value in values.items() if key in FOOT}
    rigid = values.get("rigid_toes", False)
    if not isinstance(rigid, bool):
        raise SettingsError(f"foot.rigid_toes must be true or false, got {rigid!r}")
    return made(FootDesign, "foot", {"foot": measured}, FOOT, rigid_toes=rigid)


def _confirmation(values: Mapping[str, Any]) -> ConfirmationSettings:
    measured = {key: values[key] for key in MEASURED_CONFIRMATION if key in values}
    counts = {key: value for key, value in values.items() if key not in measured}
    given = {"confirmation": measured}
    return made(ConfirmationSettings, "confirmation", given, CONFIRMATION, **counts)


def _ranges(design: Mapping[str, Any]) -> tuple[tuple[str, float, float], ...]:
    ranges = []
    for key, value in design.items():
        if not isinstance(value, list) or len(value) != 2:
            raise SettingsError(f"design.{key} must be [smallest, largest], got {value!r}")
        name, unit = FOOT[key]
        low, high = (number(f"design.{key}", end) * unit.si for end in value)
        ranges.append((name, low, high))
    return tuple(ranges)
