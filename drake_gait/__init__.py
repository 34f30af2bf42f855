"""Walking gaits for a small biped with toes, found and designed in Drake.

    from drake_gait import default_study, read_study, run_study
    result = run_study(read_study(default_study()), "runs/mine")
    result.verdict, result.best.candidate

Names load when they are first used: the pure parts need neither Drake nor torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drake_gait.execution.base import Executor, Finished, Serial
    from drake_gait.execution.dask import DaskCluster
    from drake_gait.execution.local import LocalProcesses
    from drake_gait.foot import FootDesign
    from drake_gait.gait import Gait, GaitFamily, Harmonics, KeyFrames, Start, Variable
    from drake_gait.optimization import run_study
    from drake_gait.problem import (
        Assessment,
        Candidate,
        Constraints,
        DesignSpace,
        Limit,
        Objective,
        Quantity,
        Trial,
        assess,
    )
    from drake_gait.report.build import write_report
    from drake_gait.report.study_result import StudyResult
    from drake_gait.search.direct import DirectCmaes, DirectIsade
    from drake_gait.search.paper import PaperProcedure
    from drake_gait.search.proposer import IsadeSettings, Proposal, Proposer
    from drake_gait.search.runner import Progress
    from drake_gait.search.trust_region import TrustRegion
    from drake_gait.servo import Servo
    from drake_gait.simulation.simulate import simulate, walk_trial
    from drake_gait.sole import Sole
    from drake_gait.study.reading import default_study, read_study
    from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
    from drake_gait.study.settings import StudySettings
    from drake_gait.study.store import Study
    from drake_gait.surrogates.settings import NetworkSettings
    from drake_gait.visualization.recording import record
    from drake_gait.walk import Fidelity, Outcome, Walk, WalkSettings

__version__ = "0.4.0"

_HOMES = {
    # Gaits, feet and what a walk is.
    "foot": ("FootDesign",),
    "gait": ("Gait", "GaitFamily", "Harmonics", "KeyFrames", "Start", "Variable"),
    "servo": ("Servo",),
    "sole": ("Sole",),
    "walk": ("Fidelity", "Outcome", "Walk", "WalkSettings"),
    # The problem.
    "problem": (
        "Assessment",
        "Candidate",
        "Constraints",
        "DesignSpace",
        "Limit",
        "Objective",
        "Quantity",
        "Trial",
        "assess",
    ),
    # Simulation.
    "simulation.simulate": ("simulate", "walk_trial"),
    # Studies.
    "study.reading": ("default_study", "read_study"),
    "study.search_settings": ("ConfirmationSettings", "SearchSettings"),
    "study.settings": ("StudySettings",),
    "study.store": ("Study",),
    "optimization": ("run_study",),
    "report.build": ("write_report",),
    "report.study_result": ("StudyResult",),
    # Searching.
    "search.proposer": ("IsadeSettings", "Proposal", "Proposer"),
    "search.runner": ("Progress",),
    "search.trust_region": ("TrustRegion",),
    "search.paper": ("PaperProcedure",),
    "search.direct": ("DirectCmaes", "DirectIsade"),
    "surrogates.settings": ("NetworkSettings",),
    # Executors.
    "execution.base": ("Executor", "Finished", "Serial"),
    "execution.dask": ("DaskCluster",),
    "execution.local": ("LocalProcesses",),
    # Recordings.
    "visualization.recording": ("record",),
}

__all__ = [
    "Assessment",
    "Candidate",
    "ConfirmationSettings",
    "Constraints",
    "DaskCluster",
    "DesignSpace",
    "DirectCmaes",
    "DirectIsade",
    "Executor",
    "Fidelity",
    "Finished",
    "FootDesign",
    "Gait",
    "GaitFamily",
    "Harmonics",
    "IsadeSettings",
    "KeyFrames",
    "Limit",
    "LocalProcesses",
    "NetworkSettings",
    "Objective",
    "Outcome",
    "PaperProcedure",
    "Progress",
    "Proposal",
    "Proposer",
    "Quantity",
    "SearchSettings",
    "Serial",
    "Servo",
    "Sole",
    "Start",
    "Study",
    "StudyResult",
    "StudySettings",
    "Trial",
    "TrustRegion",
    "Variable",
    "Walk",
    "WalkSettings",
    "assess",
    "default_study",
    "read_study",
    "record",
    "run_study",
    "simulate",
    "walk_trial",
    "write_report",
]


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"drake_gait.{module}"), name)
    raise AttributeError(f"module 'drake_gait' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
