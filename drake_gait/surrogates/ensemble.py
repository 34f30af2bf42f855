"""The network: what a walk will be, learnt from the walks simulated so far (paper, IV.A).

It has three layers as in the paper, sigmoid hidden units, and back-propagation on the squared error
(Eqs. 18-21). Every member of the ensemble leaves out one fold of the walks. So each walk is
predicted by a member that has not seen it. Regressors learn from walks that survived; a classifier
of the same form learns which do.
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import ArrayLike

from drake_gait.arrays import numbers
from drake_gait.errors import SettingsError
from drake_gait.gait import FloatArray
from drake_gait.surrogates.arithmetic import learning, single_thread
from drake_gait.surrogates.prediction import (
    FEWEST_SURVIVORS,
    BoolArray,
    IntArray,
    Prediction,
    learnable,
)
from drake_gait.surrogates.settings import PAPER_NETWORK, NetworkSettings

_MEMBERS = FEWEST_SURVIVORS // 2


class _Ensemble:
    """Members' weights, each of shape (members, inputs, outputs), and their shared forward pass."""

    def __init__(
        self,
        inputs: int,
        outputs: int,
        generator: torch.Generator,
        settings: NetworkSettings,
        *,
        members: int = _MEMBERS,
    ) -> None:
        units = settings.units
        self._settings = settings

        def weights(rows: int, columns: int) -> torch.Tensor:
            drawn: torch.Tensor = torch.randn(
                members,
                rows,
                columns,
                generator=generator,
                dtype=torch.float64,
                device="cpu",
            )
            scaled: torch.Tensor = drawn / rows**0.5
            return scaled.requires_grad_()

        self.hidden = weights(inputs, units)
        self.hidden_bias = weights(1, units)
        self.output = weights(units, outputs)
        self.output_bias = torch.zeros(members, 1, outputs, dtype=torch.float64).requires_grad_()

    def __call__(self, x: torch.Tensor) -> torch.Tensor:
        """Outputs of every member, shape (members, n, outputs), at x, shape (n, inputs)."""
        net = x @ self.hidden + self.hidden_bias  # Eq. 18
        # The sigmoid about its own middle: outputs then need no large bias to cancel it.
        out = torch.sigmoid(net) - 0.5  # Eq. 20
        result: torch.Tensor = out @ self.output + self.output_bias
        return result

    def train(
        self, loss_of_outputs: Callable[[torch.Tensor], torch.Tensor], x: torch.Tensor
    ) -> None:
        """Back-propagation, all members at once."""
        settings = self._settings
        optimiser = torch.optim.AdamW(
            [
                {"params": [self.hidden, self.output], "weight_decay": settings.weight_decay},
                {"params": [self.hidden_bias, self.output_bias], "weight_decay": 0.0},
            ],
            lr=settings.learning_rate,
        )
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, settings.epochs)
        for _ in range(settings.epochs):
            optimiser.zero_grad()
            loss_of_outputs(self(x)).backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step()


class _Loss:
    """Mean loss over the walks that each member may see."""

    def __init__(self, target: FloatArray, folds: IntArray, *, logistic: bool) -> None:
        self.target = torch.from_numpy(target)
        seen = folds[None, :] != np.arange(_MEMBERS)[:, None]
        self.seen = torch.from_numpy(seen)[:, :, None].to(torch.float64)
        self.logistic = logistic

    def __call__(self, outputs: torch.Tensor) -> torch.Tensor:
        if self.logistic:
            error = torch.nn.functional.binary_cross_entropy_with_logits(
                outputs, self.target.expand_as(outputs), reduction="none"
            )
        else:
            error = 0.5 * (outputs - self.target) ** 2  # Eq. 21
        return (error * self.seen).sum() / self.seen.sum()


class Surrogate:
    """Predicts walks from design vectors; made by `fit`."""

    def __init__(
        self,
        regressor: _Ensemble,
        classifier: _Ensemble | None,
        scaling: tuple[FloatArray, FloatArray],
        heldout: FloatArray,
        survival_heldout: FloatArray,
        x: FloatArray,
        outputs: FloatArray,
        survived: BoolArray,
    ) -> None:
        self._regressor = regressor
        self._classifier = classifier
        self._offset, self._scale = scaling
        self.x = x
        """Design vectors of the walks learnt from, shape (all walks, d)."""
        self.survived = survived
        """Whether each of them survived, shape (all walks,)."""
        self.learnt = learnable(outputs, survived)
        """Whether each one's outputs were learnt, shape (all walks,)."""
        self.targets = outputs[self.learnt]
        """Outputs that were learnt, shape (n, k)."""
        self.heldout = heldout
        """Their prediction by a member that has not seen them, shape (n, k)."""
        self.survival_heldout = survival_heldout
        """Every walk's chance to survive by a member that has not seen it, shape (all walks,)."""
        self.fitted = self._members(x[self.learnt]).mean(axis=0)
        """Their prediction by the whole ensemble, shape (n, k)."""
        self._residual = (self.targets - heldout).std(axis=0)

    @property
    def r2_train(self) -> FloatArray:
        """Share of variance explained on the walks learnt from, shape (k,)."""
        return r_squared(self.targets, self.fitted)

    @property
    def r2_heldout(self) -> FloatArray:
        """Share of variance explained on walks not seen, shape (k,)."""
        return r_squared(self.targets, self.heldout)

    def predict(self, x: ArrayLike) -> Prediction:
        """Predictions for design vectors, shape (n, d).

        Raises:
            SettingsError: x has another shape, or is no array of real numbers.
        """
        points = _points(x, self.x.shape[1])
        members = self._members(points)
        deviation = np.sqrt(members.var(axis=0) + self._residual**2)
        survival = np.ones(len(points))
        if self._classifier is not None:
            with single_thread(), torch.no_grad():
                logits = self._classifier(torch.from_numpy(points))
                survival = torch.sigmoid(logits).mean(dim=0)[:, 0].numpy()
        return Prediction(mean=members.mean(axis=0), deviation=deviation, survival=survival)

    def _members(self, points: FloatArray) -> FloatArray:
        with single_thread(), torch.no_grad():
            outputs = self._regressor(torch.from_numpy(points)).numpy()
        members: FloatArray = self._offset + self._scale * outputs
        return members


def fit(
    x: ArrayLike,
    outputs: ArrayLike,
    survived: ArrayLike,
    *,
    seed: int = 0,
    settings: NetworkSettings | None = None,
) -> Surrogate:
    """Train the network.

    The same walks and seed give the same network on the same machine, in any thread, whatever
    torch's defaults are there.

    Args:
        x: Design vectors, shape (n, d).
        outputs: What was simulated, shape (n, k); rows of fallen walks, or with what is not
            finite, are not used.
        survived: Whether each walk survived, shape (n,).
        seed: Fixes initial weights and folds.
        settings: Size of the network, and how long it learns.

    Raises:
        SettingsError: fewer walks can be learnt than a network can be fitted to, or a shape or a
            number cannot be used.
    """
    x, outputs, survived = checked_walks(x, outputs, survived)
    learnt = learnable(outputs, survived)
    count = int(learnt.sum())
    if count < FEWEST_SURVIVORS:
        endless = int(survived.sum()) - count
        without = f", {endless} more without finite outputs" if endless else ""
        raise SettingsError(
            f"{count} of {len(x)} walks survived{without}; the network needs {FEWEST_SURVIVORS}: "
            "draw more samples, or move the box to gaits that walk"
        )
    with learning():
        return _fitted(x, outputs, survived, learnt, seed, settings or NetworkSettings())


def _fitted(
    x: FloatArray,
    outputs: FloatArray,
    survived: BoolArray,
    learnt: BoolArray,
    seed: int,
    settings: NetworkSettings,
) -> Surrogate:
    generator = torch.Generator(device="cpu").manual_seed(_seed_for_torch(seed))
    targets, count = outputs[learnt], int(learnt.sum())
    scaling = (targets.mean(axis=0), np.maximum(targets.std(axis=0), 1e-12))
    x_learnt = torch.from_numpy(x[learnt])
    folds = folds_of(count, seed)
    regressor = _Ensemble(x.shape[1], outputs.shape[1], generator, settings)
    regressor.train(_Loss((targets - scaling[0]) / scaling[1], folds, logistic=False), x_learnt)

    classifier, survival_heldout = None, np.ones(len(x))
    if not survived.all():
        classifier = _Ensemble(x.shape[1], 1, generator, settings)
        labels, leaves_out = survived[:, None].astype(float), folds_of(len(x), seed)
        classifier.train(_Loss(labels, leaves_out, logistic=True), torch.from_numpy(x))
        with torch.no_grad():
            survival = torch.sigmoid(classifier(torch.from_numpy(x))).numpy()
        survival_heldout = survival[leaves_out, np.arange(len(x)), 0]

    with torch.no_grad():
        members = regressor(x_learnt).numpy()
    heldout = scaling[0] + scaling[1] * members[folds, np.arange(count)]
    return Surrogate(
        regressor, classifier, scaling, heldout, survival_heldout, x, outputs, survived
    )


class SingleNetwork:
    """The paper's network: one, of all walks, without a word about its errors; see `fit_single`."""

    def __init__(self, network: _Ensemble, scaling: tuple[FloatArray, FloatArray]) -> None:
        self._network = network
        self._offset, self._scale = scaling

    def predict(self, x: ArrayLike) -> Prediction:
        """Predictions for design vectors, shape (n, d); they admit no doubt.

        Raises:
            SettingsError: x has another shape, or is no array of real numbers.
        """
        points = _points(x, self._network.hidden.shape[1])
        with single_thread(), torch.no_grad():
            outputs = self._network(torch.from_numpy(points)).numpy()[0]
        mean: FloatArray = self._offset + self._scale * outputs
        return Prediction(mean=mean, deviation=np.zeros_like(mean), survival=np.ones(len(points)))


def fit_single(
    x: ArrayLike,
    targets: ArrayLike,
    *,
    seed: int = 0,
    settings: NetworkSettings = PAPER_NETWORK,
) -> SingleNetwork:
    """Train the paper's network of 16 - 20 - k units on all walks, with nothing held out.

    Args:
        x: Design vectors, shape (n, d).
        targets: What was simulated, shape (n, k).
        seed: Fixes initial weights.
        settings: Size of the network, and how long it learns; the paper's by default.

    Raises:
        SettingsError: a shape or a number cannot be used.
    """
    x = numbers("x", x)
    x, targets, _ = checked_walks(x, targets, np.ones(x.shape[:1]))
    if not len(x):
        raise SettingsError("x must have at least one row; a network learns from walks")
    _refuse_infinite("targets", targets)
    scaling = (targets.mean(axis=0), np.maximum(targets.std(axis=0), 1e-12))
    standard = torch.from_numpy((targets - scaling[0]) / scaling[1])

    def loss(outputs: torch.Tensor) -> torch.Tensor:
        return 0.5 * ((outputs - standard) ** 2).mean()  # Eq. 21

    with learning():
        generator = torch.Generator(device="cpu").manual_seed(_seed_for_torch(seed))
        network = _Ensemble(x.shape[1], targets.shape[1], generator, settings, members=1)
        network.train(loss, torch.from_numpy(x))
    return SingleNetwork(network, scaling)


def _points(x: ArrayLike, d: int) -> FloatArray:
    """Design vectors as torch takes them, shape (n, d)."""
    ready = isinstance(x, np.ndarray) and x.dtype == np.float64
    points = np.require(x, np.float64, ["C", "W"]) if ready else numbers("x", x)
    if points.ndim != 2 or points.shape[1] != d:
        raise SettingsError(f"x must be (n, {d}) in shape, got {points.shape}")
    return points


def _refuse_infinite(name: str, array: FloatArray) -> None:
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise SettingsError(
            f"{name} must be finite, got {array[row, column]} in row {row}, column {column}"
        )


def checked_walks(
    x: ArrayLike, outputs: ArrayLike, survived: ArrayLike
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Copies of what is learnt from: x (n, d), outputs (n, k), who survived (n,).

    Raises:
        SettingsError: a shape does not fit, or a number cannot be used.
    """
    points, values = numbers("x", x), numbers("outputs", outputs)
    alive = np.atleast_1d(numbers("survived", survived))
    for name, array, shape in (("x", points, "(n, d)"), ("outputs", values, "(n, k)")):
        if array.ndim != 2:
            raise SettingsError(f"{name} must be {shape} in shape, got {array.shape}")
    for name, array in (("outputs", values), ("survived", alive)):
        if len(array) != len(points):
            raise SettingsError(
                f"{name} must have a row for each of {len(points)} walks in x, "
                f"got {array.shape} in shape"
            )
    if alive.ndim != 1 or not np.isin(alive, (0.0, 1.0)).all():
        raise SettingsError("survived must be (n,) in shape, each True or False")
    _refuse_infinite("x", points)
    return points, values, alive.astype(np.bool_)


def _seed_for_torch(seed: int) -> int:
    """A seed as torch takes it, of 64 bits; those of more are mixed down to so many."""
    if seed < 2**64:
        return seed
    return int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])


def folds_of(count: int, seed: int) -> IntArray:
    """The member that leaves each walk out, shape (count,)."""
    return np.random.default_rng([seed, count]).permutation(count) % _MEMBERS


def r_squared(targets: FloatArray, predicted: FloatArray) -> FloatArray:
    """Coefficient of determination of each column, shape (k,), from two arrays (n, k)."""
    residual = ((targets - predicted) ** 2).sum(axis=0)
    total = ((targets - targets.mean(axis=0)) ** 2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        value: FloatArray = 1.0 - residual / total
    return value
