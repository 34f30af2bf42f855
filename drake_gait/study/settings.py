"""A study's settings, read from its TOML file.

Every number in the file has its unit in its name, because people write it; what comes out of here
is SI. Unknown sections and keys are refused with the nearest one that exists.
"""

import difflib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.files.shipped import shipped_folder
from drake_gait.files.text import read_text
from drake_gait.foot import FootDesign
from drake_gait.problem.problem import (
    OF_EVERY_WALK,
    Assessment,
    Constraints,
    DesignSpace,
    assess,
    quantities,
)
from drake_gait.ranges import Range, check
from drake_gait.servo import Servo
from drake_gait.study._toml import (
    MOST_BITS,
    as_toml,
    coefficients,
    folder_name,
    known,
    made,
    number,
    parse_toml,
    text,
    texts,
    told_as_written,
)
from drake_gait.study.centre import resolve_centre, whole_path
from drake_gait.study.keys import BOX, CONFIRMATION, CONSTRAINTS, FOOT, KEYS, SERVO, WALK
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.walk import Fidelity, Walk, WalkSettings

_OTHER_CENTRE = {"centre_from": "centre_deg", "centre_deg": "centre_from"}

_FRICTION = Range(lower=0.1, upper=1.5)
"""A variation may take half of it, or add half, and is still a walk that can be simulated."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """The file that settings were read from, and what took the place of its values."""

    path: str
    """The file, as it was named."""
    text: str
    """Its text."""
    overrides: tuple[str, ...] = ()
    """Settings that were given beside it, each section.key=value with the value in TOML."""
    centre_from: Mapping[str, Any] | None = None
    """Where the box's centre came from: the path as written, the whole path, keys of its foot."""


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """All that decides a study's walks."""

    name: str
    """Name of the study; its folder is runs/<name> if none is given."""
    question: str = ""
    """What the study is to find out."""
    seed: int = 0
    """Fixes every random number."""
    search: SearchSettings = field(default_factory=SearchSettings)
    """How much is simulated."""
    confirmation: ConfirmationSettings = field(default_factory=ConfirmationSettings)
    """How its best candidates are confirmed."""
    space: DesignSpace
    """Where it looks."""
    chosen: str = ""
    """How the box was chosen."""
    constraints: Constraints = field(default_factory=Constraints)
    """What makes a walk feasible."""
    walk: WalkSettings = field(default_factory=WalkSettings)
    """How a walk is simulated."""
    source: Source | None = field(default=None, compare=False, repr=False)
    """The file that it was read from; no part of its description, as it changes no walk."""
    notes: tuple[str, ...] = field(default=(), compare=False, repr=False)
    """Sentences for a person about how it was read."""

    def __post_init__(self) -> None:
        folder_name("study.name", self.name)
        text("study.question", self.question)
        text("box.chosen", self.chosen)
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise SettingsError(f"study.seed must be a whole number >= 0, got {self.seed!r}")
        if self.seed.bit_length() > MOST_BITS:
            raise SettingsError("study.seed must have at most 3900 digits")
        check("walk.friction", self.walk.friction, _FRICTION)

    @property
    def outputs(self) -> tuple[str, ...]:
        """What a network is to predict of a walk: `problem.OUTPUTS`, and what else is needed."""
        return quantities(self.constraints, self.search.objective)

    @property
    def trial_settings(self) -> WalkSettings:
        """How the walks of the search are simulated: with measures where they are needed."""
        return replace(self.walk, measures=not set(self.outputs) <= set(OF_EVERY_WALK))

    def assess(self, walk: Walk) -> Assessment:
        """A walk measured against the study's objective and constraints."""
        return assess(walk, self.constraints, self.search.objective)

    def description(self) -> dict[str, Any]:
        """Every setting as `section.key`: number, text or list; two studies can be compared."""
        walk = asdict(self.walk)
        servo = walk.pop("servo")
        walk.pop("integrator")  # The fidelity says it; another one is for comparisons only.
        walk.pop("measures")  # The objective and the constraints say it.
        nested = {
            "study": {"name": self.name, "question": self.question, "seed": self.seed},
            "search": asdict(self.search),
            "confirmation": asdict(self.confirmation),
            "box": {
                "chosen": self.chosen,
                "centre": self.space.centre.tolist(),
                "half_width": self.space.half_width.tolist(),
            },
            "constraints": asdict(self.constraints),
            "walk": {**walk, "model": str(self.walk.model), "fidelity": str(self.walk.fidelity)},
            "servo": servo,
            "foot": asdict(self.space.foot),
            "design": {name: [low, high] for name, low, high in self.space.foot_ranges},
        }
        flat = {
            f"{section}.{key}": value
            for section, values in nested.items()
            for key, value in values.items()
        }
        plain: dict[str, Any] = json.loads(json.dumps(flat))
        return plain


def study_settings(
    description: Mapping[str, Any], source: Mapping[str, Any] | None = None
) -> StudySettings:
    """Return the settings that `StudySettings.description` was taken from.

    Args:
        description: Every setting, as a study's file has them.
        source: The fields of their `Source`, where the study's file has it.
    """
    nested: dict[str, dict[str, Any]] = {section: {} for section in KEYS}
    for name, value in description.items():
        section, _, key = name.partition(".")
        nested[section][key] = value
    walk, box = nested["walk"], nested["box"]
    return StudySettings(
        **nested["study"],
        search=SearchSettings(**nested["search"]),
        confirmation=ConfirmationSettings(**nested["confirmation"]),
        space=DesignSpace(
            centre=np.array(box["centre"]),
            half_width=np.array(box["half_width"]),
            foot=FootDesign(**nested["foot"]),
            foot_ranges=tuple((name, low, high) for name, (low, high) in nested["design"].items()),
        ),
        chosen=box["chosen"],
        constraints=Constraints(**nested["constraints"]),
        walk=WalkSettings(
            model=walk["model"],
            fidelity=_fidelity(walk["fidelity"]),
            time_limit=walk["time_limit"],
            friction=walk.get("friction", 1.0),
            servo=Servo(**nested["servo"]),
        ),
        source=None
        if source is None
        else Source(
            path=source["path"],
            text=source["text"],
            overrides=tuple(source["overrides"]),
            centre_from=source.get("centre_from"),
        ),
    )


def default_study() -> Path:
    """The study that nobody names: inside an installed package, or beside it in a checkout."""
    return shipped_folder() / "steady.toml"


def read_study(
    path: Path,
    overrides: Mapping[tuple[str, str], Any] | None = None,
    *,
    begun: Callable[[str], Path] | None = None,
) -> StudySettings:
    """Read a study's TOML file.

    Args:
        path: The file.
        overrides: Values that take the place of those in the file, by section and key.
        begun: Folder of a study by its name: one that has begun there goes on around the gait that
            it began with, whatever has become of the study in `box.centre_from`.

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
            values[key] = value
            other = _OTHER_CENTRE.get(key)
            if other is not None and (section, other) not in (overrides or {}):
                values.pop(other, None)  # Said here and now: instead of the file's.
            if key == "centre_from" and isinstance(value, str):  # From this folder.
                values[key] = str(whole_path(Path(), value))
    try:
        _check_sections(content)
        name = content.get("study", {}).get("name")
        folder = begun(name) if begun is not None and isinstance(name, str) else None
        content, origin, notes = resolve_centre(content, path.parent, folder, study_settings)
        source = replace(source, centre_from=origin)
        return replace(_study(content), source=source, notes=notes)
    except SettingsError as error:
        changed = "".join(f", {section}.{key} set" for section, key in overrides or {})
        raise SettingsError(f"study {path}{changed}: {error}") from None


def read_override(text: str) -> tuple[tuple[str, str], Any]:
    """What `section.key=value` overrides: section and key, and the value.

    The value is read as TOML; a word that is none is taken as text, so that text needs no quotes.

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


def _check_sections(content: Mapping[str, Any]) -> None:
    known("section", content, KEYS)
    for section, values in content.items():
        if not isinstance(values, Mapping):
            raise SettingsError(f"[{section}] must be a section, got {values!r}")
        known(f"key of [{section}]", values, KEYS[section])


def _study(content: Mapping[str, Any]) -> StudySettings:
    study, box = dict(content.get("study", {})), _box(content.get("box", {}))
    texts("study", study, ("question",))
    if not isinstance(study.get("name"), str):
        raise SettingsError('[study] needs a name = "..."')
    return StudySettings(
        **study,
        search=SearchSettings(**content.get("search", {})),
        confirmation=_confirmation(content.get("confirmation", {})),
        space=_space(box, content),
        chosen=box.get("chosen", ""),
        constraints=made(Constraints, "constraints", content, CONSTRAINTS),
        walk=_walk(content),
    )


def _box(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the box, with all that it must have."""
    box = dict(values)
    texts("box", box, ("chosen",))
    for key in ("centre_deg", "half_width_deg"):
        if key not in box:
            raise SettingsError(f"[box] needs {key}: 4 rows (roll, hip, knee, ankle) of 4 degrees")
    return box


def _space(box: Mapping[str, Any], content: Mapping[str, Any]) -> DesignSpace:
    foot, ranges = _foot(content.get("foot", {})), _ranges(content.get("design", {}))
    if ranges and foot.rigid_toes:
        opened = next(iter(content["design"]))
        raise SettingsError(
            f"design.{opened} is open, but rigid toes have nothing to search; leave it out, or let "
            "foot.rigid_toes be false"
        )
    written = {**content.get("design", {}), **{key: box[key] for key in BOX}}
    with told_as_written("design", written, FOOT), told_as_written("box", written, BOX):
        return DesignSpace(
            centre=coefficients("box.centre_deg", box["centre_deg"]),
            half_width=coefficients("box.half_width_deg", box["half_width_deg"]),
            foot=foot,
            foot_ranges=ranges,
        )


def _walk(content: Mapping[str, Any]) -> WalkSettings:
    values = dict(content.get("walk", {}))
    texts("walk", values, ("model",))
    measured = {key: values.pop(key) for key in WALK if key in values}
    if "fidelity" in values:
        values["fidelity"] = _fidelity(values["fidelity"])
    if "friction" in measured:
        with told_as_written("walk", measured, WALK):
            check("friction", number("walk.friction", measured["friction"]), _FRICTION)
    servo = made(Servo, "servo", content, SERVO)
    return made(WalkSettings, "walk", {"walk": measured}, WALK, servo=servo, **values)


def _foot(values: Mapping[str, Any]) -> FootDesign:
    measured = {key: value for key, value in values.items() if key in FOOT}
    rigid = values.get("rigid_toes", False)
    if not isinstance(rigid, bool):
        raise SettingsError(f"foot.rigid_toes must be true or false, got {rigid!r}")
    return made(FootDesign, "foot", {"foot": measured}, FOOT, rigid_toes=rigid)


def _confirmation(values: Mapping[str, Any]) -> ConfirmationSettings:
    measured = {key: values[key] for key in ("noise_deg", "friction") if key in values}
    counts = {key: value for key, value in values.items() if key not in measured}
    given = {"confirmation": measured}
    return made(ConfirmationSettings, "confirmation", given, CONFIRMATION, **counts)


def _fidelity(value: Any) -> Fidelity:
    try:
        return Fidelity(value)
    except ValueError:
        known = ", ".join(Fidelity)
        raise SettingsError(f"walk.fidelity must be one of {known}, got {value!r}") from None


def _ranges(design: Mapping[str, Any]) -> tuple[tuple[str, float, float], ...]:
    ranges = []
    for key, value in design.items():
        if not isinstance(value, list) or len(value) != 2:
            raise SettingsError(f"design.{key} must be [smallest, largest], got {value!r}")
        name, unit = FOOT[key]
        low, high = (number(f"design.{key}", end) * unit.si for end in value)
        ranges.append((name, low, high))
    return tuple(ranges)
