"""JSON as its standard has it: what is not finite is null, and what is read has no NaN either.

Every file and every output of JSON is written by `to_json` and read by `from_json`.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Return a value as `from_json(to_json(value))` would: None in the place of NaN and infinity.

    Tuples, NumPy's arrays and NumPy's numbers become lists and numbers; keys become text.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def to_json(value: Any, *, indent: int | None = 2) -> str:
    """Return the text of a value, without a line's end.

    Args:
        value: Numbers, text, truth values, None, and lists and mappings of them.
        indent: Spaces that what is inside is moved by; None: all in one line.
    """
    return json.dumps(plain(value), indent=indent, allow_nan=False)


def from_json(content: str | bytes) -> Any:
    """Return the value of a text, or of a file's bytes in any encoding that JSON allows.

    NaN and Infinity, which files of older versions hold, are None.

    Raises:
        ValueError: it is not JSON.
    """
    try:
        return json.loads(content, parse_constant=lambda name: None)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
