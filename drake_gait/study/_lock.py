"""Lock of a study: one driver at a time writes it. The lock dies with its process."""

import errno
import fcntl
import os
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import IO

from drake_gait.errors import StudyError

_PATIENCE = (0.1, 0.1, 0.0)
"""Waits between trials [s]: `is_driven` holds the lock for a moment."""

_HELD = frozenset({errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES})
"""Errors by which a file system says that somebody has the lock; any other says it has no locks."""


def driver_lock(path: Path) -> IO[str]:
    """Hold the study file `path` for this process alone, until the returned file is closed.

    Raises:
        StudyError: another process holds it, its folder cannot be written, or its file system has
            no locks.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = _lock_file(path).open("a+", encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write in {path.parent}: {error.strerror}") from None
    for wait in _PATIENCE:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _HELD:
                lock.close()
                raise StudyError(
                    f"the file system of {path.parent} has no locks ({error.strerror}), which keep "
                    "two processes off one study; give --out for a folder on a local disk"
                ) from None
            time.sleep(wait)
        else:
            _sign(lock)
            return lock
    with lock:
        raise StudyError(
            f"another process is working on {path.parent}{_holder(lock)}; wait for it, stop it, or "
            "give --out"
        )


def is_driven(path: Path) -> bool:
    """Return whether any process holds the study file `path` as its driver at this moment."""
    try:
        lock = _lock_file(path).open(encoding="utf-8")
    except OSError:
        return False
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError as error:
            return error.errno in _HELD
    return False


def is_driven_elsewhere(path: Path) -> bool:
    """Return whether the driver of the study file `path` runs on another computer."""
    if not is_driven(path):
        return False
    with suppress(OSError, UnicodeDecodeError):
        signature = _lock_file(path).read_text(encoding="utf-8").split()
        return len(signature) == 2 and signature[0] != socket.gethostname()
    return False


def _lock_file(path: Path) -> Path:
    """The lock beside the file itself, by whatever link it was named; a copy has its own."""
    path = Path(os.path.realpath(path))
    return path.with_suffix(".lock") if path.suffix == ".db" else Path(f"{path}.lock")


def _sign(lock: IO[str]) -> None:
    """Write the computer and the process that hold a lock into it."""
    with suppress(OSError):  # Nothing depends on it: on a full disk the lock is held all the same.
        lock.truncate(0)
        os.write(lock.fileno(), f"{socket.gethostname()} {os.getpid()}\n".encode())


def _holder(lock: IO[str]) -> str:
    """The process that has signed a lock, as far as it can be read."""
    with suppress(OSError, UnicodeDecodeError):
        lock.seek(0)
        signature = lock.read().split()
        if len(signature) == 2:
            return f" (process {signature[1]} on {signature[0]})"
    return ""
