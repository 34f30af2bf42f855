"""Ways to read a study: by its folder, as a table, beside its driver, where nobody may write."""

import dataclasses
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from drake_gait.errors import StudyError
from drake_gait.study._lock import is_driven
from drake_gait.study.store import Study

DESCRIPTION = {"settings": {"study.seed": 0}, "model_sha256": "abc"}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "paper" / "study.db"


@pytest.fixture
def study(path):
    with Study.create(path, DESCRIPTION) as study:
        yield study


def test_a_study_is_opened_by_its_folder_its_file_and_their_names(study, path, entry):
    study.add(entry)
    for name in (path, path.parent, str(path), str(path.parent)):
        with Study.open(name) as reader:
            assert len(reader.walks()) == 1


def test_a_folder_without_a_study_is_refused_by_the_name_of_the_file(tmp_path):
    with pytest.raises(StudyError, match=rf"no study file {tmp_path}/study\.db"):
        Study.open(tmp_path)


def test_a_table_has_every_column_and_every_digit(study, path, entry):
    for number in (2, 0, 1):
        study.add(dataclasses.replace(entry, id=number))
    table = study.table()
    with sqlite3.connect(path) as connection:
        connection.row_factory = sqlite3.Row
        rows = connection.execute("select * from walks order by id").fetchall()
    connection.close()
    assert list(table) == rows[0].keys()
    for name in ("id", "stage", "iteration", "roll_a", "outcome", "frames", "yaw", "seconds"):
        assert table[name].tolist() == [row[name] for row in rows]
    assert {table[name].dtype.kind for name in ("id", "iteration", "frames")} == {"i"}
    assert {table[name].dtype for name in ("roll_a", "forward", "seconds")} == {np.dtype("f8")}
    assert {table[name].dtype.kind for name in ("stage", "outcome", "reason")} == {"U"}


def test_what_a_walk_lacks_is_nan_in_a_table(study, entry):
    study.add(dataclasses.replace(entry, predicted=None))
    study.add(dataclasses.replace(entry, id=1))
    predicted = study.table()["predicted_forward"]
    assert np.isnan(predicted[0])
    assert predicted[1] == entry.predicted["forward"]


def test_a_table_without_walks_has_all_columns(study, entry):
    empty = study.table()
    study.add(entry)
    full = study.table()
    assert list(empty) == list(full)
    assert {values.shape for values in empty.values()} == {(0,)}
    assert [values.dtype.kind for values in empty.values()] == [
        values.dtype.kind for values in full.values()
    ]


def test_a_table_is_a_data_frame(study, entry):
    pandas = pytest.importorskip("pandas")
    for number in range(3):
        study.add(dataclasses.replace(entry, id=number))
    frame = pandas.DataFrame(study.table())
    assert frame["id"].tolist() == [0, 1, 2]
    assert (frame["outcome"] == "walked").all()


@pytest.mark.parametrize("again", [False, True])
def test_a_study_is_driven_from_its_opening_to_its_closing(path, again):
    assert not is_driven(path)
    opened = Study.create(path, DESCRIPTION)
    if again:
        opened.close()
        assert not is_driven(path)
        opened = Study.open(path, driver=True)
    assert is_driven(path)
    with Study.open(path):
        assert is_driven(path)
    opened.close()
    assert not is_driven(path)


# As root it becomes somebody who may not write, once it has read all that it needs.
READER = """
import os, sys
from drake_gait.study.store import Study
if os.geteuid() == 0:
    os.setuid(65534)
with Study.open(sys.argv[1]) as study:
    print(len(study.walks()))
"""


@pytest.mark.parametrize("running", [False, True])
def test_a_study_is_read_where_nothing_can_be_written(entry, running):
    # Not below pytest's own folder, which is closed to whom root becomes.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.db"
        study = Study.create(path, DESCRIPTION)
        study.add(entry)
        if not running:
            study.close()
        path.parent.chmod(0o555)
        ended = subprocess.run(
            [sys.executable, "-c", READER, path], check=False, capture_output=True, text=True
        )
        path.parent.chmod(0o755)
        study.close()
    assert (ended.stdout, ended.stderr) == ("1\n", "")


def test_a_long_study_is_read_to_its_end_in_the_order_of_its_ids(study, entry):
    # More than are read together, with a gap as the one before confirming walks.
    numbers = [*range(2004), 1_000_000_000, 1_000_000_001]
    for number in reversed(numbers):
        study.add(dataclasses.replace(entry, id=number))
    assert [row[0] for row in study.rows()[1]] == numbers
    assert [walk.id for walk in study.walks()] == numbers
    with Study.open(study.path) as reader:
        assert [walk.id for walk in reader.walks()] == numbers
