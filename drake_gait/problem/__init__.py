"""The problem: what is searched, and what makes one walk better than another."""

from drake_gait.problem.candidate import Candidate, Trial
from drake_gait.problem.constraints import (
    PENALTY,
    Assessment,
    Constraints,
    Limit,
    assess,
    quantities,
)
from drake_gait.problem.design_space import COEFFICIENTS, ROUNDING, DesignSpace
from drake_gait.problem.quantities import OF_EVERY_WALK, OUTPUTS, Objective, quantity

__all__ = [
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
    "Objective",
    "Trial",
    "assess",
    "quantities",
    "quantity",
]
