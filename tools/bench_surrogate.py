r"""Learning curve of the network beside ridge, quadratic ridge, a Gaussian process and a forest.

    python -m drake_gait.optimize --samples 2000 --simulations 2000 --seed 100 \
        --set confirmation.walks=0 --out runs/lhs2000
    python tools/bench_surrogate.py runs/lhs2000 --figure docs/images/learning_curve.png

It draws random subsets of the walks of studies with the same box. These are the walks of the design
of experiments, or all with `--all`. Every model predicts each walk from the folds of the network
that do not hold it. The table has medians over the draws. Its columns are R² of Z, X and yaw of
the survivors, the area under the curve of survival, and the processor time of all folds. The last
column is the range of R² of Z. The network classifies; the others regress survival as 0 or 1.
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from markdown_table import heading, row
from numpy.typing import NDArray
from sklearn.ensemble import RandomForestRegressor
from sklearn.preprocessing import PolynomialFeatures

from drake_gait.search.proposer import training_data
from drake_gait.study.ranking import search_walks
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.store import Study
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.baselines import (
    Model,
    area_under_curve,
    heldout,
    kriging,
    ridge,
)
from drake_gait.visualization.palette import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from drake_gait.visualization.style import PAGE, new_figure, save_figure, style

COUNTS = (50, 100, 200, 400, 800, 1600, 2000)
OUTPUTS = ("forward", "lateral", "yaw")
COLUMNS = ("R² of Z", "R² of X", "R² of yaw", "AUC of survival", "time [s]")
Array = NDArray[np.float64]
Data = tuple[Array, Array, NDArray[np.bool_]]


def read(folders: Sequence[Path], study: Path, *, every: bool) -> Data:
    """Design vectors, outputs and survival of the studies' walks."""
    space = read_study(study).space
    walks = []
    for folder in folders:
        with Study.open(folder) as opened:
            walks += [
                walk for walk in search_walks(opened.walks()) if every or walk.stage == "design"
            ]
    return training_data(walks, space, OUTPUTS)


def quadratic_ridge(x: Array, outputs: Array, new: Array) -> Array:
    """Ridge regression on all products of two coordinates."""
    products = PolynomialFeatures(2, include_bias=False).fit(x)
    return ridge(products.transform(x), outputs, products.transform(new))


def forest(x: Array, outputs: Array, new: Array) -> Array:
    """A random forest."""
    trees = RandomForestRegressor(100, min_samples_leaf=3, max_features=0.5, random_state=0)
    single = outputs.shape[1] == 1
    predicted = trees.fit(x, outputs[:, 0] if single else outputs).predict(new)
    return np.reshape(predicted, (len(new), -1))


MODELS: dict[str, Callable[[Array, Array], Model]] = {
    "ridge": lambda x, outputs: ridge,
    "quadratic ridge": lambda x, outputs: quadratic_ridge,
    "Gaussian process": kriging,
    "random forest": lambda x, outputs: forest,
}
NAMES = ("network", *MODELS)
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE)


def scores(name: str, data: Data) -> list[float]:
    """R² of the three outputs, area under the curve, processor time of fitting to all folds [s]."""
    x, outputs, survived = data
    started = time.process_time()
    if name == "network":
        network = surrogate.fit(x, outputs, survived)
        seconds, survival = time.process_time() - started, network.survival_heldout
        r2 = network.r2_heldout
    else:
        model, seen, targets = MODELS[name], x[survived], outputs[survived]
        folds = surrogate.folds_of(len(seen), 0)
        r2 = surrogate.r_squared(targets, heldout(model(seen, targets), seen, targets, folds))
        labels = survived[:, None].astype(float)
        survival = heldout(model(x, labels), x, labels, surrogate.folds_of(len(x), 0))[:, 0]
        seconds = time.process_time() - started
    auc = area_under_curve(survived, survival)
    return [*map(float, r2), np.nan if auc is None else auc, seconds]


def learning_curve(data: Data, counts: Sequence[int], draws: int) -> dict[tuple[int, str], Array]:
    """Scores, shape (draws, columns), by number of walks and model."""
    found = {}
    for count in counts:
        # All walks can be drawn in one way only.
        subsets = [
            np.random.default_rng([count, draw]).permutation(len(data[0]))[:count]
            for draw in range(draws if count < len(data[0]) else 1)
        ]
        for name in NAMES:
            rows = [scores(name, tuple(part[subset] for part in data)) for subset in subsets]
            found[count, name] = np.array(rows)
            print(_row(count, name, found[count, name]), flush=True)
    return found


def _row(count: int, name: str, rows: Array) -> str:
    middle = np.median(rows, axis=0)
    spread = f"{rows[:, 0].min():.2f} to {rows[:, 0].max():.2f}"
    return row([count, name, *(f"{value:.2f}" for value in middle), spread])


def draw(found: dict[tuple[int, str], Array], path: Path) -> None:
    """Draw a panel for each score, a line for each model, and a band from lowest to highest."""
    counts = sorted({count for count, _ in found})
    with style():
        figure = new_figure(PAGE, 2.6)
        for column, axes in enumerate(figure.subplots(1, 4)):
            for name, colour in zip(NAMES, COLOURS, strict=True):
                rows = [found[count, name][:, column] for count in counts]
                middle = [np.median(one) for one in rows]
                width = 2.2 if name == "network" else 1.2
                axes.plot(
                    counts, middle, "o-", color=colour, linewidth=width, markersize=3, label=name
                )
                if name == "network":
                    low, high = [one.min() for one in rows], [one.max() for one in rows]
                    axes.fill_between(counts, low, high, color=colour, alpha=0.15, linewidth=0)
            axes.set(xscale="log", xlabel="walks simulated", title=COLUMNS[column])
            axes.set_ylim((0.5, 1.0) if column == 3 else (-0.1, 1.0))
            axes.set_xticks(counts, [str(count) for count in counts], minor=False)
            axes.minorticks_off()
        figure.legend(
            *axes.get_legend_handles_labels(), loc="outside lower center", ncols=len(NAMES)
        )
        save_figure(figure, path)


def main() -> None:
    """Run the command."""
    about = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=about)
    parser.add_argument("studies", nargs="+", type=Path, help="folders of studies, with study.db")
    parser.add_argument("--study", type=Path, default=default_study(), help="the box: its TOML")
    parser.add_argument("--all", action="store_true", help="walks of every stage, not the design's")
    parser.add_argument("--draws", type=int, default=5, help="random subsets of each size (5)")
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="walks of a subset")
    parser.add_argument("--figure", type=Path, help="where to draw the curves")
    options = parser.parse_args()
    data = read(options.studies, options.study, every=options.all)
    counts = [count for count in options.counts if count <= len(data[0])]
    print(f"{len(data[0])} walks, {int(data[2].sum())} survived; {options.draws} draws\n")
    print(heading(["walks", "model", *COLUMNS, "Z, range"], words=2))
    found = learning_curve(data, counts, options.draws)
    if options.figure:
        draw(found, options.figure)


if __name__ == "__main__":
    main()
