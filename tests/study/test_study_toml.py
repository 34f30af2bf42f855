"""A study's file written again: every setting, to the last digit, whatever it came from."""

import dataclasses
import html
import json
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from conftest import EVERY_KEY, MINIMAL
from hypothesis import given
from hypothesis import strategies as some

from drake_gait.gait import Harmonics
from drake_gait.optimization import open_study
from drake_gait.problem import Constraints, DesignSpace
from drake_gait.ranges import DEGREES
from drake_gait.study._toml import as_toml
from drake_gait.study.keys import MM, N_MM_DEG
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.study.toml import study_toml

PLAIN = some.text() | some.booleans() | some.integers() | some.floats(allow_nan=False)


@given(PLAIN | some.lists(PLAIN) | some.lists(some.lists(PLAIN, max_size=3), max_size=3))
def test_a_value_in_toml_is_the_value(value):
    assert tomllib.loads(f"x = {as_toml(value)}")["x"] == value


@given(some.dictionaries(some.text(), PLAIN))
def test_a_table_in_toml_is_the_table(value):
    assert tomllib.loads(f"x = {as_toml(value)}")["x"] == value


@pytest.mark.parametrize("unit", [DEGREES, MM, N_MM_DEG], ids=lambda unit: unit.name)
@given(written=some.floats(-1e3, 1e3))
def test_a_number_in_a_unit_comes_back_to_the_last_digit(unit, written):
    value = written * unit.si
    assert float(as_toml(value, unit)) * unit.si == value


def test_what_somebody_wrote_is_written_as_it_was():
    assert as_toml([0.52 * N_MM_DEG.si, 5.0 * N_MM_DEG.si], N_MM_DEG) == "[0.52, 5]"
    assert as_toml(np.radians([12.7, -13.1]).tolist(), DEGREES) == "[12.7, -13.1]"


def test_half_a_character_of_a_command_line_is_written_as_a_question_mark():
    assert tomllib.loads(f"x = {as_toml(chr(0xDC80))}")["x"] == "?"


@pytest.mark.parametrize(
    ("text", "overrides"),
    [
        (MINIMAL, {}),
        (EVERY_KEY, {}),
        (EVERY_KEY, {("study", "question"): 'a "quoted"\n\ttabbed \U0001f9bf \\ question'}),
        (MINIMAL, {("constraints", "slip_mm"): 12.3, ("search", "mode"): "cmaes"}),
        (MINIMAL, {("foot", "rigid_toes"): True, ("study", "seed"): 2**200}),
        (MINIMAL, {("walk", "friction"): 0.7, ("confirmation", "noise_deg"): 0.07}),
        (MINIMAL, {("study", "name"): "it's größer"}),
    ],
)
def test_a_study_written_again_is_the_same_study(read, tmp_path, text, overrides):
    settings = read(text, overrides)
    path = tmp_path / "again.toml"
    path.write_text(study_toml(settings), encoding="utf-8")
    again = read_study(path)
    assert again.description() == settings.description()
    assert (again.space.centre == settings.space.centre).all()
    assert study_toml(again).splitlines()[1:] == study_toml(settings).splitlines()[1:]


def test_every_shipped_study_written_again_is_the_same_study(repository, tmp_path):
    for file in sorted((repository / "studies").glob("*.toml")):
        if "[sweep]" not in file.read_text():
            settings = read_study(file)
            (tmp_path / file.name).write_text(study_toml(settings))
            assert read_study(tmp_path / file.name).description() == settings.description()


def test_a_limit_that_was_removed_is_not_there(tmp_path):
    standard = read_study(default_study())
    assert "yaw_swing_deg" in study_toml(standard)
    without = dataclasses.replace(standard, constraints=Constraints())
    path = tmp_path / "again.toml"
    path.write_text(study_toml(without))
    assert read_study(path).constraints.yaw_swing is None


def test_a_study_s_file_keeps_the_text_it_was_read_from_and_what_was_set_beside_it(read, tmp_path):
    text = f"# my own words\n{MINIMAL}"
    settings = read(text, {("search", "samples"): 33, ("study", "question"): "Why?"})
    open_study(settings, tmp_path / "run").close()
    with Study.open(tmp_path / "run") as study:
        description = study.description()
    source = description["source"]
    assert source["text"] == text
    assert source["path"] == str(tmp_path / "study.toml")
    assert source["overrides"] == ["search.samples=33", 'study.question="Why?"']
    again = study_settings(json.loads(json.dumps(description["settings"])), source)
    assert again.source == settings.source
    first = study_toml(again).splitlines()[0]
    assert str(tmp_path / "study.toml") in first
    assert "search.samples=33" in first


def test_a_study_without_its_text_opens_and_gets_it_from_who_goes_on(read, tmp_path):
    settings = read(MINIMAL)
    open_study(dataclasses.replace(settings, source=None), tmp_path).close()
    with Study.open(tmp_path) as study:
        assert "source" not in study.description()
    open_study(settings, tmp_path).close()
    with Study.open(tmp_path) as study:
        assert study.description()["source"]["text"] == MINIMAL


@pytest.mark.slow
def test_the_command_in_a_report_makes_the_same_walks(tmp_path):
    """A user's own study with a limit fewer, settings beside it, and a name for a shell."""
    mine = tmp_path / "my study.toml"
    text = default_study().read_text(encoding="utf-8")
    mine.write_text("\n".join(line for line in text.splitlines() if "yaw_swing" not in line))
    run = tmp_path / "a run; it's mine"
    command = [sys.executable, "-m", "drake_gait.optimize", str(mine), "--workers", "1"]
    command += ["--samples", "4", "--simulations", "5", "--set", "confirmation.walks=0"]
    command += ["--set", "walk.friction=0.9", "--out", str(run)]
    subprocess.run(command, check=True, capture_output=True)
    shown = _command_in(run / "report.html")
    subprocess.run(
        shown.replace("python ", f"{sys.executable} ", 1),
        shell=True,
        check=True,
        cwd=tmp_path,
        capture_output=True,
    )
    with Study.open(run) as first, Study.open(f"{run}-again") as second:
        assert first.description()["settings"] == second.description()["settings"]
        assert first.description()["settings"]["constraints.yaw_swing"] is None
        ours, theirs = first.walks(), second.walks()
    assert [walk.walk.forward for walk in ours] == [walk.walk.forward for walk in theirs]
    assert len(ours) == 5


def _command_in(page):
    text = page.read_text(encoding="utf-8")
    return html.unescape(text.split('id="again-title"')[1].split("<code>")[1].split("</code>")[0])


@pytest.mark.parametrize(
    ("settings", "centre"), [({}, {}), ({"duty": 0.55}, {}), ({}, {"duty": 0.55, "period": 1.1})]
)
def test_a_number_that_is_a_setting_and_a_variable_of_a_gait_comes_back(tmp_path, settings, centre):
    path = tmp_path / "study.toml"
    path.write_text(MINIMAL)
    known, family = read_study(path), Harmonics(**settings)
    variables = {**family.like(known.space.middle.gait), "duty": family.duty, **centre}
    space = DesignSpace(centre=variables, half_width=dict.fromkeys(variables, 0.01), family=family)
    wanted = dataclasses.replace(known, space=space)
    path.write_text(study_toml(wanted))
    assert read_study(path).description() == wanted.description()
