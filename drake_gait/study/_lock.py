"""Who may write a study: one driver at a time, by a lock that dies with its process."""

import fcntl
import time
from pathlib import Path
from typing import IO

from drake_gait.errors import StudyError

_PATIENCE = (0.1, 0.1, 0.0)
"""Waits between trials [s]: `is_driven` holds the lock for a moment."""


def driver_lock(path: Path) -> IO[str]:
    """Hold the study file `path` for this process alone, until what is returned is closed.

    Raises:
        StudyError: another process holds it, or its folder cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_suffix(".lock").open("w")
    except OSError as error:
        raise StudyError(f"cannot write in {path.parent}: {error.strerror}") from None
    for wait in _PATIENCE:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            time.sleep(wait)
        else:
            return lock
    lock.close()
    raise StudyError(
        f"another process is working on {path.parent}; wait for it, stop it, or give --out"
    )


def is_driven(path: Path) -> bool:
    """Whether any process holds the study file `path` as its driver at this moment."""
    try:
        lock = path.with_suffix(".lock").open()
    except OSError:
        return False
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False
