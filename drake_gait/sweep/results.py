"""Results of a sweep: one row for each of its studies, and the variants beside each other."""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from drake_gait.errors import StudyError
from drake_gait.files.destination import write
from drake_gait.files.strict_json import from_json, to_json
from drake_gait.report.study_result import as_written_today
from drake_gait.report.tables import Table
from drake_gait.sweep.settings import PlannedStudy, Sweep

Row = Mapping[str, Any]
"""Variant and seed, FURTHEST, ROBUST and "slip_mm", and all of result.json but the lists of gaits.

FURTHEST is the distance of the best feasible walk of the search, ROBUST the median of the winner's
perturbed walks; None where there is none. Nested keys of result.json are joined by dots.
"""

FURTHEST, ROBUST, COST = "furthest_mm", "robust_mm", "measures.cost_of_transport"

# Key of a row, heading of its column, and digits after the point.
_COLUMNS = (
    (FURTHEST, "Z [mm]", 1),
    (ROBUST, "robust Z [mm]", 1),
    (COST, "cost of transport", 2),
    ("measures.energy", "work [J]", 1),
    ("slip_mm", "slip [mm]", 0),
    ("measures.peak_ground_reaction", "ground reaction [weights]", 2),
)
_LEFT_OUT = ("coefficients_deg", "finalists", "versions", "study", "seed")


@dataclass(frozen=True, kw_only=True)
class Spread:
    """A number over the seeds of a variant."""

    median: float
    """The middle one."""
    lowest: float
    """The smallest one."""
    highest: float
    """The largest one."""

    def in_words(self, digits: int) -> str:
        """Median (lowest to highest), as text with so many digits after the point."""
        low, high = (f"{value:.{digits}f}" for value in (self.lowest, self.highest))
        return f"{self.median:.{digits}f} ({low} to {high})"


@dataclass(frozen=True, kw_only=True)
class VariantSummary:
    """All seeds of one variant."""

    variant: str
    """Its name."""
    studies: int
    """Studies that are finished."""
    feasible: int
    """Those that found a feasible walk."""
    robust: int
    """Those that found a robust one."""
    spreads: Mapping[str, Spread]
    """Numbers of studies with a feasible walk, by key of a row."""
    p_values: Mapping[str, float]
    """Probabilities of numbers so different from the first variant's if nothing differed
    (Mann-Whitney, two-sided), by key of a row. None for the first variant, nor where a variant has
    one such number or where all are equal."""


def read_row(study: PlannedStudy, out: Path) -> Row:
    """The row of a finished study.

    Raises:
        StudyError: it has no result.json that can be read.
    """
    path = study.folder(out) / "result.json"
    try:
        content = from_json(path.read_bytes())
    except (OSError, ValueError) as error:
        raise StudyError(f"cannot read {path}: {error}; run the sweep again") from None
    try:
        result = as_written_today(content)
        row = {
            "variant": study.variant,
            "seed": study.seed,
            FURTHEST: _furthest(result),
            ROBUST: _of_finalist(result, result["winner"], "median_mm"),
            **dict(_flat(result)),
        }
    except (AttributeError, KeyError, TypeError, ValueError):
        raise StudyError(f"{path} is no result of a study; run the sweep again") from None
    slips = [value for key, value in row.items() if key.startswith("measures.slip.")]
    if not slips or None in slips:
        return row
    return {**row, "slip_mm": 1e3 * sum(slips)}


def _furthest(result: Mapping[str, Any]) -> float | None:
    """Distance of the best feasible walk of the search [mm]."""
    if not result["feasible_count"]:
        return None
    if result["walk"] == result["nominal_best"]:
        return float(result["forward_mm"])
    return _of_finalist(result, result["nominal_best"], "forward_mm")


def _of_finalist(result: Mapping[str, Any], walk: int | None, key: str) -> float | None:
    found = [one[key] for one in result["finalists"] if one["walk"] == walk]
    return None if not found or found[0] is None else float(found[0])


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if prefix + key in _LEFT_OUT:
            continue
        if isinstance(value, list):
            value = {str(index): item for index, item in enumerate(value)}
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def summaries(rows: Sequence[Row], variants: Sequence[str]) -> list[VariantSummary]:
    """Each variant over its seeds; studies without a feasible walk do not count in its numbers."""
    found = []
    for variant in variants:
        own, first = (
            [row for row in rows if row["variant"] == name and row["feasible_count"]]
            for name in (variant, variants[0])
        )
        keys = [key for key, _, _ in _COLUMNS if _numbers(own, key)]
        found.append(
            VariantSummary(
                variant=variant,
                studies=sum(row["variant"] == variant for row in rows),
                feasible=len(own),
                robust=sum(row["winner"] is not None for row in own),
                spreads={key: _spread(_numbers(own, key)) for key in keys},
                p_values={
                    key: p_value
                    for key in keys
                    if variant != variants[0]
                    and (p_value := _p_value(_numbers(own, key), _numbers(first, key))) is not None
                },
            )
        )
    return found


def _numbers(rows: Sequence[Row], key: str) -> list[float]:
    found = (row.get(key) for row in rows)
    return [one for one in found if isinstance(one, int | float) and math.isfinite(one)]


def _spread(values: Sequence[float]) -> Spread:
    median = float(np.median(values))
    return Spread(median=median, lowest=float(min(values)), highest=float(max(values)))


def _p_value(values: Sequence[float], others: Sequence[float]) -> float | None:
    """Return the test's probability; None where it tells nothing: one seed, or no scatter."""
    if min(len(values), len(others)) < 2 or len({*values, *others}) < 2:
        return None
    return float(stats.mannwhitneyu(values, others, alternative="two-sided").pvalue)


def table(found: Sequence[VariantSummary]) -> Table:
    """Return the variants beside each other, median (lowest to highest) of each number."""
    rows = []
    for item in found:
        p_values = [item.p_values.get(key) for key in (FURTHEST, ROBUST)]
        rows.append(
            [
                item.variant,
                *(f"{count}/{item.studies}" for count in (item.feasible, item.robust)),
                *(
                    item.spreads[key].in_words(digits) if key in item.spreads else "-"
                    for key, _, digits in _COLUMNS
                ),
                *("-" if p_value is None else f"{p_value:.3f}" for p_value in p_values),
            ]
        )
    return Table(
        caption="Median over the seeds (lowest to highest); p against the first variant",
        columns=[
            "variant",
            "feasible",
            "robust",
            *(head for _, head, _ in _COLUMNS),
            "p of Z",
            "p of robust Z",
        ],
        rows=rows,
        numbers=False,
    )


def write_results(sweep: Sweep, rows: Sequence[Row], out: Path) -> None:
    """Write sweep.csv and sweep.json into the sweep's folder.

    Raises:
        StudyError: a file cannot be written.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    content = {
        "sweep": sweep.name,
        "question": sweep.question,
        "variants": [asdict(item) for item in summaries(rows, sweep.variants)],
        "studies": list(rows),
    }
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write(out / "sweep.csv", text.getvalue())
    write(out / "sweep.json", to_json(content) + "\n")
