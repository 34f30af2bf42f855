"""Walking gaits for a small biped with toes, found and designed in Drake.

    from drake_gait import Candidate, FootDesign, Gait, simulate
    walk = simulate(Candidate(gait=Gait.from_degrees(coefficients_4x4), foot=FootDesign()))

Names are imported when they are first used, so that the pure parts load without Drake and torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drake_gait.foot import FootDesign
    from drake_gait.gait import Gait, Start
    from drake_gait.problem.problem import Candidate, Constraints, DesignSpace, assess
    from drake_gait.servo import Servo
    from drake_gait.simulation.simulate import simulate
    from drake_gait.sole import Sole
    from drake_gait.study.reading import read_study
    from drake_gait.study.store import Study
    from drake_gait.walk import Fidelity, Outcome, Walk, WalkSettings

__version__ = "0.2.0"

_HOMES = {
    "foot": ("FootDesign",),
    "gait": ("Gait", "Start"),
    "problem.problem": ("Candidate", "Constraints", "DesignSpace", "assess"),
    "servo": ("Servo",),
    "sole": ("Sole",),
    "study.reading": ("read_study",),
    "simulation.simulate": ("simulate",),
    "study.store": ("Study",),
    "walk": ("Fidelity", "Outcome", "Walk", "WalkSettings"),
}

__all__ = [
    "Candidate",
    "Constraints",
    "DesignSpace",
    "Fidelity",
    "FootDesign",
    "Gait",
    "Outcome",
    "Servo",
    "Sole",
    "Start",
    "Study",
    "Walk",
    "WalkSettings",
    "assess",
    "read_study",
    "simulate",
]


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"drake_gait.{module}"), name)
    raise AttributeError(f"module 'drake_gait' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
