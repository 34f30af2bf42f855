"""The command that tells what studies there are and where they stand."""

import dataclasses
import functools
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from drake_gait.cli.studies import main
from drake_gait.problem import Objective
from drake_gait.study.ranking import feasible_walks
from drake_gait.study.records import CONFIRMATIONS
from drake_gait.study.store import Study
from drake_gait.walk import Measures, Outcome, Walk


@pytest.fixture
def make(study, entry, tmp_path):
    """Makes a study's folder with some walks of each kind."""

    def make(folder="one", *, finished=True, seed=0, walked=3, fell=2, lost=1, **changes):
        settings = dataclasses.replace(study, seed=seed, **changes)
        opened = Study.create(
            tmp_path / folder / "study.db",
            {
                "settings": settings.description(),
                "model_sha256": "abc",
                "versions": {"drake": "1.51.1"},
            },
        )
        walks = [dataclasses.replace(entry.walk, forward=0.1 * (n + 1)) for n in range(walked)]
        walks += [Walk.diverged("its process died with exit code -6")] * lost
        walks += [dataclasses.replace(entry.walk, outcome=Outcome.FELL, frames=9)] * fell
        for number, walk in enumerate(walks):
            opened.add(dataclasses.replace(entry, id=number, walk=walk))
        if finished:
            opened.set("finished", True)
            opened.set("wall_s", 12.3)
        return opened

    return make


def told(capsys, *arguments):
    """What the command prints."""
    assert main([str(argument) for argument in arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def as_json(capsys, *arguments):
    return json.loads(told(capsys, *arguments, "--json"))


def refused(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def spaced(line):
    """A line of a table with one space between its columns."""
    return " ".join(line.split())


def test_a_list_has_a_line_for_each_study_below_the_folder(make, capsys, tmp_path):
    make("one").close()
    make("deep/two", finished=False, seed=7, walked=0).close()
    lines = told(capsys, "list", tmp_path).splitlines()
    assert spaced(lines[0]) == "folder study seed mode state walks survivors feasible best"
    assert spaced(lines[1]) == "deep/two small 7 default unfinished 3/55 0 0 none"
    assert spaced(lines[2]) == "one small 0 default finished 6/55 3 3 300.0 mm"
    assert len(lines) == 3


def test_a_study_is_running_while_a_driver_has_it(make, capsys, tmp_path, entry):
    driver = make(finished=False)
    assert "  running  " in told(capsys, "list", tmp_path)
    driver.add(dataclasses.replace(entry, id=20))
    (one,) = as_json(capsys, "list", tmp_path)
    assert (one["state"], one["walks"]) == ("running", 7)
    driver.close()
    assert "  unfinished  " in told(capsys, "list", tmp_path)


def test_a_damaged_study_is_named_and_hides_no_other(make, capsys, tmp_path):
    make("one").close()
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "study.db").write_text("A letter. " * 500)
    lines = told(capsys, "list", tmp_path).splitlines()
    assert spaced(lines[1]).startswith("one ")
    assert "two/study.db is no study" in lines[2]
    _, broken = as_json(capsys, "list", tmp_path)
    assert broken["folder"] == str(tmp_path / "two")
    assert "is no study" in broken["error"]


DAMAGES = {
    "broken JSON": "update study set value = '{\"study.name\": ' where key = 'settings'",
    "an unknown outcome": "update walks set outcome = 'hopped' where id = 1",
    "no robot": "delete from study where key = 'model_sha256'",
    "a setting of nobody": "update study set value = json_set(value, '$.\"search.luck\"', 7)",
    "a budget of none": "update study set value = json_remove(value, '$.\"search.simulations\"')",
    "words for a number": "update walks set yaw = 'a little' where id = 0",
    "no column": "alter table walks drop column com_height",
    "no table": "drop table walks",
}


def spoil(file, statement):
    connection = sqlite3.connect(file)
    with connection:
        connection.execute(statement)
    connection.close()


def no_study(file):
    file.unlink()
    file.mkdir()


def empty(file):
    file.write_bytes(b"")


def cut(file):
    file.write_bytes(file.read_bytes()[:-100])


def pipe(file):
    file.unlink()
    os.mkfifo(file)


def dangle(file):
    file.unlink()
    file.symlink_to("nowhere")


def circle(file):
    file.unlink()
    file.symlink_to(file.name)


@pytest.mark.parametrize(
    "break_it",
    [
        *(functools.partial(spoil, statement=statement) for statement in DAMAGES.values()),
        no_study,
        empty,
        cut,
        pipe,
        dangle,
        circle,
    ],
    ids=[*DAMAGES, "a folder", "empty", "cut", "pipe", "dangling link", "circular link"],
)
def test_a_study_that_cannot_be_read_is_one_line_and_hides_no_other(
    make, capsys, tmp_path, break_it
):
    for name in ("a", "b", "c"):
        make(name).close()
    break_it(tmp_path / "b" / "study.db")
    lines = told(capsys, "list", tmp_path).splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["a", "c"]
    assert len(lines) == 4
    assert lines[3].startswith("cannot be read: ")
    assert f"{tmp_path}/b/study.db" in lines[3]
    *whole, broken = as_json(capsys, "list", tmp_path)
    assert [one["folder"] for one in whole] == [f"{tmp_path}/a", f"{tmp_path}/c"]
    assert broken == {
        "folder": f"{tmp_path}/b",
        "error": lines[3].removeprefix("cannot be read: "),
    }
    for arguments in (["show", tmp_path / "b"], ["compare", tmp_path / "a", tmp_path / "b"]):
        assert f"{tmp_path}/b/study.db" in refused(capsys, *arguments)


@pytest.mark.parametrize(
    "result",
    [
        "[1]",
        "{",
        '{"simulations": 6, "r2_heldout": [1]}',
        '{"simulations": 6, "r2_heldout": 0}',
        '{"simulations": 6, "r2_heldout": {"yaw": "good"}}',
        "\xff",
    ],
)
def test_an_unreadable_result_is_left_out(make, capsys, tmp_path, result):
    make().close()
    (tmp_path / "one" / "result.json").write_text(result, encoding="latin-1")
    for arguments in (["list", tmp_path], ["show", tmp_path / "one"]):
        assert "R²" not in told(capsys, *arguments)


# As root it becomes somebody whom permissions hold back, once it has read all that it needs.
SHUT_OUT = """
import gettext, locale, os, sys
import drake_gait.cli._table  # Its libraries are closed to nobody.
from drake_gait.cli.studies import main
if os.geteuid() == 0:
    os.setuid(65534)
sys.exit(main(["list", *sys.argv[1:]]))
"""


def test_a_study_behind_closed_doors_is_one_line(make, tmp_path):
    for name in ("open", "locked", "sealed", "bare"):
        make(name).close()
    with tempfile.TemporaryDirectory() as folder:  # pytest's own is closed to whom root becomes.
        runs = shutil.copytree(tmp_path, Path(folder) / "runs")
        for way in (Path(folder), runs):
            way.chmod(0o755)
        (runs / "locked").chmod(0o000)
        (runs / "sealed").chmod(0o444)
        (runs / "bare" / "study.db").chmod(0o000)
        ended = subprocess.run(
            [sys.executable, "-c", SHUT_OUT, runs], check=False, capture_output=True, text=True
        )
        for name in ("locked", "sealed"):
            (runs / name).chmod(0o755)
    assert (ended.returncode, ended.stderr) == (0, "")
    lines = ended.stdout.splitlines()
    assert lines[1].startswith("open ")
    assert len(lines) == 5
    for name in ("locked", "sealed", "bare"):
        assert sum(f"/runs/{name}" in line for line in lines) == 1


@pytest.mark.parametrize(
    ("walks", "sentence"),
    [
        ({"walked": 0, "fell": 0, "lost": 0}, "no walk has been simulated yet"),
        ({"walked": 0, "fell": 0, "lost": 4}, "none of its 4 walks could be simulated to an end"),
    ],
)
def test_a_study_that_nothing_is_known_of_says_so_in_every_command(
    make, capsys, tmp_path, walks, sentence
):
    make("one", **walks).close()
    make("two", walked=0, fell=1, lost=3).close()
    one, two = tmp_path / "one", tmp_path / "two"
    for arguments in (["list", tmp_path], ["show", one], ["compare", one, two]):
        (line,) = (line for line in told(capsys, *arguments).splitlines() if sentence in line)
        assert line
    assert sentence in as_json(capsys, "show", one)["remark"]
    assert as_json(capsys, "show", two)["remark"] is None


@pytest.mark.parametrize("arguments", [["list"], ["show"], ["compare", "nowhere"]])
def test_a_folder_without_a_study_is_one_line(capsys, tmp_path, arguments):
    assert str(tmp_path) in refused(capsys, *arguments[:1], tmp_path, *arguments[1:])


def test_the_folder_of_studies_is_runs_if_none_is_given(make, capsys, tmp_path, monkeypatch):
    make("runs/one").close()
    monkeypatch.chdir(tmp_path)
    assert spaced(told(capsys, "list").splitlines()[1]).startswith("one ")


def test_a_study_is_shown_with_its_failures_best_walks_and_settings(make, capsys, tmp_path):
    make(question="How far?").close()
    text = told(capsys, "show", tmp_path / "one")
    assert text.startswith(f"{tmp_path}/one: study small, seed 0, finished\nHow far?\n")
    rows = {spaced(line) for line in text.splitlines()}
    assert "walks 6 of 55" in rows
    assert "failures fell 2, worker died 1" in rows
    assert "2 300.0 -3.3 1.86 245.0 240 infill" in rows
    assert "search.samples 40" in rows
    assert "time 12 s" in rows
    assert "drake 1.51.1" in rows


def test_a_study_is_shown_by_its_file_too_and_without_any_walk(make, capsys, tmp_path):
    make(finished=False, walked=0, fell=0, lost=0).close()
    text = told(capsys, "show", tmp_path / "one" / "study.db")
    assert "walks          0 of 55" in text
    assert "feasible walks" not in text


def test_walks_that_confirm_others_come_on_top_of_those_of_the_search(
    make, capsys, tmp_path, entry
):
    with make() as study:
        for number in range(4):
            again = {"id": CONFIRMATIONS + number, "stage": "confirmation", "nominal": 2}
            study.add(dataclasses.replace(entry, **again))
    one = as_json(capsys, "show", tmp_path / "one")
    assert (one["walks"], one["survivors"], one["stages"]["confirmation"]) == (6, 3, 4)
    assert max(best["walk"] for best in one["best"]) < CONFIRMATIONS


def test_the_best_walks_are_best_by_what_the_study_wants(make, capsys, tmp_path, study, entry):
    cheap = dataclasses.replace(study.search, objective=Objective.COST_OF_TRANSPORT)
    with make(search=cheap, walked=0, fell=0) as opened:
        for number, cost in enumerate((0.5, 0.2, 0.3)):
            numbers = {field.name: 0.5 for field in dataclasses.fields(Measures)}
            for name, size in (("slip", 2), ("clearance", 2), ("duty_factor", 2), ("toe_range", 4)):
                numbers[name] = (0.01,) * size
            walk = dataclasses.replace(
                entry.walk, measures=Measures(**{**numbers, "cost_of_transport": cost})
            )
            opened.add(dataclasses.replace(entry, id=10 + number, walk=walk))
    one = as_json(capsys, "show", tmp_path / "one")
    assert [best["walk"] for best in one["best"]] == [11, 12, 10]


def test_r_squared_is_shown_while_it_is_of_all_walks(make, capsys, tmp_path, entry):
    make().close()
    result = tmp_path / "one" / "result.json"
    result.write_text(json.dumps({"simulations": 6, "r2_heldout": {"forward": 0.876, "yaw": None}}))
    text = told(capsys, "show", tmp_path / "one")
    assert "held-out R² of forward  0.88" in text
    assert "held-out R² of yaw      -" in text
    with Study.open(tmp_path / "one", driver=True) as study:
        study.add(dataclasses.replace(entry, id=6))
    assert "R²" not in told(capsys, "show", tmp_path / "one")
    result.write_text('{"simulations": 7, "r2_')
    assert "R²" not in told(capsys, "show", tmp_path / "one")


def test_studies_are_compared_with_the_settings_that_differ_alone(make, capsys, tmp_path, study):
    search = dataclasses.replace(study.search, samples=30)
    make("one").close()
    make("two", seed=5, search=search, fell=4, lost=0).close()
    text = told(capsys, "compare", tmp_path / "one", tmp_path / "two")
    rows = [spaced(line) for line in text.splitlines()]
    for row in ("survivors 3 3", "fell 2 4", "study.seed 0 5", "search.samples 40 30"):
        assert row in rows
    assert "worker died 1 0" in rows
    assert "search.batch" not in text
    assert "drake" not in text


def test_another_robot_and_other_versions_are_differences(make, capsys, tmp_path):
    make("one").close()
    with make("two") as study:
        study.set("model_sha256", "def")
        study.set("versions", {"drake": "1.52"})
    rows = [
        spaced(line)
        for line in told(capsys, "compare", tmp_path / "one", tmp_path / "two").splitlines()
    ]
    assert "robot's file (sha256) abc def" in rows
    assert "version of drake 1.51.1 1.52" in rows


def test_studies_that_are_alike_are_said_to_be(make, capsys, tmp_path):
    make("one").close()
    make("two").close()
    text = told(capsys, "compare", tmp_path / "one", tmp_path / "two")
    assert "all were made with the same settings, versions and robot" in text


def test_one_study_alone_is_not_compared(make, capsys, tmp_path):
    make().close()
    assert "compare needs two studies" in refused(capsys, "compare", tmp_path / "one")


def test_json_has_the_numbers_with_every_digit(make, capsys, tmp_path, study):
    make().close()
    one = as_json(capsys, "show", tmp_path / "one")
    with Study.open(tmp_path / "one") as opened:
        best = feasible_walks(opened.walks(), study.constraints)[0]
    assert one["best"][0]["forward"] == best.walk.forward
    coefficients = np.array(one["best"][0]["coefficients"])
    assert coefficients.tobytes() == best.candidate.gait.coefficients.tobytes()
    assert one["settings"] == study.description()
    assert (one["failures"], one["stages"]) == ({"fell": 2, "worker died": 1}, {"infill": 6})


def test_looking_at_a_study_changes_nothing(make, capsys, tmp_path):
    make().close()
    file = tmp_path / "one" / "study.db"
    before = file.read_bytes()
    for command in ("list", "show"):
        told(capsys, command, tmp_path / "one")
    assert file.read_bytes() == before
    connection = sqlite3.connect(file)
    assert connection.execute("pragma integrity_check").fetchone() == ("ok",)
    connection.close()


def test_the_help_names_the_commands(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert all(name in text for name in ("list", "show", "compare", "--json"))


def test_a_reader_who_has_seen_enough_is_no_error(make, tmp_path):
    make().close()
    command = [sys.executable, "-m", "drake_gait", "studies", "list", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        told = process.stderr.read()
    assert (process.returncode, told) == (0, b"")
