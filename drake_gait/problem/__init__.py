"""The problem: what is searched, and what makes one walk better than another."""

from drake_gait.gait import COEFFICIENTS, ROUNDING
from drake_gait.problem.candidate import Candidate, Trial
from drake_gait.problem.constraints import (
    PENALTY,
    Assessment,
    Constraints,
    Limit,
    assess,
    quantities,
)
from drake_gait.problem.design_space import DesignSpace
from drake_gait.problem.quantities import (
    BUILT_IN,
    OF_EVERY_WALK,
    OUTPUTS,
    Needs,
    Objective,
    Quantity,
    Side,
    evaluated,
    named,
    quantity,
)

__all__ = [
    "BUILT_IN",
    "COEFFICIENTS",
    "OF_EVERY_WALK",
    "OUTPUTS",
    "PENALTY",
    "ROUNDING",
    "Assessment",
    "Candidate",
    "Constraints",
    "DesignSpace",
    "Limit",
    "Needs",
    "Objective",
    "Quantity",
    "Side",
    "Trial",
    "assess",
    "evaluated",
    "named",
    "quantities",
    "quantity",
]
