"""A study's outcome in numbers: what result.json holds, and tables like the paper's Table II."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from drake_gait.problem.problem import OUTPUTS, Constraints
from drake_gait.provenance import versions
from drake_gait.search.confirmation import STAGE, Finalist, best_unslipping, finalists, winner
from drake_gait.study.ranking import best_walk, feasible_walks
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.baselines import Comparison
from drake_gait.surrogates.ensemble import Surrogate
from drake_gait.walk import Measures, Walk

PAPER_TABLE = (
    # X_f [mm], Z_f [mm], R_f [deg], N: the paper's Table II, F1 to F8.
    (0.725, 154.56, 3.837, 240),
    (2.962, 160.22, -0.431, 240),
    (0.837, 161.78, -2.291, 240),
    (19.690, 165.50, 4.419, 240),
    (-6.273, 165.74, -4.201, 240),
    (5.380, 166.34, 1.139, 240),
    (-4.770, 168.30, 0.796, 240),
    (0.044, 177.96, 1.203, 240),
)


def summary(
    settings: StudySettings,
    walks: Sequence[StudyWalk],
    network: Surrogate | None,
    *,
    baselines: Comparison | None = None,
    wall_s: float,
) -> dict[str, Any]:
    """What result.json holds: the best walk, how the search went, and with what.

    Lengths in millimetres and angles in degrees where the key says so; the foot in SI units. Where
    no walk is feasible, the best is the one nearest to it.
    """
    searched = [walk for walk in walks if walk.stage != STAGE]
    nominal_best = best_walk(searched, settings.constraints, settings.search.objective)
    robust = winner(settings, walks)
    best = robust.walk if robust else nominal_best
    unslipping = best_unslipping(settings, walks)
    return {
        "study": settings.name,
        "seed": settings.seed,
        "mode": str(settings.search.mode),
        "walk": best.id,
        "winner": robust.walk.id if robust else None,
        "nominal_best": nominal_best.id,
        "best_unslipping": unslipping.id if unslipping else None,
        "finalists": [_finalist(settings, one) for one in finalists(settings, walks)],
        "feasible": settings.assess(best.walk).feasible,
        "outcome": str(best.walk.outcome),
        "forward_mm": 1e3 * best.walk.forward,
        "lateral_mm": 1e3 * best.walk.lateral,
        "yaw_deg": float(np.degrees(best.walk.yaw)),
        "com_height_mm": 1e3 * best.walk.com_height,
        "steps": best.walk.steps,
        "coefficients_deg": best.candidate.gait.degrees.tolist(),
        "foot": asdict(best.candidate.foot),
        "simulations": len(searched),
        "confirmations": len(walks) - len(searched),
        "survivors": sum(walk.walk.survived for walk in searched),
        "feasible_count": sum(settings.assess(walk.walk).feasible for walk in searched),
        "r2_train": _by_output(network.r2_train if network else None),
        "r2_heldout": _by_output(network.r2_heldout if network else None),
        "r2_heldout_ridge": _by_output(baselines.ridge if baselines else None),
        "r2_heldout_kriging": _by_output(baselines.kriging if baselines else None),
        "survival_auc": baselines.network_auc if baselines else None,
        "survival_auc_logistic": baselines.logistic_auc if baselines else None,
        "wall_s": wall_s,
        "versions": versions(),
    }


def _finalist(settings: StudySettings, finalist: Finalist) -> dict[str, Any]:
    """A candidate that was walked again, as result.json has it."""
    reference, measured = finalist.reference, finalist.measured
    return {
        "walk": finalist.walk.id,
        "forward_mm": 1e3 * finalist.walk.walk.forward,
        "median_mm": 1e3 * finalist.median,
        "worst_mm": 1e3 * finalist.worst,
        "survived": finalist.survived,
        "feasible": finalist.feasible,
        "of": len(finalist.variations),
        "robust": finalist.robust,
        "slipping": finalist.slipping,
        "reference": reference
        and {
            "outcome": str(reference.walk.outcome),
            "forward_mm": 1e3 * reference.walk.forward,
            "lateral_mm": 1e3 * reference.walk.lateral,
            "yaw_deg": float(np.degrees(reference.walk.yaw)),
            "steps": reference.walk.steps,
            "feasible": settings.assess(reference.walk).feasible,
        },
        "measures": measured and measured.walk.measures and asdict(measured.walk.measures),
    }


def robust_table(settings: StudySettings, walks: Sequence[StudyWalk]) -> str:
    """The candidates that were walked again in full, as text."""
    lines = [
        " walk   Z [mm]   median    worst   feasible   reference: Z [mm]   X [mm]  R [deg]",
    ]
    for one in finalists(settings, walks):
        if len(one.variations) < settings.confirmation.replicas:
            continue
        line = (
            f"{one.walk.id:5d} {1e3 * one.walk.walk.forward:8.1f} {1e3 * one.median:8.1f} "
            f"{1e3 * one.worst:8.1f}     {one.feasible} of {len(one.variations)}"
        )
        if one.reference is not None:
            walk = one.reference.walk
            line += (
                f"            {1e3 * walk.forward:8.1f} {1e3 * walk.lateral:8.1f} "
                f"{np.degrees(walk.yaw):8.2f}"
            )
            line += "" if walk.survived else f"   {walk.reason}"
        lines.append(line + ("   robust" if one.robust else ""))
    return "\n".join(lines)


def table(walks: Sequence[StudyWalk], limits: Constraints) -> str:
    """The study's furthest feasible walks beside the paper's eight, as text."""
    ours = feasible_walks(walks, limits)[: len(PAPER_TABLE)]
    lines = [
        "            this study                              the paper (Table II)",
        " walk   X [mm]   Z [mm]  R [deg]    N           X [mm]   Z [mm]  R [deg]    N",
    ]
    for place, paper in enumerate(reversed(PAPER_TABLE)):
        left = " " * 38
        if place < len(ours):
            entry = ours[place]
            left = f"{entry.id:5d} " + _row(
                1e3 * entry.walk.lateral,
                1e3 * entry.walk.forward,
                float(np.degrees(entry.walk.yaw)),
                entry.walk.steps,
            )
        lines.append(f"{left:<40}    F{len(PAPER_TABLE) - place} {_row(*paper)}")
    return "\n".join(lines)


def r_squared_line(network: Surrogate) -> str:
    """R² of every output, training and held-out, as text."""
    names = ("Z", "X", "R", "Y")
    pairs = zip(names, network.r2_train, network.r2_heldout, strict=False)
    return "R² training / held-out: " + "   ".join(
        f"{name} {train:.2f} / {heldout:.2f}" for name, train, heldout in pairs
    )


def baselines_line(result: Mapping[str, Any]) -> str:
    """Held-out R² of ridge and kriging, as a result has them, and how survival is told, as text."""
    pairs = ((f"r2_heldout_{name}", name) for name in ("ridge", "kriging"))
    parts = [
        f"{name} Z {_two_digits(result[key]['forward'])}   "
        f"X {_two_digits(result[key]['lateral'])}   R {_two_digits(result[key]['yaw'])}"
        for key, name in pairs
    ]
    return (
        f"held-out, beside it: {'; '.join(parts)}; survival (AUC) network "
        f"{_two_digits(result['survival_auc'])}, "
        f"logistic {_two_digits(result['survival_auc_logistic'])}"
    )


def _two_digits(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def in_words(walk: Walk) -> str:
    """The paper's four numbers of a walk, as text."""
    return (
        f"{1e3 * walk.forward:.1f} mm forward, {1e3 * walk.lateral:.1f} mm lateral, "
        f"{np.degrees(walk.yaw):.2f} degrees, {walk.steps} frames"
    )


def manner_in_words(measures: Measures) -> str:
    """How a walk was walked, as text: a long one may be a shuffle."""
    slip, clearance = (1e3 * np.array(pair) for pair in (measures.slip, measures.clearance))
    return (
        f"slip {slip[0]:.0f} / {slip[1]:.0f} mm (right / left foot), "
        f"toe clearance {clearance[0]:.1f} / {clearance[1]:.1f} mm, "
        f"duty {measures.duty_factor[0]:.2f} / {measures.duty_factor[1]:.2f}, "
        f"yaw swing {np.degrees(measures.yaw_swing):.0f} degrees, "
        f"torso tilt {np.degrees(measures.torso_tilt):.0f} degrees, "
        f"peak torque {measures.peak_torque:.2f} N·m, "
        f"cost of transport {measures.cost_of_transport:.2f}"
    )


def _row(lateral_mm: float, forward_mm: float, yaw_deg: float, steps: int) -> str:
    return f"{lateral_mm:8.3f} {forward_mm:8.2f} {yaw_deg:8.3f} {steps:4d}"


def _by_output(values: Any) -> Mapping[str, float | None]:
    if values is None:
        return dict.fromkeys(OUTPUTS)
    # Of an output that does not vary nothing is explained, and JSON has no word for that number.
    return {
        name: float(value) if np.isfinite(value) else None
        for name, value in zip(OUTPUTS, values, strict=False)
    }
