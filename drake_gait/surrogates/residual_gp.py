"""Kriging: a network's errors on the walks of late tell those to expect nearby.

The network learns for a second or more; its errors are kriged in hundredths of one. So the errors
can be those of walks that it has not yet learnt from.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from drake_gait.gait import FloatArray
from drake_gait.surrogates.arithmetic import single_thread
from drake_gait.surrogates.ensemble import Surrogate, checked_walks
from drake_gait.surrogates.prediction import Prediction, learnable

_LATEST = 200
_LENGTHS = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Of the kernel, in units of the box."""
_NOISES = (0.3, 1.0, 3.0, 10.0)
"""Variances in parts of that of the process. With less noise than this a process tells the next
walks no better, and lets a search run after single lucky ones
(docs/experiments/2026-11-23-residual-process.md)."""
_SMALLEST_CHANCE = 1e-3
"""To survive, where errors nearby would make it nothing, or less."""
_AT_ONCE = 2000
"""Points that are asked together: matrices of more would take a search's memory."""


class KrigedNetwork:
    """A network whose predictions are corrected by its errors on the latest 200 walks.

    Args:
        network: What is corrected. Its errors on walks that it has learnt from are those of
            members that had not seen them.
        x: Design vectors of the walks since then, shape (n, d); n may be 0.
        outputs: What was simulated, shape (n, k); rows of fallen walks, or with what is not
            finite, are not used.
        survived: Whether each walk survived, shape (n,).
    """

    def __init__(
        self, network: Surrogate, x: ArrayLike, outputs: ArrayLike, survived: ArrayLike
    ) -> None:
        self._network = network
        x, outputs, survived = checked_walks(x, outputs, survived)
        since, learnt = network.predict(x), learnable(outputs, survived)
        with single_thread():
            self._outputs = ErrorProcesses(
                _latest(network.x[network.learnt], x[learnt]),
                _latest(network.targets - network.heldout, (outputs - since.mean)[learnt]),
            )
            self._survival = ErrorProcesses(
                _latest(network.x, x),
                _latest(
                    (network.survived - network.survival_heldout)[:, None],
                    (survived - since.survival)[:, None],
                ),
            )

    def predict(self, x: ArrayLike) -> Prediction:
        """Predictions for design vectors, shape (n, d)."""
        with single_thread():
            expected = self._network.predict(x)
            x = np.asarray(x, dtype=np.float64)
            error, deviation = self._outputs.predict(x)
            survival = expected.survival + self._survival.predict(x)[0][:, 0]
        return Prediction(
            mean=expected.mean + error,
            deviation=deviation,
            survival=np.clip(survival, _SMALLEST_CHANCE, 1.0),
        )


class ErrorProcesses:
    """Gaussian processes with Matérn 5/2 kernels, of errors whose mean is nothing.

    Each has the length, noise and variance of the largest likelihood, of five lengths and four
    noises. (Rasmussen and Williams 2006, Eqs. 2.25, 2.26 and 5.8.) One eigenvalue problem for every
    length answers for all noises and all columns.

    Args:
        x: Points, shape (n, d).
        errors: What a model lacked there, shape (n, k).
    """

    def __init__(self, x: FloatArray, errors: FloatArray) -> None:
        self._x = x
        distances = cdist(x, x)
        count = errors.shape[1]
        self._length, self._noise, self._variance = np.zeros((3, count))
        least = np.full(count, np.inf)
        self._inverse, self._weights = np.zeros_like(errors), np.zeros_like(errors)
        self._vectors: dict[float, FloatArray] = {}
        for length in _LENGTHS:
            values, vectors = np.linalg.eigh(_matern(distances / length))
            self._vectors[length] = vectors
            turned = vectors.T @ errors
            for noise in _NOISES:
                inverse = 1.0 / (values + noise)
                variance = (inverse[:, None] * turned**2).mean(axis=0)
                unlikelihood = np.log(np.maximum(variance, 1e-300)) - np.log(inverse).mean()
                better = unlikelihood < least
                least[better] = unlikelihood[better]
                self._length[better], self._noise[better] = length, noise
                self._variance[better] = variance[better]
                self._inverse[:, better] = inverse[:, None]
                self._weights[:, better] = vectors @ (inverse[:, None] * turned[:, better])

    def predict(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The errors to expect at points of shape (m, d), and their deviations, shape (m, k)."""
        if len(x) > _AT_ONCE:
            parts = [self.predict(x[at : at + _AT_ONCE]) for at in range(0, len(x), _AT_ONCE)]
            means, deviations = zip(*parts, strict=True)
            return np.concatenate(means), np.concatenate(deviations)
        distances = cdist(x, self._x)
        mean = np.empty((len(x), len(self._length)))
        share = np.empty_like(mean)
        for length in set(self._length):
            these = self._length == length
            near = _matern(distances / length)
            mean[:, these] = near @ self._weights[:, these]
            share[:, these] = (near @ self._vectors[length]) ** 2 @ self._inverse[:, these]
        deviation = np.sqrt(self._variance * (1.0 + self._noise - share))
        return mean, deviation


def _latest(before: FloatArray, since: FloatArray) -> FloatArray:
    return np.concatenate([before, since])[-_LATEST:]


def _matern(distance: FloatArray) -> FloatArray:
    r = np.sqrt(5.0) * distance
    correlation: FloatArray = (1.0 + r + r**2 / 3.0) * np.exp(-r)
    return correlation
