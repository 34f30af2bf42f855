"""A study's settings, read from its TOML file.

Every number in the file has its unit in its name, because people write it; what comes out of here
is SI. Unknown sections and keys are refused with the nearest one that exists.
"""

import difflib
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.foot import N_MM_PER_DEG, FootDesign
from drake_gait.problem.problem import (
    OF_EVERY_WALK,
    Assessment,
    Constraints,
    DesignSpace,
    assess,
    quantities,
)
from drake_gait.servo import Servo
from drake_gait.study._toml import coefficients, coefficients_of_result, known, number, texts
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.walk import Fidelity, Walk, WalkSettings

_DEGREE = math.pi / 180.0
_MM = 1e-3

# Section and key in the file -> field of the section's object, and its unit in SI.
_SERVO = {
    "stiffness_n_m_per_rad": ("stiffness", 1.0),
    "damping_n_m_s_per_rad": ("damping", 1.0),
    "no_load_speed_rad_per_s": ("no_load_speed", 1.0),
}
_CONSTRAINTS = {
    "lateral_mm": ("lateral", _MM),
    "yaw_deg": ("yaw", _DEGREE),
    "com_height_mm": ("com_height", _MM),
    "energy_j": ("energy", 1.0),
    "positive_energy_j": ("positive_energy", 1.0),
    "cost_of_transport": ("cost_of_transport", 1.0),
    "peak_torque_n_m": ("peak_torque", 1.0),
    "peak_speed_rad_per_s": ("peak_speed", 1.0),
    "saturated_fraction": ("saturated_fraction", 1.0),
    "slip_mm": ("slip", _MM),
    "clearance_mm": ("clearance", _MM),
    "duty_factor": ("duty_factor", 1.0),
    "peak_ground_reaction": ("peak_ground_reaction", 1.0),
    "toe_range_deg": ("toe_range", _DEGREE),
    "yaw_swing_deg": ("yaw_swing", _DEGREE),
    "torso_tilt_deg": ("torso_tilt", _DEGREE),
}
_CONFIRMATION = {
    "walks": "walks",
    "winners": "winners",
    "replicas": "replicas",
    "feasible": "feasible",
    "noise_deg": "noise",
    "friction": "friction",
}
_FOOT = {
    "big_toe_stiffness_n_mm_per_deg": ("big_toe_stiffness", N_MM_PER_DEG),
    "lesser_toes_stiffness_n_mm_per_deg": ("lesser_toes_stiffness", N_MM_PER_DEG),
    "toe_damping_n_m_s_per_rad": ("toe_damping", 1.0),
    "big_toe_width_mm": ("big_toe_width", _MM),
    "toe_length_mm": ("toe_length", _MM),
}
# Name in a description -> name in the file, and its unit in SI.
_IN_FILE = {
    f"{section}.{name}": (f"{section}.{key}", unit)
    for section, table in (
        ("servo", _SERVO), ("constraints", _CONSTRAINTS), ("foot", _FOOT), ("design", _FOOT)
    )
    for key, (name, unit) in table.items()
} | {
    "box.centre": ("box.centre_deg", _DEGREE),
    "box.half_width": ("box.half_width_deg", _DEGREE),
    "confirmation.noise": ("confirmation.noise_deg", _DEGREE),
    "walk.time_limit": ("walk.time_limit_s", 1.0),
}  # fmt: skip
_KEYS = {
    "study": ("name", "question", "seed"),
    "search": tuple(field.name for field in fields(SearchSettings)),
    "confirmation": tuple(_CONFIRMATION),
    "box": ("chosen", "centre_deg", "centre_from", "half_width_deg"),
    "constraints": tuple(_CONSTRAINTS),
    "walk": ("model", "fidelity", "time_limit_s", "friction"),
    "servo": tuple(_SERVO),
    "foot": (*_FOOT, "rigid_toes"),
    "design": tuple(_FOOT),
}


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

    def __post_init__(self) -> None:
        if not self.name or "/" in self.name or self.name.startswith("."):
            raise SettingsError(f"study.name must do as a folder's name, got '{self.name}'")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise SettingsError(f"study.seed must be a whole number >= 0, got {self.seed}")
        # A variation may take half of it, or add half, and is still a walk that can be simulated.
        if not 0.1 <= self.walk.friction <= 1.5:
            raise SettingsError(f"walk.friction must be 0.1 to 1.5, got {self.walk.friction}")

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


def study_settings(description: Mapping[str, Any]) -> StudySettings:
    """The settings that `StudySettings.description` was taken from."""
    nested: dict[str, dict[str, Any]] = {section: {} for section in _KEYS}
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
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"cannot read study {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"study {path} is not TOML: {error}") from None
    for (section, key), value in (overrides or {}).items():
        if isinstance(values := content.setdefault(section, {}), dict):  # Others: see _study.
            values[key] = value
            if key == "centre_from":  # Said here and now: instead of the file's, from this folder.
                values.pop("centre_deg", None)
                values[key] = str(Path(value).absolute()) if isinstance(value, str) else value
    try:
        return _study(content, path.parent)
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
        known = [f"{section}.{key}" for section, keys in _KEYS.items() for key in keys]
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
        raise SettingsError(
            f"a setting is given as section.key=value, like {near}=..., got '{text}'"
        )
    try:
        found = tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError as error:
        if value.startswith(("[", "{", '"', "'")):
            raise SettingsError(f"the value of {name} is not TOML: {error}, got {value}") from None
        return (section, key), value
    # A line break would let a value set more than its own key.
    return (section, key), found["value"] if len(found) == 1 else value


def overrides(settings: StudySettings, standard: StudySettings) -> dict[str, str]:
    """What makes a study of another one: values as TOML, by section.key, see `read_override`."""
    before, found = standard.description(), {}
    for name, value in settings.description().items():
        if value is not None and value != before.get(name):
            key, unit = _IN_FILE.get(name, (name, None))
            found[key] = _as_toml(value, unit)
    return found


def _as_toml(value: Any, unit: float | None) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_as_toml(item, unit) for item in value)}]"
    # Twelve digits give back what somebody has written, and not what rounding made of it.
    return json.dumps(value) if unit is None else f"{value / unit:.12g}"


def _study(content: Mapping[str, Any], folder: Path) -> StudySettings:
    known("section", content, _KEYS)
    for section, values in content.items():
        if not isinstance(values, Mapping):
            raise SettingsError(f"[{section}] must be a section, got {values!r}")
        known(f"key of [{section}]", values, _KEYS[section])
    study, box = dict(content.get("study", {})), _box(content.get("box", {}), folder)
    walk = dict(content.get("walk", {}))
    if "time_limit_s" in walk:
        walk["time_limit"] = number("walk.time_limit_s", walk.pop("time_limit_s"))
    if "friction" in walk:
        walk["friction"] = number("walk.friction", walk["friction"])
    if "fidelity" in walk:
        walk["fidelity"] = _fidelity(walk["fidelity"])
    texts("walk", walk, ("model",))
    texts("study", study, ("question",))
    if not isinstance(study.get("name"), str):
        raise SettingsError('[study] needs a name = "..."')
    return StudySettings(
        **study,
        search=SearchSettings(**content.get("search", {})),
        confirmation=_confirmation(content.get("confirmation", {})),
        space=DesignSpace(
            centre=coefficients("box.centre_deg", box["centre_deg"]),
            half_width=coefficients("box.half_width_deg", box["half_width_deg"]),
            foot=_foot(content.get("foot", {})),
            foot_ranges=_ranges(content.get("design", {})),
        ),
        chosen=box.get("chosen", ""),
        constraints=Constraints(**_scaled("constraints", content, _CONSTRAINTS)),
        walk=WalkSettings(**walk, servo=Servo(**_scaled("servo", content, _SERVO))),
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


def _scaled(
    section: str, content: Mapping[str, Any], table: Mapping[str, tuple[str, float]]
) -> dict[str, float]:
    return {
        table[key][0]: number(f"{section}.{key}", value) * table[key][1]
        for key, value in content.get(section, {}).items()
    }


def _foot(values: Mapping[str, Any]) -> FootDesign:
    measured = {key: value for key, value in values.items() if key in _FOOT}
    return FootDesign(
        **_scaled("foot", {"foot": measured}, _FOOT), rigid_toes=values.get("rigid_toes", False)
    )


def _confirmation(values: Mapping[str, Any]) -> ConfirmationSettings:
    given = {_CONFIRMATION[key]: value for key, value in values.items()}
    for key in ("noise", "friction"):
        if key in given:
            given[key] = number(f"confirmation.{key}", given[key])
    if "noise" in given:
        given["noise"] *= _DEGREE
    return ConfirmationSettings(**given)


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
        name, unit = _FOOT[key]
        low, high = (number(f"design.{key}", end) * unit for end in value)
        ranges.append((name, low, high))
    return tuple(ranges)
