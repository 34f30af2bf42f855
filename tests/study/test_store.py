"""The study file: what it keeps, and whom it lets write."""

import dataclasses
import errno
import fcntl
import os
import socket
import sqlite3
import subprocess
import sys

import numpy as np
import pytest
from conftest import DESCRIPTION

from drake_gait.errors import StudyError
from drake_gait.foot import FootDesign
from drake_gait.study._lock import is_driven
from drake_gait.study.store import SCHEMA, Study
from drake_gait.walk import Outcome, Walk


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "paper" / "study.db"


@pytest.fixture
def study(path):
    with Study.create(path, DESCRIPTION) as study:
        yield study


def test_rigid_toes_return_as_they_were(study, path, entry):
    feet = [FootDesign(rigid_toes=True), FootDesign(toe_length=0.1 / 7)]
    for number, foot in enumerate(feet):
        candidate = dataclasses.replace(entry.candidate, foot=foot)
        study.add(dataclasses.replace(entry, id=number, candidate=candidate))
    with Study.open(path) as again:
        assert [walk.candidate.foot for walk in again.walks()] == feet


def test_a_walk_returns_with_every_digit(study, path, entry):
    study.add(entry)
    with Study.open(path) as reader:
        (found,) = reader.walks()
    assert found.candidate == entry.candidate
    assert (
        found.candidate.gait.coefficients.tobytes() == entry.candidate.gait.coefficients.tobytes()
    )
    assert dataclasses.asdict(found.walk) == dataclasses.asdict(entry.walk)
    for name in ("id", "stage", "iteration", "predicted", "seconds"):
        assert getattr(found, name) == getattr(entry, name)


@pytest.mark.parametrize("value", [5e-324, np.nextafter(0.1, 1), -1 / 3, 1e300])
def test_the_smallest_difference_of_a_double_is_kept(study, entry, value):
    study.add(dataclasses.replace(entry, walk=dataclasses.replace(entry.walk, lateral=value)))
    found = study.walks()[0].walk.lateral
    assert np.float64(found).tobytes() == np.float64(value).tobytes()


def test_numbers_of_numpy_are_kept_as_numbers(study, path, entry):
    numbers = {"frames": np.int64(240), "forward": np.float64(1 / 3), "yaw": np.float32(0.5)}
    study.add(
        dataclasses.replace(entry, id=np.int64(0), walk=dataclasses.replace(entry.walk, **numbers))
    )
    with sqlite3.connect(path) as connection:
        row = connection.execute(
            "select typeof(id), typeof(frames), typeof(forward), typeof(yaw), yaw from walks"
        ).fetchone()
    connection.close()
    assert row == ("integer", "integer", "real", "real", 0.5)


def test_a_walk_without_a_prediction_has_none(study, entry):
    study.add(dataclasses.replace(entry, predicted=None, stage="design", iteration=0))
    assert study.walks()[0].predicted is None


@pytest.mark.parametrize(
    "walk",
    [
        Walk.diverged("its process died with exit code -6"),
        Walk(
            outcome=Outcome.FELL,
            frames=117,
            forward=0.05,
            lateral=0.1,
            yaw=-2.0,
            com_height=0.1,
            reason="fell at 2.36 s; 'quoted' \"twice\" ü",
        ),
    ],
)
def test_a_walk_that_failed_keeps_its_outcome_and_reason(study, entry, walk):
    study.add(dataclasses.replace(entry, walk=walk))
    assert dataclasses.asdict(study.walks()[0].walk) == dataclasses.asdict(walk)


def test_walks_come_in_the_order_of_their_ids(study, entry):
    for number in (3, 0, 2, 1):
        study.add(dataclasses.replace(entry, id=number, seconds=float(number)))
    assert [walk.id for walk in study.walks()] == [0, 1, 2, 3]
    assert [walk.seconds for walk in study.walks()] == [0.0, 1.0, 2.0, 3.0]


def test_a_walk_is_on_disk_as_soon_as_it_is_added(study, path, entry):
    for number in range(3):
        study.add(dataclasses.replace(entry, id=number))
        with Study.open(path) as reader:
            assert len(reader.walks()) == number + 1


def test_a_walk_cannot_be_stored_twice(study, entry):
    study.add(entry)
    with pytest.raises(StudyError, match=r"walks\.id"):
        study.add(entry)
    assert len(study.walks()) == 1


def test_a_study_tells_what_it_is(study, path):
    with Study.open(path) as reader:
        assert reader.description() == {"schema": SCHEMA, **DESCRIPTION}


def test_a_value_kept_beside_the_walks_returns(study, path):
    study.set("wall_s", 1 / 3)
    study.set("wall_s", 2 / 3)
    with Study.open(path) as reader:
        assert reader.description()["wall_s"] == 2 / 3


def test_any_sqlite_tool_reads_a_study(closed):
    with sqlite3.connect(closed) as connection:
        connection.row_factory = sqlite3.Row
        rows = connection.execute("select * from walks").fetchall()
    connection.close()
    assert len(rows) == 200
    wanted = {"roll_a", "ankle_d", "big_toe_stiffness", "forward", "outcome", "reason", "seconds"}
    assert wanted <= set(rows[0].keys())


def test_a_closed_study_is_one_file_that_can_be_copied(closed, tmp_path):
    copy = tmp_path / "copy.db"
    copy.write_bytes(closed.read_bytes())
    with Study.open(copy) as study:
        assert len(study.walks()) == 200


def test_a_reader_cannot_add_walks(closed, entry):
    with Study.open(closed) as reader, pytest.raises(StudyError, match="readonly"):
        reader.add(dataclasses.replace(entry, id=999))


def test_a_second_driver_is_refused(study, path):
    with pytest.raises(StudyError, match=r"another process is working on .*paper.*--out"):
        Study.open(path, driver=True)
    with pytest.raises(StudyError, match="another process"):
        Study.create(path, DESCRIPTION)


def test_a_driver_in_another_process_is_refused(study, path):
    code = (
        "import sys, pathlib; from drake_gait.study.store import Study\n"
        "Study.open(pathlib.Path(sys.argv[1]), driver=True)"
    )
    other = subprocess.run(
        [sys.executable, "-c", code, path], check=False, capture_output=True, text=True
    )
    assert other.returncode == 1
    assert "another process is working on" in other.stderr


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS])
def test_a_file_system_without_locks_is_told_by_its_folder_and_no_process_is_blamed(
    closed, monkeypatch, number
):
    def refuse(file, operation):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
    for make in (
        lambda: Study.open(closed, driver=True),
        lambda: Study.create(closed.with_name("other.db"), DESCRIPTION),
    ):
        with pytest.raises(StudyError, match=rf"{closed.parent} has no locks .*--out") as caught:
            make()
        assert os.strerror(number) in str(caught.value)
        assert "another process" not in str(caught.value)
    assert not is_driven(closed)
    with Study.open(closed) as study:  # Nobody needs a lock to read it.
        assert len(study.walks()) == 200


@pytest.mark.parametrize("number", [errno.EWOULDBLOCK, errno.EACCES])
def test_a_lock_that_somebody_has_is_no_lack_of_locks(closed, monkeypatch, number):
    def refuse(file, operation):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
    assert is_driven(closed)
    with pytest.raises(StudyError, match="another process is working on"):
        Study.open(closed, driver=True)


def test_a_refused_driver_is_told_which_process_has_the_study(study, path):
    holder = rf"process {os.getpid()} on {socket.gethostname()}"
    for _ in range(2):  # The refused one leaves the name of the other.
        with pytest.raises(StudyError, match=holder):
            Study.open(path, driver=True)


def test_a_study_has_one_driver_by_whatever_link_it_is_named(study, path, tmp_path):
    link = tmp_path / "link.db"
    link.symlink_to(path)
    assert is_driven(link)
    with pytest.raises(StudyError, match="another process"):
        Study.open(link, driver=True)


def test_a_closed_study_lets_another_driver_have_it(closed, entry):
    for number in (200, 201):
        with Study.open(closed, driver=True) as study:
            study.add(dataclasses.replace(entry, id=number))
    with Study.open(closed) as study:
        assert len(study.walks()) == 202


def test_a_reader_does_not_hold_up_the_driver(study, path, entry):
    with Study.open(path) as reader:
        study.add(entry)
        assert len(reader.walks()) == 1
        study.add(dataclasses.replace(entry, id=1))
        assert len(reader.walks()) == 2
