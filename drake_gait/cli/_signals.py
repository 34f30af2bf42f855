"""Ctrl-C, and SIGTERM, which a cluster sends when a job's time is over, end a command alike."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from drake_gait.execution.machine import ONE_THREAD

INTERRUPTED, TERMINATED = 130, 143
"""Exit status after Ctrl-C and after SIGTERM, as shells have it."""

_STATUS = {signal.SIGINT: INTERRUPTED, signal.SIGTERM: TERMINATED}


class Terminated(KeyboardInterrupt):
    """SIGTERM: what ends at Ctrl-C ends at this too."""


def begin() -> None:
    """Prepare this process to be a command, before its slow imports.

    Ctrl-C and SIGTERM end it at once. A standard stream that is closed leads nowhere: else the next
    file that is opened would take its place, and what is printed. No window is ever opened, so that
    matplotlib needs not know the one that a user prefers elsewhere. Libraries compute in one
    thread, unless the environment says how many.
    """
    ctrl_c_ends_at_once()
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # The lowest that is free.
    os.environ.pop("MPLBACKEND", None)
    if not ONE_THREAD.keys() & os.environ.keys():  # Libraries that are not named follow OMP's.
        os.environ.update(ONE_THREAD)


def ctrl_c_ends_at_once() -> None:
    """Have Ctrl-C and SIGTERM end this process in one line, until a command begins its work.

    While Drake and torch are imported there is nothing to put in order. An import that an exception
    breaks off takes seconds to say so, in many lines. A process that does not hear a
    signal goes on not to hear it.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end_at_once)
    if signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _end_at_once)


@contextmanager
def importing() -> Iterator[None]:
    """Inside, Ctrl-C and SIGTERM end this process in one line: for slow imports amid a command.

    An import that an exception breaks off takes seconds to say so, in many lines. A signal that is
    not heard, or that somebody else hears, stays so.
    """
    if not _in_main_thread():
        yield
        return
    ours = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: _raise_once}
    before = {number: signal.getsignal(number) for number in ours}
    changed = [number for number, handler in ours.items() if before[number] is handler]
    for number in changed:
        signal.signal(number, _end_at_once)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, before[number])


@contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Inside, SIGTERM raises Terminated and Ctrl-C KeyboardInterrupt in the main thread.

    Another thread hears no signals, and leaves them as they are.
    """
    if not _in_main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _STATUS}
    if before[signal.SIGINT] in (signal.SIG_DFL, _end_at_once):
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if before[signal.SIGTERM] != signal.SIG_IGN:
        signal.signal(signal.SIGTERM, _raise_once)
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # One that is not Python's cannot be put back.
                signal.signal(number, handler)


def exit_status(interruption: KeyboardInterrupt) -> int:
    """Return the status that a command ends with."""
    return TERMINATED if isinstance(interruption, Terminated) else INTERRUPTED


@contextmanager
def signals_ignored() -> Iterator[None]:
    """Inside, neither Ctrl-C nor SIGTERM is heard: for the last words of a command."""
    if not _in_main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in _STATUS}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)


def leave(status: int) -> NoReturn:
    """End this process with a command's status; at once where it was interrupted.

    By then the study is closed and its workers are gone, and Python would take longer than both to
    take torch down. A signal that comes during that changes nothing any more.
    """
    for number in _STATUS:
        signal.signal(number, signal.SIG_IGN)
    if status in (INTERRUPTED, TERMINATED):
        import atexit

        atexit._run_exitfuncs()  # What Dask and multiprocessing have left to put away.
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (AttributeError, OSError, ValueError):
                continue  # Nobody hears it.
        os._exit(status)
    sys.exit(status)


def _in_main_thread() -> bool:

    return threading.current_thread() is threading.main_thread()


def _raise_once(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)  # A second one must not break off the cleaning up.
    raise Terminated


def _end_at_once(number: int, frame: FrameType | None) -> None:
    try:
        os.write(2, b"stopped\n")
    finally:
        os._exit(_STATUS[signal.Signals(number)])
