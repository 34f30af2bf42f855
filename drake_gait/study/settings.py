"""A study's settings: all that decides its walks, in SI units."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import COEFFICIENTS, GaitFamily, PaperFamily, Start, family_of, plain_family
from drake_gait.problem import (
    BUILT_IN,
    Assessment,
    Constraints,
    DesignSpace,
    Limit,
    Objective,
    Quantity,
    assess,
    quantities,
)
from drake_gait.ranges import Range, check, choice
from drake_gait.robot.description import servo_of
from drake_gait.servo import Servo
from drake_gait.sole import Sole
from drake_gait.study._toml import (
    MOST_BITS,
    folder_name,
    text,
)
from drake_gait.study.keys import KEYS, OLDER
from drake_gait.study.records import names_of
from drake_gait.study.search_settings import ConfirmationSettings, Mode, SearchSettings
from drake_gait.walk import Engine, Fidelity, Walk, WalkSettings

FRICTION = Range(lower=0.1, upper=1.5)
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
    quantities: tuple[Quantity, ...] = field(default=(), compare=False)
    """Quantities beside those of the package; those of constraints and objective are added."""
    quantities_from: str = field(default="", compare=False)
    """The file that they were read from, if there is one."""
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
        object.__setattr__(self, "walk", replace(self.walk, servo=servo_of(self.walk)))
        check("walk.friction", self.walk.friction, FRICTION)
        used = (limit.quantity for limit in self.constraints.given)
        named = {one.name: one for one in (*self.quantities, *used, self.search.objective.wanted)}
        own = tuple(one for one in named.values() if one is not BUILT_IN.get(one.name))
        require_variables(self.space.family)
        require_own(own, self.space.family.names)
        object.__setattr__(self, "quantities", own)

    def with_quantities(self, own: Sequence[Quantity]) -> "StudySettings":
        """Return the same settings with quantities, which take the place of those of their names.

        Raises:
            SettingsError: a name is taken.
        """
        by_name = {one.name: one for one in (*self.quantities, *own)}
        objective, limits = self.search.objective, self.constraints.given
        return replace(
            self,
            quantities=tuple(by_name.values()),
            search=replace(
                self.search,
                objective=Objective(
                    by_name.get(objective.wanted.name, objective.wanted),
                    maximise=objective.maximise,
                ),
            ),
            constraints=Constraints(
                *(
                    Limit(
                        by_name.get(one.quantity.name, one.quantity),
                        lower=one.lower,
                        upper=one.upper,
                    )
                    for one in limits
                )
            ),
        )

    @property
    def outputs(self) -> tuple[Quantity, ...]:
        """Return the outputs of a network: `problem.OUTPUTS`, and what else is needed."""
        return quantities(self.constraints, self.search.objective)

    @property
    def two_grounds(self) -> bool:
        """Return whether the search's walks alternate between slippery and sticky ground."""
        alternates = self.search.grounds and self.search.mode is not Mode.PAPER
        return alternates and self.confirmation.friction > 0.0

    def variables(self) -> list[dict[str, Any]] | None:
        """Return the variables of the gait family as JSON has them; None of the paper's.

        Those of a user's own have the fingerprint of the commands in the middle of the box, so that
        a study is not resumed with another class of the same name.
        """
        family = self.space.family
        if isinstance(family, PaperFamily):
            return None
        plain = [
            {"name": one.name, "unit": one.unit.name, "lower": one.lower, "upper": one.upper}
            for one in family.variables
        ]
        if not family.name:
            commands = family.gait(self.space.centre).commands
            rounded = np.round(commands, 9) + 0.0  # Last digits differ between machines.
            plain[0]["commands_sha256"] = hashlib.sha256(rounded.tobytes()).hexdigest()
        plain[0]["family"] = family.label
        return plain

    def assess(self, walk: Walk) -> Assessment:
        """A walk measured against the study's objective and constraints."""
        return assess(walk, self.constraints, self.search.objective)

    def description(self) -> dict[str, Any]:
        """Every setting as `section.key`: number, text or list; two studies can be compared."""
        walk = asdict(self.walk)
        servo, robot = walk.pop("servo"), walk.pop("robot")
        walk.pop("disturbance")  # Of single walks.
        walk.pop("integrator")  # The fidelity says it; another one is for comparisons only.
        walk.pop("contact")  # The sole says it, likewise.
        start, family = walk.pop("start"), self.space.family
        centre, half_width = self.space.centre.tolist(), self.space.half_width.tolist()
        gait = plain_family(family)
        if isinstance(family, PaperFamily):
            gait["start"] = start
        else:
            centre = family.named(self.space.centre)
            widths = family.named(self.space.half_width)
            half_width = {name: width for name, width in widths.items() if width}
        nested = {
            "study": {
                "name": self.name,
                "question": self.question,
                "seed": self.seed,
                "quantities": self.quantities_from,
            },
            "search": {one.name: getattr(self.search, one.name) for one in fields(self.search)}
            | {"objective": str(self.search.objective)},
            "confirmation": self.confirmation.plain(),
            "box": {
                "chosen": self.chosen,
                "centre": centre,
                "half_width": half_width,
            },
            "constraints": self.constraints.plain(),
            "gait": gait,
            "robot": {"file": str(robot)},
            "walk": {**walk, "model": str(self.walk.model)},
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


def require_variables(family: GaitFamily) -> None:
    """Refuse variables of a gait family whose columns a study file has already.

    Raises:
        SettingsError: names the variable.
    """
    taken = {*names_of(()), *BUILT_IN}
    for name in family.names:
        if name in taken:
            raise SettingsError(
                f"the variable {name} of the gait family {family.label} needs another name: a "
                f"study file has a column '{name}' already"
            )


def require_own(own: Sequence[Quantity], variables: Sequence[str] = COEFFICIENTS) -> None:
    """Refuse quantities of a user's own whose columns a study file has already.

    Args:
        own: The quantities.
        variables: Names of the variables of the study's gait family.

    Raises:
        SettingsError: names the quantity, and the names that are taken.
    """
    taken = set(names_of(variables))
    for one in own:
        for column in {one.name, *one.columns}:
            if column in taken or column in BUILT_IN:
                raise SettingsError(
                    f"the quantity {one.name} needs another name: a study file has a column "
                    f"'{column}' already"
                )
        taken |= {one.name, *one.columns}


def limits_of(values: Mapping[str, Any], own: Sequence[Quantity] = ()) -> Constraints:
    """Return the constraints of values [SI] by the names of quantities.

    Raises:
        SettingsError: there is no such quantity, or a value is none.
    """
    by_name = {one.name: one for one in own}
    limits = [
        Limit.at(by_name[name], value)
        for name, value in values.items()
        if name in by_name and value is not None
    ]
    return Constraints(
        *limits, **{name: value for name, value in values.items() if name not in by_name}
    )


def study_settings(
    description: Mapping[str, Any],
    source: Mapping[str, Any] | None = None,
    own: Sequence[Quantity] = (),
    family: GaitFamily | None = None,
) -> StudySettings:
    """Return the settings that `StudySettings.description` was taken from.

    Args:
        description: Every setting, as a study's file has them.
        source: The fields of their `Source`, where the study's file has it.
        own: Quantities of the study's own.
        family: The family of its gaits, where that is not to be looked for.
    """
    nested: dict[str, dict[str, Any]] = {section: {} for section in KEYS}
    for name, value in {**OLDER, **description}.items():
        section, _, key = name.partition(".")
        nested[section][key] = value
    walk, box, gait = nested["walk"], nested["box"], nested["gait"]
    start = gait.pop("start")
    family = family or family_of(gait)
    search = nested["search"]
    search["objective"] = Objective.read(search["objective"], own)
    return StudySettings(
        name=nested["study"]["name"],
        question=nested["study"]["question"],
        seed=nested["study"]["seed"],
        quantities=tuple(own),
        quantities_from=nested["study"]["quantities"],
        search=SearchSettings(**search),
        confirmation=ConfirmationSettings(**nested["confirmation"]),
        space=DesignSpace(
            centre=box["centre"],
            half_width=box["half_width"],
            family=family,
            foot=FootDesign(**nested["foot"]),
            foot_ranges=tuple((name, low, high) for name, (low, high) in nested["design"].items()),
        ),
        chosen=box["chosen"],
        constraints=limits_of(nested["constraints"], own),
        walk=WalkSettings(
            model=walk["model"],
            robot=nested["robot"]["file"],
            engine=choice(Engine, "walk.engine", walk["engine"]),
            fidelity=choice(Fidelity, "walk.fidelity", walk["fidelity"]),
            step=walk["step"],
            sole=choice(Sole, "walk.sole", walk["sole"]),
            start=choice(Start, "gait.start", start)
            if isinstance(family, PaperFamily)
            else WalkSettings.start,
            time_limit=walk["time_limit"],
            friction=walk["friction"],
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
