"""The quantities of a walk: numbers that limits and objectives are set on, each declared once.

A declaration gives the key in a study's file, the limit and the output of the network. It also
gives the columns of a study file and an export, the row in the report and the reference's line.
"""

import keyword
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.problem.candidate import Trial
from drake_gait.ranges import DEGREES, JOULES, MM, N_M, NONE, RAD_PER_S, Unit, choice
from drake_gait.walk import Outcome, Walk


class Needs(StrEnum):
    """The sources of quantities."""

    CANDIDATE = "candidate"
    """The trial alone, before anything is simulated."""
    WALK = "walk"
    """The numbers that every walk has."""
    MEASURES = "measures"
    """The measures of a walk."""
    HISTORY = "history"
    """Its time histories, which stay where it was simulated: only the value travels."""


class Side(StrEnum):
    """The side of a limit that is given as one number."""

    UPPER = "upper"
    """The largest value; of several feet or toes the largest counts."""
    LOWER = "lower"
    """The smallest value; of several the smallest counts."""
    BOTH = "both"
    """The largest size: -x to x; of several the largest size counts."""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """A monotone function of a quantity, which limits, objectives and networks take instead.

    A network learns a number best that is finite, and that few walks have far from the others.
    """

    name: str
    """Name of the number that it gives."""
    function: Callable[[float], float]
    """The number of a value in SI units."""
    falls: bool
    """Whether a larger value gives a smaller number."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Quantity(str):
    """A number of a walk: its name as text, with all that is known of it.

    `read` is given a Walk, and returns a finite number, or one for each of `parts`. Where `needs`
    is "candidate" it is given a Trial. Where it is "history", the walk has its `history`.

        def sway(walk):
            return float(np.ptp(walk.history.com[:, 1]))

        Quantity(name="sway", unit=MM, needs="history", read=sway)
    """

    name: str
    """Lower-case word: the field in Python, the column, and with its unit the key in a file."""
    read: Callable[[Any], float | Sequence[float]]
    """The value [SI] of a walk, or of a trial."""
    label: str = ""
    """Its name for people; the name itself by default."""
    symbol: str = ""
    """The paper's symbol."""
    unit: Unit = NONE
    """The unit that people write."""
    digits: int = 2
    """Decimal places that people read."""
    side: Side = Side.UPPER
    """What one number in [constraints] limits."""
    maximise: bool | None = None
    """Whether an objective wants more of it; by default where `side` is "lower"."""
    needs: Needs = Needs.WALK
    """Where it comes from."""
    parts: tuple[str, ...] = ()
    """Names of the feet or toes that it has a value of; none: one value."""
    limit: float | None = None
    """The limit of a study that gives none [SI]."""
    scale: Scale | None = None
    """What limits, objectives and networks take instead."""

    def __new__(cls, *, name: str, **others: Any) -> "Quantity":
        """Make the text that a quantity is; the rest is set as in any dataclass."""
        return super().__new__(cls, name)

    def __post_init__(self) -> None:
        name = self.name
        if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
            raise SettingsError(
                f"a quantity's name must be lower-case letters, digits and _, got '{name}'"
            )
        for part in self.parts:
            if not re.fullmatch(r"[a-z0-9_]+", part):
                raise SettingsError(
                    f"a part of the quantity {name} must be lower-case letters, digits and _, "
                    f"got '{part}'"
                )
        if not callable(self.read):
            raise SettingsError(f"read of the quantity {name} must be a function of a walk")
        object.__setattr__(self, "parts", tuple(self.parts))
        object.__setattr__(self, "side", choice(Side, f"side of {name}", self.side))
        object.__setattr__(self, "needs", choice(Needs, f"needs of {name}", self.needs))
        if not self.label:
            object.__setattr__(self, "label", name.replace("_", " "))
        if self.maximise is None:
            object.__setattr__(self, "maximise", self.side is Side.LOWER)

    def __repr__(self) -> str:
        return f"Quantity({self.name})"

    def __reduce__(self) -> tuple[Any, ...]:
        if BUILT_IN.get(self.name) is self:
            return _built_in, (self.name,)
        # By value: a worker has neither the user's file nor the functions of a notebook.
        import cloudpickle  # Nobody else needs it.

        content = {one.name: getattr(self, one.name) for one in fields(self)}
        return _unpickled, (cloudpickle.dumps(content),)

    def __deepcopy__(self, memo: Any) -> "Quantity":
        return self

    @property
    def key(self) -> str:
        """Its key in [constraints]: the name with the unit."""
        return f"{self.name}_{self.unit.suffix}" if self.unit.suffix else self.name

    @property
    def title(self) -> str:  # type: ignore[override]
        """Its name for people, with the unit."""
        return f"{self.label} [{self.unit.short}]" if self.unit.name else self.label

    @property
    def columns(self) -> tuple[str, ...]:
        """Its columns in a study file, one for each part."""
        return tuple(f"{self.name}_{part}" for part in self.parts) or (self.name,)

    def values(self, walk: Walk) -> tuple[float, ...] | None:
        """Return the value [SI] of each part; None where a walk does not tell it."""
        if isinstance(self.read, _Scaled):
            scaled = self.read(walk)
            return None if math.isnan(scaled) else (scaled,)
        found = walk.values.get(self.name)
        if found is not None or not self.at_hand:
            return found
        if self.needs is Needs.CANDIDATE or (
            walk.outcome is Outcome.DIVERGED and self.name not in OF_EVERY_WALK
        ):
            return None
        if self.needs is Needs.MEASURES and walk.measures is None:
            return None
        if self.needs is Needs.HISTORY and walk.history is None:
            return None
        return self.evaluated(walk)

    def of(self, walk: Walk) -> float:
        """Return its value [SI]: of several feet or toes, the worst; NaN where it is unknown.

        Raises:
            SettingsError: it needs measures, and the walk was simulated without.
        """
        found = self.values(walk)
        if found is None:
            diverged = walk.outcome is Outcome.DIVERGED
            if self.needs is Needs.MEASURES and walk.measures is None and not diverged:
                raise SettingsError(
                    f"{self.name} needs the measures of a walk, which those of older studies lack; "
                    "simulate it again"
                )
            return math.nan
        if self.side is Side.LOWER:
            return float(min(found))
        return float(max(found) if self.side is Side.UPPER else max(found, key=abs))

    def evaluated(self, walk_or_trial: Walk | Trial) -> tuple[float, ...]:
        """Return what `read` says, one number [SI] for each part.

        Raises:
            SettingsError: it raises an error, or says something else; names the quantity.
        """
        try:
            said = self.read(walk_or_trial)
            found = tuple(map(float, said if isinstance(said, Iterable) else (said,)))
        except SettingsError:
            raise
        except Exception as error:
            raise SettingsError(
                f"the quantity {self.name} cannot be read: {type(error).__name__}: {error}"
            ) from error
        if len(found) != max(len(self.parts), 1):
            wanted = f"one for each of {', '.join(self.parts)}" if self.parts else "one"
            raise SettingsError(
                f"the quantity {self.name} must be read as numbers, {wanted}, got {len(found)}"
            )
        return found

    def scaled(self) -> "Quantity":
        """Return the number that limits and networks take: this one, or its `scale`."""
        return self if self.scale is None else self._on(self.scale)

    def gain(self, *, maximise: bool) -> "Quantity":
        """Return a number above 0 that grows as this one gets better: what a search maximises."""
        if self.name == FORWARD.name and maximise:
            return self  # Eq. 10. The other ways of walking are no gain.
        if self.scale is not None and self.scale.falls and not maximise:
            return self.scaled()
        sign = 1.0 if maximise else -1.0
        gain = _Gain(size=self.unit.si, sign=sign, of_size=self.side is Side.BOTH)
        return self._on(Scale(name=f"gain_of_{self.name}", function=gain, falls=not maximise))

    def _on(self, scale: Scale) -> "Quantity":
        side = {Side.UPPER: Side.LOWER, Side.LOWER: Side.UPPER}.get(self.side, self.side)
        return Quantity(
            name=scale.name,
            label=scale.name.replace("_", " "),
            read=_Scaled(base=self, function=scale.function),
            side=side if scale.falls else self.side,
            needs=self.needs,
        )

    def plain(self) -> dict[str, Any]:
        """Return all but its function, for a study file."""
        return {
            "name": self.name,
            "label": self.label,
            "symbol": self.symbol,
            "unit": [self.unit.name, self.unit.si],
            "digits": self.digits,
            "side": str(self.side),
            "maximise": self.maximise,
            "needs": str(self.needs),
            "parts": list(self.parts),
            "limit": self.limit,
        }

    @classmethod
    def from_plain(cls, content: Mapping[str, Any]) -> "Quantity":
        """Return the quantity of a study file: it has values of the study's walks, and no other."""
        name, si = content["unit"]
        return cls(
            **{
                **content,
                "unit": Unit(name=name, si=si),
                "read": Absent(name=content["name"]),
            }
        )

    @property
    def at_hand(self) -> bool:
        """True where it can be read of a new walk."""
        return not isinstance(self.read, Absent)


@dataclass(frozen=True, kw_only=True)
class Absent:
    """The function of a quantity that is known from a study file alone."""

    name: str
    """Name of the quantity."""

    def __call__(self, walk: Any) -> float:
        """Refuse to tell anything of a new walk."""
        raise SettingsError(f"the quantity {self.name} is not at hand; give the file that has it")


@dataclass(frozen=True, kw_only=True)
class _Scaled:
    base: Quantity
    function: Callable[[float], float]

    def __call__(self, walk: Walk) -> float:
        value = self.base.of(walk)
        return math.nan if math.isnan(value) else self.function(value)


@dataclass(frozen=True, kw_only=True)
class _Gain:
    """A smooth function without a zero: 1 + v where v > 0, and 1 / (1 - v) below."""

    size: float
    sign: float
    of_size: bool
    """Whether the size of a value counts, and not the way that it goes."""

    def __call__(self, value: float) -> float:
        v = self.sign * (abs(value) if self.of_size else value) / self.size
        return 1.0 + v if v > 0.0 else 1.0 / (1.0 - v)


def _inverse(value: float) -> float:
    return math.inf if value == 0.0 else 1.0 / value


def _share(value: float) -> float:
    return 1.0 if math.isinf(value) else value / (1.0 + value)


def _slip_ratio(walk: Walk) -> float:
    slip = max(walk.measures.slip) if walk.measures else math.nan
    return slip / walk.forward if walk.forward > 0.0 else math.inf


def _yaw_swing(walk: Walk) -> float:
    return math.nan if walk.yaw_swing is None else walk.yaw_swing


def _jump(trial: Trial) -> float:
    return float(np.abs(trial.candidate.gait.jumps_from(trial.settings.start)).max())


FEET = ("right", "left")
"""Names of the parts of a quantity that each foot has."""
_TOES = ("right_big", "right_lesser", "left_big", "left_lesser")


def _measured(name: str, label: str, **others: Any) -> Quantity:
    read = attrgetter(f"measures.{name}")
    return Quantity(name=name, label=label, read=read, needs=Needs.MEASURES, **others)


FORWARD = Quantity(
    name="forward", label="distance forward", symbol="Z", unit=MM, digits=1, side=Side.LOWER,
    read=attrgetter("forward"),
)  # fmt: skip
JUMP = Quantity(
    name="jump", label="jump of the command where walking begins and ends", unit=DEGREES, digits=1,
    needs=Needs.CANDIDATE, read=_jump,
)  # fmt: skip

_DECLARED = (
    FORWARD,
    Quantity(name="lateral", label="lateral displacement, Eq. 11", symbol="X", unit=MM, digits=1,
             side=Side.BOTH, limit=0.020, read=attrgetter("lateral")),
    Quantity(name="yaw", label="turn, Eq. 12", symbol="R", unit=DEGREES, side=Side.BOTH,
             limit=math.radians(5.0), read=attrgetter("yaw")),
    Quantity(name="com_height", label="height of the centre of mass at the end, Eq. 13", symbol="Y",
             unit=MM, side=Side.LOWER, limit=0.24353, read=attrgetter("com_height")),
    _measured("energy", "work of the servos, driving and braking", unit=JOULES),
    _measured("positive_energy", "driving work of the servos", unit=JOULES),
    _measured("cost_of_transport", "cost of transport",
              scale=Scale(name="transport_efficiency", function=_inverse, falls=True)),
    _measured("peak_torque", "largest torque", unit=N_M),
    _measured("peak_speed", "largest speed", unit=RAD_PER_S, digits=1),
    _measured("driving_torque", "largest torque of a servo, driving", unit=N_M),
    _measured("braking_torque", "largest torque of a servo, driven back", unit=N_M),
    _measured("driving_speed", "largest speed of a servo, driving", unit=RAD_PER_S, digits=1),
    _measured("braking_speed", "largest speed of a servo, driven back", unit=RAD_PER_S, digits=1),
    _measured("line_share", "largest share of the torque-speed line, driving"),
    _measured("saturated_fraction", "share of servo-time at the stall torque", digits=3),
    _measured("slip", "slip of the loaded sole", unit=MM, digits=0, parts=FEET),
    _measured("clearance", "minimum toe clearance of the lowest swing", unit=MM, digits=1,
              side=Side.LOWER, parts=FEET),
    _measured("duty_factor", "duty factor in the second cycle", parts=FEET),
    _measured("peak_ground_reaction", "largest ground reaction in weights"),
    _measured("toe_range", "largest angle of each toe", unit=DEGREES, digits=1, parts=_TOES),
    Quantity(name="yaw_swing", label="range of the torso's heading", unit=DEGREES, digits=0,
             read=_yaw_swing),
    _measured("torso_tilt", "largest lean of the torso", unit=DEGREES, digits=0),
    Quantity(name="slip_ratio", label="slip of the worse foot / distance forward", digits=3,
             needs=Needs.MEASURES, read=_slip_ratio,
             scale=Scale(name="slip_share", function=_share, falls=False)),
    JUMP,
)  # fmt: skip

BUILT_IN = {one.name: one for one in _DECLARED}
"""Every quantity of the package by its name, in the order of the columns."""

OUTPUTS = ("forward", "lateral", "yaw", "com_height")
"""What every network predicts: Z_f, X_f [m], R_f [rad], Y_f [m]."""

OF_EVERY_WALK = (*OUTPUTS, "yaw_swing")
"""What every walk has, with measures or without."""

_SCALED = {one.scaled().name: one.scaled() for one in _DECLARED if one.scale is not None}


def _built_in(name: str) -> Quantity:
    return BUILT_IN[name]


def _unpickled(content: bytes) -> Quantity:
    import cloudpickle

    return Quantity(**cloudpickle.loads(content))


def named(name: str, own: Iterable[Quantity] = ()) -> Quantity:
    """Return the quantity of a name.

    Args:
        name: The name, or a quantity.
        own: Quantities beside those of the package.

    Raises:
        SettingsError: there is none.
    """
    if isinstance(name, Quantity):
        return name
    known = {**BUILT_IN, **_SCALED, **{one.name: one for one in own}}
    if name not in known:
        there = ", ".join(one for one in known if one not in _SCALED)
        raise SettingsError(f"no quantity is called '{name}'; there are {there}")
    return known[name]


def quantity(walk: Walk, name: str) -> float:
    """Return one number of a walk, in SI units; see `Quantity.of`.

    Args:
        walk: The walk.
        name: A quantity, or the name of one of the package.

    Raises:
        SettingsError: the walk was simulated without measures.
    """
    return named(name).of(walk)


def evaluated(walk: Walk, trial: Trial) -> Walk:
    """Return a walk with the values of what its trial asks for, and without its history.

    What a walk has already, and what needs a history that it has no more, stays as it is.

    Raises:
        SettingsError: a quantity of a user's own cannot be read.
    """
    found = dict(walk.values)
    for one in (JUMP, *trial.quantities):
        if one.name in found:
            continue
        if one.needs is Needs.CANDIDATE:
            found[one.name] = one.evaluated(trial)
        elif (values := one.values(walk)) is not None:
            found[one.name] = values
    return replace(walk, values=found, history=None)


@dataclass(frozen=True, init=False)
class Objective:
    """The aim of a study: the most, or the least, of a quantity."""

    wanted: Quantity
    """The quantity."""
    maximise: bool
    """Whether more of it is better."""
    quantity: Quantity = field(compare=False, repr=False)
    """The number that a search maximises: the quantity, or one that grows as it gets better."""

    DISTANCE: ClassVar["Objective"]
    """The largest distance walked forward, Eq. 10."""
    COST_OF_TRANSPORT: ClassVar["Objective"]
    """The smallest driving work per weight and distance; the paper's future work."""

    def __init__(self, quantity: str = "distance", *, maximise: bool | None = None) -> None:
        """Take a quantity, or the name of one of the package.

        Args:
            quantity: The quantity; "distance" means "forward".
            maximise: Whether more is better; the quantity's own word by default.

        Raises:
            SettingsError: there is no such quantity.
        """
        wanted = named(_ALIASES.get(quantity, quantity))
        object.__setattr__(self, "wanted", wanted)
        object.__setattr__(self, "maximise", wanted.maximise if maximise is None else maximise)
        object.__setattr__(self, "quantity", wanted.gain(maximise=self.maximise))

    def __str__(self) -> str:
        """Return the objective as a file names it."""
        text = {name: alias for alias, name in _ALIASES.items()}.get(self.wanted, self.wanted.name)
        if self.maximise == self.wanted.maximise:
            return text
        return f"{'maximise' if self.maximise else 'minimise'} {text}"

    @classmethod
    def read(cls, text: Any, own: Sequence[Quantity] = ()) -> "Objective":
        """Return the objective that a file names: a quantity, "minimise" or "maximise" before it.

        Raises:
            SettingsError: there is none.
        """
        if isinstance(text, Objective):
            return text
        direction, _, name = str(text).rpartition(" ")
        name = _ALIASES.get(name, name)
        known = {**BUILT_IN, **{one.name: one for one in own}}
        if name not in known or direction not in ("", "minimise", "maximise"):
            there = [*_ALIASES, *(one for one in known if one not in _ALIASES.values())]
            raise SettingsError(
                f"search.objective must be one of {', '.join(there)}, with minimise or maximise "
                f"before it where that is not its own, got {text!r}"
            )
        return cls(known[name], maximise=direction == "maximise" if direction else None)


_ALIASES = {"distance": "forward"}

Objective.DISTANCE = Objective("distance")
Objective.COST_OF_TRANSPORT = Objective("cost_of_transport")
