"""A study's outcome in numbers and words, and the numbers of the paper's Table II."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from drake_gait.gait import FloatArray
from drake_gait.provenance import versions
from drake_gait.report.study_result import best_in_words, distances, plain_walk, quantities_of
from drake_gait.study.finalists import Finalist, Tier, best_unslipping, finalists, winner
from drake_gait.study.ranking import best_walk, search_walks
from drake_gait.study.records import StudyWalk
from drake_gait.study.settings import StudySettings
from drake_gait.walk import Outcome, Walk

if TYPE_CHECKING:  # It loads torch and scikit-learn, which no word needs.
    from drake_gait.surrogates.baselines import Comparison


class Scored(Protocol):
    """Something of which is known how much it explains, such as a network."""

    @property
    def r2_train(self) -> FloatArray:
        """Share of variance explained on the walks learnt from, shape (k,)."""
        ...

    @property
    def r2_heldout(self) -> FloatArray:
        """Share of variance explained on walks not seen, shape (k,)."""
        ...


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
    network: Scored | None,
    *,
    baselines: "Comparison | None" = None,
    wall_s: float,
    proposer: str | None = None,
) -> dict[str, Any]:
    """Return the content of result.json, see `StudyResult`.

    Lengths in millimetres and angles in degrees where the key says so; the foot in SI units. Where
    no walk is feasible, the best is the one nearest to it. A number that is not known is None. A
    study without walks has none, and a walk that could not be simulated to its end no distance.
    """
    searched = search_walks(walks)
    nominal_best = (
        best_walk(searched, settings.constraints, settings.search.objective) if searched else None
    )
    robust = winner(settings, walks)
    best = robust.walk if robust else nominal_best
    unslipping = best_unslipping(settings, walks)
    outputs = [one.name for one in settings.outputs]
    return {
        "study": settings.name,
        "seed": settings.seed,
        "mode": str(settings.search.mode),
        "proposer": proposer,
        "verdict": verdict(settings, walks),
        "best": plain_walk(best) if best else None,
        "quantities": quantities_of(best.walk, settings.quantities) if best else None,
        "winner": robust.walk.id if robust else None,
        "tier": int(robust.tier) if robust else int(Tier.FOUND),
        "trusted_mm": _mm(robust.trusted) if robust else None,
        "nominal_best": nominal_best.id if nominal_best else None,
        "best_unslipping": unslipping.id if unslipping else None,
        "finalists": [_finalist(settings, one) for one in finalists(settings, walks)],
        "feasible": best is not None and settings.assess(best.walk).feasible,
        **best_in_words(best),
        "simulations": len(searched),
        "confirmations": len(walks) - len(searched),
        "survivors": sum(walk.walk.survived for walk in searched),
        "feasible_count": sum(settings.assess(walk.walk).feasible for walk in searched),
        **scores(network, baselines, outputs),
        "wall_s": wall_s,
        "versions": versions(),
    }


def scores(
    network: Scored | None, baselines: "Comparison | None", outputs: Sequence[str]
) -> dict[str, Any]:
    """Return what result.json says of a network and its baselines; None for what is not known."""
    return {
        "r2_train": _by_output(network.r2_train if network else None, outputs),
        "r2_heldout": _by_output(network.r2_heldout if network else None, outputs),
        "r2_heldout_ridge": _by_output(baselines.ridge if baselines else None, outputs),
        "r2_heldout_kriging": _by_output(baselines.kriging if baselines else None, outputs),
        "survival_auc": baselines.network_auc if baselines else None,
        "survival_auc_logistic": baselines.logistic_auc if baselines else None,
    }


def verdict(settings: StudySettings, walks: Sequence[StudyWalk]) -> str:
    """Return the outcome of a study in one sentence, whatever became of its walks."""
    searched = search_walks(walks)
    if not searched:
        return "No walk has been simulated yet."
    count = f"{len(searched)} walk{'s' if len(searched) > 1 else ''}"
    if all(walk.walk.outcome is Outcome.DIVERGED for walk in searched):
        causes = Counter(str(walk.walk.failure) for walk in searched).most_common()
        told = ", ".join(f"{cause} {number}" for cause, number in causes)
        return f"None of {count} could be simulated to its end ({told})."
    best = best_walk(searched, settings.constraints, settings.search.objective)
    words = f"walk {best.id}: {in_words(best.walk)}"
    if not settings.assess(best.walk).feasible:
        fallen = not any(walk.walk.survived for walk in searched)
        why = "ends on its feet" if fallen else "holds all constraints"
        return f"None of {count} {why}; the nearest is {words}."
    robust = winner(settings, walks)
    if robust is None:
        return f"{untrusted(settings, robust)} The best of {count}, walked once, is {words}."
    if robust.trusted is None:
        return (
            f"{untrusted(settings, robust)} The best that repeats, of {count}, is walk "
            f"{robust.walk.id}: {1e3 * robust.median:.1f} mm in the median of "
            f"{len(robust.variations)} walks with noise."
        )
    mean = ", a mean of neighbours" if robust.walk.is_mean else ""
    return (
        f"The winner of {count} is walk {robust.walk.id}{mean}, which can be trusted: "
        f"{1e3 * robust.trusted:.1f} mm in the median of {len(robust.converged)} walks with noise "
        f"at reference fidelity, {robust.converged_feasible} of them feasible."
    )


def untrusted(settings: StudySettings, best: Finalist | None) -> str:
    """Return why no gait of a study can be trusted, and what to do, as text."""
    plan = settings.confirmation
    if not plan.walks:
        return (
            "No gait is known to hold: none was walked again; begin another study with "
            "confirmation.walks > 0."
        )
    if not plan.reference_walks:
        what = "none was tried" if best else "none repeats"
        return (
            f"No gait is known to hold at reference fidelity: {what}; begin another study with "
            "confirmation.reference_walks > 0."
        )
    if best is None:
        return (
            "No gait holds: none repeats with noise at the search's fidelity; raise "
            "search.simulations, or take another seed or box."
        )
    return (
        "No gait holds at reference fidelity; raise search.simulations, or take another seed or "
        "a finer walk.fidelity."
    )


def _mm(length: float | None) -> float | None:
    return None if length is None else 1e3 * length


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
        "tier": int(finalist.tier),
        "trusted_mm": _mm(finalist.trusted),
        "converged": _counts(finalist.converged, finalist.converged_feasible),
        "servo": _counts(finalist.servo, finalist.servo_feasible),
        "other_sole": _elsewhere(settings, finalist, finalist.other_sole),
        "other_engine": _elsewhere(settings, finalist, finalist.other_engine),
        "mean": finalist.walk.is_mean,
        "slipping": finalist.slipping,
        "reference": reference
        and {
            "outcome": str(reference.walk.outcome),
            **distances(reference.walk),
            "frames": reference.walk.frames,
            "feasible": settings.assess(reference.walk).feasible,
        },
        "yaw_swing": measured and measured.walk.yaw_swing,
        "measures": measured and measured.walk.measures and asdict(measured.walk.measures),
    }


def _elsewhere(
    settings: StudySettings, finalist: Finalist, other: StudyWalk | None
) -> dict[str, Any] | None:
    """Return how a walk on another sole or in another engine went; None where there is none."""
    passed = finalist.transfers(other, settings.confirmation.transfer_distance)
    if other is None or passed is None:
        return None
    return {
        "outcome": str(other.walk.outcome),
        **distances(other.walk),
        "of_distance": finalist.part_of_distance(other),
        "passed": passed,
    }


def _counts(walks: Sequence[StudyWalk], feasible: int) -> dict[str, Any] | None:
    """Return how the walks of a tier ended; None without any."""
    if not walks:
        return None
    distances = [1e3 * walk.walk.forward for walk in walks]
    return {
        "of": len(walks),
        "survived": sum(walk.walk.survived for walk in walks),
        "feasible": feasible,
        "median_mm": float(np.median(distances)),
        "worst_mm": min(distances),
    }


def r_squared_line(network: Scored) -> str:
    """R² of every output, training and held-out, as text."""
    names = ("Z", "X", "R", "Y")
    pairs = zip(names, network.r2_train, network.r2_heldout, strict=False)
    return "R² training / held-out: " + "   ".join(
        f"{name} {train:.2f} / {heldout:.2f}" for name, train, heldout in pairs
    )


def baselines_line(result: Mapping[str, Any]) -> str:
    """Return held-out R² of ridge and kriging of a result, and the AUC of survival, as text."""
    pairs = ((f"r2_heldout_{name}", name) for name in ("ridge", "kriging"))
    parts = [
        f"{name} Z {_rounded(result[key]['forward'], 2)}   "
        f"X {_rounded(result[key]['lateral'], 2)}   R {_rounded(result[key]['yaw'], 2)}"
        for key, name in pairs
    ]
    return (
        f"held-out, beside it: {'; '.join(parts)}; survival (AUC) network "
        f"{_rounded(result['survival_auc'], 2)}, "
        f"logistic {_rounded(result['survival_auc_logistic'], 2)}"
    )


def _rounded(value: float | None, digits: int) -> str:
    """Return a number as text; a dash for one that is not known."""
    return f"{value:.{digits}f}" if value is not None and np.isfinite(value) else "-"


def in_words(walk: Walk) -> str:
    """Return the paper's four numbers of a walk, as text, or why there are none."""
    if walk.outcome is Outcome.DIVERGED:
        return f"not simulated to its end ({walk.reason}), {walk.frames} frames"
    return (
        f"{1e3 * walk.forward:.1f} mm forward, {1e3 * walk.lateral:.1f} mm lateral, "
        f"{np.degrees(walk.yaw):.2f} degrees, {walk.frames} frames"
    )


def manner_in_words(walk: Walk) -> str:
    """Return how a walk was walked, as text: a long one may be a shuffle. Empty if not measured.

    A dash stands for what such a walk does not have, as the duty of one that fell too soon.
    """
    measures = walk.measures
    if measures is None:
        return ""

    def feet(values: Iterable[float], digits: int) -> str:
        return " / ".join(_rounded(value, digits) for value in values)

    slip, clearance = (1e3 * np.array(pair) for pair in (measures.slip, measures.clearance))
    swing = None if walk.yaw_swing is None else float(np.degrees(walk.yaw_swing))
    tilt = float(np.degrees(measures.torso_tilt))
    return (
        f"slip {feet(slip, 0)} mm (right / left foot), toe clearance {feet(clearance, 1)} mm, "
        f"duty {feet(measures.duty_factor, 2)}, yaw swing {_rounded(swing, 0)} degrees, "
        f"torso tilt {_rounded(tilt, 0)} degrees, "
        f"peak torque {_rounded(measures.peak_torque, 2)} N·m, "
        f"cost of transport {_rounded(measures.cost_of_transport, 2)}"
    )


def _by_output(values: Any, names: Sequence[str]) -> Mapping[str, float | None]:
    if values is None:
        return dict.fromkeys(names)
    # Of an output that does not vary nothing is explained, and JSON has no word for that number.
    return {
        name: float(value) if np.isfinite(value) else None
        for name, value in zip(names, values, strict=True)
    }
