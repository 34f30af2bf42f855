"""Score a search's predictions of its next batch, with and without kriged errors.

    python tools/bench_ahead.py runs/bench_search/default/seed-*

It learns as a search does. The network learns from all walks but the last batch, its errors are
kriged with those of that batch, and the next batch is predicted. That is repeated after every third
batch, from 300 walks on. The table has means over all of these. It has the correlation of each
output among the survivors, and the area under the curve of survival and of a feasible walk. Its
last column is the logarithm of the probability given to the outcome; 0 is certainty. A surrogate
knows less of walks that it has chosen itself: who chose them is at a disadvantage.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from markdown_table import heading, row
from numpy.typing import NDArray

from drake_gait.search.acquisition import Acquisition
from drake_gait.search.proposer import training_data
from drake_gait.study.ranking import search_walks
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.baselines import area_under_curve, kriging
from drake_gait.surrogates.prediction import Prediction
from drake_gait.surrogates.residual_gp import KrigedNetwork

FIRST, EVERY, FEWEST = 300, 3, 5
LEAST_CHANCE = 1e-3


def read(folder: Path) -> tuple[list[dict[str, list[float]]], tuple[str, ...]]:
    """Scores by name at every point of a study, and the outputs that they are of."""
    with Study.open(folder) as study:
        settings = study_settings(study.description()["settings"])
        walks = search_walks(study.walks())
    x, outputs, survived = training_data(walks, settings.space, settings.outputs)
    feasible = np.array([settings.assess(walk.walk).feasible for walk in walks])
    batch, found = settings.search.batch, []
    for now in range(FIRST, len(walks) - batch + 1, EVERY * batch):
        learnt, since, after = slice(now - batch), slice(now - batch, now), slice(now, now + batch)
        network = surrogate.fit(x[learnt], outputs[learnt], survived[learnt])
        kriged = KrigedNetwork(network, x[since], outputs[since], survived[since])
        without = KrigedNetwork(network, x[:0], outputs[:0], survived[:0])
        seen = survived & (np.arange(len(x)) < now)
        alone = network.predict(x[after])
        expected = {
            "network": alone,
            "network, errors kriged without the last batch": without.predict(x[after]),
            "network, errors kriged": kriged.predict(x[after]),
            "kriging by itself, the network's errors": Prediction(
                mean=kriging(x[seen], outputs[seen])(x[seen], outputs[seen], x[after]),
                deviation=alone.deviation,
                survival=alone.survival,
            ),
        }
        chance = Acquisition(
            network, settings.outputs, "forward", settings.constraints.limits, None, [], 1.0
        ).chance
        truth = outputs[after], survived[after], feasible[after]
        found.append({name: scores(one, chance(one), *truth) for name, one in expected.items()})
    return found, settings.outputs


def scores(
    expected: Prediction,
    chance: NDArray[np.float64],
    outputs: NDArray[np.float64],
    survived: NDArray[np.bool_],
    feasible: NDArray[np.bool_],
) -> list[float]:
    """Correlation of every output, two areas under the curve, logarithm of the probability."""
    told = zip(outputs[survived].T, expected.mean[survived].T, strict=True)
    enough = survived.sum() >= FEWEST
    areas = (
        area_under_curve(survived, expected.survival),
        area_under_curve(feasible, chance),
    )
    given = np.clip(np.where(feasible, chance, 1.0 - chance), LEAST_CHANCE, 1.0)
    return [
        *(float(np.corrcoef(pair)[0, 1]) if enough else np.nan for pair in told),
        *(np.nan if area is None else area for area in areas),
        float(np.log(given).mean()),
    ]


def main() -> None:
    """Run the command."""
    about = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=about)
    parser.add_argument("studies", nargs="+", type=Path, help="folders of studies, with study.db")
    found, outputs = [], ()
    for folder in parser.parse_args().studies:
        rows, outputs = read(folder)
        found += rows
    columns = [f"r of {name}" for name in outputs]
    columns += ["AUC of survival", "AUC of feasible", "log probability"]
    print(f"{len(found)} batches\n\n{heading(['model', *columns])}")
    for name in found[0]:
        means = np.nanmean([one[name] for one in found], axis=0)
        print(row([name, *(f"{mean:.2f}" for mean in means)]))


if __name__ == "__main__":
    main()
