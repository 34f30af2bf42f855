"""Settings of a sweep, read from its TOML file: variants of one study, or a grid of feet.

    [sweep]
    name = "toes_or_rigid"
    question = "Do passive toes help?"
    base = "paper.toml"            # a study file, beside this one
    seeds = [0, 1, 2]

    [common]                       # settings of all variants
    search.simulations = 300

    [variants.toes]                # settings of one; none here
    [variants.rigid]
    foot.rigid_toes = true

A grid has, in place of seeds and variants, gaits that walk on every foot of the grid:

    [grid]
    replicas = 5                   # walks of a gait on a foot
    noise_deg = 0.05               # added to every coefficient of a replica, evenly up to ±
    results = ["../runs/paper/result.json"]   # gaits, or coefficients_deg = [[4 rows of 4], ...]

    [[grid.axes]]                  # two of them; the keys are those of a study's [foot]
    name = "damping"
    toe_damping_n_m_s_per_rad = [1e-4, 1e-3]
"""

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drake_gait.errors import SettingsError
from drake_gait.files.text import read_text
from drake_gait.foot import FootDesign
from drake_gait.gait import AnyGait, Gait, GaitFamily, PaperFamily
from drake_gait.robot.description import located
from drake_gait.study import robot_section
from drake_gait.study._toml import folder_name, parse_toml, text
from drake_gait.study.centre import whole_path
from drake_gait.study.earlier_study import earlier_winner
from drake_gait.study.reading import family_from, read_study
from drake_gait.study.settings import StudySettings, study_settings

Overrides = Mapping[tuple[str, str], Any]

OUTPUTS = ("sweep.csv", "sweep.json", "sweep.png", "pareto.png", "sweep.lock")
"""Files that a sweep writes beside the folders of its variants."""

_SWEEP_KEYS = ("name", "question", "base", "seeds")
_GRID_KEYS = ("replicas", "noise_deg", "results", "coefficients_deg", "axes")


@dataclass(frozen=True, kw_only=True)
class PlannedStudy:
    """One optimisation of a sweep: an ordinary study."""

    variant: str
    """The variant that it belongs to."""
    seed: int
    """Its seed."""
    settings: StudySettings
    """All its settings."""
    overrides: Overrides
    """What differs from the base, as `optimize --set` takes it."""

    def folder(self, out: Path) -> Path:
        """Its folder in a sweep's."""
        return out / self.variant / f"seed-{self.seed}"


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One factor of a grid."""

    name: str
    """What it is called."""
    levels: tuple[Mapping[str, float], ...]
    """Keys of a study's [foot] and their values, for each level."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Feet on which given gaits walk."""

    settings: StudySettings
    """The base: how a walk is simulated, and the foot that the axes change."""
    gaits: tuple[AnyGait, ...]
    """The gaits, of the family of the base."""
    axes: tuple[Axis, Axis]
    """The two factors."""
    feet: tuple[tuple[FootDesign, ...], ...]
    """The foot of every cell, by levels of the first and of the second axis."""
    replicas: int
    """Walks of every gait on every foot."""
    noise_deg: float
    """Largest change of each coefficient, or other angle, of a replica [degrees]."""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A sweep's file, read and checked as a whole."""

    name: str
    """Its name; its folder is runs/<name> if none is given."""
    question: str
    """What it is to find out."""
    base: Path
    """The study file whose settings it varies."""
    studies: tuple[PlannedStudy, ...] = ()
    """Every optimisation, one seed of all variants after the other."""
    grid: Grid | None = None
    """Or the grid."""

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the variants, in the order of the file."""
        return tuple(dict.fromkeys(study.variant for study in self.studies))


def read_sweep(path: Path, out: Path | None = None) -> Sweep:
    """Read a sweep's TOML file; every study in it is read too, so that none is refused later.

    Args:
        path: The file.
        out: The sweep's folder; runs/<name> if None. Studies in it may have begun.

    Raises:
        SettingsError: the file, its base or a result cannot be read, or a value cannot be used.
    """
    try:
        content = parse_toml(read_text(path, "sweep"))
    except ValueError as error:
        raise SettingsError(f"sweep {path} is not TOML: {error}") from None
    try:
        return _sweep(content, path.parent, out)
    except SettingsError as error:
        raise SettingsError(f"sweep {path}: {error}") from None


def _sweep(content: Mapping[str, Any], folder: Path, out: Path | None) -> Sweep:
    _only("section", content, ("sweep", "common", "variants", "grid"))
    head = _table("sweep", content.get("sweep", {}))
    _only("key of [sweep]", head, _SWEEP_KEYS)
    for key in ("name", "base"):
        if not isinstance(head.get(key), str) or not head[key]:
            raise SettingsError(f'[sweep] needs a {key} = "..."')
    folder_name("sweep.name", head["name"])
    text("sweep.question", head.get("question", ""))
    base = folder / head["base"]
    common = _overrides("common", content.get("common", {}), folder)
    named = {"name": head["name"], "question": head.get("question", ""), "base": base}
    if ("grid" in content) == ("variants" in content):
        raise SettingsError("a sweep has either [variants.NAME] sections or a [grid]")
    if "grid" in content:
        if "seeds" in head:
            raise SettingsError("a [grid] has no sweep.seeds; its base has the seed")
        about = {("study", key): named[key] for key in ("name", "question")}
        values = _table("grid", content["grid"])
        return Sweep(**named, grid=_grid(values, base, {**common, **about}, folder))
    _check_names(_table("variants", content["variants"]))
    variants = {
        name: {**common, **_overrides(f"variants.{name}", values, folder)}
        for name, values in _table("variants", content["variants"]).items()
    }
    studies = tuple(
        _planned(head["name"], variant, seed, base, overrides, out)
        for seed in _seeds(head.get("seeds"))
        for variant, overrides in variants.items()
    )
    return Sweep(**named, studies=studies)


def _check_names(variants: Mapping[str, Any]) -> None:
    """Refuse names of variants that do not do as names of folders beside each other."""
    taken: dict[str, str] = {name: f"the sweep's {name}" for name in OUTPUTS}
    for name in variants:
        folder_name("a variant's name", name)
        # Where a file system does not tell them apart, two variants would share a folder.
        if (other := taken.setdefault(unicodedata.normalize("NFC", name).casefold(), name)) != name:
            raise SettingsError(
                f"the folder of variant '{name}' could be that of {other}; call it otherwise"
            )


def _planned(
    sweep: str, variant: str, seed: int, base: Path, overrides: Overrides, out: Path | None
) -> PlannedStudy:
    overrides = {**overrides, ("study", "name"): f"{sweep}-{variant}", ("study", "seed"): seed}
    folder = (out or Path("runs") / sweep) / variant / f"seed-{seed}"
    settings = read_study(base, overrides, begun=lambda name: folder)
    return PlannedStudy(variant=variant, seed=seed, settings=settings, overrides=overrides)


def _grid(values: Mapping[str, Any], base: Path, common: Overrides, folder: Path) -> Grid:
    _only("key of [grid]", values, _GRID_KEYS)
    replicas, noise = values.get("replicas", 1), values.get("noise_deg", 0.0)
    if isinstance(replicas, bool) or not isinstance(replicas, int) or replicas < 1:
        raise SettingsError(f"grid.replicas must be a whole number >= 1, got {replicas!r}")
    if isinstance(noise, bool) or not isinstance(noise, (int, float)) or not 0.0 <= noise <= 1.0:
        raise SettingsError(f"grid.noise_deg must lie in 0 to 1 degrees, got {noise!r}")
    settings = read_study(base, common)
    gaits = _gaits(values, folder, settings.space.family)
    _check_scatter(gaits, replicas, noise)
    axes = values.get("axes", [])
    if not isinstance(axes, list) or len(axes) != 2:
        raise SettingsError("[grid] needs two [[grid.axes]]")
    first, second = (_axis(_table("grid.axes", axis)) for axis in axes)
    if shared := first.levels[0].keys() & second.levels[0].keys():
        raise SettingsError(f"both axes of the grid set {', '.join(sorted(shared))}")
    if first.name == second.name:
        raise SettingsError(f"both axes of the grid are called '{first.name}'; name one otherwise")
    feet = tuple(
        tuple(
            read_study(
                base, {**common, **{("foot", key): value for key, value in (one | two).items()}}
            ).space.foot
            for two in map(dict, second.levels)
        )
        for one in map(dict, first.levels)
    )
    return Grid(
        settings=settings,
        gaits=gaits,
        axes=(first, second),
        feet=feet,
        replicas=replicas,
        noise_deg=float(noise),
    )


def _axis(values: Mapping[str, Any]) -> Axis:
    columns = {key: column for key, column in values.items() if key != "name"}
    name = values.get("name", next(iter(columns), ""))
    counts = {len(column) if isinstance(column, list) else 0 for column in columns.values()}
    if not isinstance(name, str) or len(counts) != 1 or min(counts) < 2:
        raise SettingsError(
            "each of [[grid.axes]] needs keys of [foot] with equally many values, two or more, "
            f"got {dict(values)}"
        )
    text("the name of a grid's axis", name)
    rows = list(zip(*columns.values(), strict=True))
    if repeated := [row for place, row in enumerate(rows) if row in rows[:place]]:
        again = " / ".join(map(str, repeated[0]))
        raise SettingsError(f"axis '{name}' of the grid has the level {again} twice; leave one out")
    return Axis(name=name, levels=tuple(dict(zip(columns, row, strict=True)) for row in rows))


def _check_scatter(gaits: Sequence[AnyGait], replicas: int, noise: float) -> None:
    """Refuse walks between which an analysis of variance would find no scatter."""
    if replicas * len(gaits) < 2:
        raise SettingsError(
            "one gait with grid.replicas = 1 walks once on every foot, which leaves an analysis of "
            "variance no scatter; give replicas >= 2 and noise_deg > 0, or more gaits"
        )
    if noise == 0.0 and replicas > 1:
        raise SettingsError(
            f"grid.replicas = {replicas} with grid.noise_deg = 0 are the same walk again and "
            "again, which leaves an analysis of variance no scatter; give noise_deg > 0, or "
            "replicas = 1 with two gaits or more"
        )
    if noise == 0.0 and len(set(gaits)) < len(gaits):
        raise SettingsError(
            "a gait is given twice to a [grid] with grid.noise_deg = 0; leave it out, or give "
            "noise_deg > 0"
        )


def _gaits(values: Mapping[str, Any], folder: Path, family: GaitFamily) -> tuple[AnyGait, ...]:
    tables, names = values.get("coefficients_deg", []), values.get("results", [])
    if not isinstance(tables, list):
        raise SettingsError(f"grid.coefficients_deg must be a list of gaits, got {tables!r}")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SettingsError(f'grid.results must be a list of files, ["..."], got {names!r}')
    winners = [earlier_winner(folder / name, study_settings) for name in names]
    if not (tables or winners):
        raise SettingsError('[grid] needs gaits: results = ["..."] or coefficients_deg = [...]')
    gaits: list[AnyGait] = [
        Gait.from_degrees(table)
        for table in [*tables, *(one.coefficients_deg for one in winners if one.gait is None)]
    ]
    gaits += [one.gait for one in winners if one.gait is not None]
    if isinstance(family, PaperFamily):
        for one in gaits:
            if not isinstance(one, Gait):
                raise SettingsError(
                    f"a gait of [grid] is of the family {one.family.label}, and the base's is "
                    "paper; give the base the same gait.family"
                )
        return tuple(replace(one, family=family) for one in gaits if isinstance(one, Gait))
    return tuple(family.gait(family.values(family.like(one))) for one in gaits)


def _seeds(seeds: Any) -> list[int]:
    whole = isinstance(seeds, list) and all(type(seed) is int and seed >= 0 for seed in seeds)
    if not whole or not seeds or len(set(seeds)) != len(seeds):
        raise SettingsError(f"sweep.seeds must be different whole numbers >= 0, got {seeds!r}")
    return list(seeds)


def _overrides(name: str, values: Any, folder: Path) -> dict[tuple[str, str], Any]:
    """Settings by section and key; what is relative to the sweep's file is made absolute."""
    found = {
        (section, key): _from_folder(folder, value)
        if (section, key) == ("box", "centre_from")
        else value
        for section, keys in _table(name, values).items()
        for key, value in _table(f"{name}.{section}", keys).items()
    }
    for section, key in robot_section.NAMES:
        if isinstance(model := found.get((section, key)), str):
            # From the sweep's folder.
            found[section, key] = located(model, folder, f"{section}.{key}")
    if isinstance(family := found.get(("gait", "family")), str):
        found["gait", "family"] = family_from(family, folder)
    return found


def _from_folder(folder: Path, value: Any) -> Any:
    if not isinstance(value, str):
        return value
    return str(whole_path(folder, value))


def _table(name: str, values: Any) -> Mapping[str, Any]:
    if not isinstance(values, Mapping):
        raise SettingsError(f"[{name}] must be a section, got {values!r}")
    return values


def _only(what: str, given: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for name in given:
        if name not in known:
            raise SettingsError(f"no {what} is called '{name}'; there are {', '.join(known)}")
