"""The study file: every walk ever simulated, in one SQLite database.

Tables (schema 5; SI units, angles in radians, numbers as full doubles):

    study   key, value      schema, settings, model_sha256, versions and source (the file that
                            the settings were read from, and what was set beside it), each as JSON
    walks   one row a walk  id is its place in the study; what it was simulated for (stage), of
                            which walk it is a variation and which one; the candidate, what it
                            did, its measures where they were taken, what was predicted of it,
                            when it finished and how long it took

`pandas.DataFrame(Study.open("runs/steady").table())` has all of it, and any SQLite tool reads it;
docs/reference/study.md lists the columns. The driver is the only writer and commits each walk as it
finishes; how, and what a copy of the file holds, says `database`.

A change of the columns is a new schema. Older ones down to schema 2 are read, with nothing in the
columns that they lack. The driver that resumes one adds these columns.
"""

import json
import stat
from collections.abc import Iterator, Mapping, Sequence, Set
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

from drake_gait.errors import GaitError, SettingsError, StudyError
from drake_gait.gait import COEFFICIENTS, PAPER, GaitFamily, family_of
from drake_gait.problem import Quantity
from drake_gait.study._database import Database, damaged, write_new
from drake_gait.study._lock import driver_lock
from drake_gait.study.keys import DROPPED, OLDER, difference
from drake_gait.study.records import (
    COLUMNS,
    CONFIRMATIONS,
    StudyWalk,
    columns,
    from_row,
    names_of,
    own_names,
    require_types,
    to_row,
)
from drake_gait.study.settings import StudySettings, study_settings

SCHEMA = 5
_OLDEST = 2
_SINCE_OLDEST = frozenset(
    {
        "peak_ground_reaction",
        "slip_ratio",
        "jump",
        "driving_torque",
        "braking_torque",
        "driving_speed",
        "braking_speed",
        "line_share",
    }
)
"""Columns that a study of an older schema may lack."""
_RENAMED = {"frames": "steps"}
"""Columns that had another name until schema 3, with that name."""

VARIABLES = "variables"
"""Key of a study under which the variables of its gait family are, if that is not the paper's."""
_AT_ONCE = 2000
"""Walks that are read together."""

QUANTITIES = "quantities"
"""Key of a study under which the quantities of its own are, as `Quantity.plain` has them."""
PROPOSER = "proposer"
"""Key of a study under which the name of a proposer is that was handed over."""

_WORDS = {"study.question", "box.chosen", "walk.model", "robot.file", "study.quantities"}
"""Settings that change no walk: a study goes on when somebody mends their wording.

A robot is its content, model_sha256, wherever its file is.
"""

_LOOKS = {"label", "symbol", "digits", "limit"}
"""What may change in a quantity of a study's own: its values are the same."""

_BUDGET = "search.simulations"
"""The setting that may change in a study: its walks are the same, there are more or fewer."""
_MORE = frozenset(f"confirmation.{name}" for name in ("means", "transfer", "transfer_distance"))
"""Settings that may change too: walks are added to those that confirm, or counted otherwise."""

_KINDS = {
    # No whole number stands for none.
    name: "real" if kind == "integer" and not constraints else kind
    for name, kind, *constraints in map(str.split, COLUMNS)
}
"""What a column's array holds."""
_VALUES: dict[str, tuple[str, tuple[type, ...]]] = {
    "settings": ("table", (dict,)),
    "model_sha256": ("text", (str,)),
    "versions": ("table", (dict,)),
    "wall_s": ("number", (int, float)),
    PROPOSER: ("text", (str,)),
    QUANTITIES: ("list", (list,)),
    VARIABLES: ("list", (list,)),
    "worker_deaths": ("table", (dict,)),
}
"""Kinds of the values that the table `study` has, or may have."""
_REQUIRED = ("settings", "model_sha256")
_REQUIRED_SETTINGS = ("study.name", "study.seed", "search.simulations")
"""Settings that every study has; others came later, and have the value that they stand for."""

_DTYPES = {"integer": np.int64, "real": np.float64, "text": np.str_}
_MISSING = {"real": np.nan, "text": ""}


class Study:
    """An open study file: `with Study.open(path) as study: study.walks()`."""

    def __init__(self, path: Path, database: Database) -> None:
        self.path = path
        self._database = database
        self._own: tuple[Quantity, ...] | None = None
        self._variables: tuple[str, ...] | None = None
        self._family: GaitFamily | None = None

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
        _require_file(path)
        with ExitStack() as cleanup:
            lock = cleanup.enter_context(driver_lock(path)) if driver else None
            study = cls._opened(path, lock)
            cleanup.pop_all()
        return study

    @classmethod
    def _opened(cls, path: Path, lock: IO[str] | None) -> Self:
        with ExitStack() as cleanup:
            database = Database(path, lock)
            cleanup.callback(database.close)
            study = cls(path, database)
            found = study._decoded("select key, value from study where key = 'schema'").get(
                "schema"
            )
            if not isinstance(found, int) or not _OLDEST <= found <= SCHEMA:
                raise StudyError(
                    f"{path} has schema {found}; this version reads schemas {_OLDEST} to {SCHEMA}: "
                    "install the one that made it, or give another folder"
                )
            if lock:
                database.begin_writing()
                if found != SCHEMA:
                    study._bring_up_to_date()
            cleanup.pop_all()
        return study

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let another driver have it."""
        self._database.close()

    def description(self) -> dict[str, Any]:
        """The values about the study: settings, model_sha256 and all others, by their names.

        Raises:
            StudyError: one is missing, or cannot be read; names it.
        """
        found = self._decoded("select key, value from study")
        for key in _REQUIRED:
            if key not in found:
                raise damaged(self.path, f"it has no value of {key}")
        for key, (kind, types) in _VALUES.items():
            if key in found and not isinstance(found[key], types):
                raise damaged(self.path, f"its value of {key} is no {kind}")
        return found

    def settings(self) -> StudySettings:
        """The settings that the study was made with.

        Raises:
            StudyError: one is missing, or is not one that this version can use.
        """
        description = self.description()
        found = description["settings"]
        for key in _REQUIRED_SETTINGS:
            if key not in found:
                raise damaged(self.path, f"its settings have no {key}")
        family = self.family()
        try:
            return study_settings(found, description.get("source"), self.quantities(), family)
        except KeyError as error:
            why = f"the name {error} is missing, or unknown"
        except (GaitError, TypeError, ValueError, AttributeError) as error:
            why = " ".join(str(error).rpartition("__init__() ")[2].split())
        raise StudyError(
            f"{self.path} has settings that this version cannot use ({why}); install the version "
            "that made it, or put back a copy"
        )

    def quantities(self) -> tuple[Quantity, ...]:
        """Return the quantities of the study's own; they have values of its walks, and no other.

        Raises:
            StudyError: they cannot be read.
        """
        if self._own is not None:
            return self._own
        query = f"select key, value from study where key = '{QUANTITIES}'"
        plain = self._decoded(query).get(QUANTITIES, [])
        try:
            self._own = tuple(Quantity.from_plain(one) for one in plain)
            return self._own
        except (GaitError, TypeError, ValueError, KeyError, AttributeError) as error:
            raise damaged(self.path, f"its value of {QUANTITIES} is none: {error}") from None

    def variables(self) -> tuple[str, ...]:
        """Return the names of the variables of the study's gaits, which are columns of its walks.

        Raises:
            StudyError: they cannot be read.
        """
        if self._variables is None:
            query = f"select key, value from study where key = '{VARIABLES}'"
            plain = self._decoded(query).get(VARIABLES)
            try:
                self._variables = (
                    COEFFICIENTS if plain is None else tuple(str(one["name"]) for one in plain)
                )
            except (TypeError, KeyError) as error:
                raise damaged(self.path, f"its value of {VARIABLES} is none: {error}") from None
        return self._variables

    def family(self) -> GaitFamily:
        """Return the family of the study's gaits. Python of a user's own file is run for that.

        The file is looked for where it was, then beside the study.

        Raises:
            StudyError: the class of a user's own is not at hand; names the file.
        """
        if self._family is None:
            found = self._decoded("select key, value from study where key = 'settings'")
            settings = {
                name.removeprefix("gait."): value
                for name, value in found.get("settings", {}).items()
                if name.startswith("gait.") and name != "gait.start"
            }
            reference = str(settings.get("family", PAPER.name))
            file, colon, name = reference.rpartition(":")
            beside = self.path.parent / Path(file).name
            if colon and file.endswith(".py") and not Path(file).is_file() and beside.is_file():
                settings["family"] = f"{beside}:{name}"
            try:
                self._family = family_of(settings)
            except SettingsError as error:
                raise StudyError(f"the study {self.path} needs its gait family: {error}") from None
            if self._family.names != self.variables():
                raise StudyError(
                    f"{self.path} was made with the variables {', '.join(self.variables())}; the "
                    f"gait family {reference} has {', '.join(self._family.names)}"
                )
        return self._family

    def _decoded(self, query: str) -> dict[str, Any]:
        """Values about the study, by their names."""
        found = {}
        for key, value in self._database.rows(query):
            try:
                found[key] = json.loads(value)
            except (ValueError, TypeError, RecursionError):
                raise damaged(self.path, f"its value of {key} is no JSON") from None
        return found

    def _bring_up_to_date(self) -> None:
        """Give the file the columns of this schema."""
        found = self._found()
        with self._database.writing() as connection:
            connection.execute("begin")
            for name, was in _RENAMED.items():
                if name not in found:
                    connection.execute(f"alter table walks rename column {was} to {name}")
            for name in _SINCE_OLDEST - found:
                connection.execute(f"alter table walks add column {name} real")
            connection.execute(
                "update study set value = ? where key = 'schema'", (json.dumps(SCHEMA),)
            )

    def _found(self) -> frozenset[str]:
        """Return the columns that the file has."""
        found = self._database.rows("select name from pragma_table_info('walks')")
        return frozenset(name for (name,) in found)

    def require(self, wanted: Mapping[str, Any]) -> None:
        """Refuse to go on where the study was made with something else than `wanted`.

        Another search.simulations is accepted if it has room for all walks of the file.

        Raises:
            StudyError: names the first setting that differs, or that the robot's file does.
        """
        found = self.description()
        folder, cure = (
            self.path.parent,
            "give --out for another folder, or what the study began with",
        )
        now = wanted.get("settings", found["settings"])
        self._require_quantities(wanted.get(QUANTITIES, []), found)
        self._require_variables(wanted.get(VARIABLES), found)
        was = {key: OLDER[key] for key in OLDER.keys() & now.keys()} | found["settings"]
        left_out = _WORDS | _MORE | {_BUDGET} | {".".join(name) for name in DROPPED}
        if VARIABLES in found and VARIABLES in wanted:
            left_out = left_out | {"gait.family"}  # A file's path; see _require_variables.
        for key in sorted((was.keys() | now.keys()) - left_out):
            if was.get(key) != now.get(key):
                told = difference(key, was.get(key), now.get(key), self.quantities())
                raise StudyError(f"{folder} holds a study with {told}; {cure}")
        if found["model_sha256"] != wanted["model_sha256"]:
            name = now.get("walk.model")
            raise StudyError(
                f"{folder} holds a study of another version of {name}: the file has changed since; "
                f"{cure}"
                if name == was.get("walk.model")
                else f"{folder} holds a study of {was.get('walk.model')}, not of {name}; {cure}"
            )
        if (used := self._budget_used()) > now.get(_BUDGET, used):
            raise StudyError(
                f"{folder} holds {used} walks already, more than {_BUDGET} = {now[_BUDGET]}; give "
                f"{used} or more, or --out for another folder"
            )

    def _require_variables(
        self, wanted: Sequence[Mapping[str, Any]] | None, description: Mapping[str, Any]
    ) -> None:
        """Refuse a gait family with other variables, or other commands, than the walks have."""
        was = description.get(VARIABLES)
        if was is None or wanted is None or list(wanted) == was:
            return  # What differs is a setting, gait.family.
        names = [[one["name"] for one in some] for some in (was, wanted)]
        if names[0] != names[1]:
            told = f"the variables {', '.join(names[0])}, not {', '.join(names[1])}"
        else:
            told = "another version of its gait family, whose limits or commands differ"
        raise StudyError(
            f"{self.path.parent} holds a study with {told}; give the family that it began with, or "
            "--out for another folder"
        )

    def _require_quantities(
        self, wanted: Sequence[Mapping[str, Any]], description: Mapping[str, Any]
    ) -> None:
        """Refuse other quantities than those that the walks have values of."""
        now, was = (
            {one["name"]: one for one in some} for some in (wanted, description.get(QUANTITIES, []))
        )
        if now.keys() != was.keys():
            has = f"the quantities {', '.join(was)}" if was else "no quantities of its own"
            raise StudyError(
                f"{self.path.parent} holds a study with {has}, not with "
                f"{', '.join(now) or 'none'}; "
                f"{_cure_of_quantities(description['settings'])}, or --out for another folder"
            )
        for name, one in now.items():
            changed = [
                key for key in one.keys() | was[name].keys() if one.get(key) != was[name].get(key)
            ]
            if words := sorted(set(changed) - _LOOKS):
                raise StudyError(
                    f"{self.path.parent} holds a study whose quantity {name} has {words[0]} = "
                    f"{was[name].get(words[0])!r}, not {one.get(words[0])!r}; give it so, or --out "
                    "for another folder"
                )

    def require_at_hand(self, quantities: Sequence[Quantity]) -> None:
        """Refuse to simulate for quantities that are known from the study's file alone.

        Raises:
            StudyError: names them, and the file to give.
        """
        absent = [one.name for one in quantities if not one.at_hand]
        if absent:
            raise StudyError(
                f"{self.path.parent} needs the quantities {', '.join(absent)} to go on; "
                f"{_cure_of_quantities(self.description()['settings'])}"
            )

    def resize(self, simulations: int) -> None:
        """Give a study another number of walks in all; with room for more it is unfinished again.

        The design of experiments and every walk stay what they are.
        """
        settings = self.description()["settings"]
        if settings.get(_BUDGET) == simulations:
            return
        settings[_BUDGET] = simulations
        with self._database.writing() as connection:
            connection.execute(
                "update study set value = ? where key = 'settings'", (json.dumps(settings),)
            )
            connection.execute("delete from study where key = 'finished'")

    def adopt(self, wanted: Mapping[str, Any]) -> None:
        """Keep the settings of `wanted` that add to a confirmation, unless it is finished."""
        known = self.description()
        settings = known["settings"]
        if "finished" in known:
            return
        changed = {key: wanted[key] for key in _MORE & wanted.keys()}
        if any(settings.get(key) != value for key, value in changed.items()):
            self.set("settings", settings | changed)

    def _budget_used(self) -> int:
        """The smallest budget that has room for every walk."""
        query = f"select ifnull(max(id), -1) + 1 from walks where id < {CONFIRMATIONS}"
        ((used,),) = self._database.rows(query)
        return int(used)

    def set(self, key: str, value: Any) -> None:
        """Keep one more value about the study, as JSON."""
        with self._database.writing() as connection:
            connection.execute(
                "insert or replace into study values (?, ?)", (key, json.dumps(value))
            )

    def add(self, entry: StudyWalk) -> None:
        """Commit a finished walk.

        Raises:
            StudyError: the file cannot be written, or was moved; everything before is safe.
        """
        own = self.quantities()
        names = _quoted([*names_of(self.variables()), *own_names(own)])
        row = to_row(entry, own)
        with self._database.writing() as connection:
            connection.execute(
                f"insert into walks ({names}) values ({', '.join('?' * len(row))})", row
            )

    def rows(self) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Names of all columns, and all walks so far, one tuple each, in the order of their ids.

        Raises:
            StudyError: a value is none that its column can have.
        """
        names = [*names_of(self.variables()), *own_names(self.quantities())]
        return names, [row for chunk in self._chunks(names) for row in chunk]

    def _chunks(self, names: Sequence[str]) -> Iterator[list[tuple[Any, ...]]]:
        """Read walks a few at a time, in the order of their ids: few are held twice."""
        present, own, variables = self._found(), self.quantities(), self.variables()
        columns = ", ".join(_selected(name, present) for name in names)
        beyond = ""
        while found := self._database.rows(
            f"select {columns} from walks {beyond} order by id limit {_AT_ONCE}"
        ):
            try:
                for row in found:
                    require_types(dict(zip(names, row, strict=True)), own, variables)
            except StudyError as error:
                raise damaged(self.path, error) from None
            yield found
            beyond = f"where id > {found[-1][names.index('id')]}"

    def table(self) -> dict[str, NDArray[Any]]:
        """All walks so far, in the order of their ids: `pandas.DataFrame(study.table())`.

        Returns:
            Every column of the file by its name, shape (n,). Whole numbers are int64, and text is
            str. Other numbers, and those that a walk may lack, are float64, with nan for none.
            Units are those of docs/reference/study.md.
        """
        names, rows = self.rows()
        columns = zip(*rows, strict=True) if rows else [()] * len(names)
        return {
            name: _column(values, _KINDS.get(name, "real"))
            for name, values in zip(names, columns, strict=True)
        }

    def walks(self) -> list[StudyWalk]:
        """All walks so far, in the order of their ids.

        Raises:
            StudyError: a walk has a value that it cannot have.
        """
        own, family = self.quantities(), self.family()
        names = [*names_of(self.variables()), *own_names(own)]
        walks: list[StudyWalk] = []
        for chunk in self._chunks(names):
            try:
                walks += [
                    from_row(dict(zip(names, row, strict=True)), own, family) for row in chunk
                ]
            except StudyError as error:
                raise damaged(self.path, error) from None
        return walks


def study_file(path: str | Path) -> Path:
    """The study file that a path means: itself, or study.db in a folder."""
    path = Path(path)
    try:
        return path / "study.db" if path.is_dir() else path
    except OSError:  # Whoever opens the file learns why.
        return path


def _selected(name: str, found: Set[str]) -> str:
    """Return what a query selects as a column, of a file that may have been made before it."""
    if name not in found and name in _SINCE_OLDEST:
        return f"null as {name}"
    was = _RENAMED.get(name, name)
    return f'"{was}" as "{name}"' if name not in found and was in found else f'"{name}"'


def _quoted(names: Sequence[str]) -> str:
    """Return the names of columns as SQL, which has words of its own."""
    return ", ".join(f'"{name}"' for name in names)


def _cure_of_quantities(settings: Mapping[str, Any]) -> str:
    """Return how the quantities of a study are given."""
    file = settings.get("study.quantities") or "my_quantities.py"
    return f'give their file, --set study.quantities="{file}", or run_study(..., quantities=[...])'


def _column(values: Sequence[Any], kind: str) -> NDArray[Any]:
    filled = [_MISSING[kind] if value is None else value for value in values]
    return np.array(filled, dtype=_DTYPES[kind])


def _require_file(path: Path) -> None:
    try:
        if stat.S_ISREG(path.stat().st_mode):
            return
        why = "is no file"
    except FileNotFoundError:
        raise StudyError(
            f"no study file {path}; `python -m drake_gait.optimize` makes one"
        ) from None
    except (OSError, ValueError) as error:  # A path may be none: too long, with a null byte.
        why = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    raise StudyError(f"study file {path} {why}; give the folder of a study, or its study.db")


def _write_empty(path: Path, description: Mapping[str, Any]) -> None:
    """Write a study without walks."""
    rows = {"schema": SCHEMA, **description}
    own = [Quantity.from_plain(one) for one in description.get(QUANTITIES, [])]
    variables = [one["name"] for one in description.get(VARIABLES, [])] or COEFFICIENTS
    declared = [
        f'"{name}" {kind}' for name, _, kind in (one.partition(" ") for one in columns(variables))
    ]
    declared += [f'"{name}" real' for name in own_names(own)]
    tables = [
        ("create table study (key text primary key, value text)", ()),
        (f"create table walks ({', '.join(declared)})", ()),
    ]
    values = [
        ("insert into study values (?, ?)", (key, json.dumps(value))) for key, value in rows.items()
    ]
    write_new(path, [*tables, *values])
