"""Arithmetic that is the same on every machine, and leaves torch and BLAS as the caller has them.

Our matrices are small: one thread computes them fastest, and its last digits depend on no number
of cores. Threads, gradients and the default device belong to whoever calls. They are changed
inside a context, and are afterwards as they were.
"""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache

import torch
from threadpoolctl import ThreadpoolController


@contextmanager
def single_thread() -> Iterator[None]:
    """Inside, torch computes in the calling thread alone, and BLAS in whichever calls it."""
    before = torch.get_num_threads()
    with ExitStack() as cleanup:
        _blas.enter()
        cleanup.callback(_blas.leave)
        if _blas_threads() > 1:  # A limit that the caller has set can be lowered here only.
            cleanup.enter_context(_libraries().limit(limits=1, user_api="blas"))
        if before != 1:
            cleanup.callback(torch.set_num_threads, before)
            _set_torch_threads(1, elsewhere=before)
        yield


@contextmanager
def learning() -> Iterator[None]:
    """Inside, tensors are made on the processor, have gradients, and one thread computes them."""
    with ExitStack() as modes:
        modes.enter_context(single_thread())
        modes.enter_context(torch.inference_mode(mode=False))
        modes.enter_context(torch.enable_grad())
        if torch.get_default_device().type != "cpu":
            modes.enter_context(torch.device("cpu"))
        yield


_lock = threading.Lock()


def _set_torch_threads(count: int, *, elsewhere: int) -> None:
    """Give this thread a number of threads, and another one to threads that begin later.

    Torch keeps one number for each thread that has computed, and one for those to come. It sets
    both at once.
    """
    with _lock:
        torch.set_num_threads(count)
        other = threading.Thread(target=torch.set_num_threads, args=(elsewhere,), daemon=True)
        other.start()
        other.join()


class _Blas:
    """BLAS in one thread for as long as anyone is inside.

    It has one number of threads for the whole process, and threadpoolctl lets only the thread that
    lowered it raise it again. So a thread of its own does both: those who are inside may leave in
    any order.
    """

    def __init__(self) -> None:
        self._inside = 0
        self._keeper: threading.Thread | None = None
        self._left = threading.Event()

    def enter(self) -> None:
        """Come in; the first one has the number lowered."""
        with _lock:
            if self._inside == 0 and _blas_threads() > 1:
                entered, self._left = threading.Event(), threading.Event()
                self._keeper = threading.Thread(
                    target=_keep_blas, args=(entered, self._left), daemon=True
                )
                self._keeper.start()
                entered.wait()
            self._inside += 1

    def leave(self) -> None:
        """Go out; the last one has the number raised again."""
        with _lock:
            self._inside -= 1
            if self._inside == 0 and self._keeper is not None:
                self._left.set()
                self._keeper.join()
                self._keeper = None


_blas = _Blas()


def _keep_blas(entered: threading.Event, left: threading.Event) -> None:
    with _libraries().limit(limits=1, user_api="blas"):
        entered.set()
        left.wait()


def _blas_threads() -> int:
    controllers = _libraries().select(user_api="blas").lib_controllers
    return max((one.num_threads for one in controllers), default=1)


@cache
def _libraries() -> ThreadpoolController:
    """The libraries of numpy and scipy, which are loaded by now: to look for them takes long."""
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()
