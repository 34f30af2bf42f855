"""Learning and predicting leave torch, BLAS and random numbers as the caller has them."""

import random
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from conftest import QUICK_NETWORK
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import ThreadpoolController

from drake_gait.errors import SettingsError
from drake_gait.surrogates.arithmetic import learning, single_thread
from drake_gait.surrogates.baselines import compare
from drake_gait.surrogates.ensemble import fit, fit_single
from drake_gait.surrogates.prediction import FEWEST_SURVIVORS
from drake_gait.surrogates.residual_gp import KrigedNetwork

X = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 5)).round(3)
Y = np.stack([X[:, 0] * X[:, 1], np.sin(X[:, 2])], axis=1).round(3)
SURVIVED = X[:, 3] < 0.6
NEW = np.random.default_rng(1).uniform(-1.0, 1.0, (9, 5)).round(3)


def everything(x=X, y=Y, survived=SURVIVED, new=NEW, *, seed=0, baselines=False):
    """All numbers that come out of all that learns, as bytes."""
    network = fit(x, y, survived, seed=seed, settings=QUICK_NETWORK)
    since = KrigedNetwork(network, new, np.zeros((len(NEW), 2)), np.arange(len(NEW)) > 3)
    single = fit_single(x, y, seed=seed, settings=QUICK_NETWORK)
    predicted = [one.predict(new) for one in (network, since, single)]
    arrays = [array for one in predicted for array in (one.mean, one.deviation, one.survival)]
    arrays += [network.heldout, network.fitted]
    if baselines:
        compared = compare(network, x, y, survived, seed=seed)
        arrays += [compared.ridge, compared.kriging]
    assert all(array.dtype == np.float64 for array in arrays)
    return b"".join(array.tobytes() for array in arrays)


@pytest.fixture(scope="module")
def expected():
    return everything()


@pytest.fixture(scope="module")
def learnt():
    """A network with cross-validation and a single one."""
    return fit(X, Y, SURVIVED, settings=QUICK_NETWORK), fit_single(X, Y, settings=QUICK_NETWORK)


def blas_threads():
    libraries = ThreadpoolController().select(user_api="blas").info()
    return [library["num_threads"] for library in libraries]


@pytest.fixture
def two_threads():
    """torch and BLAS with two threads each, whatever the machine has."""
    before, libraries = torch.get_num_threads(), ThreadpoolController()
    torch.set_num_threads(2)
    # In a thread that ends: threadpoolctl lets the one that set a limit alone change it.
    limiter = in_a_thread(lambda: libraries.limit(limits=2, user_api="blas"))
    yield
    in_a_thread(limiter.restore_original_limits)
    torch.set_num_threads(before)


def in_a_thread(function):
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(function).result()


@pytest.mark.usefixtures("two_threads")
def test_threads_are_as_many_afterwards_as_before_here_and_in_other_threads(expected):
    assert everything(baselines=True).startswith(expected)
    assert torch.get_num_threads() == in_a_thread(torch.get_num_threads) == 2
    assert set(blas_threads()) == {2}


@pytest.mark.usefixtures("two_threads")
def test_one_thread_computes_inside_and_a_thread_that_begins_then_has_its_own():
    with single_thread():
        assert torch.get_num_threads() == 1
        assert set(blas_threads()) == {1}
        with learning():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 1
        assert in_a_thread(torch.get_num_threads) == 2
    assert torch.get_num_threads() == 2


@pytest.mark.usefixtures("two_threads")
def test_contexts_of_threads_that_overlap_leave_what_was_there():
    entered, leave = threading.Event(), threading.Event()
    seen = []

    def other():
        with single_thread():
            entered.set()
            assert leave.wait(20.0)
            seen.append((torch.get_num_threads(), set(blas_threads())))
        seen.append((torch.get_num_threads(), set(blas_threads())))

    thread = threading.Thread(target=other)
    with single_thread():
        thread.start()
        assert entered.wait(20.0)
    leave.set()  # The first to enter has left first.
    thread.join()
    assert seen == [(1, {1}), (2, {2})]
    assert torch.get_num_threads() == in_a_thread(torch.get_num_threads) == 2


@pytest.mark.usefixtures("two_threads")
def test_a_limit_of_the_caller_s_is_lowered_inside_and_stays():
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        with single_thread():
            assert set(blas_threads()) == {1}
        assert set(blas_threads()) == {2}


@pytest.mark.usefixtures("two_threads")
def test_an_error_inside_gives_the_threads_back():
    with pytest.raises(SettingsError), learning():
        fit(X, Y, np.zeros(len(X), dtype=bool))
    with pytest.raises(KeyboardInterrupt), single_thread():
        raise KeyboardInterrupt
    assert torch.get_num_threads() == 2
    assert set(blas_threads()) == {2}


@pytest.mark.parametrize(
    "surroundings",
    [
        torch.no_grad,
        torch.inference_mode,
        lambda: torch.device("meta"),
        lambda: torch.autocast("cpu", torch.bfloat16),
        lambda: torch.set_grad_enabled(False),
    ],
)
def test_the_caller_s_modes_change_no_number_and_stay(expected, surroundings):
    with surroundings():
        before = torch.is_grad_enabled(), torch.is_inference_mode_enabled()
        device = torch.get_default_device()
        assert everything() == expected
        assert (torch.is_grad_enabled(), torch.is_inference_mode_enabled()) == before
        assert torch.get_default_device() == device


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16, torch.bfloat16])
def test_the_caller_s_default_type_changes_no_number_and_stays(expected, dtype):
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        assert everything() == expected
        assert torch.get_default_dtype() == dtype
    finally:
        torch.set_default_dtype(before)


def test_the_caller_s_default_device_changes_no_number_and_stays(expected):
    torch.set_default_device("meta")
    try:
        assert everything() == expected
        assert torch.get_default_device().type == "meta"
    finally:
        torch.set_default_device(None)


def test_the_global_random_numbers_are_left_alone():
    states = torch.get_rng_state().tolist(), np.random.get_state()[1].tolist()  # noqa: NPY002
    plain = random.getstate()
    everything()
    assert states[0] == torch.get_rng_state().tolist()
    assert states[1] == np.random.get_state()[1].tolist()  # noqa: NPY002
    assert plain == random.getstate()


@pytest.mark.slow
def test_fits_in_threads_give_what_they_give_one_after_the_other():
    alone = [everything(seed=seed, baselines=True) for seed in range(2)]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(lambda seed: everything(seed=seed, baselines=True), range(2)))
    assert together == alone
    assert ("ignore", None, ConvergenceWarning, None, 0) not in warnings.filters


@pytest.mark.parametrize(
    "form",
    [
        np.ndarray.tolist,
        np.asfortranarray,
        lambda array: array[::-1][::-1],
        lambda array: array.astype(">f8") if array.dtype == float else array.astype(np.int8),
        lambda array: torch.from_numpy(array),
        lambda array: (row for row in array),
    ],
    ids=["list", "columns", "view", "big endian", "tensor", "generator"],
)
def test_numbers_in_every_form_are_learnt_alike(learnt, form):
    network = fit(form(X), form(Y), form(SURVIVED), settings=QUICK_NETWORK)
    plain, plain_single = learnt
    assert network.heldout.tobytes() == plain.heldout.tobytes()
    assert network.predict(form(NEW)).mean.tobytes() == plain.predict(NEW).mean.tobytes()
    single = fit_single(form(X), form(Y), settings=QUICK_NETWORK).predict(form(NEW))
    assert single.mean.tobytes() == plain_single.predict(NEW).mean.tobytes()


def test_single_precision_is_learnt_as_the_numbers_that_it_holds():
    x, y, new = (array.astype(np.float32) for array in (X, Y, NEW))
    doubled = everything(*(array.astype(np.float64) for array in (x, y)), SURVIVED, NEW)
    assert everything(x, y, SURVIVED, NEW) == doubled
    network = fit(x, y, SURVIVED, settings=QUICK_NETWORK)
    assert network.predict(new).mean.dtype == np.float64


def test_numbers_that_may_not_be_written_are_learnt_without_a_warning(expected):
    arrays = [array.copy() for array in (X, Y, SURVIVED, NEW)]
    for array in arrays:
        array.setflags(write=False)
    assert everything(*arrays) == expected


def test_training_data_may_change_after_the_fit():
    x, y, survived = X.copy(), Y.copy(), SURVIVED.copy()
    network = fit(x, y, survived, settings=QUICK_NETWORK)
    x[:], y[:], survived[:] = 0.0, 0.0, False
    assert network.x.tolist() == X.tolist()
    assert network.targets.tolist() == Y[SURVIVED].tolist()


@pytest.mark.parametrize("endless", [np.inf, -np.inf, np.nan])
def test_a_walk_that_left_no_number_is_not_learnt_but_has_survived(endless):
    outputs = Y.copy()
    lost = np.flatnonzero(SURVIVED)[[0, 7]]
    outputs[lost, 1] = endless
    network = fit(X, outputs, SURVIVED, settings=QUICK_NETWORK)
    assert np.isfinite(network.predict(NEW).mean).all()
    assert len(network.targets) == SURVIVED.sum() - 2
    assert network.survived.tolist() == SURVIVED.tolist()
    kriged = KrigedNetwork(network, X, outputs, SURVIVED).predict(NEW)
    assert np.isfinite(kriged.mean).all()
    assert np.isfinite(compare(network, X, outputs, SURVIVED).ridge).all()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"x": X[:, 0]}, r"x must be \(n, d\) in shape, got \(60,\)"),
        ({"outputs": Y[:, 0]}, r"outputs must be \(n, k\) in shape, got \(60,\)"),
        ({"outputs": Y[:9]}, r"outputs .* 60 walks in x, got \(9, 2\)"),
        ({"survived": [0, 3, 5]}, r"survived .* 60 walks in x, got \(3,\)"),
        ({"survived": np.arange(60)}, "survived must be .* True or False"),
        ({"survived": np.ones((60, 1))}, "survived must be .* True or False"),
        ({"x": np.where(X[7, 2] == X, np.nan, X)}, "x must be finite, got nan in row 7, column 2"),
        ({"x": X.astype(str)}, "x must be real numbers"),
        ({"outputs": Y + 0j}, "outputs"),
        (
            {"outputs": np.where(np.arange(60)[:, None] < FEWEST_SURVIVORS - 1, Y, np.inf)},
            "without finite outputs",
        ),
    ],
)
def test_unusable_training_data_are_refused_by_their_fault(wrong, words):
    with pytest.raises(SettingsError, match=words):
        fit(**{"x": X, "outputs": Y, "survived": SURVIVED} | wrong)


@pytest.mark.parametrize("new", [NEW[0], NEW[:, :4], "x", NEW[:, :, None], None])
def test_points_of_another_shape_are_refused(learnt, new):
    for network in learnt:
        with pytest.raises(SettingsError, match="x must be"):
            network.predict(new)


def test_targets_that_are_no_numbers_are_refused_by_row():
    with pytest.raises(SettingsError, match=r"targets.*inf in row 3, column 1"):
        fit_single(X, np.where(Y[3, 1] == Y, np.inf, Y))
