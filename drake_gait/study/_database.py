"""The SQLite file of a study: opened so that a copy of it alone is the study, at any moment.

The driver commits into SQLite's write-ahead log, which costs no wait for the disk (`synchronous =
normal`). A thread brings the commits into the file itself at most half a second later, and empties
the log. Closing the file removes the log. So a copy of the file lacks the last moments at most.

Readers create, change and lock nothing that a driver could trip over. Beside a driver they read its
log. A study that nobody drives is read with what a killed driver has left in the log. That takes no
lock, no shared memory and no room, so full, read-only and lockless disks will do. The driver of
another computer shares no memory with a reader, who sees the file itself.
"""

import os
import sqlite3
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from typing import IO, Any

from drake_gait.errors import StudyError
from drake_gait.study._lock import is_driven, is_driven_elsewhere

_PAUSE = 0.5
"""Shortest time between two emptyings of the log [s]."""
_WAITS = (0.0, 0.02, 0.1, 0.3, 0.6)
"""Waits for others to be through with the file [s]."""

Rows = list[tuple[Any, ...]]


class Database:
    """A study's SQLite file: of its driver, who has a lock, or of a reader.

    Args:
        path: The file.
        lock: The driver's lock, which closes with the file; None for a reader.

    Raises:
        StudyError: the file is damaged, or cannot be read (or, by its driver, written).
    """

    def __init__(self, path: Path, lock: IO[str] | None) -> None:
        self.path = path
        self._lock = lock
        self._driver: sqlite3.Connection | None = None
        self._emptying: _Emptying | None = None
        if lock is None:
            self.rows("pragma schema_version", check=True)
            return
        with reporting(path):
            self._driver = _whole(_connect(path, "mode=rw"), path)
            self._identity = _identity(path)

    def begin_writing(self) -> None:
        """Have the driver commit into a log; before this, nothing of the file is changed.

        Raises:
            StudyError: the file cannot be written.
        """
        if self._driver is None:
            raise self._readonly()
        with self._in_place():
            self._driver.execute("pragma journal_mode = wal").fetchall()
            # A power cut loses the last moments, and the file stays sound.
            self._driver.execute("pragma synchronous = normal").fetchall()
        self._emptying = _Emptying(self.path)
        weakref.finalize(self, self._emptying.stop)  # The thread ends with a forgotten study.

    def rows(self, statement: str, *, check: bool = False) -> Rows:
        """Everything that a query finds.

        Args:
            statement: The query.
            check: Whether to go through the whole file first, for damage.

        Raises:
            StudyError: the file cannot be read, or is damaged.
        """
        if self._driver is not None:
            with reporting(self.path):
                return self._driver.execute(statement).fetchall()
        with reporting(self.path):
            return _read(self.path, statement, check=check)

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction: committed at the end, or not at all.

        Raises:
            StudyError: the file cannot be written, or is no longer where it was.
        """
        if self._driver is None or self._emptying is None:
            raise self._readonly()
        with self._in_place():
            self._emptying.require_success()
            with self._driver:
                yield self._driver
        self._emptying.begin()

    def close(self) -> None:
        """Close the file, as one file that is complete, and let another driver have it."""
        if self._driver is None or self._lock is None:
            return
        try:
            if self._emptying is not None:
                self._emptying.end()
                with suppress(sqlite3.DatabaseError, StudyError):  # On a full disk the log stays.
                    self._settle(self._driver)
        finally:
            self._driver.close()
            self._driver = None
            self._lock.close()

    def _readonly(self) -> StudyError:
        return StudyError(f"{self.path} is open readonly; Study.open(path, driver=True) writes")

    def _settle(self, connection: sqlite3.Connection) -> None:
        """Empty the log, and remove it if nobody else reads it just now."""
        connection.execute("pragma busy_timeout = 100").fetchall()
        connection.execute("pragma wal_checkpoint(truncate)").fetchall()
        self._require_in_place()  # Else SQLite might remove the log of another study.
        for wait in _WAITS:
            time.sleep(wait)
            with suppress(sqlite3.OperationalError):
                connection.execute("pragma journal_mode = delete").fetchall()
                return

    @contextmanager
    def _in_place(self) -> Iterator[None]:
        """Inside, the file is written; an error that comes of its absence says so."""
        self._require_in_place()
        try:
            with reporting(self.path):
                yield
        except StudyError:
            self._require_in_place()
            raise

    def _require_in_place(self) -> None:
        """Refuse to write a file that has lost its name: nobody would find the walks."""
        try:
            moved = _identity(self.path) != self._identity
            why = "another file has its name"
        except OSError as error:
            moved, why = True, str(error.strerror)
        if moved:
            raise StudyError(
                f"{self.path} was deleted, moved or made unreadable while its study ran ({why}); "
                "put it back, or give --out, and run the command again"
            )


class _Emptying:
    """A thread that empties the log of a study file soon after every commit."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._changed, self._stopping = Event(), Event()
        self._error: sqlite3.Error | None = None
        self._thread = Thread(target=self._run, name="study file", daemon=True)
        self._thread.start()

    def begin(self) -> None:
        """Have the log emptied."""
        self._changed.set()

    def stop(self) -> None:
        """Have the thread end."""
        self._stopping.set()
        self._changed.set()

    def end(self) -> None:
        """End the thread, and wait until it has ended."""
        self.stop()
        self._thread.join()

    def require_success(self) -> None:
        """Raise the error that the log could not be emptied for, if there was one."""
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            # No patience: the driver must not wait for who makes this thread wait.
            with closing(_connect(self._path, "mode=rw", timeout=0.0)) as connection:
                while self._changed.wait() and not self._stopping.is_set():
                    self._changed.clear()
                    if not _emptied(connection):
                        self._changed.set()
                    self._stopping.wait(_PAUSE)
        except sqlite3.Error as error:
            self._error = error


def _emptied(connection: sqlite3.Connection) -> bool:
    """Empty the log as far as readers let it; True if nothing is left."""
    try:
        ((busy, *_),) = connection.execute("pragma wal_checkpoint(truncate)").fetchall()
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in _LOCKED:
            raise
        return False
    return not busy


@contextmanager
def reporting(path: Path) -> Iterator[None]:
    """Turns what SQLite says into one line for the user."""
    try:
        yield
    except (sqlite3.ProgrammingError, sqlite3.InterfaceError):
        raise  # A bug of ours.
    except sqlite3.DatabaseError as error:
        raise _study_error(path, error) from None
    except OSError as error:
        raise StudyError(f"study file {path} cannot be read: {error.strerror}") from None


def damaged(path: Path, why: object) -> StudyError:
    """The error of a file that cannot be read as a study."""
    reason = " ".join(str(why).split())
    return StudyError(
        f"{path} is no study, or is damaged or incomplete ({reason}); copy it again, put back a "
        "copy, or give --out for another folder"
    )


# What SQLite reports of a file that is no database, of a broken one, and of one without our tables.
_NO_STUDY = (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)
_LOCKED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def _study_error(path: Path, error: sqlite3.DatabaseError) -> StudyError:
    # Python, not SQLite, finds out that text is none.
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF
    if code in _NO_STUDY:
        return damaged(path, error)
    if code in _LOCKED:
        return StudyError(
            f"study file {path}: {error}; close the program that has it open, or, where its file "
            "system has no locks, give --out for a folder on a local disk"
        )
    return StudyError(
        f"study file {path}: {error}; what it holds is safe: free space, or permit reading and "
        "writing, and run the command again"
    )


def _reader(path: Path) -> sqlite3.Connection:
    """A connection that leaves everything as it is."""
    log = Path(f"{os.path.realpath(path)}-wal")
    if is_driven_elsewhere(path):
        return _connect(path, "mode=ro&immutable=1")
    if is_driven(path):
        return _connect(path, "mode=ro")
    if not (log.is_file() and log.stat().st_size):
        return _connect(path, "mode=ro&immutable=1")
    # In exclusive mode SQLite keeps its index of the log in its own memory, and nobody needs one.
    connection = _connect(path, "mode=ro&vfs=unix-none")
    connection.execute("pragma locking_mode = exclusive").fetchall()
    return connection


def _connect(path: Path, options: str, timeout: float = 5.0) -> sqlite3.Connection:
    uri = Path(os.path.realpath(path)).as_uri()
    # A study may be opened in one thread and run in another: SQLite serialises their calls.
    return sqlite3.connect(f"{uri}?{options}", timeout=timeout, uri=True, check_same_thread=False)


def _read(path: Path, statement: str, *, check: bool) -> Rows:
    for wait in _WAITS:
        try:
            with closing(_reader(path)) as connection:
                if check:
                    _whole(connection, path)
                return connection.execute(statement).fetchall()
        except sqlite3.DatabaseError:
            if wait == _WAITS[-1] or not is_driven(path):
                raise
            time.sleep(wait)  # It may have been read while it was written.
    raise AssertionError


def _whole(connection: sqlite3.Connection, path: Path) -> sqlite3.Connection:
    """The same connection, to a file whose end is there and whose pages fit together."""
    try:
        ((found,), *_) = connection.execute("pragma quick_check(1)").fetchall()
        ((size,),) = connection.execute("pragma page_size").fetchall()
        if path.stat().st_size % size:  # SQLite takes the rest of a page to be zeros.
            found = "its end is missing"
        if found != "ok":
            raise sqlite3.DatabaseError(found)
    except sqlite3.DatabaseError:
        connection.close()
        raise
    return connection


def _identity(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_dev, status.st_ino


def write_new(path: Path, statements: Sequence[tuple[str, Sequence[Any]]]) -> None:
    """Write a database that has its name only when it is complete.

    Args:
        path: Where.
        statements: What fills it, each with its values.

    Raises:
        StudyError: it cannot be written.
    """
    beginning = path.with_suffix(".new")
    try:
        beginning.unlink(missing_ok=True)
        with reporting(path), closing(_connect(beginning, "mode=rwc")) as connection:
            # A log of its own could outlive it, and be taken for that of the next beginning.
            connection.execute("pragma journal_mode = off").fetchall()
            with connection:
                for statement, values in statements:
                    connection.execute(statement, values)
        beginning.replace(path)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror}") from None
