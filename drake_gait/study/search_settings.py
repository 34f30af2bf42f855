"""How a study searches: by which procedure, with how many walks, and how it confirms its winner."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

from drake_gait.errors import SettingsError
from drake_gait.problem import Objective
from drake_gait.ranges import Range, Unit, check


class Mode(StrEnum):
    """What proposes the walks of a study."""

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
    """What a search on two grounds weighs against distance."""

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
    """How much is simulated, and in what portions."""

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
        """Whether networks propose, from a design of experiments on."""
        return self.mode in (Mode.DEFAULT, Mode.ISADE_NETWORK, Mode.PAPER)


@dataclass(frozen=True, kw_only=True)
class ConfirmationSettings:
    """How the best candidates of a search are walked again, tier by tier (study.finalists.Tier).

    `replicas` walks of a candidate are made with noise on every coefficient and friction that is
    lower and higher in turn, and as many with fresh noise at reference fidelity. In each tier
    `feasible` of them must be feasible. The winner alone is walked with other servos and masses.
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
    noise: float = math.radians(0.05)
    """Standard deviation of the noise on every coefficient [rad]."""
    friction: float = 0.1
    """Part by which friction is lower or higher."""

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
        check("confirmation.noise", self.noise, Range(lower=0.0, upper=0.1), Unit(name="rad"))
        check("confirmation.friction", self.friction, Range(lower=0.0, upper=0.5))


_Enum = TypeVar("_Enum", bound=StrEnum)


def _one_of(name: str, kind: type[_Enum], value: Any) -> _Enum:
    try:
        return kind(value)
    except ValueError:
        raise SettingsError(f"{name} must be one of {', '.join(kind)}, got {value!r}") from None


def _whole(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise SettingsError(f"{name} must be a whole number >= {least}, got {value!r}")
