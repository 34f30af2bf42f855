"""What is no study of this version, this robot and these settings is refused."""

import dataclasses
import os
import re
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from conftest import DESCRIPTION

from drake_gait.errors import StudyError
from drake_gait.study.keys import OLDER
from drake_gait.study.reading import read_study
from drake_gait.study.store import SCHEMA, Study


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runs" / "paper" / "study.db"


@pytest.fixture
def study(path):
    with Study.create(path, DESCRIPTION) as study:
        yield study


@pytest.fixture
def study_settings(paper_study):
    return read_study(paper_study)


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
@pytest.mark.parametrize("schema", [SCHEMA + 1, 1, "of my own", None])
def test_a_study_of_a_newer_schema_is_refused_with_both_schemas(closed, schema, driver):
    with Study.open(closed, driver=True) as study:
        study.set("schema", schema)
    content = closed.read_bytes()
    for _ in range(2):
        with pytest.raises(StudyError, match=rf"schema {schema}; .* reads schemas 2 to {SCHEMA}:"):
            Study.open(closed, driver=driver)
    assert closed.read_bytes() == content


def damage(path, statement):
    """Change a study's file behind the program's back."""
    connection = sqlite3.connect(path)
    with connection:
        assert connection.execute(statement).rowcount == 1
    connection.close()


@pytest.mark.parametrize(
    ("statement", "named"),
    [
        ("update walks set outcome = 'crawled' where id = 5", "walk 5: outcome 'crawled'"),
        ("update walks set lateral = 'left' where id = 6", "walk 6 has lateral = 'left'"),
        ("update walks set ankle_d = x'00' where id = 7", "walk 7 has ankle_d"),
        ("update walks set stage = x'ff' where id = 8", "walk 8 has stage"),
        ("update walks set frames = 'all' where id = 9", "walk 9 has frames = 'all'"),
        ("update walks set predicted_yaw = 'none' where id = 10", "walk 10 has predicted_yaw"),
        ("update walks set nominal = 1.5 where id = 11", "walk 11 has nominal"),
        ("update walks set toe_length = 900.0 where id = 12", "walk 12: toe_length"),
        ("update walks set reason = cast(x'ff41' as text) where id = 13", "UTF-8"),
        ("update study set value = '{' where key = 'versions'", "versions is no JSON"),
        ("update study set value = null where key = 'model_sha256'", "model_sha256 is no JSON"),
        ("update study set value = '7' where key = 'model_sha256'", "model_sha256 is no text"),
        ("update study set value = '[]' where key = 'settings'", "settings is no table"),
        ("delete from study where key = 'settings'", "no value of settings"),
        ("delete from study where key = 'model_sha256'", "no value of model_sha256"),
        ("delete from study where key = 'schema'", "schema None"),
        ("insert into study values ('wall_s', '\"long\"')", "wall_s is no number"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_its_place(closed, statement, named):
    damage(closed, statement)
    for driver in (False, True):
        with pytest.raises(StudyError, match=re.escape(named)) as caught:
            _read_all(closed, driver)
        assert str(closed) in str(caught.value)
        assert "\n" not in str(caught.value)


def _read_all(path, driver):
    with Study.open(path, driver=driver) as study:
        study.description()
        study.walks()


@pytest.mark.parametrize("value", ["'far'", "x'00'"])
def test_a_table_refuses_what_its_column_cannot_hold(closed, value):
    damage(closed, f"update walks set forward = {value} where id = 3")
    for read in (Study.table, Study.rows):
        with Study.open(closed) as study, pytest.raises(StudyError, match="walk 3 has forward"):
            read(study)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"study.seed": None}, r"no study\.seed"),
        ({"search.simulations": None}, r"no search\.simulations"),
        ({"box.centre": None}, "centre"),
        ({"walk.model": None}, "model"),
        ({"search.samples": "many"}, r"search\.samples .*many"),
        ({"box.half_width": [[1, 2], [3]]}, "settings"),
        ({"search.patience": 3}, "patience"),
        ({"weather.rain": 1}, "weather"),
        ({"walk.fidelity": "quick"}, "quick"),
        ({"servo.damping": "soft"}, "soft|settings"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_by_their_name(
    path, study_settings, change, named
):
    settings = {**study_settings.description(), **change}
    settings = {key: value for key, value in settings.items() if value is not None}
    with Study.create(path, {**DESCRIPTION, "settings": settings}) as made:
        with pytest.raises(StudyError, match=named) as caught:
            made.settings()
        assert str(path) in str(caught.value)


def test_the_settings_of_a_study_return_as_they_were(path, study_settings):
    description = study_settings.description()
    with Study.create(path, {**DESCRIPTION, "settings": description}) as made:
        assert made.settings().description() == description


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "file/study.db", "fifo", "loop"])
def test_a_path_that_is_no_file_is_one_line(tmp_path, name):
    (tmp_path / "file").write_text("a letter")
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(StudyError, match=r"study file .*tmp|study file .*pytest") as caught:
        Study.open(tmp_path / name)
    assert "\n" not in str(caught.value)


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


# As root it becomes somebody who may not write, once it has read all that it needs.
DRIVER = """
import os, sys
from pathlib import Path
from drake_gait.errors import StudyError
from drake_gait.study.store import Study
if os.geteuid() == 0:
    os.setuid(65534)
for drive in (lambda path: Study.open(path, driver=True), lambda path: Study.create(path, {})):
    try:
        drive(Path(sys.argv[1]))
    except StudyError as error:
        print(error)
"""


def test_a_folder_that_cannot_be_written_is_refused_and_left_as_it_is():
    # Not below pytest's own folder, which is closed to whom root becomes.
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.db"
        Study.create(path, DESCRIPTION).close()
        path.with_suffix(".lock").unlink()
        before = path.read_bytes()
        path.parent.chmod(0o555)
        ended = subprocess.run(
            [sys.executable, "-c", DRIVER, path], check=False, capture_output=True, text=True
        )
        path.parent.chmod(0o755)
        assert [path.read_bytes() for path in path.parent.iterdir()] == [before]
    assert ended.stderr == ""
    assert ended.stdout == f"cannot write in {folder}: Permission denied\n" * 2


def test_what_a_study_began_with_is_accepted(study):
    study.require(DESCRIPTION)


@pytest.mark.parametrize("key", sorted(DESCRIPTION["settings"].keys() - {"walk.model"}))
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


def test_a_study_of_before_is_resumed_on_its_boxes_and_on_no_other_sole(study):
    began = DESCRIPTION["settings"]
    study.require({**DESCRIPTION, "settings": {**began, **OLDER}})
    now = {**began, **OLDER, "walk.sole": "area"}
    with pytest.raises(StudyError, match=r"walk\.sole = boxes, not area"):
        study.require({**DESCRIPTION, "settings": now})


def test_a_study_that_keeps_a_setting_without_effect_goes_on_without_it(path, study):
    began = study.description()["settings"]
    older = path.parent / "older.db"
    with Study.create(older, {**DESCRIPTION, "settings": {**began, "walk.measures": True}}) as kept:
        kept.require(DESCRIPTION)
        with pytest.raises(StudyError, match=r"study\.seed = 0, not 1"):
            kept.require({**DESCRIPTION, "settings": {**began, "study.seed": 1}})


def test_another_path_of_the_same_robot_is_accepted_and_another_robot_is_not(study):
    wanted = {**DESCRIPTION, "settings": {**DESCRIPTION["settings"], "walk.model": "mine.sdf"}}
    study.require(wanted)
    with pytest.raises(StudyError, match=r"a study of khr3hv\.sdf, not of mine\.sdf"):
        study.require({**wanted, "model_sha256": "def"})


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


def test_what_adds_to_a_confirmation_is_accepted_and_kept_while_it_is_not_finished(study):
    settings = {**DESCRIPTION["settings"], "confirmation.mass": 0.03}
    wanted = {**settings, "confirmation.means": True, "confirmation.transfer": True}
    study.require({**DESCRIPTION, "settings": wanted})
    study.adopt(wanted)
    adopted = {**DESCRIPTION["settings"], "confirmation.means": True, "confirmation.transfer": True}
    assert study.description()["settings"] == adopted
    study.set("finished", True)
    study.adopt({**wanted, "confirmation.means": False})
    assert study.description()["settings"] == adopted
    with pytest.raises(StudyError, match=r"confirmation\.mass = 0\.03, not 0\.05"):
        study.require({**DESCRIPTION, "settings": {**wanted, "confirmation.mass": 0.05}})


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
