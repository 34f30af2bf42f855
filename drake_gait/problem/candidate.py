"""The candidate, a gait on a foot, and the trial, a candidate with how it is simulated."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drake_gait.foot import FootDesign
from drake_gait.gait import AnyGait
from drake_gait.walk import WalkSettings

if TYPE_CHECKING:
    from drake_gait.problem.quantities import Quantity


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A gait on a pair of feet, which one simulation walks."""

    gait: AnyGait
    """What the joints do."""
    foot: FootDesign = field(default_factory=FootDesign)
    """The toes."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One simulation to run: all that its numbers depend on."""

    candidate: Candidate
    """What walks."""
    settings: WalkSettings = field(default_factory=WalkSettings)
    """How it is simulated."""
    quantities: "tuple[Quantity, ...]" = ()
    """Quantities of a user's own, to be read where it is simulated."""
