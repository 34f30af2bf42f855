"""A study walks one robot, which is kept in it: its content, wherever its file is by then."""

import re
import shutil
from dataclasses import replace

import pytest

from drake_gait import optimization as study
from drake_gait.cli import report
from drake_gait.cli._replay import choose
from drake_gait.errors import ModelError, SettingsError, StudyError
from drake_gait.optimization import is_finished, open_study, try_robot
from drake_gait.problem import Trial
from drake_gait.robot.description import model_path, read_model
from drake_gait.search.confirmation import walked_as
from drake_gait.simulation import simulate as simulation
from drake_gait.simulation.simulate import simulate, walk_trial
from drake_gait.study.reading import read_study
from drake_gait.study.robot import ROBOT, robot_of, settings_with_robot
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.study.store import Study
from drake_gait.sweep.settings import read_sweep
from drake_gait.walk import WalkSettings

TEXT = model_path().read_text(encoding="utf-8")
WEAK = TEXT.replace(">1.373<", ">0.5<")

STUDY = """
[study]
name = "mine"
[walk]
model = "robots/mine.sdf"
[box]
centre_deg = [[0, -1, 3, 0], [13, -11, 8, 0], [16, -3, 14, 0], [8, 8, 8.5, 0]]
half_width_deg = [[1, 1, 1, 1], [2, 2, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]]
"""


@pytest.fixture
def file(tmp_path):
    """A study's file with a robot below its folder."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "mine.sdf").write_text(TEXT)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


@pytest.fixture
def settings(file):
    return replace(
        read_study(file),
        search=SearchSettings(samples=4, simulations=4),
        confirmation=ConfirmationSettings(walks=0),
    )


@pytest.fixture
def robot(file):
    return file.parent / "robots" / "mine.sdf"


def edit_after(monkeypatch, robot, walks):
    """Let somebody edit the robot's file when so many walks are done."""
    seen = []

    def report(progress):
        seen.append(progress.walks)
        if len(seen) == walks:
            robot.write_text(WEAK)

    return report


def test_a_robot_s_path_begins_at_the_file_that_names_it(file, robot, monkeypatch, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert read_study(file).walk.model == str(robot)
    (elsewhere / "near.sdf").write_text(TEXT)
    named = read_study(file, {("walk", "model"): "near.sdf"})
    assert named.walk.model == str(elsewhere / "near.sdf")
    # A study that is read relative to the current folder as well.
    monkeypatch.chdir(tmp_path)
    assert read_study(file.relative_to(tmp_path)).walk.model == str(robot)


def test_a_sweep_s_robot_begins_at_the_sweep_s_file(file, robot, monkeypatch, tmp_path):
    folder = tmp_path / "sweeps"
    folder.mkdir()
    (folder / "sweep.toml").write_text(
        '[sweep]\nname = "s"\nbase = "../study.toml"\nseeds = [0]\n'
        '[common]\nwalk.model = "../robots/mine.sdf"\n'
        '[variants.usual]\n[variants.other]\nwalk.model = "near.sdf"\n'
    )
    monkeypatch.chdir(robot.parent)
    usual, other = (one.settings.walk.model for one in read_sweep(folder / "sweep.toml").studies)
    assert usual == str(robot)
    assert other == str(folder / "near.sdf")


def test_a_robot_that_is_named_twice_is_refused_with_the_study(file):
    (file.parent / "khr3hv.sdf").write_text(WEAK)
    file.write_text(STUDY.replace("robots/mine", "khr3hv"))
    with pytest.raises(SettingsError, match=r"study\.toml.*'\./khr3hv\.sdf'"):
        read_study(file)
    file.write_text(STUDY.replace("robots/mine", "./khr3hv"))
    assert read_model(read_study(file).walk.model).content == WEAK.encode()


@pytest.mark.slow
def test_a_study_walks_the_robot_that_it_began_with(settings, robot, tmp_path, monkeypatch):
    with open_study(settings, tmp_path / "run") as opened:
        with study.workers_of(settings, opened, 1) as executor:
            report = edit_after(monkeypatch, robot, 1)
            study.search_study(settings, opened, executor, report)
        walks = opened.walks()
    assert robot.read_text() == WEAK
    with Study.open(tmp_path / "run") as opened:
        kept = settings_with_robot(opened)
    for walk in walks:
        assert simulate(walk.candidate, walked_as(kept, walk)).forward == walk.walk.forward
    assert (
        simulate(walks[0].candidate, walked_as(settings, walks[0])).forward != walks[0].walk.forward
    )


def test_a_worker_walks_the_content_and_not_the_path(settings, robot):
    model = read_model(robot)
    trial = Trial(candidate=settings.space.decode([0.0] * 16), settings=settings.walk)
    before = walk_trial(trial, model.for_walks())
    robot.unlink()
    simulation._robot.cache_clear()
    simulation._standing.cache_clear()
    assert walk_trial(trial, model.for_walks()).forward == before.forward


def test_a_study_is_gone_on_with_by_the_robot_that_it_began_with_only(settings, robot, tmp_path):
    open_study(settings, tmp_path / "run").close()
    robot.write_text(WEAK)
    for ask in (open_study, is_finished):
        with pytest.raises(StudyError, match=r"another version of .*mine\.sdf"):
            ask(settings, tmp_path / "run")
    robot.write_text(TEXT)
    open_study(settings, tmp_path / "run").close()


def test_a_study_goes_on_where_its_robot_s_file_has_moved(settings, robot, tmp_path):
    open_study(settings, tmp_path / "run").close()
    moved = robot.rename(tmp_path / "other.sdf")
    there = replace(settings, walk=replace(settings.walk, model=str(moved)))
    open_study(there, tmp_path / "run").close()
    moved.write_text(WEAK)
    with pytest.raises(StudyError, match=r"study of .*mine\.sdf, not of .*other\.sdf"):
        open_study(there, tmp_path / "run")


def test_a_study_travels_with_its_robot(settings, robot, tmp_path, entry):
    with open_study(settings, tmp_path / "run") as opened:
        opened.add(entry)
    shutil.move(tmp_path / "run", tmp_path / "elsewhere")
    robot.unlink()
    found, _, as_then = choose(tmp_path / "elsewhere", 0)
    assert found.walk.model == as_then.model
    assert found.walk.model.content == TEXT.encode()
    assert found.description()["walk.model"] == str(robot)


@pytest.fixture
def older(settings, robot, tmp_path, entry):
    """A study of the time when none kept its robot."""
    description = {"settings": settings.description(), "model_sha256": read_model(robot).sha256}
    with Study.create(tmp_path / "older" / "study.db", description) as opened:
        opened.add(entry)
    return tmp_path / "older"


def test_an_older_study_has_its_robot_from_the_file_if_that_is_the_same(older, robot):
    with Study.open(older) as opened:
        assert robot_of(opened).content == TEXT.encode()
        robot.write_text(WEAK)
        with pytest.raises(StudyError, match=r"older holds walks of another version of .*mine"):
            robot_of(opened)
        robot.unlink()
        with pytest.raises(StudyError, match=r"no robot description '.*mine\.sdf'"):
            robot_of(opened)


def test_an_older_study_keeps_its_robot_from_when_it_is_gone_on_with(older, settings, robot):
    open_study(settings, older).close()
    robot.unlink()
    with Study.open(older) as opened:
        assert robot_of(opened).content == TEXT.encode()


def test_a_report_of_another_robot_is_refused_and_changes_no_result(older, robot, capsys):
    (older / "result.json").write_text("{}")
    robot.write_text(WEAK)
    assert report.main([str(older)]) == 2
    assert re.fullmatch(r"error: .*another version of .*mine\.sdf.*\n", capsys.readouterr().err)
    assert (older / "result.json").read_text() == "{}"


def test_a_robot_that_was_changed_in_the_study_is_one_line(settings, tmp_path):
    with open_study(settings, tmp_path / "run") as opened:
        opened.set(ROBOT, {**opened.description()[ROBOT], "text": WEAK})
        with pytest.raises(StudyError, match=r"study\.db.*damaged"):
            robot_of(opened)


def test_a_robot_is_tried_on_all_grounds_and_feet_of_its_study(settings, robot, monkeypatch):
    tried = []
    monkeypatch.setattr(study, "try_out", lambda candidate, walk: tried.append((candidate, walk)))
    ranges = (("big_toe_width", 0.010, 0.040), ("toe_damping", 1e-4, 1e-3))
    designed = replace(settings, space=replace(settings.space, foot_ranges=ranges))
    try_robot(designed, read_model(robot))
    assert {candidate.foot.big_toe_width for candidate, _ in tried} == {0.010, 0.040, 0.022}
    assert {round(walk.friction, 9) for _, walk in tried} == {0.9, 1.0, 1.1}


def test_a_robot_that_does_not_walk_a_moment_is_refused_before_a_study_is_there(
    settings, tmp_path, monkeypatch
):
    monkeypatch.setattr(simulation, "_TRIED_OUT", 3)
    short = replace(settings, walk=replace(settings.walk, time_limit=1e-9))
    with pytest.raises(ModelError, match=r"mine\.sdf.*does not walk.*longer than"):
        open_study(short, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_setting_may_be_a_robot_that_has_been_read(robot):
    model = read_model(robot)
    assert read_model(model) is model
    assert hash(WalkSettings(model=model)) == hash(WalkSettings(model=read_model(robot)))
