"""The tables of a study's report: what result.json and the walks say, in words and numbers."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from drake_gait.foot import DESIGN_UNITS, N_MM_PER_DEG
from drake_gait.gait import FRAME_TIME, TERMS, WAVEFORMS, GaitFamily
from drake_gait.problem import BUILT_IN, OUTPUTS, Constraints, Limit, Quantity
from drake_gait.problem.quantities import FEET
from drake_gait.report.result import PAPER_TABLE
from drake_gait.study import finalists as study_finalists
from drake_gait.study.ranking import feasible_walks
from drake_gait.study.records import CONFIRMATION, StudyWalk
from drake_gait.study.search_settings import Mode
from drake_gait.study.settings import StudySettings
from drake_gait.walk import Outcome

OUTPUT_NAMES = {
    "forward": "Z, forward",
    "lateral": "X, lateral",
    "yaw": "R, turn",
    "com_height": "Y, height of the centre of mass",
}
"""What the network predicts, for people."""

_COMPARED = ("slip", "yaw_swing", "torso_tilt", "cost_of_transport")
"""Quantities of the winners that are compared."""

_DEGREES = float(np.degrees(1.0))

_FOOT_UNITS = {
    "N·m/rad": (1.0 / N_MM_PER_DEG, "N·mm/deg"),
    "m": (1e3, "mm"),
    "N·m·s/rad": (1.0, "N·m·s/rad"),
}

_DESIGN_OF_EXPERIMENTS = "design of experiments"
STAGE_NAMES = {
    Mode.DEFAULT: (_DESIGN_OF_EXPERIMENTS, "proposed by the network"),
    Mode.PAPER: (_DESIGN_OF_EXPERIMENTS, "found by ISADE on the network"),
    Mode.ISADE_NETWORK: ("design of experiments", "proposed by ISADE, screened by the network"),
    Mode.ISADE: ("first generation of ISADE", "proposed by ISADE"),
    Mode.CMAES: ("first generation of CMA-ES", "proposed by CMA-ES"),
}
"""Stages "design" and "infill" for people: the mode says who proposed a walk."""

_OF_FINALISTS = (
    "walk",
    "Z alone [mm]",
    "median Z [mm]",
    "worst Z [mm]",
    "on its feet",
    "feasible",
    "tier",
    "T2: median Z [mm]",
    "T2: feasible",
    "T3: on its feet",
    "T3: feasible",
    "T4: other sole",
    "T4: other engine",
    "finer, alone: it",
    "Z [mm]",
    "X [mm]",
    "R [deg]",
    "feasible there",
)
"""Columns of the finalists' table."""
_NOT_FINER = 6
"""So many of them, from the first, are of walks that are not finer."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table as text; the first cell of a row is its header."""

    caption: str
    """What it shows."""
    columns: Sequence[str]
    """Headers, the first one above the headers of the rows."""
    rows: Sequence[Sequence[str]]
    """Cells, as many in each row as columns."""
    numbers: bool = True
    """Whether the cells are numbers, to be set below each other."""
    marked: int | None = None
    """Row that stands out."""


def number(value: float | None, digits: int) -> str:
    """A number as text, with a proper minus, and never minus zero; a dash for none."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def scaled(value: float | None, factor: float, digits: int) -> str:
    """Return a number in another unit as text, see `number`."""
    return number(None if value is None else factor * value, digits)


def words(name: str) -> str:
    """A key as words."""
    return name.replace("_", " ")


def beside_the_paper(walks: Sequence[StudyWalk], limits: Constraints) -> Table:
    """The furthest feasible walks beside the paper's Table II."""
    ours = feasible_walks(walks, limits)[: len(PAPER_TABLE)]
    rows = []
    for place, paper in enumerate(reversed(PAPER_TABLE)):
        left = ["–"] * 5
        if place < len(ours):
            walk = ours[place].walk
            left = [
                str(ours[place].id),
                *_paper_s_numbers(
                    1e3 * walk.lateral, 1e3 * walk.forward, float(np.degrees(walk.yaw)), walk.frames
                ),
            ]
        rows.append(
            [str(place + 1), *left, f"F{len(PAPER_TABLE) - place}", *_paper_s_numbers(*paper)]
        )
    four = ["X [mm]", "Z [mm]", "R [deg]", "N"]
    return Table(
        caption="The furthest feasible walks of this study beside those of the paper, Table II",
        columns=["place", "walk", *four, "paper", *four],
        rows=rows,
    )


def _paper_s_numbers(lateral: float, forward: float, yaw: float, frames: int) -> list[str]:
    return [number(lateral, 2), number(forward, 2), number(yaw, 2), str(frames)]


def tiers(settings: StudySettings, walks: Sequence[StudyWalk]) -> Table | None:
    """Return the candidates that were walked again in full, tier by tier; None without any."""
    rows = [
        [
            str(one.walk.id),
            number(1e3 * one.walk.walk.forward, 1),
            *_in_tier(one.variations, one.feasible, number(1e3 * one.median, 1)),
            *_in_tier(one.converged, one.converged_feasible, _median(one.converged)),
            *_in_tier(one.servo, one.servo_feasible, _upright(one.servo)),
            _part_elsewhere(one, one.other_sole),
            _part_elsewhere(one, one.other_engine),
            f"T{one.tier}",
        ]
        for one in study_finalists.finalists(settings, walks)
        if len(one.variations) >= settings.confirmation.replicas
    ]
    if not rows:
        return None
    return Table(
        caption="Walked again, with noise and other friction",
        columns=[
            "walk",
            "Z [mm]",
            "T1 median",
            "feasible",
            "T2 median",
            "feasible",
            "T3 upright",
            "feasible",
            "T4 sole",
            "engine",
            "tier",
        ],
        rows=rows,
    )


def _part_elsewhere(finalist: study_finalists.Finalist, other: StudyWalk | None) -> str:
    """Return how much of its distance a finalist walked on another sole or in another engine."""
    part = finalist.part_of_distance(other)
    if other is None or part is None:
        return "–"
    return f"{100.0 * part:.0f} %" if other.walk.survived else str(other.walk.outcome)


def _in_tier(walks: Sequence[StudyWalk], feasible: int, told: str) -> tuple[str, str]:
    return told, f"{feasible} of {len(walks)}" if walks else "–"


def _median(walks: Sequence[StudyWalk]) -> str:
    return number(1e3 * float(np.median([one.walk.forward for one in walks])), 1) if walks else "–"


def _upright(walks: Sequence[StudyWalk]) -> str:
    return f"{sum(one.walk.survived for one in walks)} of {len(walks)}" if walks else "–"


def finalists(result: Mapping[str, Any], *, dropped: bool = False) -> Table | None:
    """Return how the finalists walked again, tier by tier; None without any.

    Those that were walked in full, or those that were not.
    """
    winner = result.get("winner")
    found = [
        entry
        for entry in result.get("finalists") or []
        if (entry["reference"] is None and not entry.get("converged") and entry["walk"] != winner)
        == dropped
    ]
    if not found:
        return None
    rows = [_row_of_finalist(entry) for entry in found]
    if dropped:  # None of these was walked any finer.
        return Table(
            caption="Dropped when too few were feasible, or all walks were used: with noise on "
            "every coefficient and other friction",
            columns=_OF_FINALISTS[:_NOT_FINER],
            rows=[row[:_NOT_FINER] for row in rows],
        )
    return Table(
        caption="The finalists, walked again: with noise on every coefficient and other friction "
        "(T1), with fresh noise and finer (T2), with other servos and masses (T3), "
        "on the other sole and in the other engine (T4: part of the distance at the reference)",
        columns=_OF_FINALISTS,
        rows=rows,
        marked=_place_of_winner(found, result),
    )


def _row_of_finalist(entry: Mapping[str, Any]) -> list[str]:
    """Return a finalist's cells, as many as `_OF_FINALISTS`."""
    finer, of = entry.get("reference") or {}, entry["of"]
    converged, servo = entry.get("converged"), entry.get("servo")
    return [
        str(entry["walk"]),
        number(entry["forward_mm"], 1),
        number(entry["median_mm"], 1),
        number(entry["worst_mm"], 1),
        f"{entry['survived']} of {of}",
        f"{entry['feasible']} of {of}",
        _tier(entry),
        number(converged and converged["median_mm"], 1),
        _share(converged, "feasible"),
        _share(servo, "survived"),
        _share(servo, "feasible"),
        _elsewhere(entry, "other_sole"),
        _elsewhere(entry, "other_engine"),
        str(finer.get("outcome", "–")),
        number(finer.get("forward_mm"), 1),
        number(finer.get("lateral_mm"), 1),
        number(finer.get("yaw_deg"), 1),
        _yes_or_no(finer.get("feasible")),
    ]


def _yes_or_no(value: bool | None) -> str:
    """Return a truth value as a word; a dash where it is not known."""
    return "–" if value is None else "yes" if value else "no"


def _tier(entry: Mapping[str, Any]) -> str:
    """Return the tier of a finalist; older results say only whether it repeats."""
    if "tier" in entry:
        return f"T{entry['tier']}"
    return f"T{int(entry['robust'])}" if "robust" in entry else "–"


def _elsewhere(entry: Mapping[str, Any], name: str) -> str:
    """Return how far a finalist walked on another sole or in another engine, and if it passed."""
    other = entry.get(name)
    if other is None:
        tested = name == "other_engine" and entry.get("other_sole") is not None
        return "not installed" if tested else "–"
    if other["outcome"] != "walked":
        return str(other["outcome"])
    told = f"{number(other['of_distance'] and 100.0 * other['of_distance'], 0)} %"
    return told if other["passed"] else f"{told}, fails"


def _share(counts: Mapping[str, Any] | None, key: str) -> str:
    return f"{counts[key]} of {counts['of']}" if counts else "–"


def manner_of_finalists(result: Mapping[str, Any]) -> Table | None:
    """Return how the finalists walk, alone; None where that was not measured."""
    found = [entry for entry in result.get("finalists") or [] if entry.get("measures")]
    if not found:
        return None
    rows = []
    for entry in found:
        measures = entry["measures"]
        rows.append(
            [
                str(entry["walk"]),
                number(entry["forward_mm"], 1),
                *(scaled(value, 1e3, 0) for value in measures["slip"]),
                scaled(entry.get("yaw_swing"), _DEGREES, 0),
                scaled(measures["torso_tilt"], _DEGREES, 0),
                number(measures["cost_of_transport"], 2),
            ]
        )
    return Table(
        caption="How the finalists walk: far may be slid, and swung",
        columns=[
            "walk",
            "Z alone [mm]",
            "right sole slips [mm]",
            "left [mm]",
            "heading swings [deg]",
            "torso leans [deg]",
            "cost of transport",
        ],
        rows=rows,
        marked=_place_of_winner(found, result),
    )


def gait(result: Mapping[str, Any], family: GaitFamily) -> Table:
    """Return the best walk's gait: its coefficients, or its variables in the units of a file.

    Args:
        result: Content of result.json.
        family: The family of the study's gaits.
    """
    best = (result.get("best") or {}).get("candidate", {})
    if "variables" not in best:
        return coefficients(result["coefficients_deg"] or [])
    rows = [
        [words(one.name), f"{best['variables'][one.name] / one.unit.si + 0.0:.4g}", one.unit.short]
        for one in family.variables
    ]
    return Table(
        caption=f"The gait, of the family {family.label}",
        columns=["variable", "value", "unit"],
        rows=rows,
    )


def coefficients(degrees: Sequence[Sequence[float]]) -> Table:
    """The sixteen coefficients of a gait."""
    return Table(
        caption="Coefficients of the gait function [deg]",
        columns=["waveform", *TERMS],
        rows=[
            [name, *(number(value, 2) for value in row)]
            for name, row in zip(WAVEFORMS, degrees, strict=False)
        ],
    )


def foot(design: Mapping[str, float]) -> Table:
    """The foot, in the paper's units."""
    rows = []
    for name, value in design.items():
        if name in DESIGN_UNITS:
            factor, unit = _FOOT_UNITS[DESIGN_UNITS[name]]
            rows.append([words(name), f"{factor * value:.4g}", unit])
        else:
            rows.append([words(name), "yes" if value else "no", ""])
    return Table(caption="The foot", columns=["design variable", "value", "unit"], rows=rows)


def _place_of_winner(entries: Sequence[Mapping[str, Any]], result: Mapping[str, Any]) -> int | None:
    walks = [entry["walk"] for entry in entries]
    winner = result.get("winner")
    return walks.index(winner) if winner in walks else None


def manner(result: Mapping[str, Any], own: Sequence[Quantity] = ()) -> Table | None:
    """Return how the winner walks: every quantity but the paper's; None where none is known.

    Args:
        result: The content of a result.json.
        own: Quantities of the study's own.
    """
    known = quantities(result)
    rows = []
    for one in (*BUILT_IN.values(), *own):
        if one.name in OUTPUTS or one.name not in known:
            continue
        value = known[one.name]
        cells = [shown(part, one) for part in (value if isinstance(value, list) else [value])]
        if one.parts == FEET or len(cells) == 1:
            rows.append([one.title, *cells, *[""] * (2 - len(cells))])
        else:
            for part, cell in zip(one.parts, cells, strict=True):
                rows.append([f"{one.title}, {words(part)}", cell, ""])
    if not rows:
        return None
    return Table(
        caption="How it walks", columns=["quantity", "right foot, or all", "left foot"], rows=rows
    )


def shown(value: float | None, one: Quantity) -> str:
    """Return a value [SI] of a quantity as people read it, see `number`."""
    return scaled(value, 1.0 / one.unit.si, one.digits)


def limit_in_words(limit: Limit | None) -> str:
    """Return the range of a limit in the unit of its quantity; empty without one."""
    if limit is None:
        return ""
    low, high = (
        f"{round(end / limit.quantity.unit.si, 4):g}".replace("-", "\N{MINUS SIGN}")
        for end in (limit.lower, limit.upper)
    )
    if limit.lower == -limit.upper:
        return f"within ±{high}"
    if math.isinf(limit.upper):
        return f"at least {low}"
    return f"at most {high}" if math.isinf(limit.lower) else f"{low} to {high}"


def quantities(result: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the quantities of a result [SI]; of an older one, those that were measured."""
    of_old = {"yaw_swing": result.get("yaw_swing"), **(result.get("measures") or {})}
    return result.get("quantities") or {
        name: value for name, value in of_old.items() if value is not None
    }


def stages(
    walks: Iterable[StudyWalk], settings: StudySettings, proposer: str | None = None
) -> Table:
    """Return what the walks were simulated for, and what became of them.

    Args:
        walks: All of a study.
        settings: The study's.
        proposer: Name of the proposer that was handed over, if one was.
    """
    counts: dict[str, list[int]] = {}
    for walk in walks:
        row = counts.setdefault(walk.stage, [0, 0, 0])
        row[0] += 1
        row[1] += walk.walk.survived
        row[2] += settings.assess(walk.walk).feasible
    design, infill = STAGE_NAMES[settings.search.mode]
    if proposer is not None:
        design, infill = "first iteration", f"proposed by {proposer}"
    names = {"design": design, "infill": infill, CONFIRMATION: "walked again to confirm"}
    rows = [[names.get(stage, stage), *map(str, row)] for stage, row in counts.items()]
    rows.append(["all", *(str(sum(row[place] for row in counts.values())) for place in range(3))])
    return Table(
        caption="Walks simulated",
        columns=["stage", "walks", "on their feet", "feasible"],
        rows=rows,
    )


def failures(walks: Iterable[StudyWalk]) -> Table:
    """Return the causes of early ends: falls by their gait cycle, and others."""
    counts: Counter[str] = Counter()
    walks = list(walks)
    one_period = len({entry.candidate.gait.schedule.period for entry in walks}) == 1
    for entry in walks:
        walk, period = entry.walk, entry.candidate.gait.schedule.period
        if walk.outcome is Outcome.FELL:
            cycle = int(walk.frames * FRAME_TIME / period)
            begin = period * cycle
            counts[
                f"fell between {begin:.1f} and {begin + period:.1f} s"
                if one_period
                else f"fell in gait cycle {cycle + 1}"
            ] += 1
        elif walk.failure:
            counts[walk.failure] += 1
    rows = [[cause, str(count)] for cause, count in sorted(counts.items())]
    return Table(
        caption="Walks that failed, by reason",
        columns=["reason", "walks"],
        rows=rows or [["none", "0"]],
    )


def network(result: Mapping[str, Any]) -> Table | None:
    """R² of every output, and held out that of the baselines; None without a network."""
    train, heldout = result["r2_train"], result["r2_heldout"]
    # Results of before had no baselines.
    beside = [result.get(f"r2_heldout_{name}") or {} for name in ("ridge", "kriging")]
    if all(value is None for value in train.values()):
        return None
    return Table(
        caption="Share of the variance that the network explains, R²",
        columns=["output", "training", "held out", "ridge, held out", "kriging, held out"],
        rows=[
            [OUTPUT_NAMES.get(name, words(name)), number(train[name], 2), number(heldout[name], 2)]
            + [number(one.get(name), 2) for one in beside]
            for name in train
        ],
    )


def settings(description: Mapping[str, Any]) -> Table:
    """Every setting, in SI units, angles in radians."""
    rows = [[key, _plain(value)] for key, value in description.items() if key != "study.question"]
    return Table(
        caption="Settings, in SI units and radians",
        columns=["setting", "value"],
        rows=rows,
        numbers=False,
    )


def _plain(value: Any) -> str:
    if isinstance(value, list):
        inner = (_plain(item) for item in value)
        return "; ".join(inner) if value and isinstance(value[0], list) else ", ".join(inner)
    if isinstance(value, float):
        return f"{value:.6g}"
    return "none" if value is None else str(value)


def versions(found: Mapping[str, str]) -> Table:
    """Return the versions that the numbers depend on."""
    return Table(
        caption="Versions",
        columns=["of", "version"],
        rows=[[name, value] for name, value in found.items()],
        numbers=False,
    )


def side_by_side(
    names: Sequence[str], results: Sequence[Mapping[str, Any]], own: Sequence[Quantity] = ()
) -> Table:
    """The numbers of several studies, and the quantities of their own."""
    lines = (
        ("best walk", "walk", 0),
        ("Z, forward [mm]", "forward_mm", 1),
        ("X, lateral [mm]", "lateral_mm", 1),
        ("R, turn [deg]", "yaw_deg", 2),
        ("Y, height of the centre of mass [mm]", "com_height_mm", 2),
        ("N, frames", "frames", 0),
        ("walks", "simulations", 0),
        ("on their feet", "survivors", 0),
        ("feasible walks", "feasible_count", 0),
        ("time [s]", "wall_s", 0),
    )
    rows = [
        [label, *(number(result[key], digits) for result in results)]
        for label, key, digits in lines
    ]
    # As text: a seed may have more digits than a number.
    rows.insert(0, ["seed", *(str(result["seed"]) for result in results)])
    rows.insert(
        2, ["best walk is feasible", *("yes" if result["feasible"] else "no" for result in results)]
    )
    rows += [
        [
            f"held-out R² of {OUTPUT_NAMES[output]}",
            *(number(result["r2_heldout"].get(output), 2) for result in results),
        ]
        for output in ("forward", "lateral", "yaw")
    ]
    for label, key in (
        ("trusted Z of the winner [mm]", "trusted_mm"),
        ("median Z of the winner [mm]", "median_mm"),
        ("worst Z of the winner [mm]", "worst_mm"),
    ):
        values = [_of_winner(result, key) for result in results]
        if any(value is not None for value in values):
            rows.append([label, *(number(value, 1) for value in values)])
    for one in (*(BUILT_IN[name] for name in _COMPARED), *own):
        measured = [_largest(quantities(result).get(one.name)) for result in results]
        rows.append([one.title, *(shown(value, one) for value in measured)])
    return Table(caption="The studies side by side", columns=["", *names], rows=rows)


def _largest(value: Any) -> float | None:
    """Return the largest of a measure's numbers; None where one is not known."""
    numbers = value if isinstance(value, list | tuple) else [value]
    return None if None in numbers else float(max(numbers))


def _of_winner(result: Mapping[str, Any], key: str) -> float | None:
    for entry in result.get("finalists") or []:
        if entry["walk"] == result.get("winner"):
            return None if entry.get(key) is None else float(entry[key])
    return None


def differences(names: Sequence[str], described: Sequence[Mapping[str, Any]]) -> Table | None:
    """Settings that are not the same in all studies; None where all are."""
    keys = dict.fromkeys(key for one in described for key in one)
    rows = []
    for key in keys:
        values = [_plain(one.get(key)) for one in described]
        if len(set(values)) > 1:
            rows.append([key, *values])
    if not rows:
        return None
    return Table(
        caption="Settings that differ, in SI units and radians",
        columns=["setting", *names],
        rows=rows,
        numbers=False,
    )
