"""A study's settings, read from its TOML file.

Every number in the file has its unit in its name, because people write it; what comes out of here
is SI. Unknown sections and keys are refused with the nearest one that exists.
"""

import difflib
import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import TERMS, WAVEFORMS
from drake_gait.problem.problem import (
    OF_EVERY_WALK,
    Assessment,
    Constraints,
    DesignSpace,
    assess,
    quantities,
)
from drake_gait.ranges import OutOfRangeError, Range, check
from drake_gait.servo import Servo
from drake_gait.study._toml import (
    as_toml,
    coefficients,
    coefficients_of_result,
    known,
    number,
    texts,
)
from drake_gait.study.keys import BOX, CONFIRMATION, CONSTRAINTS, FOOT, KEYS, SERVO, WALK, Table
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.walk import Fidelity, Walk, WalkSettings

_Made = TypeVar("_Made")

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

    def __post_init__(self) -> None:
        if not self.name or "/" in self.name or self.name.startswith("."):
            raise SettingsError(f"study.name must do as a folder's name, got '{self.name}'")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise SettingsError(f"study.seed must be a whole number >= 0, got {self.seed}")
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
        else Source(path=source["path"], text=source["text"], overrides=tuple(source["overrides"])),
    )


def default_study() -> Path:
    """The study that nobody names: inside an installed package, or beside it in a checkout."""
    package = Path(str(files("drake_gait")))
    inside = package / "studies" / "steady.toml"
    return inside if inside.is_file() else package.parent / "studies" / "steady.toml"


def read_study(path: Path, overrides: Mapping[tuple[str, str], Any] | None = None) -> StudySettings:
    """Read a study's TOML file.

    Args:
        path: The file.
        overrides: Values that take the place of those in the file, by section and key.

    Raises:
        SettingsError: the file cannot be read, or a section, key or value cannot be used.
    """
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except OSError as error:
        raise SettingsError(f"cannot read study {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # A number may have too many digits for Python.
        raise SettingsError(f"study {path} is not TOML: {error}") from None
    told = tuple(f"{'.'.join(name)}={as_toml(value)}" for name, value in (overrides or {}).items())
    source = Source(path=str(path), text=text, overrides=told)
    for (section, key), value in (overrides or {}).items():
        if isinstance(values := content.setdefault(section, {}), dict):  # Others: see _study.
            values[key] = value
            if key == "centre_from":  # Said here and now: instead of the file's, from this folder.
                values.pop("centre_deg", None)
                values[key] = str(Path(value).absolute()) if isinstance(value, str) else value
    try:
        return replace(_study(content, path.parent), source=source)
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
        found = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError) as error:
        if value.startswith(("[", "{", '"', "'")):
            raise SettingsError(f"the value of {name} is not TOML: {error}, got {value}") from None
        return (section, key), value
    # A line break would let a value set more than its own key.
    return (section, key), found["value"] if len(found) == 1 else value


def _study(content: Mapping[str, Any], folder: Path) -> StudySettings:
    known("section", content, KEYS)
    for section, values in content.items():
        if not isinstance(values, Mapping):
            raise SettingsError(f"[{section}] must be a section, got {values!r}")
        known(f"key of [{section}]", values, KEYS[section])
    study, box = dict(content.get("study", {})), _box(content.get("box", {}), folder)
    texts("study", study, ("question",))
    if not isinstance(study.get("name"), str):
        raise SettingsError('[study] needs a name = "..."')
    return StudySettings(
        **study,
        search=SearchSettings(**content.get("search", {})),
        confirmation=_confirmation(content.get("confirmation", {})),
        space=_space(box, content),
        chosen=box.get("chosen", ""),
        constraints=_made(Constraints, "constraints", content, CONSTRAINTS),
        walk=_walk(content),
    )


def _box(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The box with its centre, which may be the winner of an earlier study."""
    box = dict(values)
    texts("box", box, ("chosen", "centre_from"))
    if "centre_from" in box:
        if "centre_deg" in box:
            raise SettingsError("[box] has either centre_deg or centre_from")
        box["centre_deg"] = coefficients_of_result(folder / box["centre_from"])
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
    with _told_as_written("design", written, FOOT), _told_as_written("box", written, BOX):
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
        with _told_as_written("walk", measured, WALK):
            check("friction", number("walk.friction", measured["friction"]), _FRICTION)
    servo = _made(Servo, "servo", content, SERVO)
    return _made(WalkSettings, "walk", {"walk": measured}, WALK, servo=servo, **values)


def _foot(values: Mapping[str, Any]) -> FootDesign:
    measured = {key: value for key, value in values.items() if key in FOOT}
    rigid = values.get("rigid_toes", False)
    if not isinstance(rigid, bool):
        raise SettingsError(f"foot.rigid_toes must be true or false, got {rigid!r}")
    return _made(FootDesign, "foot", {"foot": measured}, FOOT, rigid_toes=rigid)


def _confirmation(values: Mapping[str, Any]) -> ConfirmationSettings:
    measured = {key: values[key] for key in ("noise_deg", "friction") if key in values}
    counts = {key: value for key, value in values.items() if key not in measured}
    given = {"confirmation": measured}
    return _made(ConfirmationSettings, "confirmation", given, CONFIRMATION, **counts)


def _made(
    kind: Callable[..., _Made],
    section: str,
    content: Mapping[str, Any],
    table: Table,
    **others: Any,
) -> _Made:
    """Return an object of settings from a section of numbers with units, and other arguments."""
    written = content.get(section, {})
    values = {
        table[key][0]: number(f"{section}.{key}", value) * table[key][1].si
        for key, value in written.items()
    }
    with _told_as_written(section, written, table):
        return kind(**values, **others)


@contextmanager
def _told_as_written(section: str, written: Mapping[str, Any], table: Table) -> Iterator[None]:
    """Tell of a number outside its range with the key, the value and the unit of the file."""
    try:
        yield
    except OutOfRangeError as error:
        for key, (field_name, unit) in table.items():
            if field_name == error.field and key in written:
                name, value = f"{section}.{key}", written[key]
                if error.place is not None:
                    row, column = error.place
                    name = f"{WAVEFORMS[row]}_{TERMS[column]} of {name}"
                    value = value[row][column]
                raise SettingsError(error.told(name, repr(value), unit)) from None
        raise


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
