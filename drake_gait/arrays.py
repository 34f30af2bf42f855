"""Numbers as users give them: arrays of any type, sequences, iterators; floats that are whole."""

import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_gait.errors import SettingsError


def numbers(name: str, values: Any) -> NDArray[np.float64]:
    """Return a copy of real numbers as an array, from arrays, sequences, iterators or scalars.

    Raises:
        SettingsError: They are no real numbers, or do not fill an array.
    """
    if isinstance(values, Iterable) and not hasattr(values, "__array__"):
        values = values if isinstance(values, str | bytes) else list(values)
    try:
        found = np.asarray(values)
        if found.dtype.kind == "O":
            real = [float(value) for value in found.ravel().tolist()]
            return np.array(real, dtype=np.float64).reshape(found.shape)
    except (TypeError, ValueError, RuntimeError) as error:
        raise SettingsError(f"{name} must be real numbers: {error}") from None
    if found.dtype.kind not in "biuf":
        raise SettingsError(f"{name} must be real numbers, got {values!r:.80}")
    return found.astype(np.float64, order="C")


def whole_number(name: str, value: Any, least: int) -> int:
    """Return a whole number as an int; 1e4 is one.

    Raises:
        SettingsError: It is none, or is below `least`.
    """
    try:
        number = operator.index(value)
    except TypeError:
        real = isinstance(value, float | np.floating) and float(value).is_integer()
        number = int(value) if real else least - 1
    if number < least:
        raise SettingsError(f"{name} must be a whole number of at least {least}, got {value}")
    return number
