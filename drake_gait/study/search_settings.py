"""Settings of a search: its procedure, its number of walks, and its confirmation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any, TypeVar

from drake_gait.errors import SettingsError
from drake_gait.problem import Objective
from drake_gait.ranges import DEGREES, MS, RAD, Range, Unit, check
from drake_gait.study.changes import Change, Varied, check_tier, own_changes
from drake_gait.walk import MOST_DELAY


class Mode(StrEnum):
    """Procedure that proposes the walks of a study."""

    DEFAULT = "default"
    """An ensemble of networks, ISADE on the improvement to expect, a trust region."""
    ISADE_NETWORK = "isade-network"
    """ISADE on simulated walks, its trials ranked by the ensemble of networks."""
    PAPER = "paper"
    """The paper's procedure to the letter: one network of all walks, and ISADE on its outputs."""
    ISADE = "isade"
    """ISADE on the simulator, without a network."""
    CMAES = "cmaes"
    """The covariance matrix adaptation evolution strategy on the simulator."""


class Risk(StrEnum):
    """Weight of safety against distance, in a search on two grounds."""

    TRUST = "trust"
    """The mean improvement to expect, and the chance to pass the confirmation's first test."""

    MEAN = "mean"
    """The improvement to expect, and the chance to hold, of the mean of both grounds."""
    CHANCE = "chance"
    """The mean improvement to expect, and the chance to hold on both grounds."""
    WORST = "worst"
    """The improvement to expect on the worse ground, and the chance to hold on both."""


MOST_SIMULATIONS = 1_000_000
"""Walks of a study are fewer: ids from here on are those of confirmations."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Number of walks of a search, and its batches."""

    mode: Mode = Mode.DEFAULT
    """What proposes the walks."""
    objective: Objective = Objective.DISTANCE
    """What is wanted of a walk."""
    samples: int = 100
    """Walks of the design of experiments (paper: Eq. 29 gives 169, some were added)."""
    simulations: int = 400
    """Walks in all, design of experiments included, confirmation not."""
    batch: int = 12
    """Candidates proposed by one network, at least 4."""
    replicas: int = 1
    """Walks of every candidate that is proposed: the first as it is, the others perturbed.

    Their median counts, and seven of eight must be feasible. A design of experiments, from which
    networks learn, has one walk of each candidate.
    """
    grounds: bool = True
    """Walk on slippery and on sticky ground in turn, by `confirmation.friction`.

    Batches alternate, so that the walks of one compare; a network learns the ground as one more
    input. The paper's mode keeps to the ground of `walk.friction`.
    """
    risk: Risk = Risk.CHANCE
    """What weighs against distance, on two grounds."""
    stagnation: int | None = None
    """Stop after so many networks without a better feasible walk; None: use the whole budget."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "mode", _one_of("search.mode", Mode, self.mode))
        object.__setattr__(self, "objective", Objective.read(self.objective))
        object.__setattr__(self, "risk", _one_of("search.risk", Risk, self.risk))
        if not isinstance(self.grounds, bool):
            raise SettingsError(f"search.grounds must be true or false, got {self.grounds!r}")
        for name in ("samples", "simulations", "replicas"):
            _whole(f"search.{name}", getattr(self, name), 1)
        _whole("search.batch", self.batch, 4)  # CMA-ES has no smaller population.
        if self.stagnation is not None:
            _whole("search.stagnation", self.stagnation, 1)
        if self.simulations >= MOST_SIMULATIONS:
            raise SettingsError(
                f"search.simulations must be less than {MOST_SIMULATIONS}, got {self.simulations}; "
                "part it into studies of several seeds"
            )
        if self.samples > self.simulations:
            raise SettingsError(
                f"search.samples ({self.samples}) must not exceed search.simulations "
                f"({self.simulations}), which counts them too"
            )
        proposed = self.simulations - (self.samples if self.learns else 0)
        if proposed % self.replicas:
            raise SettingsError(
                f"search.simulations ({self.simulations}) leaves {proposed} walks for candidates "
                f"that are proposed; it must leave a multiple of search.replicas ({self.replicas})"
            )

    @property
    def learns(self) -> bool:
        """Return whether networks propose, from a design of experiments on."""
        return self.mode in (Mode.DEFAULT, Mode.ISADE_NETWORK, Mode.PAPER)


def _varied(default: float, **declared: Any) -> Any:
    """Return a number by which walks are changed, with all that is known of it."""
    return field(default=default, metadata={_VARIED: Varied(**declared)})


_VARIED = "varied"
_HALF = Range(lower=0.0, upper=0.5)


@dataclass(frozen=True, kw_only=True)
class ConfirmationSettings:
    """Walks that confirm the best candidates, tier by tier (study.finalists.Tier).

    A candidate walks `replicas` times with noise on every coefficient, and friction that is lower
    and higher in turn. It walks as often with fresh noise at reference fidelity. In each tier
    `feasible` of the walks must be feasible. The winner alone is walked with other servos and
    masses, on the other sole, and in the other engine.
    """

    walks: int = 240
    """Perturbed walks at the search's fidelity, at most; 0: no confirmation."""
    reference_walks: int = 96
    """Perturbed walks at reference fidelity, at most; 0: the first tier is the last."""
    servo_walks: int = 16
    """Walks of the winner with other servos and masses."""
    winners: int = 1
    """Candidates that hold, after which only those that promise more are tried."""
    replicas: int = 8
    """Perturbed walks of a candidate in each tier."""
    feasible: int = 7
    """Perturbed walks of a tier that must be feasible."""
    noise: float = _varied(
        math.radians(0.05),
        tier=1,
        allowed=Range(lower=0.0, upper=0.1),
        key="noise_deg",
        unit=RAD,
        written=DEGREES,
    )
    """Standard deviation of the noise on every coefficient [rad]."""
    friction: float = _varied(0.1, tier=1, allowed=_HALF, key="friction")
    """Part by which friction is lower or higher."""
    joint_zero: float = _varied(
        math.radians(0.5),
        tier=3,
        allowed=Range(lower=0.0, upper=0.1),
        key="joint_zero_deg",
        unit=RAD,
        written=DEGREES,
    )
    """Largest error of a servo's zero, drawn evenly for each joint [rad]."""
    servo_stiffness: float = _varied(0.1, tier=3, allowed=_HALF, key="servo_stiffness")
    """Part by which the servos are softer or stiffer at most, drawn evenly."""
    supply_voltage: float = _varied(0.1, tier=3, allowed=_HALF, key="supply_voltage")
    """Part by which stall torque and no-load speed are lower or higher at most, drawn evenly."""
    mass: float = _varied(0.03, tier=3, allowed=_HALF, key="mass")
    """Part by which masses and inertias are lower or higher at most, drawn evenly."""
    command_delay: float = _varied(
        0.0,
        tier=3,
        allowed=Range(lower=0.0, upper=MOST_DELAY),
        key="command_delay_ms",
        unit=Unit(name="s"),
        written=MS,
    )
    """Largest delay of all commands, drawn evenly [s].

    0 by default: a gait knows no feedback, so an equal delay only shifts its walk in time.
    """
    integrator_step: float = _varied(
        0.0, tier=3, allowed=Range(lower=0.0, upper=0.9), key="integrator_step"
    )
    """Part by which a step is shorter at most, drawn evenly; its error too, where it is controlled.

    0 by default: tier 2 compares the search's step with that of the reference.
    """
    tiers: Mapping[str, int] = field(default_factory=dict, hash=False)
    """Tiers of changes that are not to be in their own, by the names of these fields."""
    own: tuple[Change, ...] = ()
    """Changes of a user's own."""
    means: bool = True
    """Whether means of neighbours, which the search never walked, are candidates too."""
    transfer: bool = True
    """Whether the winner is walked on the other sole and in the other engine."""
    transfer_distance: float = 0.1
    """Part of its distance by which it may then be shorter or longer."""

    def __post_init__(self) -> None:
        _whole("confirmation.walks", self.walks, 0)
        _whole("confirmation.reference_walks", self.reference_walks, 0)
        _whole("confirmation.servo_walks", self.servo_walks, 0)
        _whole("confirmation.winners", self.winners, 1)
        _whole("confirmation.replicas", self.replicas, 1)
        _whole("confirmation.feasible", self.feasible, 1)
        if self.feasible > self.replicas:
            raise SettingsError(
                f"confirmation.feasible ({self.feasible}) must not exceed confirmation.replicas "
                f"({self.replicas})"
            )
        for name, varied in CHANGES.items():
            check(f"confirmation.{name}", getattr(self, name), varied.allowed, varied.unit)
        for name in ("means", "transfer"):
            if not isinstance(getattr(self, name), bool):
                raise SettingsError(
                    f"confirmation.{name} must be true or false, got {getattr(self, name)!r}"
                )
        check("confirmation.transfer_distance", self.transfer_distance, _HALF)
        if not isinstance(self.tiers, Mapping):
            raise SettingsError(
                f"confirmation.tiers must be a table like {{mass = 2}}, got {self.tiers!r}"
            )
        for name, tier in self.tiers.items():
            if name not in CHANGES:
                raise SettingsError(
                    f"confirmation.tiers names '{name}'; there are {', '.join(CHANGES)}"
                )
            check_tier(f"confirmation.tiers.{name}", tier)
        object.__setattr__(self, "own", own_changes(self.own, tuple(CHANGES)))

    def changes(self, tier: int) -> tuple[str, ...]:
        """Return the names of the package's changes that walks of a tier have."""
        found = {name: self.tiers.get(name, varied.tier) for name, varied in CHANGES.items()}
        return tuple(name for name, own in found.items() if _is_made(own, tier))

    def own_changes(self, tier: int) -> tuple[Change, ...]:
        """Return the changes of a user's own that walks of a tier have."""
        return tuple(one for one in self.own if _is_made(one.tier, tier))

    def plain(self) -> dict[str, Any]:
        """Return what the constructor takes, as JSON has it: of own changes names and tiers.

        What nobody has set, `tiers` and `own`, is left out, so that older studies are the same.
        """
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        found["tiers"] = dict(self.tiers)
        found["own"] = [{"name": one.name, "tier": one.tier} for one in self.own]
        return {name: value for name, value in found.items() if value or name not in _UNSET}


CHANGES: Mapping[str, Varied] = {
    one.name: one.metadata[_VARIED]
    for one in fields(ConfirmationSettings)
    if _VARIED in one.metadata
}
"""The package's changes by the names of their settings, in the order of their random numbers."""

_UNSET = ("tiers", "own")


def _is_made(own: int, tier: int) -> bool:
    """Return whether a change of one tier is made in the walks of another."""
    return own == tier or (own, tier) == (1, 2)


_Enum = TypeVar("_Enum", bound=StrEnum)


def _one_of(name: str, kind: type[_Enum], value: Any) -> _Enum:
    try:
        return kind(value)
    except ValueError:
        raise SettingsError(f"{name} must be one of {', '.join(kind)}, got {value!r}") from None


def _whole(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise SettingsError(f"{name} must be a whole number >= {least}, got {value!r}")
