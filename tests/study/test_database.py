"""The study's file by itself: what a copy of it holds, who can read it, and what it loses."""

import dataclasses
import shutil
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from conftest import DESCRIPTION, OWN_MOUNTS, WRITER, may_mount

from drake_gait.errors import StudyError
from drake_gait.study import _database as database
from drake_gait.study._lock import is_driven
from drake_gait.study.store import Study


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "paper" / "study.db"


@pytest.fixture
def driver(path):
    """A study that is being worked on."""
    with Study.create(path, DESCRIPTION) as study:
        yield study


@pytest.fixture
def left(closed, tmp_path, entry):
    """A study as a killed driver leaves it: 200 walks in the file, and one more in its log."""
    folder, original = tmp_path / "left", closed.with_name("original.db")
    folder.mkdir()
    shutil.copy(closed, original)
    with Study.open(original, driver=True) as study:
        connection = sqlite3.connect(original)
        connection.execute("begin")  # A reader in the midst of it keeps the log from being emptied.
        connection.execute("select count(*) from walks").fetchone()
        study.add(dataclasses.replace(entry, id=200))
        for ending in ("", "-wal"):
            (folder / f"study.db{ending}").write_bytes(Path(f"{original}{ending}").read_bytes())
        connection.close()
    return folder / "study.db"


def seen(folder):
    """Everything in a folder that reading could change."""
    return {
        path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in sorted(folder.iterdir())
    }


def ids(path):
    with Study.open(path) as study:
        return study.table()["id"].tolist()


def copied(path, expected, patience=5.0):
    """What a copy of the file alone holds, once it holds `expected` walks or patience is lost."""
    end = time.monotonic() + patience
    while True:
        copy = shutil.copy(path, path.with_name("copy of it.sqlite"))
        found = ids(copy)
        if len(found) == expected or time.monotonic() > end:
            return found
        time.sleep(0.05)


def test_a_copy_of_a_running_study_has_every_walk_a_moment_after_it_finished(driver, path, entry):
    for number in range(12):
        driver.add(dataclasses.replace(entry, id=number))
        if number % 4 == 0:
            assert copied(path, number + 1) == list(range(number + 1))
    assert copied(path, 12) == list(range(12))  # The last ones too, though nothing comes after.


def test_a_copy_is_a_study_that_goes_on(driver, path, entry):
    driver.add(entry)
    copied(path, 1)
    with Study.open(path.with_name("copy of it.sqlite"), driver=True) as study:
        study.add(dataclasses.replace(entry, id=1))
        assert study.description()["settings"] == DESCRIPTION["settings"]
    assert ids(path.with_name("copy of it.sqlite")) == [0, 1]
    assert ids(path) == [0]


@pytest.mark.parametrize("name", ["study.bak", "study.db.old", "study 2.db"])
def test_a_copy_beside_a_running_study_is_not_running_and_is_left_as_it_is(
    driver, path, entry, name
):
    driver.add(entry)
    copied(path, 1)
    copy = Path(shutil.copy(path, path.with_name(name)))
    assert is_driven(path)
    assert not is_driven(copy)
    assert ids(copy) == [0]
    assert not [item for item in path.parent.iterdir() if item.name.startswith(f"{name}-")]


def test_the_file_alone_of_a_killed_study_lacks_the_last_moments_at_most(path):
    command = [sys.executable, "-c", WRITER, path, "0.02"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        for _ in range(100):
            writer.stdout.readline()
        writer.kill()
        told = 100 + len(writer.stdout.read().split())
    found = ids(shutil.copy(path, path.with_name("alone.db")))
    assert found == list(range(len(found)))
    assert told - len(found) < 0.5 * told
    assert len(ids(path)) >= told - 1


def test_a_closed_study_leaves_its_file_and_no_log(driver, path, entry):
    driver.add(entry)
    reader = Study.open(path)
    assert len(reader.walks()) == 1
    driver.close()
    assert {item.name for item in path.parent.iterdir()} == {"study.db", "study.lock"}
    assert len(reader.walks()) == 1


def test_a_reader_in_the_midst_holds_up_neither_a_walk_nor_the_closing(driver, path, entry):
    connection = sqlite3.connect(path)
    connection.execute("begin")
    assert connection.execute("select count(*) from walks").fetchone() == (0,)
    begun = time.monotonic()
    for number in range(5):
        driver.add(dataclasses.replace(entry, id=number))
    assert time.monotonic() - begun < 1.0
    driver.close()
    assert time.monotonic() - begun < 4.0
    connection.close()
    assert ids(path) == list(range(5))
    # The next driver puts the file in order again.
    Study.open(path, driver=True).close()
    assert {item.name for item in path.parent.iterdir()} == {"study.db", "study.lock"}


def test_what_a_killed_driver_left_in_its_log_is_read_and_left_there(left):
    before = seen(left.parent)
    assert ids(left) == list(range(201))
    assert seen(left.parent) == before


def test_a_file_that_an_earlier_version_closed_is_read_without_a_trace(closed):
    connection = sqlite3.connect(closed)
    assert connection.execute("pragma journal_mode = wal").fetchone() == ("wal",)
    connection.close()
    before = seen(closed.parent)
    assert len(ids(closed)) == 200
    assert seen(closed.parent) == before


@pytest.mark.parametrize("name", ["best", "reference"])
def test_a_committed_study_is_read_without_a_trace(repository, name):
    folder = repository / "studies" / name
    before = seen(folder)
    with Study.open(folder) as study:
        assert len(study.walks()) > 100
        assert study.settings().name == name
    assert seen(folder) == before


NO_ROOM = """
import errno, shutil, subprocess, sys
from pathlib import Path
from drake_gait.study._lock import is_driven
from drake_gait.study.store import Study

disk = Path(sys.argv[1])
for source in map(Path, sys.argv[2:]):
    for way in ("full", "read-only"):
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", disk], check=True)
        for path in source.parent.glob("study.db*"):
            shutil.copy(path, disk)
        if way == "full":
            try:
                with (disk / "ballast").open("wb", buffering=0) as file:
                    while True:
                        file.write(bytes(4096))
            except OSError as error:
                assert error.errno == errno.ENOSPC
        else:
            subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        before = sorted(disk.iterdir())
        with Study.open(disk) as study:
            print(way, len(study.walks()), sorted(disk.iterdir()) == before, flush=True)
        subprocess.run(["umount", disk], check=True)
"""


@pytest.mark.skipif(not may_mount(), reason="no mounts of its own are permitted here")
def test_a_study_is_read_with_no_byte_free_and_from_what_nobody_can_write(closed, left, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    command = [*OWN_MOUNTS, sys.executable, "-c", NO_ROOM, disk, closed, left]
    told = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    assert told.splitlines() == [
        f"{way} {walks} True" for walks in (200, 201) for way in ("full", "read-only")
    ]


def test_a_copy_that_was_cut_short_is_refused_wherever_it_was_cut(closed):
    content = closed.read_bytes()
    sizes = [*range(0, len(content), 4096 * 3), 1, 100, 5000, len(content) - 1, len(content) - 700]
    for size in sizes:
        closed.write_bytes(content[:size])
        with pytest.raises(StudyError, match=r"study\.db .*damaged or incomplete.*copy it again"):
            Study.open(closed)
        with pytest.raises(StudyError, match="damaged or incomplete"):
            Study.open(closed, driver=True)
        assert closed.read_bytes() == content[:size]


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_copy_with_pages_of_zeros_is_refused(closed, share):
    content = bytearray(closed.read_bytes())
    start = 4096 * int(share * len(content) / 4096)
    content[start : start + 4096] = bytes(4096)
    closed.write_bytes(content)
    with pytest.raises(StudyError, match="damaged or incomplete"):
        Study.open(closed)


def move(folder):
    folder.rename(folder.with_name("elsewhere"))


def replace(folder):
    copy = shutil.copy(folder / "study.db", folder / "another")
    Path(copy).replace(folder / "study.db")


def delete_file(folder):
    (folder / "study.db").unlink()


def remove(folder):
    """Remove a folder into which the driver may write at the same time."""
    while folder.exists():
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.parametrize("lose", [remove, move, replace, delete_file])
def test_a_driver_whose_file_has_gone_says_so_at_the_next_walk(path, entry, lose):
    with Study.create(path, DESCRIPTION) as study:
        study.add(entry)
        lose(path.parent)
        for write in (
            lambda: study.add(dataclasses.replace(entry, id=1)),
            lambda: study.set("finished", True),
        ):
            with pytest.raises(StudyError, match=r"study\.db was deleted, moved .*--out") as caught:
                write()
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize("lose", [remove, move, replace, delete_file])
def test_a_file_that_goes_while_it_is_opened_is_no_fault_of_the_disk(closed, monkeypatch, lose):
    begin = database.Database.begin_writing

    def begin_too_late(self):
        lose(closed.parent)
        begin(self)

    monkeypatch.setattr(database.Database, "begin_writing", begin_too_late)
    with pytest.raises(StudyError, match="was deleted, moved"):
        Study.open(closed, driver=True)


def test_a_moved_study_has_its_walks_where_it_was_moved_to(path, entry):
    with Study.create(path, DESCRIPTION) as study:
        for number in range(7):
            study.add(dataclasses.replace(entry, id=number))
        move(path.parent)
        # Another study in its old place is none of its business.
        with Study.create(path, DESCRIPTION) as other:
            other.add(entry)
            study.close()
            other.add(dataclasses.replace(entry, id=1))
            assert ids(path) == [0, 1]
        assert ids(path) == [0, 1]
    assert ids(path.parent.with_name("elsewhere")) == list(range(7))


# As root it becomes somebody whom permissions hold back, once it has read all that it needs.
SHUT_OUT = """
import os, sys
from pathlib import Path
from drake_gait.study import _database as database
from drake_gait.errors import StudyError
from drake_gait.study._lock import is_driven
from drake_gait.study.store import Study
folder = Path(sys.argv[1])
if os.geteuid() == 0:
    os.chown(folder, 65534, 65534)
    os.setuid(65534)
with Study.create(folder / "study.db", {"settings": {}, "model_sha256": ""}) as study:
    study.set("note", 1)
    folder.chmod(0o000)
    try:
        study.set("note", 2)
    except StudyError as error:
        print(error)
folder.chmod(0o700)
with Study.open(folder) as study:
    print(study.description()["note"])
"""


def test_a_driver_that_is_shut_out_of_its_folder_says_so_at_the_next_walk():
    # Not below pytest's own folder, which is closed to whom root becomes.
    with tempfile.TemporaryDirectory() as folder:
        ended = subprocess.run(
            [sys.executable, "-c", SHUT_OUT, folder], check=False, capture_output=True, text=True
        )
    assert ended.stderr == ""
    refusal, note = ended.stdout.splitlines()
    assert f"{folder}/study.db was deleted, moved or made unreadable" in refusal
    assert "Permission denied" in refusal
    assert note == "1"


def test_a_reader_on_another_computer_reads_the_file_itself(driver, path, entry, monkeypatch):
    driver.add(entry)
    copied(path, 1)
    monkeypatch.setattr(socket, "gethostname", lambda: "another")
    # A log that this computer must not touch, as its memory is not shared with the driver's.
    with Study.open(path) as reader:
        assert len(reader.walks()) == 1
    driver.add(dataclasses.replace(entry, id=1))
    assert copied(path, 2) == [0, 1]
    assert len(ids(path)) == 2


def test_a_full_disk_while_the_log_is_emptied_ends_the_next_walk_in_one_line(driver, path, entry):
    driver.add(entry)
    copied(path, 1)
    driver._database._emptying._error = sqlite3.OperationalError("database or disk is full")
    driver._database._emptying._error.sqlite_errorcode = sqlite3.SQLITE_FULL
    with pytest.raises(StudyError, match=r"disk is full.*free space"):
        driver.add(dataclasses.replace(entry, id=1))


def test_a_closed_study_has_no_thread(path, entry):
    before = threading.active_count()
    with Study.create(path, DESCRIPTION) as study:
        study.add(entry)
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
