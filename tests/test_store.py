"""The study file: what it keeps, what it survives, what it refuses."""

import dataclasses
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drake_gait.errors import StudyError
from drake_gait.foot import FootDesign
from drake_gait.store import SCHEMA, Study
from drake_gait.walk import Outcome, Walk

DESCRIPTION = {
    "settings": {"study.seed": 0, "search.samples": 20, "walk.model": "khr3hv.sdf"},
    "model_sha256": "abc",
    "versions": {"drake": "1.51"},
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "paper" / "study.db"


@pytest.fixture
def study(path):
    with Study.create(path, DESCRIPTION) as study:
        yield study


@pytest.fixture
def closed(path, entry):
    """Path of a study of 200 walks that no process has open."""
    with Study.create(path, DESCRIPTION) as study:
        for number in range(200):
            study.add(dataclasses.replace(entry, id=number))
    return path


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
    numbers = {"steps": np.int64(240), "forward": np.float64(1 / 3), "yaw": np.float32(0.5)}
    study.add(
        dataclasses.replace(entry, id=np.int64(0), walk=dataclasses.replace(entry.walk, **numbers))
    )
    with sqlite3.connect(path) as connection:
        row = connection.execute(
            "select typeof(id), typeof(steps), typeof(forward), typeof(yaw), yaw from walks"
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
            steps=117,
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
        "import sys, pathlib; from drake_gait.store import Study\n"
        "Study.open(pathlib.Path(sys.argv[1]), driver=True)"
    )
    other = subprocess.run(
        [sys.executable, "-c", code, path], check=False, capture_output=True, text=True
    )
    assert other.returncode == 1
    assert "another process is working on" in other.stderr


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


def test_a_study_is_not_started_over_another(closed):
    with pytest.raises(StudyError, match="holds a study"):
        Study.create(closed, DESCRIPTION)
    with Study.open(closed, driver=True) as study:
        assert len(study.walks()) == 200


@pytest.mark.parametrize("driver", [False, True])
def test_a_study_that_does_not_exist_is_refused_with_the_command_that_makes_one(path, driver):
    with pytest.raises(StudyError, match=r"no study file .*study\.db.*drake_gait\.optimize"):
        Study.open(path, driver=driver)
    assert not path.parent.exists()


@pytest.mark.parametrize("driver", [False, True])
@pytest.mark.parametrize("content", [b"This is a letter, not a study. " * 200, b"\0" * 5000])
def test_a_file_that_is_no_database_is_refused_and_left_as_it_is(tmp_path, content, driver):
    path = tmp_path / "study.db"
    path.write_bytes(content)
    for _ in range(2):  # The second time, no lock may be left behind.
        with pytest.raises(StudyError, match=r"study\.db is no study, or is damaged.*--out"):
            Study.open(path, driver=driver)
    assert path.read_bytes() == content


@pytest.mark.parametrize("driver", [False, True])
@pytest.mark.parametrize("statements", ["", "create table recipes (title text)"])
def test_a_database_that_is_no_study_is_refused(tmp_path, statements, driver):
    path = tmp_path / "study.db"
    connection = sqlite3.connect(path)
    connection.executescript(statements or "vacuum")
    connection.close()
    with pytest.raises(StudyError, match=r"study\.db is no study, or is damaged"):
        Study.open(path, driver=driver)


@pytest.mark.parametrize("part", [0.9, 0.5, 0.1])
def test_a_truncated_study_is_refused_and_left_as_it_is(closed, part):
    content = closed.read_bytes()[: int(closed.stat().st_size * part)]
    closed.write_bytes(content)

    def read():
        with Study.open(closed) as study:
            study.walks()

    with pytest.raises(StudyError, match=r"study\.db is no study, or is damaged"):
        read()
    assert closed.read_bytes() == content


@pytest.mark.parametrize("driver", [False, True])
def test_a_study_of_a_newer_schema_is_refused_with_both_schemas(closed, driver):
    with Study.open(closed, driver=True) as study:
        study.set("schema", SCHEMA + 1)
    for _ in range(2):
        with pytest.raises(StudyError, match=rf"schema {SCHEMA + 1}.*reads schema {SCHEMA}"):
            Study.open(closed, driver=driver)


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    blocked = tmp_path / "paper"
    blocked.write_text("not a folder")
    with pytest.raises(StudyError, match=r"cannot write in .*paper"):
        Study.create(blocked / "study.db", DESCRIPTION)


def test_a_folder_in_the_place_of_the_file_is_refused(path):
    path.mkdir(parents=True)
    for _ in range(2):
        with pytest.raises(StudyError, match="paper holds"):
            Study.create(path, DESCRIPTION)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write in every folder")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(StudyError, match="cannot write in"):
        Study.create(tmp_path / "study.db", DESCRIPTION)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told_in_one_line_and_loses_nothing(closed, entry):
    with Study.open(closed, driver=True) as study:
        # A page limit is how SQLite has a full disk without one.
        pages = study._connection.execute("pragma page_count").fetchone()[0]
        study._connection.execute(f"pragma max_page_count = {pages}")

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


def test_what_a_study_began_with_is_accepted(study):
    study.require(DESCRIPTION)


@pytest.mark.parametrize("key", sorted(DESCRIPTION["settings"]))
def test_another_setting_is_refused_by_its_name_with_both_values(study, key):
    settings = {**DESCRIPTION["settings"], key: "other"}
    was = DESCRIPTION["settings"][key]
    with pytest.raises(StudyError, match=rf"paper holds a study with {key} = {was}, not other"):
        study.require({**DESCRIPTION, "settings": settings})


@pytest.mark.parametrize("settings", [{"study.seed": 0}, {"search.new": 1}])
def test_a_setting_that_only_one_side_has_is_refused_by_its_name(study, settings):
    wanted = {**DESCRIPTION["settings"], **settings}
    if "search.new" not in settings:
        del wanted["search.samples"]
    name = "search.new" if "search.new" in settings else "search.samples"
    with pytest.raises(StudyError, match=name):
        study.require({**DESCRIPTION, "settings": wanted})


def test_another_version_of_the_robot_is_refused_by_its_name(study):
    with pytest.raises(StudyError, match=r"another version of khr3hv\.sdf"):
        study.require({**DESCRIPTION, "model_sha256": "def"})


@pytest.mark.parametrize("simulations", [4, 5, 50])
def test_another_budget_is_accepted_while_it_has_room_for_every_walk(budgeted, simulations):
    wanted = {**budgeted.description()["settings"], "search.simulations": simulations}
    budgeted.require({"settings": wanted, "model_sha256": "abc"})
    budgeted.resize(simulations)
    description = budgeted.description()
    assert description["settings"] == wanted
    assert ("finished" in description) == (simulations == 5)
    assert [walk.id for walk in budgeted.walks()] == [0, 3]


def test_a_budget_without_room_for_a_walk_is_refused_with_the_smallest_that_has(budgeted):
    settings = {**budgeted.description()["settings"], "search.simulations": 3}
    with pytest.raises(StudyError, match=r"holds 4 walks already.*simulations = 3; give 4 or more"):
        budgeted.require({"settings": settings, "model_sha256": "abc"})


@pytest.fixture
def budgeted(path, entry):
    """A finished study of five walks, of which an interruption left ids 0 and 3."""
    settings = {**DESCRIPTION["settings"], "search.simulations": 5}
    with Study.create(path, {**DESCRIPTION, "settings": settings}) as study:
        study.set("finished", True)
        for number in (0, 3):
            study.add(dataclasses.replace(entry, id=number))
        yield study


WRITER = """
import dataclasses, pathlib, sys
import numpy as np
from drake_gait.gait import STANDING
from drake_gait.problem import Candidate
from drake_gait.store import Study
from drake_gait.records import StudyWalk
from drake_gait.walk import Walk

study = Study.create(pathlib.Path(sys.argv[1]), {"settings": {}, "model_sha256": ""})
for number in range(100_000):
    study.add(StudyWalk(id=number, stage="design", iteration=0,
                        candidate=Candidate(gait=STANDING), walk=Walk.diverged("made up")))
    print(number, flush=True)
"""


@pytest.mark.parametrize("walks", [1, 40, 333])
def test_a_killed_driver_loses_no_walk(path, entry, walks):
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True
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
