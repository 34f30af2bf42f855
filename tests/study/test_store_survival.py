"""What a study file survives: a killed driver, a full disk, a change of its columns."""

import dataclasses
import hashlib
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import DESCRIPTION, OWN_MOUNTS, WRITER, may_mount

from drake_gait.errors import StudyError
from drake_gait.study.records import COLUMNS
from drake_gait.study.store import SCHEMA, Study


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "paper" / "study.db"


def test_a_full_disk_is_told_in_one_line_and_loses_nothing(closed, entry):
    with Study.open(closed, driver=True) as study:
        # A page limit is how SQLite has a full disk without one.
        ((pages,),) = study._database.rows("pragma page_count")
        study._database.rows(f"pragma max_page_count = {pages}")

        def fill():
            for number in range(200, 400):
                study.add(dataclasses.replace(entry, id=number))

        with pytest.raises(StudyError, match=r"full.*free space.*run the command again") as caught:
            fill()
    assert "\n" not in str(caught.value)
    with Study.open(closed, driver=True) as study:
        kept = len(study.walks())
        assert kept >= 200
        study.add(dataclasses.replace(entry, id=kept))


@pytest.mark.parametrize("walks", [1, 40, 333])
def test_a_killed_driver_loses_no_walk(path, entry, walks):
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, path, "0"], stdout=subprocess.PIPE, text=True
    )
    for _ in range(walks):
        writer.stdout.readline()
    writer.send_signal(signal.SIGKILL)
    told, _ = writer.communicate()
    last = int(told.split()[-1]) if told.split() else walks - 1
    # The lock died with its holder, and the study goes on.
    with Study.open(path, driver=True) as study:
        ids = [walk.id for walk in study.walks()]
        assert ids == list(range(len(ids)))
        assert len(ids) in (last + 1, last + 2)
        study.add(dataclasses.replace(entry, id=len(ids)))


def test_a_driver_killed_while_it_starts_a_study_leaves_none(path, monkeypatch):
    class Killed(BaseException):
        pass

    def die(*arguments):
        raise Killed

    # Whatever is the last thing before a study has its name, dying there leaves no half study.
    monkeypatch.setattr(Path, "replace", die)
    with pytest.raises(Killed):
        Study.create(path, DESCRIPTION)
    monkeypatch.undo()
    assert not path.exists()
    with Study.create(path, DESCRIPTION) as study:
        assert study.walks() == []


# A disk of its own that is too small for what it is to hold, and then is not.
DISK = """
import subprocess, sys
from pathlib import Path
from drake_gait.errors import StudyError
from drake_gait.gait import STANDING
from drake_gait.problem import Candidate
from drake_gait.study.records import StudyWalk
from drake_gait.study.store import Study
from drake_gait.walk import Walk

disk, description = Path(sys.argv[1]), {"settings": {}, "model_sha256": "", "notes": 2000 * "ü"}

def walk(number):
    candidate = Candidate(gait=STANDING)
    made_up = Walk.diverged("made up")
    return StudyWalk(id=number, stage="design", iteration=0, candidate=candidate, walk=made_up)

for size in range(4, 200, 4):
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", disk], check=True)
    path, added, told, readable = disk / "run" / "study.db", 0, "nothing", True
    try:
        with Study.create(path, description) as study:
            for number in range(500):
                study.add(walk(number))
                added = number + 1
    except StudyError as error:
        told = str(error)
    if path.exists():  # While it is full it is read.
        with Study.open(path) as study:
            readable = [walk.id for walk in study.walks()] == list(range(added))
    subprocess.run(["mount", "-o", "remount,size=10M", disk], check=True)
    again = Study.open(path, driver=True) if path.exists() else Study.create(path, description)
    with again as study:
        same = study.description()["notes"] == description["notes"]
        kept = [walk.id for walk in study.walks()] == list(range(added))
        study.add(walk(500))
    print(size, added, same and kept and readable, told, sep="|")
    subprocess.run(["umount", disk], check=True)
"""


@pytest.mark.skipif(not may_mount(), reason="no mounts of its own are permitted here")
def test_a_study_goes_on_after_a_full_disk_whenever_it_was_full(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    command = [*OWN_MOUNTS, sys.executable, "-c", DISK, disk]
    ended = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    rows = [line.split("|") for line in ended.stdout.splitlines()]
    assert len(rows) == 49
    # None is damaged, and every walk that was added is there.
    assert [size for size, _, whole, _ in rows if whole != "True"] == []
    assert all("free space" in told for *_, told in rows)
    numbers = [int(added) for _, added, _, _ in rows]
    assert min(numbers) == 0
    assert max(numbers) > 20


SINCE = {
    2: ["peak_ground_reaction"],
    3: ["slip_ratio", "jump"],
    4: ["driving_torque", "braking_torque", "driving_speed", "braking_speed", "line_share"],
}
"""Columns that came after each schema."""


@pytest.fixture(params=SINCE)
def old(request, path, entry, measures):
    """Path of a study of an older schema, with one walk and its measures."""
    walk = dataclasses.replace(entry.walk, measures=measures)
    with Study.create(path, DESCRIPTION) as study:
        study.add(dataclasses.replace(entry, walk=walk))
        study.set("schema", request.param)
    connection = sqlite3.connect(path)
    if request.param < 4:
        connection.execute("alter table walks rename column frames to steps")
    for name in lacking(request.param):
        connection.execute(f"alter table walks drop column {name}")
    connection.close()
    return path


def lacking(schema):
    """Columns that a file of an older schema lacks."""
    return [name for since, names in SINCE.items() if since >= schema for name in names]


def test_a_study_of_an_older_schema_is_read_and_left_as_it_is(old, entry, measures):
    content = old.read_bytes()
    with Study.open(old) as study:
        (walk,) = study.walks()
        table = study.table()
        without = lacking(study.description()["schema"])
    for name in SINCE[2] + SINCE[4]:
        assert np.isnan(getattr(walk.walk.measures, name)) == (name in without)
        assert np.isnan(table[name]).all() == (name in without)
    assert table["frames"].tolist() == [entry.walk.frames] == [walk.walk.frames]
    assert "steps" not in table
    assert table["slip_left"].tolist() == [measures.slip[1]]
    assert old.read_bytes() == content


def test_a_study_of_an_older_schema_goes_on_with_the_columns_of_this_one(old, entry, measures):
    with Study.open(old) as study:
        without = lacking(study.description()["schema"])
    walk = dataclasses.replace(entry.walk, measures=measures)
    for number in (1, 2):
        with Study.open(old, driver=True) as study:
            assert study.description()["schema"] == SCHEMA
            study.add(dataclasses.replace(entry, id=number, walk=walk))
    with Study.open(old) as study:
        table = study.table()
        assert [walk.id for walk in study.walks()] == [0, 1, 2]
    for name in SINCE[2] + SINCE[4]:
        assert np.isnan(table[name]).tolist() == [name in without, False, False]
    assert table["frames"].tolist() == [entry.walk.frames] * 3
    assert table["seconds"].tolist() == [entry.seconds] * 3
    assert table["toe_range_left_lesser"].tolist() == [measures.toe_range[3]] * 3


def test_a_change_of_the_columns_is_a_new_schema():
    digest = hashlib.sha256("\n".join(COLUMNS).encode()).hexdigest()[:12]
    assert (SCHEMA, digest) == (5, "3c43c722dd7a")
