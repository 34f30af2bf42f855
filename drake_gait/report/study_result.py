"""The result of a study, and result.json, which holds it in strict JSON."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from drake_gait.errors import GaitError, StudyError
from drake_gait.files.destination import write
from drake_gait.files.strict_json import from_json, plain, to_json
from drake_gait.foot import FootDesign
from drake_gait.gait import Gait, gait_of, plain_gait
from drake_gait.problem import BUILT_IN, Candidate, Quantity
from drake_gait.study.records import StudyWalk
from drake_gait.walk import Measures, Outcome, Walk

RESULT = "result.json"
"""Name of the file in a study's folder."""

OF_THE_REPORT = (
    "r2_train",
    "r2_heldout",
    "r2_heldout_ridge",
    "r2_heldout_kriging",
    "survival_auc",
    "survival_auc_logistic",
    "measures",
    "jumps_deg",
    "quantities",
)
"""Keys that are null until `write_report` has learnt a network and walked the best walk again."""


@dataclass(frozen=True, kw_only=True)
class FinalistResult:
    """A candidate that was walked again: perturbed, and at reference fidelity."""

    walk: int
    """Id of its walk in the search."""
    forward_mm: float
    """Distance of that walk [mm]."""
    median_mm: float | None
    """Median distance of the perturbed walks [mm]."""
    worst_mm: float | None
    """Shortest distance of the perturbed walks [mm]."""
    survived: int
    """Perturbed walks that ended on their feet."""
    feasible: int
    """Perturbed walks that are feasible."""
    of: int
    """Perturbed walks."""
    robust: bool
    """Whether as many are feasible as the study asks for."""
    tier: int = 0
    """Highest tier of trust that it reached, see `finalists.Tier`."""
    trusted_mm: float | None = None
    """Its trusted distance [mm]: the median of its walks of tier T2; None below that tier."""
    converged: Mapping[str, Any] | None = None
    """Counts and distances of its walks of tier T2."""
    servo: Mapping[str, Any] | None = None
    """Counts and distances of its walks of tier T3."""
    other_sole: Mapping[str, Any] | None = None
    """Outcome and numbers of its walk on the other sole, for tier T4, and whether it passes."""
    other_engine: Mapping[str, Any] | None = None
    """The same in the other engine; None where that is not installed."""
    mean: bool = False
    """Whether it is a mean of neighbours, which the search never walked."""
    slipping: bool | None = None
    """Whether it advances by sliding; None where that was not measured."""
    reference: Mapping[str, Any] | None = None
    """Outcome and numbers of its walk at reference fidelity, by their keys in result.json."""
    yaw_swing: float | None = None
    """Range of the torso's heading in that walk [rad]."""
    measures: Mapping[str, Any] | None = None
    """Its `walk.Measures`, by the names of their fields."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """Result of a study; two with the same `plain()` have the same numbers.

    A number that is not known is None, and null in the file.
    """

    folder: Path
    """The study's folder; no part of the file."""
    study: str
    """Name of the study."""
    seed: int
    """The seed of all its random numbers."""
    mode: str
    """Its search.mode."""
    proposer: str | None = None
    """Name of the proposer that was handed over, if one was."""
    verdict: str
    """The outcome in one sentence."""
    best: StudyWalk | None
    """The winner; else the best feasible walk, or the one nearest to it. None without walks."""
    winner: StudyWalk | None
    """The walk of the robust candidate with the best median; None where no candidate is robust."""
    tier: int = 0
    """Highest tier of trust that the winner reached; 0 without one."""
    trusted_mm: float | None = None
    """Trusted distance of the winner [mm]; None below tier T2."""
    feasible: bool
    """Whether the best walk satisfies every constraint."""
    nominal_best: int | None
    """Id of the best walk of the search, confirmed or not."""
    best_unslipping: int | None = None
    """Id of the best feasible walk that is known not to slide."""
    finalists: Sequence[FinalistResult] = ()
    """Candidates that were walked again, the best first."""
    simulations: int
    """Walks of the search."""
    confirmations: int = 0
    """Walks that confirm others."""
    survivors: int
    """Walks of the search that ended on their feet."""
    feasible_count: int
    """Walks of the search that satisfy every constraint."""
    r2_train: Mapping[str, float | None]
    """R² of the network of all walks on what it learnt, by output."""
    r2_heldout: Mapping[str, float | None]
    """R² of the network on walks that it had not seen, by output."""
    r2_heldout_ridge: Mapping[str, float | None]
    """The same of a ridge regression."""
    r2_heldout_kriging: Mapping[str, float | None]
    """The same of kriging."""
    survival_auc: float | None = None
    """Area under the curve by which the network tells survivors."""
    survival_auc_logistic: float | None = None
    """The same of a logistic regression."""
    wall_s: float
    """Time on the clock of all runs [s]."""
    versions: Mapping[str, str]
    """Versions of what computed it."""
    measures: Measures | None = None
    """Measures of the best walk."""
    jumps_deg: Mapping[str, float] | None = None
    """Jumps of the best walk's command where walking begins and ends [deg], by their times."""
    quantities: Mapping[str, Any] | None = None
    """Every known quantity of the best walk by its name [SI]; a list where it has parts."""

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read the result of the study in a folder.

        Raises:
            StudyError: there is no result.json that can be read; names the file and the cure.
        """
        folder = Path(folder)
        return cls.from_plain(read_result(folder), folder)

    @classmethod
    def from_plain(cls, content: Mapping[str, Any], folder: Path) -> Self:
        """Return the result that `plain` was taken from, or the content of an older result.json.

        Raises:
            StudyError: a key is missing, or holds what no result has.
        """
        try:
            content = as_written_today(content)
            best = _best(content)
            known = {one.name: content[one.name] for one in fields(cls) if one.name in content}
            robust = content["winner"] is not None
            known |= {"folder": folder, "best": best, "winner": best if robust else None}
            known.setdefault("verdict", "")
            known["finalists"] = tuple(FinalistResult(**one) for one in known.get("finalists", ()))
            for name in ("r2_heldout_ridge", "r2_heldout_kriging"):
                known.setdefault(name, dict.fromkeys(content["r2_heldout"]))
            if content.get("measures") is not None:
                known["measures"] = measures_from(content["measures"])
            return cls(**known)
        except KeyError as error:
            reason = f"the key {error} is missing, or unknown"
        except (GaitError, TypeError, ValueError, AttributeError) as error:
            reason = " ".join(str(error).rpartition("__init__() ")[2].split())
        raise StudyError(
            f"{folder / RESULT} is no result of a study ({reason}); {_cure(folder)}"
        ) from None

    def plain(self) -> dict[str, Any]:
        """Return the content of result.json: None in the place of what is not a finite number.

        Beside its own fields it has the best walk in mm and degrees, as people read it.
        """
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        del own["folder"]
        own |= {
            "finalists": [asdict(one) for one in self.finalists],
            "measures": self.measures and asdict(self.measures),
            **best_in_words(self.best),
            "best": self.best and plain_walk(self.best),
            "winner": self.winner and self.winner.id,
        }
        found: dict[str, Any] = plain(own)
        return found

    def write(self) -> None:
        """Write result.json into the study's folder.

        Raises:
            GaitError: it cannot be written.
        """
        write(self.folder / RESULT, to_json(self.plain()) + "\n")


def best_in_words(best: StudyWalk | None) -> dict[str, Any]:
    """Return the keys of result.json that tell of the best walk in mm and degrees."""
    walk, gait = (best.walk, best.candidate.gait) if best else (None, None)
    return {
        "walk": best.id if best else None,
        "outcome": str(walk.outcome) if walk else None,
        **distances(walk),
        "frames": walk.frames if walk else None,
        "coefficients_deg": gait.degrees.tolist() if isinstance(gait, Gait) else None,
        "foot": asdict(best.candidate.foot) if best else None,
    }


def quantities_of(walk: Walk, own: Sequence[Quantity] = ()) -> dict[str, Any]:
    """Return every known quantity of a walk by its name [SI]; a list where it has parts.

    A number that is not finite is None. A walk that was not simulated to its end has none.

    Args:
        walk: The walk.
        own: Quantities of the study's own.
    """
    found: dict[str, Any] = {}
    for one in (*BUILT_IN.values(), *own):
        if walk.outcome is Outcome.DIVERGED and one.name not in walk.values:
            continue
        values = [value if np.isfinite(value) else None for value in one.values(walk) or ()]
        if values:
            found[one.name] = values if one.parts else values[0]
    return found


def distances(walk: Walk | None) -> dict[str, float | None]:
    """Return the paper's numbers of a walk but N; None of a walk that was not simulated."""
    names = ("forward_mm", "lateral_mm", "yaw_deg", "com_height_mm")
    if walk is None or walk.outcome is Outcome.DIVERGED:
        return dict.fromkeys(names)
    lengths = (1e3 * walk.forward, 1e3 * walk.lateral)
    numbers = (*lengths, float(np.degrees(walk.yaw)), 1e3 * walk.com_height)
    return dict(zip(names, numbers, strict=True))


def plain_walk(entry: StudyWalk) -> dict[str, Any]:
    """Return a walk of a study in SI units, to the last digit, as JSON has it."""
    walk = {one.name: getattr(entry.walk, one.name) for one in fields(Walk)}
    del walk["history"]
    walk["measures"] = entry.walk.measures and asdict(entry.walk.measures)
    candidate = entry.candidate
    own = {one.name: getattr(entry, one.name) for one in fields(entry)}
    found: dict[str, Any] = plain(
        {
            **own,
            "candidate": {**plain_gait(candidate.gait), "foot": asdict(candidate.foot)},
            "walk": {**walk, "outcome": str(walk["outcome"])},
        }
    )
    return found


def read_result(folder: Path) -> dict[str, Any]:
    """Return the content of a study's result.json.

    Raises:
        StudyError: there is none that can be read.
    """
    path = folder / RESULT
    try:
        found = from_json(path.read_bytes())
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise StudyError(f"cannot read {path}: {reason}; {_cure(folder)}") from None
    if not isinstance(found, dict):
        raise StudyError(f"{path} is no result of a study")
    return as_written_today(found)


def as_written_today(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a result.json with the keys of this version.

    Older versions called frames "steps", and had `yaw_swing` among the measures of a walk.
    """

    def renamed(value: Any) -> Any:
        if isinstance(value, Mapping):
            return as_written_today(value)
        return [renamed(one) for one in value] if isinstance(value, list) else value

    found = {"frames" if key == "steps" else key: renamed(one) for key, one in content.items()}
    measures = found.get("measures")
    if isinstance(measures, dict) and "yaw_swing" in measures:
        swing = measures.pop("yaw_swing")
        if found.get("yaw_swing") is None:
            found["yaw_swing"] = swing
    return found


def _cure(folder: Path) -> str:
    return f"`python -m drake_gait report {shlex.quote(str(folder))}` writes it anew"


def _best(content: Mapping[str, Any]) -> StudyWalk | None:
    """The best walk, of an older file from its numbers in mm and degrees."""
    if content["walk"] is None:
        return None
    if "best" in content:
        kept = dict(content["best"])
        candidate, walk = kept["candidate"], kept["walk"]
        kept["candidate"] = Candidate(
            gait=gait_of(candidate),
            foot=FootDesign(**candidate["foot"]),
        )
        numbers: dict[str, Any] = {
            name: np.nan if value is None and name in _NUMBERS else value
            for name, value in walk.items()
        }
        numbers["values"] = {
            name: tuple(np.nan if one is None else one for one in values)
            for name, values in walk.get("values", {}).items()
        }
        numbers["measures"] = walk["measures"] and measures_from(walk["measures"])
        numbers["outcome"] = Outcome(walk["outcome"])
        kept["walk"] = Walk(**numbers)
        return StudyWalk(**kept)
    forward, lateral, height = (
        (content.get(key) or 0.0) / 1e3 for key in ("forward_mm", "lateral_mm", "com_height_mm")
    )
    return StudyWalk(
        id=content["walk"],
        stage="",
        iteration=0,
        candidate=Candidate(
            gait=Gait.from_degrees(content["coefficients_deg"]),
            foot=FootDesign(**content["foot"]),
        ),
        walk=Walk(
            outcome=Outcome(content["outcome"]),
            frames=content["frames"],
            forward=forward,
            lateral=lateral,
            yaw=float(np.radians(content.get("yaw_deg") or 0.0)),
            com_height=height,
        ),
    )


_NUMBERS = ("forward", "lateral", "yaw", "com_height")


def measures_from(content: Mapping[str, Any]) -> Measures:
    """Return measures from JSON: what is null was not finite."""

    def number(value: Any) -> Any:
        if isinstance(value, list):
            return tuple(number(one) for one in value)
        return np.nan if value is None else value

    known = {one.name for one in fields(Measures)}
    return Measures(**{name: number(value) for name, value in content.items() if name in known})
