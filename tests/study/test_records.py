"""A walk and its row."""

import dataclasses
import math
import sqlite3

import pytest

from drake_gait.foot import FootDesign
from drake_gait.study.records import COLUMNS, NAMES, from_row, to_row
from drake_gait.study.store import Study
from drake_gait.walk import Walk


def stored(entry, tmp_path):
    """A walk as a study file gives it back."""
    with Study.create(tmp_path / "study.db", {}) as study:
        study.add(entry)
        (found,) = study.walks()
    return found


def assert_same(found, expected):
    # Infinities are equal, and here a value that is not a number is, too.
    for field in dataclasses.fields(expected):
        if field.name != "walk":
            assert getattr(found, field.name) == getattr(expected, field.name), field.name
    for field in dataclasses.fields(expected.walk):
        if field.name != "measures":
            one, other = getattr(found.walk, field.name), getattr(expected.walk, field.name)
            assert one == other, field.name
    if expected.walk.measures is None:
        assert found.walk.measures is None
    else:
        assert str(found.walk.measures) == str(expected.walk.measures)


def measured(entry, measures):
    walk = dataclasses.replace(entry.walk, measures=measures, yaw_swing=0.31)
    return dataclasses.replace(entry, walk=walk)


def test_a_walk_without_measures_returns_from_its_row(entry, tmp_path):
    assert_same(stored(entry, tmp_path), entry)


def test_the_range_of_a_heading_returns_without_measures(entry, tmp_path):
    walk = dataclasses.replace(entry.walk, yaw_swing=0.123456789012345678)
    expected = dataclasses.replace(entry, walk=walk)
    assert_same(stored(expected, tmp_path), expected)


def test_a_walk_with_measures_returns_to_the_last_digit(entry, measures, tmp_path):
    expected = measured(entry, measures)
    found = stored(expected, tmp_path)
    assert_same(found, expected)
    assert found.walk.measures == measures


def test_what_a_short_walk_has_no_number_for_returns_as_that(entry, measures, tmp_path):
    odd = dataclasses.replace(
        measures, duty_factor=(math.nan, math.nan), cost_of_transport=math.inf
    )
    found = stored(measured(entry, odd), tmp_path)
    assert_same(found, measured(entry, odd))
    assert all(math.isnan(value) for value in found.walk.measures.duty_factor)
    assert found.walk.measures.cost_of_transport == math.inf


def test_each_side_and_each_toe_has_its_own_column(entry, measures):
    row = dict(zip(NAMES, to_row(measured(entry, measures)), strict=True))
    assert (row["slip_right"], row["slip_left"]) == measures.slip
    assert (row["clearance_right"], row["clearance_left"]) == measures.clearance
    assert (row["duty_factor_right"], row["duty_factor_left"]) == measures.duty_factor
    toes = ("right_big", "right_lesser", "left_big", "left_lesser")
    assert tuple(row[f"toe_range_{toe}"] for toe in toes) == measures.toe_range
    assert row["torso_tilt"] == measures.torso_tilt


@pytest.mark.parametrize(
    "changes",
    [
        {"nominal": 12, "variation": 3, "stage": "confirmation", "id": 1_000_007},
        {"nominal": 12, "variation": -1},
        {"predicted": None},
        {"walk": Walk.diverged("its process died", frames=17)},
    ],
)
def test_a_walk_of_any_kind_returns_from_its_row(entry, tmp_path, changes):
    expected = dataclasses.replace(entry, **changes)
    assert_same(stored(expected, tmp_path), expected)


def test_rigid_toes_return_as_a_truth_value(entry, tmp_path):
    candidate = dataclasses.replace(entry.candidate, foot=FootDesign(rigid_toes=True))
    found = stored(dataclasses.replace(entry, candidate=candidate), tmp_path)
    assert found.candidate.foot.rigid_toes is True


def test_columns_have_names_of_their_own_and_a_row_fills_them(entry, measures):
    assert len(set(NAMES)) == len(NAMES) == len(COLUMNS)
    assert len(to_row(measured(entry, measures))) == len(NAMES)
    needed = {name for name, column in zip(NAMES, COLUMNS, strict=True) if "not null" in column}
    row = dict(zip(NAMES, to_row(entry), strict=True))
    assert all(row[name] is not None for name in needed)


def test_a_row_can_be_read_by_the_names_of_its_columns(entry, measures):
    connection = sqlite3.connect(":memory:")
    connection.row_factory = sqlite3.Row
    connection.execute(f"create table walks ({', '.join(COLUMNS)})")
    row = to_row(measured(entry, measures))
    connection.execute(f"insert into walks values ({', '.join('?' * len(row))})", row)
    assert_same(
        from_row(connection.execute("select * from walks").fetchone()), measured(entry, measures)
    )
    connection.close()
