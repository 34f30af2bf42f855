"""JSON that every reader takes."""

import json
import math
from enum import StrEnum

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from drake_gait.files.strict_json import from_json, plain, to_json

NUMBERS = some.floats() | some.integers() | some.booleans() | some.none() | some.text()
VALUES = some.recursive(
    NUMBERS, lambda inner: some.lists(inner) | some.dictionaries(some.text(), inner), max_leaves=12
)


def refuse(constant):
    pytest.fail(f"{constant} is no JSON")


@given(VALUES)
def test_whatever_is_written_is_strict_and_reads_as_it_is_plain(value):
    text = to_json(value)
    assert json.loads(text, parse_constant=refuse) == plain(value) == from_json(text)


@pytest.mark.parametrize(
    "value",
    [math.nan, math.inf, -math.inf, np.float64("nan"), np.float32("inf"), np.array(np.nan)],
)
def test_a_number_that_is_not_finite_is_null_at_any_depth(value):
    assert to_json(value) == "null"
    assert plain({"a": [(value, 1.0)], "b": {"c": value}}) == {"a": [[None, 1.0]], "b": {"c": None}}


def test_arrays_tuples_and_numbers_of_numpy_become_lists_and_numbers():
    value = {"a": np.eye(2), "b": (np.int64(3), np.float64(0.1)), "c": np.bool_(True)}
    assert from_json(to_json(value)) == {"a": [[1.0, 0.0], [0.0, 1.0]], "b": [3, 0.1], "c": True}


def test_words_of_an_enumeration_are_text():
    class Colour(StrEnum):
        RED = "red"

    assert to_json(Colour.RED) == '"red"'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_a_file_s_bytes_are_read_in_every_encoding_of_json(encoding):
    assert from_json('{"name": "größer \U0001f9bf"}'.encode(encoding)) == {
        "name": "größer \U0001f9bf"
    }


def test_the_constants_of_older_files_are_read_as_nothing():
    assert from_json("[NaN, Infinity, -Infinity, 1.5]") == [None, None, None, 1.5]


@pytest.mark.parametrize("content", ["", "{", "nan", b"\xff\x00\x01", b"[1,", "[" * 100_000])
def test_content_that_is_not_json_is_a_value_error(content):
    with pytest.raises(ValueError, match=r"Expecting|decode|nested"):
        from_json(content)
