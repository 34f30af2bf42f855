"""Correlate the measures of a gait with the scatter of its perturbed walks.

    python tools/bench_scatter.py runs/bench_search/*/seed-*

It takes the candidates that a confirmation walked at least twice. The first table has the median
range of X and of yaw over the walk and its first two variations. It has medians of measures of the
walk, which is simulated again for them. The second table has each measure's rank correlation with
the scatter: between the studies (their medians), and within one (median over the studies).
"""

import argparse
import os
from dataclasses import fields
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from markdown_table import heading, row
from scipy.stats import spearmanr

from drake_gait.gait import FloatArray
from drake_gait.problem import quantity
from drake_gait.simulation.simulate import simulate
from drake_gait.study.finalists import finalists
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Measures

_VARIATIONS = 2  # One on more slippery ground, one on less.
_SHOWN = ("yaw_swing", "slip", "torso_tilt", "peak_ground_reaction")
_NAMES = (*(field.name for field in fields(Measures)), "yaw_swing")


def scattered(folder: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distances [mm], ranges of X [mm] and yaw [deg] (n, 3), measures (n, m) of a study."""
    with Study.open(folder) as study:
        settings, walks = study_settings(study.description()["settings"]), study.walks()
    ranges, measures = [], []
    for finalist in finalists(settings, walks):
        variations = finalist.variations[:_VARIATIONS]
        if len(variations) < _VARIATIONS:
            continue
        again = simulate(finalist.walk.candidate, settings.walk, history=True)
        walked = [again, *(variation.walk for variation in variations)]
        ranges.append(
            [
                1e3 * again.forward,
                1e3 * np.ptp([walk.lateral for walk in walked]),
                np.degrees(np.ptp([walk.yaw for walk in walked])),
            ]
        )
        measures.append([quantity(again, name) for name in _NAMES])
    found = np.array(ranges).reshape(-1, 3)
    return found, np.log(found[:, 1] / 20.0 + found[:, 2] / 5.0), np.array(measures)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a study")
    studies = []
    columns = ["study", "candidates", "Z [mm]", "range of X [mm]", "of yaw [deg]"]
    columns += ["yaw swing [deg]", "slip [mm]", "tilt [deg]", "peak reaction [weights]"]
    print(heading(columns))
    for run in parser.parse_args().runs:
        ranges, scatter, measures = scattered(run)
        studies.append((scatter, measures))
        units = (np.degrees(1.0), 1e3, np.degrees(1.0), 1.0)
        shown = [
            unit * np.median(measures[:, _NAMES.index(name)])
            for name, unit in zip(_SHOWN, units, strict=True)
        ]
        cells = (f"{value:.1f}" for value in (*np.median(ranges, axis=0), *shown))
        print(row([f"{run.parent.name}/{run.name}", len(ranges), *cells]), flush=True)
    medians = [np.median(scatter) for scatter, _ in studies]
    print(f"\n{heading(['measure', 'between studies', 'within one'])}")
    for column, name in enumerate(_NAMES):
        between = spearmanr([np.median(found[:, column]) for _, found in studies], medians)
        within = np.median(
            [spearmanr(found[:, column], scatter).statistic for scatter, found in studies]
        )
        print(row([name, f"{between.statistic:.2f}", f"{within:.2f}"]))


if __name__ == "__main__":
    main()
