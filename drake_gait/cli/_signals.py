"""Ctrl-C, and SIGTERM, which a cluster sends when a job's time is over, end a command alike."""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

INTERRUPTED, TERMINATED = 130, 143
"""Exit status after Ctrl-C and after SIGTERM, as shells have it."""


class Terminated(KeyboardInterrupt):
    """SIGTERM: what ends at Ctrl-C ends at this too."""


def ctrl_c_ends_at_once() -> None:
    """Have Ctrl-C end this process without a word, until a command begins its work.

    While Drake and torch are imported there is nothing to put in order, and an import that an
    exception breaks off takes seconds to say so, in many lines.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # Else it is not heard.
        signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Inside, SIGTERM raises Terminated in the main thread.

    From here on Ctrl-C raises KeyboardInterrupt, if it ended the process until now. Another thread
    hears no signals, and leaves them as they are.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    before = signal.signal(signal.SIGTERM, _raise_once)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)


def exit_status(interruption: KeyboardInterrupt) -> int:
    """The status that a command ends with."""
    return TERMINATED if isinstance(interruption, Terminated) else INTERRUPTED


def leave(status: int) -> NoReturn:
    """End this process with a command's status; at once where it was interrupted.

    By then the study is closed and its workers are gone, and Python would take longer than both to
    take torch down.
    """
    if status in (INTERRUPTED, TERMINATED):
        atexit._run_exitfuncs()  # What Dask and multiprocessing have left to put away.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


def forget_pipe() -> None:
    """Go on without standard output: who reads it has seen enough, and has closed the pipe.

    Python would complain again when it closes its own end.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _raise_once(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)  # A second one must not break off the cleaning up.
    raise Terminated
