"""Parts of a report that are kept: what is made again is only what would come out otherwise.

result.json says what each part was made from, as a fingerprint, and has fingerprints of its files.
Everything that decides a part is in its fingerprint: walks, settings, this package and the
libraries. A part whose files were changed or lost is made again.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

import numpy as np

from drake_gait.files.strict_json import from_json
from drake_gait.provenance import file_sha256, source_sha256, versions
from drake_gait.report.study_result import RESULT

MADE = "made"
"""Key of result.json under which the parts are."""


class Kept:
    """Parts of the report in a folder: those of an earlier report, and those of this one.

    Args:
        folder: The study's folder.
        content: What result.json held, whatever that is.
    """

    def __init__(self, folder: Path, content: Any) -> None:
        self.folder = folder
        self._content: Mapping[str, Any] = content if isinstance(content, dict) else {}
        self._made: dict[str, dict[str, Any]] = {}

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Return what a folder's result.json knows of; nothing where it cannot be read."""
        try:
            return cls(folder, from_json((folder / RESULT).read_bytes()))
        except (OSError, ValueError):
            return cls(folder, {})

    def found(self, part: str, made_from: str) -> dict[str, Any] | None:
        """Return what result.json said of a part, if the same would come out again."""
        try:
            known = self._content[MADE][part]
            if known["made_from"] != made_from or known["files"] != self._present(known["files"]):
                return None
            content = {key: self._content[key] for key in known["keys"]}
        except (KeyError, TypeError, AttributeError, OSError):
            return None
        self._made[part] = known
        return content

    def keep(
        self, part: str, made_from: str, content: dict[str, Any], files: Iterable[str]
    ) -> dict[str, Any]:
        """Keep a part, and return its content.

        Args:
            part: Its name.
            made_from: Fingerprint of what decides it.
            content: What result.json is to say of it.
            files: Names of its files in the folder, as far as they were written.
        """
        self._made[part] = {
            "made_from": made_from,
            "keys": list(content),
            "files": self._present(files),
        }
        return content

    @property
    def files(self) -> set[str]:
        """Names of the files of all parts that stand."""
        return {name for part in self._made.values() for name in part["files"]}

    def plain(self) -> dict[str, Any]:
        """Return all parts that stand, for result.json."""
        return dict(self._made)

    def _present(self, names: Iterable[str]) -> dict[str, str]:
        """Fingerprints of those of some files that are there."""
        paths = {name: self.folder / name for name in sorted(names)}
        return {name: file_sha256(path) for name, path in paths.items() if path.is_file()}


def fingerprint(*parts: Any) -> str:
    """Return the fingerprint of what decides something, and of the code that makes it.

    Args:
        parts: Numbers, text, arrays, enumerations, dataclasses, and tuples, lists and mappings of
            these.
    """
    found = hashlib.sha256(_code().encode())
    _add(found, parts)
    return found.hexdigest()


def _add(found: "hashlib._Hash", value: Any) -> None:
    if isinstance(value, np.ndarray):
        found.update(f"{value.dtype}{value.shape}".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value) and not isinstance(value, type):
        _add(found, [(one.name, getattr(value, one.name)) for one in fields(value)])
    elif isinstance(value, Mapping):
        _add(found, [(str(key), one) for key, one in value.items()])
    elif isinstance(value, list | tuple):
        found.update(f"{len(value)}(".encode())
        for one in value:
            _add(found, one)
    elif value is None or isinstance(value, str | float | int | Enum | np.generic):
        found.update(f"{value!r},".encode())
    else:  # Its text may have an address, which is another one every time.
        raise TypeError(f"{value!r} has no fingerprint")


@lru_cache(maxsize=1)
def _code() -> str:
    """Return what tells this package and its libraries from other versions of them."""
    known = versions()
    for package in ("matplotlib", "scikit-learn"):
        try:
            known[package] = version(package)
        except PackageNotFoundError:
            known[package] = "not installed"
    return f"{source_sha256()} {sorted(known.items())}"
