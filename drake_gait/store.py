"""The study file: every walk ever simulated, in one SQLite database.

Tables (schema 1; SI units, angles in radians, numbers as full doubles):

    study   key, value      schema, settings, model_sha256 and versions, each as JSON
    walks   one row a walk  id is its place in the study; the candidate, what it did, what was
                            predicted of it, when it finished and how long it took

`pandas.read_sql("select * from walks", "sqlite:///study.db")` reads all of it. The driver is the
only writer and commits each walk as it finishes (write-ahead log, synchronous = normal): a killed
process loses none, a power cut at most the last few.
"""

import fcntl
import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Self

import numpy as np

from drake_gait.errors import StudyError
from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.problem import COEFFICIENTS, Candidate
from drake_gait.walk import Outcome, Walk

SCHEMA = 1

_FOOT = tuple(field.name for field in fields(FootDesign))
_WALK = ("steps", "forward", "lateral", "yaw", "com_height")
_PREDICTED = ("forward", "lateral", "yaw", "survival")

_COLUMNS = (
    ["id integer primary key", "stage text not null", "iteration integer not null"]
    + [f"{name} real not null" for name in (*COEFFICIENTS, *_FOOT)]
    + ["outcome text not null", "reason text not null", "steps integer not null"]
    + [f"{name} real not null" for name in _WALK[1:]]
    + [f"predicted_{name} real" for name in _PREDICTED]
    + ["seconds real not null", "finished text not null"]
)
_NAMES = [column.split()[0] for column in _COLUMNS]


_WORDS = {"study.question", "box.chosen"}
"""Settings that change no walk: a study goes on when somebody mends their wording."""


@dataclass(frozen=True, kw_only=True)
class StudyWalk:
    """One walk of a study."""

    id: int
    """Its place in the study, from 0."""
    stage: str
    """What it was simulated for: "design" (of experiments) or "infill"."""
    iteration: int
    """0 for the design of experiments, then the number of the batch after it."""
    candidate: Candidate
    """What walked."""
    walk: Walk
    """What it did; without a history."""
    predicted: Mapping[str, float] | None = None
    """forward, lateral [m], yaw [rad] and survival, as the network expected them."""
    seconds: float = 0.0
    """Time that the simulation took [s]."""


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
            lock = cleanup.enter_context(_driver_lock(path))
            if path.exists():
                raise StudyError(f"{path.parent} holds a study already; open it, or give --out")
            _write_empty(path, description)
            study = cls._opened(path, lock)
            cleanup.pop_all()
        return study

    @classmethod
    def open(cls, path: Path, *, driver: bool = False) -> Self:
        """Open a study file to read it, or, as its driver, to add walks.

        Raises:
            StudyError: there is none, it is none, it is of a newer schema, or, as driver, another
                driver has it.
        """
        if not path.is_file():
            raise StudyError(f"no study file {path}; `python -m drake_gait.optimize` makes one")
        with ExitStack() as cleanup:
            lock = cleanup.enter_context(_driver_lock(path)) if driver else None
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
            if found != SCHEMA:
                raise StudyError(f"{path} has schema {found}; this version reads schema {SCHEMA}")
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

    def require(self, wanted: Mapping[str, Any]) -> None:
        """Refuse to go on where the study was made with something else than `wanted`.

        Raises:
            StudyError: names the first setting that differs, or that the robot's file does.
        """
        found = self.description()
        folder, cure = (
            self.path.parent,
            "give --out for another folder, or what the study began with",
        )
        was, now = found["settings"], wanted.get("settings", found["settings"])
        for key in sorted((was.keys() | now.keys()) - _WORDS):
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
        walk, predicted = entry.walk, entry.predicted or {}
        row = (
            [int(entry.id), entry.stage, int(entry.iteration)]
            + [float(value) for value in entry.candidate.gait.coefficients.ravel()]
            + [getattr(entry.candidate.foot, name) for name in _FOOT]
            + [walk.outcome.value, walk.reason, int(walk.steps)]
            + [float(getattr(walk, name)) for name in _WALK[1:]]
            + [predicted.get(name) for name in _PREDICTED]
            + [float(entry.seconds), datetime.now(UTC).isoformat(timespec="milliseconds")]
        )
        with _reporting(self.path), self._connection:
            self._connection.execute(f"insert into walks values ({', '.join('?' * len(row))})", row)

    def walks(self) -> list[StudyWalk]:
        """All walks so far, in the order of their ids."""
        with _reporting(self.path):
            rows = self._connection.execute(
                f"select {', '.join(_NAMES)} from walks order by id"
            ).fetchall()
        return [_study_walk(dict(zip(_NAMES, row, strict=True))) for row in rows]


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
    with _reporting(path):
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode={mode}", uri=True)
        connection.execute("pragma synchronous = normal")
    return connection


def _write_empty(path: Path, description: Mapping[str, Any]) -> None:
    """Write a study without walks; it has its name only when it is complete."""
    beginning = path.with_suffix(".new")
    try:
        beginning.unlink(missing_ok=True)
        with _reporting(path), closing(_connect(beginning, "rwc")) as connection:
            connection.execute("pragma journal_mode = wal")
            with connection:
                connection.execute("create table study (key text primary key, value text)")
                connection.execute(f"create table walks ({', '.join(_COLUMNS)})")
                rows = {"schema": SCHEMA, **description}
                connection.executemany(
                    "insert into study values (?, ?)",
                    [(key, json.dumps(value)) for key, value in rows.items()],
                )
        beginning.replace(path)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror}") from None


def _driver_lock(path: Path) -> IO[str]:
    """Hold the study for this process alone; the system lets go of it if the process dies."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_suffix(".lock").open("w")
    except OSError as error:
        raise StudyError(f"cannot write in {path.parent}: {error.strerror}") from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        raise StudyError(
            f"another process is working on {path.parent}; wait for it, stop it, or give --out"
        ) from None
    return lock


def _study_walk(row: dict[str, Any]) -> StudyWalk:
    coefficients = np.array([row[name] for name in COEFFICIENTS]).reshape(4, 4)
    predicted = {name: row[f"predicted_{name}"] for name in _PREDICTED}
    return StudyWalk(
        id=row["id"],
        stage=row["stage"],
        iteration=row["iteration"],
        candidate=Candidate(
            gait=Gait(coefficients=coefficients),
            foot=FootDesign(**{name: row[name] for name in _FOOT}),
        ),
        walk=Walk(
            outcome=Outcome(row["outcome"]),
            reason=row["reason"],
            **{name: row[name] for name in _WALK},
        ),
        predicted=None if predicted["forward"] is None else predicted,
        seconds=row["seconds"],
    )
