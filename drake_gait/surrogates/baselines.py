"""Baselines beside the network: ridge regression, kriging and logistic regression.

A network that does not beat a straight line is not worth its name. Each baseline predicts the walks
that the network's members predict: each walk is left out with the same fold.
"""

import threading
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel
from sklearn.linear_model import LogisticRegressionCV, RidgeCV
from sklearn.metrics import roc_auc_score

from drake_gait.gait import FloatArray
from drake_gait.surrogates.arithmetic import single_thread
from drake_gait.surrogates.ensemble import Surrogate, checked_walks, folds_of, r_squared
from drake_gait.surrogates.prediction import BoolArray, IntArray, learnable

Model = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Predictions at new points (m, d), shape (m, k), from points (n, d) and their outputs (n, k)."""

_PENALTIES = np.logspace(-2.0, 5.0, 15)
_COSTS = np.logspace(-3.0, 2.0, 6)
_KERNEL_WALKS = 256
_FEWEST_OF_A_CLASS = 10
_filters = threading.RLock()
"""Warnings are filtered for the whole process, by scikit-learn too: one comparison at a time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Scores of the network and the baselines on walks that they have not seen."""

    ridge: FloatArray
    """R² of ridge regression, shape (k,)."""
    kriging: FloatArray
    """R² of the Gaussian process, shape (k,)."""
    network_auc: float | None
    """Area under the curve of the network's survival; None where all walks survived."""
    logistic_auc: float | None
    """The same of logistic regression; None where too few fell, or survived, to be fitted."""


def compare(
    network: Surrogate, x: ArrayLike, outputs: ArrayLike, survived: ArrayLike, *, seed: int = 0
) -> Comparison:
    """Fit the baselines to what a network was fitted to, on its folds.

    Args:
        network: What `surrogate.fit` made of the other arguments.
        x: Design vectors, shape (n, d).
        outputs: What was simulated, shape (n, k); rows of fallen walks, or with what is not
            finite, are not used.
        survived: Whether each walk survived, shape (n,).
        seed: That of the network: it fixes the folds.

    Raises:
        SettingsError: a shape does not fit, or a number cannot be used.
    """
    x, outputs, survived = checked_walks(x, outputs, survived)
    learnt = learnable(outputs, survived)
    targets, seen = outputs[learnt], x[learnt]
    folds = folds_of(len(targets), seed)
    logistic_auc = None
    with single_thread(), _filters:
        if min(survived.sum(), (~survived).sum()) >= _FEWEST_OF_A_CLASS:
            expected = heldout(logistic, x, survived[:, None].astype(float), folds_of(len(x), seed))
            logistic_auc = area_under_curve(survived, expected[:, 0])
        return Comparison(
            ridge=r_squared(targets, heldout(ridge, seen, targets, folds)),
            kriging=r_squared(targets, heldout(kriging(seen, targets), seen, targets, folds)),
            network_auc=area_under_curve(survived, network.survival_heldout),
            logistic_auc=logistic_auc,
        )


def heldout(model: Model, x: FloatArray, outputs: FloatArray, folds: IntArray) -> FloatArray:
    """Prediction of each walk by a model of the other folds' walks, shape (n, k)."""
    predicted = np.empty_like(outputs)
    for fold in np.unique(folds):
        left_out = folds == fold
        predicted[left_out] = model(x[~left_out], outputs[~left_out], x[left_out])
    return predicted


def ridge(x: FloatArray, outputs: FloatArray, new: FloatArray) -> FloatArray:
    """Ridge regression; leaving one walk out chooses the penalty of every output."""
    offset, scale = _scaling(outputs)
    model = RidgeCV(_PENALTIES, alpha_per_target=outputs.shape[1] > 1)
    predicted = model.fit(x, (outputs - offset) / scale).predict(new)
    found: FloatArray = offset + scale * predicted.reshape(len(new), -1)
    return found


def kriging(x: FloatArray, outputs: FloatArray) -> Model:
    """A Gaussian process of one Matérn 5/2 kernel and white noise for every output.

    The three numbers of a kernel have the largest likelihood on at most 256 of the given walks.
    They are found once for all folds: three numbers hardly tell one walk from the others.
    """
    offset, scale = _scaling(outputs)
    chosen = np.random.default_rng(len(x)).permutation(len(x))[:_KERNEL_WALKS]
    kernel = ConstantKernel() * Matern(4.0, (0.3, 1e3), nu=2.5) + WhiteKernel(0.1, (1e-5, 1e1))
    varying = np.ptp(outputs, axis=0) > 0.0
    kernels = {}
    for column in np.flatnonzero(varying):
        target = (outputs[chosen, column] - offset[column]) / scale[column]
        with _filters, warnings.catch_warnings():
            # Of pure noise the best length is the longest: at the bound, as it should be.
            warnings.simplefilter("ignore", ConvergenceWarning)
            kernels[column] = GaussianProcessRegressor(kernel).fit(x[chosen], target).kernel_

    def model(known: FloatArray, values: FloatArray, new: FloatArray) -> FloatArray:
        predicted = np.tile(values.mean(axis=0), (len(new), 1))
        for column, fitted in kernels.items():
            standard = (values[:, column] - offset[column]) / scale[column]
            process = GaussianProcessRegressor(fitted, optimizer=None).fit(known, standard)
            predicted[:, column] = offset[column] + scale[column] * process.predict(new)
        return predicted

    return model


def logistic(x: FloatArray, survived: FloatArray, new: FloatArray) -> FloatArray:
    """Probability that new walks survive, shape (m, 1), by logistic regression."""
    model = LogisticRegressionCV(
        Cs=_COSTS,
        cv=3,
        scoring="neg_log_loss",
        l1_ratios=(0.0,),
        use_legacy_attributes=False,
        max_iter=500,
    )
    return np.asarray(model.fit(x, survived[:, 0] > 0.5).predict_proba(new)[:, 1:])


def area_under_curve(survived: BoolArray, expected: FloatArray) -> float | None:
    """Chance that a surviving walk is expected to survive rather than a falling one.

    Args:
        survived: Whether each walk survived, shape (n,).
        expected: What was expected, shape (n,); larger is more likely to survive.

    Returns:
        1 for perfect order, 0.5 for none; None where all or none survived.
    """
    if survived.all() or not survived.any():
        return None
    return float(roc_auc_score(survived, expected))


def _scaling(outputs: FloatArray) -> tuple[FloatArray, FloatArray]:
    return outputs.mean(axis=0), np.maximum(outputs.std(axis=0), 1e-12)
