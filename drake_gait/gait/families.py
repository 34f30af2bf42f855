"""Gait families by their names: those that are shipped, and classes of a user's own."""

import os
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.errors import SettingsError
from drake_gait.files.python import run
from drake_gait.gait.family import AnyGait, GaitFamily
from drake_gait.gait.harmonics import Harmonics
from drake_gait.gait.keyframes import KeyFrames
from drake_gait.gait.paper import PAPER, Gait, PaperFamily

SHIPPED: Mapping[str, type[GaitFamily]] = {
    kind.name: kind for kind in (PaperFamily, Harmonics, KeyFrames)
}
"""The shipped families by their names."""

_MODULE = "_drake_gait_family"
"""Name of a user's file as a module. Nobody can import it: workers get its class by value."""


def family_kind(reference: str) -> type[GaitFamily]:
    """Return the class of a gait family.

    Args:
        reference: Name of a shipped family, `FILE.py:CLASS`, or `MODULE:CLASS`. A file is run.

    Raises:
        SettingsError: there is none, or its file cannot be run; names what there is.
    """
    if reference in SHIPPED:
        return SHIPPED[reference]
    place, colon, name = reference.rpartition(":")
    if not colon and reference.endswith(".py"):
        place, name = reference, ""
    if place.endswith(".py") or os.sep in place:
        return _in_file(Path(place), name)
    if place and name:
        return _in_module(place, name)
    raise SettingsError(
        f"no gait family is called '{reference}'; there are {', '.join(SHIPPED)}, or give the file "
        'and the class of your own: "my_gait.py:MyGait"'
    )


def reference_of(family: GaitFamily) -> str:
    """Return what `family_kind` finds the class of a family by."""
    kind = type(family)
    return family.name or kind.source or f"{kind.__module__}:{kind.__qualname__}"


def is_file(reference: str) -> bool:
    """Return whether a family is named by its file."""
    return reference.endswith(".py") or reference.rpartition(":")[0].endswith(".py")


def family_of(plain: Mapping[str, Any]) -> GaitFamily:
    """Return the family that `plain_family` tells of.

    Raises:
        SettingsError: there is none, or it has no such setting, or none with such a value.
    """
    settings = dict(plain)
    kind = family_kind(settings.pop("family", PAPER.name))
    known = kind.setting_units()
    for name in settings:
        if name not in known:
            raise SettingsError(
                f"the gait family {kind.name or kind.__name__} has no setting '{name}'; there are "
                f"{', '.join(known)}"
            )
    return kind(**settings)


def plain_family(family: GaitFamily) -> dict[str, Any]:
    """Return the name of a family and its settings [SI], as JSON has them."""
    return {"family": reference_of(family), **family.plain()}


def gait_of(plain: Mapping[str, Any]) -> AnyGait:
    """Return the gait that `plain_gait` tells of.

    Raises:
        SettingsError: its family is not at hand, or has no such gait.
        KeyError: something is missing.
    """
    family = family_of(plain["family"]) if "family" in plain else PAPER
    if "coefficients" in plain and isinstance(family, PaperFamily):
        return Gait(coefficients=np.array(plain["coefficients"]), family=family)
    return family.gait(family.values(plain["variables"]))


def plain_gait(gait: AnyGait) -> dict[str, Any]:
    """Return a gait as JSON has it: coefficients [rad], or variables [SI] by name and the family.

    A gait of the paper's family with its own settings has coefficients alone.
    """
    family = gait.family
    of = {} if family == PAPER else {"family": plain_family(family)}
    if isinstance(gait, Gait):
        return {"coefficients": gait.coefficients.tolist(), **of}
    return {"variables": family.named(gait.variables), **of}


def _in_file(path: Path, name: str) -> type[GaitFamily]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise SettingsError(
            f"no file of a gait family {path} ({error.strerror}); give gait.family another path"
        ) from None
    found = _classes(path.absolute(), content)
    if not found:
        raise SettingsError(
            f"the file {path} declares no gait family; write class MyGait(GaitFamily): ..."
        )
    if name in found or (not name and len(found) == 1):
        return found[name or next(iter(found))]
    raise SettingsError(
        f"the file {path} has no gait family '{name}'; there are {', '.join(found)}: "
        f'"{path.name}:{next(iter(found))}"'
    )


@lru_cache(maxsize=16)
def _classes(path: Path, content: bytes) -> dict[str, type[GaitFamily]]:
    """Return the families that a file declares, by their names; the same text, the same classes."""
    module = run(path, module=_MODULE, what="file of a gait family", content=content)
    found = {
        one.__name__: one
        for one in vars(module).values()
        if isinstance(one, type) and issubclass(one, GaitFamily) and one.__module__ == _MODULE
    }
    for name, kind in found.items():
        kind.source = f"{path}:{name}"
    return found


def _in_module(module: str, name: str) -> type[GaitFamily]:
    base: Any = GaitFamily
    for kind in _below(base):
        if (kind.__module__, kind.__qualname__) == (module, name):
            return kind
    try:
        found = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError):
        found = None
    if not (isinstance(found, type) and issubclass(found, GaitFamily)):
        raise SettingsError(
            f"the gait family {module}:{name} is not at hand; put the class into a file, and give "
            f'gait.family = "my_gait.py:{name}"'
        )
    return found


def _below(kind: type[GaitFamily]) -> Iterator[type[GaitFamily]]:
    for one in kind.__subclasses__():
        yield one
        yield from _below(one)
