"""Families of gaits: classes that turn a few named numbers into joint commands.

A family says which variables its gaits have, and what joints do for given values. Fields of the
class are its settings, which a study gives in [gait].

    class Nod(GaitFamily):
        variables = (Variable("depth", lower=0.0, upper=0.5),)

        def commands(self, x):
            ...  # Joint angles [rad], shape (frames + 1, 10).
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from drake_gait.arrays import numbers
from drake_gait.errors import SettingsError
from drake_gait.gait.joints import FRAME_TIME, FloatArray, joint_commands
from drake_gait.ranges import DEGREES, NONE, SECONDS, OutOfRangeError, Range, Unit

if TYPE_CHECKING:
    from drake_gait.gait.paper import Start

ROUNDING = 1e-9
"""A variable beyond its limits by no more than this is at its end [SI]."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class Variable:
    """A variable of a gait family."""

    name: str
    """Lower-case word; with the unit it is the key in a study's file."""
    unit: Unit = DEGREES
    """The unit that people write."""
    lower: float = field(default=-math.pi, kw_only=True)
    """Smallest value [SI]."""
    upper: float = field(default=math.pi, kw_only=True)
    """Largest value [SI]."""
    default: float | None = field(default=None, kw_only=True)
    """Value of a study that names none [SI]; None where a study must."""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise SettingsError(
                f"a variable's name must be lower-case letters, digits and _, got '{self.name}'"
            )
        if not (math.isfinite(self.lower) and self.lower < self.upper < math.inf):
            raise SettingsError(
                f"limits of the variable {self.name} must be finite and rise, got {self.lower} to "
                f"{self.upper}"
            )

    @property
    def key(self) -> str:
        """Its key in a study's file: the name with the unit."""
        return f"{self.name}_{self.unit.suffix}" if self.unit.suffix else self.name

    @property
    def allowed(self) -> Range:
        """The range of its values [SI]."""
        return Range(lower=self.lower, upper=self.upper)

    @property
    def is_angle(self) -> bool:
        """Return whether it is an angle, to which a confirmation adds noise."""
        return self.unit in (DEGREES, Unit(name="rad"))


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Frames of a walk, and its gait cycle."""

    period: float
    """Duration of one gait cycle, two steps [s]."""
    begin: int
    """Frame in which walking begins."""
    end: int
    """Frame in which it ends."""
    frames: int
    """Frames of the whole walk, with the standing after it."""

    @property
    def second_cycle(self) -> tuple[float, float]:
        """Beginning and end of the second gait cycle [s], or of the last one of a shorter walk."""
        end = self.end * FRAME_TIME
        if 2.0 * self.period <= end:
            return self.period, 2.0 * self.period
        return max(end - self.period, 0.0), end


def frames_of(seconds: float) -> int:
    """Return how many frames a time has."""
    return round(seconds / FRAME_TIME)


def setting(
    default: Any, unit: Unit = NONE, *, lower: float = -math.inf, upper: float = math.inf
) -> Any:
    """Declare a field of a family that a study's [gait] may set.

    Args:
        default: Its value where the study does not; the kind of it is the kind of the setting.
        unit: The unit that people write.
        lower: Smallest value [SI].
        upper: Largest value [SI].
    """
    return field(default=default, metadata={"unit": unit, "lower": lower, "upper": upper})


@dataclass(frozen=True, kw_only=True)
class GaitFamily(ABC):
    """A kind of gait: its variables, its settings, and the commands of given values."""

    name: ClassVar[str] = ""
    """Name of a shipped family; those of a user's own are named by their class."""
    source: ClassVar[str] = ""
    """File and class of a user's own that was read from a file: FILE.py:CLASS."""

    period: float = setting(1.2, SECONDS, lower=0.2, upper=10.0)
    """Duration of one gait cycle, two steps [s]."""
    cycles: int = setting(3, lower=1, upper=100)
    """Gait cycles of a walk."""
    standing: float = setting(1.2, SECONDS, lower=0.0, upper=30.0)
    """Time for which the robot stands after them [s]."""

    def __post_init__(self) -> None:
        for one in fields(self):
            object.__setattr__(self, one.name, _checked(self.label, one, getattr(self, one.name)))
        found = self.variables
        if not found or not all(isinstance(one, Variable) for one in found):
            raise SettingsError(
                f"the gait family {self.label} must have Variables, got {found!r:.80}"
            )
        names = [one.name for one in found]
        if twice := [name for name in names if names.count(name) > 1]:
            raise SettingsError(f"the gait family {self.label} has two variables '{twice[0]}'")

    @property
    @abstractmethod
    def variables(self) -> Sequence[Variable]:
        """The variables of its gaits, in the order of x."""

    @abstractmethod
    def commands(self, x: FloatArray) -> ArrayLike:
        """Return joint angles from the first frame to the last.

        Args:
            x: Values of the variables [SI], shape (n,).

        Returns:
            Angles relative to the standing robot [rad], shape (frames + 1, 10), columns as JOINTS.
        """

    def period_of(self, x: FloatArray) -> float:
        """Return the gait cycle of a gait [s]; the setting, unless a variable says it."""
        return self.period

    def schedule(self, x: FloatArray) -> Schedule:
        """Return the frames of a gait: its cycles from frame 0 on, then the standing."""
        period = self.period_of(x)
        end = frames_of(self.cycles * period)
        return Schedule(period=period, begin=0, end=end, frames=end + frames_of(self.standing))

    def times(self, x: FloatArray) -> FloatArray:
        """Return the times of the frames of a gait [s], shape (frames + 1,)."""
        return np.arange(self.schedule(x).frames + 1, dtype=float) * FRAME_TIME

    def gait(self, x: ArrayLike) -> "AnyGait":
        """Return the gait of values of the variables [SI], shape (n,)."""
        return FamilyGait(family=self, x=numbers(f"variables of {self.label}", x))

    @property
    def label(self) -> str:
        """Its name in messages."""
        return self.name or type(self).__name__

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its variables."""
        return tuple(one.name for one in self.variables)

    @property
    def limits(self) -> FloatArray:
        """Limits of its variables [SI], shape (n, 2)."""
        return np.array([(one.lower, one.upper) for one in self.variables], dtype=float)

    def named(self, x: FloatArray) -> dict[str, float]:
        """Return the values of a gait's variables by their names."""
        return dict(zip(self.names, np.asarray(x, dtype=float).tolist(), strict=True))

    def values(self, named: Mapping[str, Any], *, what: str = "a gait") -> FloatArray:
        """Return the values of all variables [SI], shape (n,), from those that are named.

        Args:
            named: Values [SI] by names; those that are missing have their defaults.
            what: What the values are, for messages.

        Raises:
            SettingsError: there is no such variable, or one without a default is missing.
        """
        for name in named:
            if name not in self.names:
                raise SettingsError(
                    f"{what} has no variable '{name}' in the gait family {self.label}; there are "
                    f"{', '.join(self.names)}"
                )
        missing = [
            one.name for one in self.variables if one.default is None and one.name not in named
        ]
        if missing:
            raise SettingsError(
                f"{what} needs {', '.join(missing)} of the gait family {self.label}"
            )
        return numbers(what, [named.get(one.name, one.default) for one in self.variables])

    def like(self, gait: "AnyGait") -> dict[str, float]:
        """Return values of variables [SI] by name of a gait like one of another family.

        Raises:
            SettingsError: the family knows of none.
        """
        if gait.family.names == self.names:
            return self.named(gait.variables)
        raise SettingsError(
            f"the gait family {self.label} knows no gait like one of the family {gait.family.label}"
        )

    @classmethod
    def setting_units(cls) -> dict[str, Unit]:
        """Return the names of the settings of a family, with the units that people write."""
        return {one.name: one.metadata.get("unit", NONE) for one in fields(cls)}

    def plain(self) -> dict[str, Any]:
        """Return the settings [SI] by their names, as JSON has them."""
        return {
            one.name: list(value) if isinstance(value, tuple) else value
            for one in fields(self)
            for value in (getattr(self, one.name),)
        }

    def __reduce__(self) -> tuple[Any, ...]:
        if type(self).__module__.startswith("drake_gait."):
            return _shipped, (type(self), self.plain())
        # By value: a worker has neither the user's file nor the classes of a notebook.
        import cloudpickle  # Nobody else needs it.

        return _unpickled, (cloudpickle.dumps((type(self), self.plain())),)


def _shipped(kind: type[GaitFamily], plain: Mapping[str, Any]) -> GaitFamily:
    return kind(**plain)


def _unpickled(content: bytes) -> GaitFamily:
    import cloudpickle

    kind, plain = cloudpickle.loads(content)
    made: GaitFamily = kind(**plain)
    return made


_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
"""Kinds of settings, in words."""


def _checked(family: str, declared: Field[Any], value: Any) -> Any:
    """Return the value of a setting, of the kind of its default and within its range."""
    default, told = declared.default, f"{declared.name} of the gait family {family}"
    value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    if isinstance(default, tuple):
        if not isinstance(value, list | tuple) or not value:
            raise SettingsError(f"{told} must be a list, got {value!r}")
        kind = type(default[0])
        return tuple(_of_kind(told, declared, kind, one) for one in value)
    return _of_kind(told, declared, type(default), value)


def _of_kind(told: str, declared: Field[Any], kind: type, value: Any) -> Any:
    if kind not in _KINDS:
        return value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    whole = number and float(value).is_integer()
    if not {int: whole, float: number}.get(kind, isinstance(value, kind)):
        raise SettingsError(f"{told} must be {_KINDS[kind]}, got {value!r}")
    found = kind(value)
    if kind in (int, float):
        ends = {end: declared.metadata[end] for end in ("lower", "upper") if declared.metadata}
        if found not in (allowed := Range(**ends)):
            raise OutOfRangeError(told, declared.name, value, allowed)
    return found


class AnyGait(ABC):
    """A gait of any family: what a simulation needs to know of it."""

    family: GaitFamily
    """Its family."""

    @property
    @abstractmethod
    def variables(self) -> FloatArray:
        """Values of its variables [SI], shape (n,), ordered as in its family."""

    @property
    @abstractmethod
    def commands(self) -> FloatArray:
        """Joint angles [rad], shape (frames + 1, 10), columns as JOINTS.

        Frame k is sent at k * FRAME_TIME.
        """

    @cached_property
    def schedule(self) -> Schedule:
        """Its frames and its gait cycle."""
        return self.family.schedule(self.variables)

    @property
    def frames(self) -> int:
        """Frames of its walk."""
        return self.schedule.frames

    @property
    def walking(self) -> tuple[int, int]:
        """Frames in which walking begins and ends."""
        return self.schedule.begin, self.schedule.end

    def commands_from(self, start: "Start") -> FloatArray:
        """Return the commands after a start, which gaits of most families have of their own."""
        return self.commands

    def jumps_from(self, start: "Start") -> FloatArray:
        """Return the jumps of the command where walking begins and ends.

        Returns:
            Differences of the changes in two frames that follow each other [rad], shape (2, 10):
            near 0 where commands are smooth, a jump's size where they jump.
        """
        commands = self.commands_from(start)
        # Before frame 0 the robot stands, after the last it is held.
        padded = np.vstack([np.zeros_like(commands[:1]), commands, commands[-1:]])
        changes = np.diff(padded, n=2, axis=0)
        jumps: FloatArray = changes[list(self.walking)]
        return jumps

    def moved(self, by: FloatArray) -> "AnyGait":
        """Return a gait with other angles.

        Args:
            by: Change of each variable [rad], shape (n,); of those that are no angles it has no
                effect. Limits hold.
        """
        family = self.family
        angles = [one.is_angle for one in family.variables]
        changed = self.variables + np.where(angles, by, 0.0)
        return family.gait(np.clip(changed, *family.limits.T))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, AnyGait):
            return NotImplemented
        return self.family == other.family and bool(np.array_equal(self.variables, other.variables))

    def __hash__(self) -> int:
        return hash(self.variables.tobytes())


@dataclass(frozen=True, kw_only=True, eq=False)
class FamilyGait(AnyGait):
    """A gait of a family: values of its variables."""

    family: GaitFamily
    """Its family."""
    x: FloatArray = field(repr=False)
    """Values of its variables [SI], shape (n,)."""

    def __post_init__(self) -> None:
        values, family = np.array(self.x, dtype=float), self.family
        if values.shape != (len(family.names),):
            raise SettingsError(
                f"a gait of the family {family.label} has {len(family.names)} variables, got an "
                f"array of shape {values.shape}; there are {', '.join(family.names)}"
            )
        within = np.clip(values, *family.limits.T)
        for one, value, clipped in zip(family.variables, values, within, strict=True):
            if not abs(value - clipped) <= ROUNDING:
                raise OutOfRangeError(
                    f"{one.name} of the gait family {family.label}",
                    one.name,
                    f"{value / one.unit.si:g}",
                    one.allowed,
                    one.unit,
                )
        within += 0.0  # Equal gaits must have equal bytes to hash: -0.0 becomes 0.0.
        within.setflags(write=False)
        object.__setattr__(self, "x", within)

    @property
    def variables(self) -> FloatArray:
        """Values of its variables [SI], shape (n,)."""
        return self.x

    @cached_property
    def commands(self) -> FloatArray:
        """Joint angles [rad], shape (frames + 1, 10), columns as JOINTS, checked.

        Raises:
            SettingsError: the family gives none, or others than a servo can follow; names it.
        """
        family = self.family
        name = f"commands of the gait family {family.label}"
        try:
            found = family.commands(self.variables)
        except SettingsError:
            raise
        except Exception as error:
            raise SettingsError(
                f"{name} cannot be computed: {type(error).__name__}: {error}"
            ) from error
        commands = joint_commands(found, name)
        if len(commands) != self.frames + 1:
            raise SettingsError(
                f"{name} must have {self.frames + 1} rows, frames 0 to {self.frames}, got "
                f"{len(commands)}; its cycles, period and standing say how many"
            )
        commands.setflags(write=False)  # They are kept.
        return commands

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs; commands are computed there."""
        return {"family": self.family, "x": self.x}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Become what `__getstate__` told of."""
        self.__dict__.update(state)
        self.x.setflags(write=False)


def raised_cosine(progress: ArrayLike) -> FloatArray:
    """Return a smooth growth: 0 until `progress` is 0, 1 from where it is 1."""
    within = np.clip(np.asarray(progress, dtype=float), 0.0, 1.0)
    grown: FloatArray = 0.5 - 0.5 * np.cos(np.pi * within)
    return grown
