"""The study file: every walk ever simulated, in one SQLite database.

Tables (schema 3; SI units, angles in radians, numbers as full doubles):

    study   key, value      schema, settings, model_sha256 and versions, each as JSON
    walks   one row a walk  id is its place in the study; what it was simulated for (stage), of
                            which walk it is a variation and which one; the candidate, what it
                            did, its measures where they were taken, what was predicted of it,
                            when it finished and how long it took

`pandas.DataFrame(Study.open("runs/steady").table())` has all of it, and any SQLite tool reads it;
docs/reference/study.md lists the columns. The driver is the only writer and commits each walk as it
finishes (write-ahead log, synchronous = normal): a killed process loses none, a power cut at most
the last few.

A change of the columns is a new schema. Older ones down to schema 2 are read, with nothing in the
columns that they lack, and get those from the driver that goes on with them.
"""

import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from drake_gait.errors import StudyError
from drake_gait.study._lock import driver_lock
from drake_gait.study.records import COLUMNS, CONFIRMATIONS, NAMES, StudyWalk, from_row, to_row

SCHEMA = 3
_OLDEST = 2
_SINCE_OLDEST = frozenset({"peak_ground_reaction"})
"""Columns that a study of an older schema may lack."""

_WORDS = {"study.question", "box.chosen"}
"""Settings that change no walk: a study goes on when somebody mends their wording."""

_BUDGET = "search.simulations"
"""The setting that may change in a study: its walks are the same, there are more or fewer."""

_KINDS = {
    # No whole number stands for none.
    name: "real" if kind == "integer" and not constraints else kind
    for name, kind, *constraints in map(str.split, COLUMNS)
}
"""What a column's array holds."""
_DTYPES = {"integer": np.int64, "real": np.float64, "text": np.str_}
_MISSING = {"real": np.nan, "text": ""}


class Study:
    """An open study file: `with Study.open(path) as study: study.walks()`."""

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: IO[str] | None) -> None:
        self.path = path
        self._connection = connection
        self._lock = lock

    @classmethod
    def create(cls, path: Path, description: Mapping[str, Any]) -> Self:
        """Start a study file.

        Args:
            path: Where; its folder is made.
            description: What the study is (settings, model_sha256, versions), kept as JSON.

        Raises:
            StudyError: it cannot be written, or another driver has it.
        """
        with ExitStack() as cleanup:
            lock = cleanup.enter_context(driver_lock(path))
            if path.exists():
                raise StudyError(f"{path.parent} holds a study already; open it, or give --out")
            _write_empty(path, description)
            study = cls._opened(path, lock)
            cleanup.pop_all()
        return study

    @classmethod
    def open(cls, path: str | Path, *, driver: bool = False) -> Self:
        """Open a study to read it, or, as its driver, to add walks.

        Args:
            path: The study file, or the folder that holds it as study.db.
            driver: Whether to add walks.

        Raises:
            StudyError: there is none, it is none, it is of a newer schema, or, as driver, another
                driver has it.
        """
        path = study_file(path)
        if not path.is_file():
            raise StudyError(f"no study file {path}; `python -m drake_gait.optimize` makes one")
        with ExitStack() as cleanup:
            lock = cleanup.enter_context(driver_lock(path)) if driver else None
            study = cls._opened(path, lock)
            cleanup.pop_all()
        return study

    @classmethod
    def _opened(cls, path: Path, lock: IO[str] | None) -> Self:
        with ExitStack() as cleanup:
            connection = _connect(path, "rw" if lock else "ro")
            cleanup.callback(connection.close)
            study = cls(path, connection, lock)
            found = study.description().get("schema")
            if not isinstance(found, int) or not _OLDEST <= found <= SCHEMA:
                raise StudyError(
                    f"{path} has schema {found}; this version reads schemas {_OLDEST} to {SCHEMA}: "
                    "install the one that made it, or give another folder"
                )
            if lock:
                study._make_ready(found)
            cleanup.pop_all()
        return study

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let another driver have it."""
        self._connection.close()
        if self._lock is not None:
            self._lock.close()

    def description(self) -> dict[str, Any]:
        """What the study is: schema, settings, model_sha256, versions."""
        with _reporting(self.path):
            rows = self._connection.execute("select key, value from study").fetchall()
        return {key: json.loads(value) for key, value in rows}

    def _make_ready(self, schema: int) -> None:
        """Prepare the file for a driver: a write-ahead log, and the columns of this schema."""
        with _reporting(self.path), self._connection as connection:
            connection.execute("pragma journal_mode = wal")
            if schema == SCHEMA:
                return
            connection.execute("begin")
            for name in self._lacking():
                connection.execute(f"alter table walks add column {name} real")
            connection.execute(
                "update study set value = ? where key = 'schema'", (json.dumps(SCHEMA),)
            )

    def _lacking(self) -> frozenset[str]:
        """Columns that have come since the file was made."""
        found = self._connection.execute("select name from pragma_table_info('walks')")
        return _SINCE_OLDEST - {name for (name,) in found}

    def require(self, wanted: Mapping[str, Any]) -> None:
        """Refuse to go on where the study was made with something else than `wanted`.

        Another search.simulations is accepted if it has room for all walks that there are.

        Raises:
            StudyError: names the first setting that differs, or that the robot's file does.
        """
        found = self.description()
        folder, cure = (
            self.path.parent,
            "give --out for another folder, or what the study began with",
        )
        was, now = found["settings"], wanted.get("settings", found["settings"])
        for key in sorted((was.keys() | now.keys()) - _WORDS - {_BUDGET}):
            if was.get(key) != now.get(key):
                raise StudyError(
                    f"{folder} holds a study with {key} = {was.get(key)}, not {now.get(key)}; "
                    f"{cure}"
                )
        if found["model_sha256"] != wanted["model_sha256"]:
            raise StudyError(
                f"{folder} holds a study of another version of {was['walk.model']}: the file has "
                f"changed since; {cure}"
            )
        if (used := self._budget_used()) > now.get(_BUDGET, used):
            raise StudyError(
                f"{folder} holds {used} walks already, more than {_BUDGET} = {now[_BUDGET]}; give "
                f"{used} or more, or --out for another folder"
            )

    def resize(self, simulations: int) -> None:
        """Give a study another number of walks in all; with room for more it is unfinished again.

        The design of experiments and every walk stay what they are.
        """
        settings = self.description()["settings"]
        if settings[_BUDGET] == simulations:
            return
        settings[_BUDGET] = simulations
        with _reporting(self.path), self._connection:
            self._connection.execute(
                "update study set value = ? where key = 'settings'", (json.dumps(settings),)
            )
            self._connection.execute("delete from study where key = 'finished'")

    def _budget_used(self) -> int:
        """The smallest budget that has room for every walk."""
        with _reporting(self.path):
            (used,) = self._connection.execute(
                "select ifnull(max(id), -1) + 1 from walks where id < ?", (CONFIRMATIONS,)
            ).fetchone()
        return int(used)

    def set(self, key: str, value: Any) -> None:
        """Keep one more value about the study, as JSON."""
        with _reporting(self.path), self._connection:
            self._connection.execute(
                "insert or replace into study values (?, ?)", (key, json.dumps(value))
            )

    def add(self, entry: StudyWalk) -> None:
        """Commit a finished walk.

        Raises:
            StudyError: the file cannot be written; everything before is safe.
        """
        row = to_row(entry)
        with _reporting(self.path), self._connection:
            self._connection.execute(
                f"insert into walks ({', '.join(NAMES)}) values ({', '.join('?' * len(row))})", row
            )

    def rows(self) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Names of all columns, and all walks so far, one tuple each, in the order of their ids."""
        with _reporting(self.path):
            lacking = self._lacking()
            columns = (f"null as {name}" if name in lacking else name for name in NAMES)
            found = self._connection.execute(f"select {', '.join(columns)} from walks order by id")
            return list(NAMES), found.fetchall()

    def table(self) -> dict[str, NDArray[Any]]:
        """All walks so far, in the order of their ids: `pandas.DataFrame(study.table())`.

        Returns:
            Every column of the file by its name, shape (n,): whole numbers as int64, others and
            those that a walk may lack as float64 (nan where it does), text as str. Units are those
            of docs/reference/study.md.
        """
        names, rows = self.rows()
        columns = zip(*rows, strict=True) if rows else [()] * len(names)
        return {
            name: _column(values, _KINDS[name]) for name, values in zip(names, columns, strict=True)
        }

    def walks(self) -> list[StudyWalk]:
        """All walks so far, in the order of their ids."""
        names, rows = self.rows()
        return [from_row(dict(zip(names, row, strict=True))) for row in rows]


def study_file(path: str | Path) -> Path:
    """The study file that a path means: itself, or study.db in a folder."""
    path = Path(path)
    return path / "study.db" if path.is_dir() else path


def _column(values: Sequence[Any], kind: str) -> NDArray[Any]:
    filled = [_MISSING[kind] if value is None else value for value in values]
    return np.array(filled, dtype=_DTYPES[kind])


@contextmanager
def _reporting(path: Path) -> Iterator[None]:
    """Turns what SQLite says into one line for the user."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode & 0xFF in _NO_STUDY:
            raise StudyError(
                f"{path} is no study, or is damaged ({error}); put back a copy, or give --out for "
                "another folder"
            ) from None
        raise StudyError(
            f"study file {path}: {error}; what it holds is safe: free space, or permit reading and "
            "writing, and run the command again"
        ) from None


# What SQLite reports of a file that is no database, of a broken one, and of one without our tables.
_NO_STUDY = (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    reads = mode == "ro"
    if reads and os.access(path.parent, os.W_OK):
        mode = "rw"  # Its log is made beside a closed study, and who only reads leaves it there.
    elif reads and not _log(path).exists():
        mode = "ro&immutable=1"  # No log can be made there, and none is needed.
    with _reporting(path):
        # A study may be opened in one thread and run in another: SQLite serialises their calls.
        connection = sqlite3.connect(
            f"{path.resolve().as_uri()}?mode={mode}", uri=True, check_same_thread=False
        )
        connection.execute("pragma synchronous = normal")
        if reads:
            connection.execute("pragma query_only = on")
    return connection


def _log(path: Path) -> Path:
    """Where SQLite keeps what is not in the file itself yet."""
    return path.with_name(f"{path.name}-wal")


def _write_empty(path: Path, description: Mapping[str, Any]) -> None:
    """Write a study without walks; it has its name only when it is complete."""
    beginning = path.with_suffix(".new")
    try:
        beginning.unlink(missing_ok=True)
        with _reporting(path), closing(_connect(beginning, "rwc")) as connection:
            # A log of its own could outlive it, and be taken for that of the next beginning.
            connection.execute("pragma journal_mode = off")
            with connection:
                connection.execute("create table study (key text primary key, value text)")
                connection.execute(f"create table walks ({', '.join(COLUMNS)})")
                rows = {"schema": SCHEMA, **description}
                connection.executemany(
                    "insert into study values (?, ?)",
                    [(key, json.dumps(value)) for key, value in rows.items()],
                )
        beginning.replace(path)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror}") from None
