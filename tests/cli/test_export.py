"""Taking a study elsewhere: as CSV, and as an Optuna study."""

import csv
import dataclasses
import io
import shutil
import sqlite3
import subprocess
import sys
from datetime import datetime, timedelta

import numpy as np
import pytest

from drake_gait.cli.export import main
from drake_gait.gait import Gait
from drake_gait.study.ranking import best_walk
from drake_gait.study.search_settings import SearchSettings
from drake_gait.study.store import Study
from drake_gait.walk import Outcome, Walk


@pytest.fixture
def walks(entry, space):
    """Two walks, one of them feasible and shorter, a fall, and one that diverged."""
    rng = np.random.default_rng(1)
    kinds = [
        dataclasses.replace(entry.walk, forward=0.5, lateral=0.3),
        entry.walk,
        dataclasses.replace(
            entry.walk, outcome=Outcome.FELL, frames=97, reason='fell, "at" 1.94 s\nü'
        ),
        Walk.diverged("its process died with exit code -6"),
    ]
    return [
        dataclasses.replace(
            entry,
            id=number,
            walk=walk,
            candidate=space.decode(rng.uniform(-1, 1, space.dimension)),
            predicted=entry.predicted if number else None,
        )
        for number, walk in enumerate(kinds)
    ]


@pytest.fixture
def run(study, walks, tmp_path):
    """The folder of a study of these walks."""
    folder = tmp_path / "one"
    made_with = {"settings": study.description(), "model_sha256": "abc"}
    with Study.create(folder / "study.db", made_with) as opened:
        for walk in walks:
            opened.add(walk)
    return folder


def rows_of(folder):
    connection = sqlite3.connect(folder / "study.db")
    connection.row_factory = sqlite3.Row
    rows = connection.execute("select * from walks order by id").fetchall()
    connection.close()
    return [dict(row) for row in rows]


def told(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def refused(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_a_csv_has_all_walks_all_columns_and_every_digit(run, capsys, tmp_path):
    path = tmp_path / "walks.csv"
    assert told(capsys, run, "--csv", path) == f"{path}: 4 walks\n"
    with path.open(newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    expected = rows_of(run)
    assert len(found) == 4
    for read, row in zip(found, expected, strict=True):
        assert list(read) == list(row)
        for name, value in row.items():
            if value is None:
                assert read[name] == ""
            else:
                assert type(value)(read[name]) == value


def test_a_csv_goes_to_standard_output(run, capsys, tmp_path):
    path = tmp_path / "walks.csv"
    told(capsys, run, "--csv", path)
    assert told(capsys, run, "--csv", "-") == path.read_text(encoding="utf-8")


def test_a_csv_is_read_by_pandas_to_the_table_of_the_study(run, capsys):
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(io.StringIO(told(capsys, run, "--csv", "-")))
    with Study.open(run) as study:
        table = study.table()
    for name in ("id", "roll_a", "forward", "predicted_yaw", "frames"):
        np.testing.assert_allclose(frame[name].to_numpy(), table[name], rtol=1e-15)


def test_a_reader_that_has_seen_enough_is_no_error(run):
    command = (
        f"'{sys.executable}' -m drake_gait export '{run}' --csv - | true; echo ${{PIPESTATUS[0]}}"
    )
    ended = subprocess.run(["bash", "-c", command], check=False, capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == ("0\n", "")


def test_a_study_that_runs_is_exported_as_far_as_it_is(run, capsys, tmp_path, walks):
    with Study.open(run, driver=True) as study:
        study.add(dataclasses.replace(walks[0], id=9))
        assert len(told(capsys, run, "--csv", "-").splitlines()) == 7  # One reason has two lines.


def test_a_csv_that_cannot_be_written_is_one_line_and_leaves_nothing(run, capsys, tmp_path):
    assert "nowhere/walks.csv" in refused(capsys, run, "--csv", tmp_path / "nowhere" / "walks.csv")
    (tmp_path / "folder").mkdir()
    assert "Is a directory" in refused(capsys, run, "--csv", tmp_path / "folder")
    assert {path.name for path in tmp_path.iterdir()} == {"one", "folder"}


def test_a_folder_without_a_study_is_one_line(capsys, tmp_path):
    assert "no study file" in refused(capsys, tmp_path, "--csv", "-")


@pytest.mark.parametrize("arguments", [[], ["--csv", "a", "--optuna", "b"]])
def test_one_place_to_export_to_is_given(run, capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(run), *arguments])
    assert ended.value.code == 2
    assert "--csv" in capsys.readouterr().err


@pytest.fixture
def optuna():
    return pytest.importorskip("optuna")


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """A database of Optuna without a study: its tables are made once."""
    optuna = pytest.importorskip("optuna")
    path = tmp_path_factory.mktemp("tables") / "optuna.db"
    optuna.storages.RDBStorage(f"sqlite:///{path}")
    return path


@pytest.fixture
def url(tables, tmp_path):
    return f"sqlite:///{shutil.copy(tables, tmp_path / 'optuna.db')}"


def exported(optuna, url, name="one"):
    return optuna.load_study(study_name=name, storage=url)


def test_each_walk_is_a_trial_with_the_numbers_of_the_study(optuna, run, url, capsys, walks, study):
    assert told(capsys, run, "--optuna", url) == f"{url}, study one: 4 walks added, 0 were there\n"
    goal = exported(optuna, url)
    trials = goal.get_trials()
    assert [trial.user_attrs["id"] for trial in trials] == [0, 1, 2, 3]
    assert [trial.state.name for trial in trials] == ["COMPLETE", "COMPLETE", "PRUNED", "FAIL"]
    assert goal.user_attrs["drake_gait.model_sha256"] == "abc"
    for trial, row in zip(trials, rows_of(run), strict=True):
        assert list(trial.params) == list(study.space.names)
        assert trial.params == {name: row[name] for name in study.space.names}
        others = {key: value for key, value in row.items() if key not in trial.params}
        assert trial.user_attrs == {
            key: value for key, value in others.items() if value is not None
        }
        finished = datetime.fromisoformat(row["finished"])
        assert trial.datetime_complete.astimezone() == finished
        assert trial.datetime_start.astimezone() == finished - timedelta(seconds=row["seconds"])
    assert [trial.value for trial in trials] == [0.5, walks[1].walk.forward, None, None]
    assert trials[2].intermediate_values == {97: walks[2].walk.forward}


def test_the_best_trial_is_the_best_walk(optuna, run, url, capsys, walks, study):
    told(capsys, run, "--optuna", url)
    best = exported(optuna, url).best_trial
    assert best.user_attrs["id"] == best_walk(walks, study.constraints).id == 1
    longest = exported(optuna, url).get_trials()[0]
    assert longest.value > best.value
    assert max(longest.system_attrs["constraints"]) > 0.0
    assert max(best.system_attrs["constraints"]) == 0.0


def test_a_parameter_s_range_is_how_far_the_search_may_go(optuna, run, url, capsys, study):
    told(capsys, run, "--optuna", url)
    ranges = exported(optuna, url).get_trials()[0].distributions
    limits = study.space.limits
    for sign, end in ((0, "low"), (1, "high")):
        x = limits[:, sign]
        coefficients = study.space.decode(x).gait.coefficients.ravel()
        found = [getattr(ranges[name], end) for name in study.space.names]
        np.testing.assert_allclose(found, coefficients, rtol=1e-7, atol=1e-7)


def test_an_open_foot_is_a_parameter_searched_as_the_search_does(
    optuna, study, entry, tmp_path, capsys, url
):
    open_ranges = (("big_toe_stiffness", 0.01, 0.1), ("big_toe_width", 0.010, 0.040))
    space = dataclasses.replace(study.space, foot_ranges=open_ranges)
    made_with = {"settings": dataclasses.replace(study, space=space).description()}
    with Study.create(
        tmp_path / "one" / "study.db", {**made_with, "model_sha256": "abc"}
    ) as opened:
        for number, x in enumerate((space.limits[:, 0], space.limits[:, 1])):
            opened.add(dataclasses.replace(entry, id=number, candidate=space.decode(x)))
    told(capsys, tmp_path / "one", "--optuna", url)
    lowest, highest = exported(optuna, url).get_trials()
    stiffness, width = (lowest.distributions[name] for name, _, _ in open_ranges)
    assert (stiffness.log, width.log) == (True, False)
    assert (stiffness.low, stiffness.high) == pytest.approx((0.01, 0.1))
    assert (lowest.params["big_toe_width"], highest.params["big_toe_width"]) == pytest.approx(
        (0.010, 0.040)
    )
    assert "toe_damping" in lowest.user_attrs


def test_exporting_again_adds_what_is_new_and_nothing_twice(optuna, run, url, capsys, walks, study):
    told(capsys, run, "--optuna", url)
    assert "0 walks added, 4 were there" in told(capsys, run, "--optuna", url)
    with Study.open(run, driver=True) as opened:
        opened.resize(99)  # More walks are no other study.
        opened.add(dataclasses.replace(walks[1], id=7))
    assert "1 walks added, 4 were there" in told(capsys, run, "--optuna", url)
    trials = exported(optuna, url).get_trials()
    assert [trial.user_attrs["id"] for trial in trials] == [0, 1, 2, 3, 7]


def test_another_study_of_the_same_name_is_refused(optuna, run, url, capsys, study, tmp_path):
    told(capsys, run, "--optuna", url)
    other = tmp_path / "deep" / "one"
    settings = dataclasses.replace(study, seed=8).description()
    Study.create(other / "study.db", {"settings": settings, "model_sha256": "abc"}).close()
    assert "another study called one" in refused(capsys, other, "--optuna", url)
    told(capsys, other, "--optuna", url, "--name", "two")
    assert len(exported(optuna, url, "two").get_trials()) == 0
    optuna.create_study(study_name="mine", storage=url).ask()
    assert "another study called mine" in refused(capsys, run, "--optuna", url, "--name", "mine")


@pytest.mark.parametrize("own", ["finished", "running", "waiting", "failed", "copied", "numbered"])
def test_exporting_again_leaves_the_user_s_own_trials(optuna, run, url, capsys, walks, study, own):
    told(capsys, run, "--optuna", url)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    goal = exported(optuna, url)
    walked = goal.get_trials()[0]
    if own == "waiting":
        goal.enqueue_trial(walked.params)
    elif own == "copied":
        goal.enqueue_trial(walked.params, user_attrs=walked.user_attrs)
    else:
        trial = goal.ask()
        for name, distribution in walked.distributions.items():
            trial.suggest_float(name, distribution.low, distribution.high)
        if own == "numbered":
            trial.set_user_attr("id", 7)
        if own != "running":
            goal.tell(
                trial,
                state=optuna.trial.TrialState.FAIL if own == "failed" else None,
                values=None if own == "failed" else 0.3,
            )
    before = goal.get_trials()[4]
    with Study.open(run, driver=True) as opened:
        opened.add(dataclasses.replace(walks[1], id=7))
    assert "1 walks added, 4 were there" in told(capsys, run, "--optuna", url)
    assert "0 walks added, 5 were there" in told(capsys, run, "--optuna", url)
    trials = exported(optuna, url).get_trials()
    assert len(trials) == 6
    assert trials[4] == before
    assert trials[5].user_attrs["id"] == 7


def test_replicas_beyond_the_search_s_range_are_trials_of_one_range(
    optuna, study, entry, tmp_path, capsys, url
):
    search = SearchSettings(samples=20, simulations=36, batch=4, replicas=4)
    settings = dataclasses.replace(study, search=search)
    limits, rng = study.space.limits, np.random.default_rng(0)
    noise = settings.confirmation.noise

    def noisy(x):
        candidate = study.space.decode(x)
        coefficients = candidate.gait.coefficients + noise * rng.standard_normal((4, 4))
        return dataclasses.replace(candidate, gait=Gait(coefficients=coefficients))

    folder = tmp_path / "one"
    made_with = {"settings": settings.description(), "model_sha256": "abc"}

    def add(*numbers):
        with Study.open(folder, driver=True) as opened:
            for number in numbers:
                side = limits[:, number % 2]
                opened.add(dataclasses.replace(entry, id=number, candidate=noisy(side)))

    Study.create(folder / "study.db", made_with).close()
    add(0, 1, 2)
    told(capsys, folder, "--optuna", url)
    add(3, 4, 5)
    told(capsys, folder, "--optuna", url)
    trials = exported(optuna, url).get_trials()
    assert [trial.params for trial in trials] == [
        {name: row[name] for name in study.space.names} for row in rows_of(folder)
    ]
    beyond = study.space.decode(limits[:, 1]).gait.coefficients.ravel()
    assert any(
        value > highest
        for trial in trials
        for value, highest in zip(trial.params.values(), beyond, strict=False)
    )
    space = optuna.search_space.intersection_search_space(trials)
    assert set(space) == set(study.space.names)


def test_a_walk_outside_every_range_is_a_trial_with_its_own_numbers(
    optuna, run, url, capsys, walks, study
):
    far = dataclasses.replace(
        walks[1], id=9, candidate=study.space.decode(3.0 * study.space.limits[:, 1])
    )
    with Study.open(run, driver=True) as opened:
        opened.add(far)
    told(capsys, run, "--optuna", url)
    trials = exported(optuna, url).get_trials()
    row = rows_of(run)[-1]
    assert trials[-1].params == {name: row[name] for name in study.space.names}
    assert set(optuna.search_space.intersection_search_space(trials)) == set(study.space.names)


@pytest.mark.parametrize("directions", [["minimize"], ["maximize", "maximize"], ["minimize"] * 3])
def test_a_study_of_other_directions_is_refused_by_name(optuna, run, url, capsys, directions):
    optuna.create_study(study_name="theirs", storage=url, directions=directions)
    capsys.readouterr()
    text = refused(capsys, run, "--optuna", url, "--name", "theirs")
    assert "study called theirs" in text
    assert ", ".join(directions) in text
    assert "--name" in text
    assert exported(optuna, url, "theirs").get_trials() == []
    assert exported(optuna, url, "theirs").user_attrs == {}


def test_a_study_whose_parameters_are_of_another_kind_is_refused_by_name(
    optuna, run, url, capsys, walks
):
    told(capsys, run, "--optuna", url)
    goal = exported(optuna, url)
    other = optuna.create_study(study_name="ints", storage=url, direction="maximize")
    for key, value in goal.user_attrs.items():
        other.set_user_attr(key, value)
    trial = other.ask()
    trial.suggest_int("roll_a", 0, 3)
    capsys.readouterr()
    text = refused(capsys, run, "--optuna", url, "--name", "ints")
    assert "roll_a as IntDistribution" in text
    assert "trial 0 of the study ints" in text


def test_an_empty_study_that_the_user_has_made_is_taken(optuna, run, url, capsys):
    mine = optuna.create_study(study_name="one", storage=url, direction="maximize")
    mine.set_user_attr("note", "of mine")
    capsys.readouterr()
    told(capsys, run, "--optuna", url)
    assert exported(optuna, url).user_attrs["note"] == "of mine"
    assert "0 walks added" in told(capsys, run, "--optuna", url)


def test_an_interrupted_export_is_resumed(optuna, run, url, capsys, monkeypatch):
    set_attribute = optuna.Study.set_user_attr

    def broken(goal, key, value):
        set_attribute(goal, key, value)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(optuna.Study, "set_user_attr", broken)
        with pytest.raises(KeyboardInterrupt):
            export_to(run, url)
    assert optuna.logging.get_verbosity() != optuna.logging.CRITICAL
    assert "4 walks added" in told(capsys, run, "--optuna", url)


def export_to(run, storage, name="one"):
    from drake_gait.report.optuna import export_to_optuna

    with Study.open(run) as study:
        return export_to_optuna(study, storage, name)


def test_a_journal_is_exported_to_from_python(optuna, run, tmp_path):
    from optuna.storages.journal import JournalFileBackend

    def journal():
        return optuna.storages.JournalStorage(JournalFileBackend(str(tmp_path / "journal.log")))

    assert export_to(run, journal()) == (4, 0)
    assert export_to(run, journal()) == (0, 4)
    assert len(optuna.load_study(study_name="one", storage=journal()).get_trials()) == 4


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("optuna.db", ""),
        ("", ""),
        ("sqlite:////nowhere/optuna.db", "unable to open"),
        ("postgresql+nodriver://127.0.0.1:1/x", "nodriver"),
        ("nobase://127.0.0.1/x", "nobase"),
        ("mysql+cymysql://127.0.0.1/x", "cymysql"),
        ("redis://127.0.0.1", "Redis"),
        ("postgresql://127.0.0.1:port/x", "port"),
        ("https://example.org/optuna.db", "https"),
        ("sqlite:///{folder}", "unable to open"),
        ("sqlite:///{run}/study.toml", "not a database"),
        ("sqlite:///file:{folder}/there.db?mode=ro&uri=true", "readonly"),
        ("sqlite:///a\0b.db", "null"),
        ("sqlite://", "in memory"),
        ("sqlite:///", "in memory"),
        ("sqlite:///:memory:", "in memory"),
        ("sqlite+pysqlite:///:memory:", "in memory"),
        ("sqlite:///file::memory:?cache=shared&uri=true", "in memory"),
        ("sqlite:///file:name?mode=memory&cache=shared&uri=true", "in memory"),
        ("sqlite:///file:/name?vfs=memdb&uri=true", "in memory"),
    ],
)
@pytest.mark.usefixtures("optuna")
def test_a_database_that_cannot_be_used_is_one_line_with_one_that_can(
    run, capsys, tmp_path, url, words
):
    url = url.format(folder=tmp_path, run=run)
    (run / "study.toml").write_text("no database, " * 99, encoding="utf-8")
    sqlite3.connect(tmp_path / "there.db").executescript("create table mine (x)")
    text = refused(capsys, run, "--optuna", url)
    assert f"cannot use the database {url}" in text
    assert words in text
    assert "sqlite:///optuna.db" in text


@pytest.mark.usefixtures("optuna")
def test_a_password_is_not_shown(run, capsys):
    url = "postgresql+nodriver://me:secret@127.0.0.1:1/x"
    text = refused(capsys, run, "--optuna", url)
    assert "secret" not in text
    assert "me:***@127.0.0.1:1/x" in text


def test_exporting_into_a_new_file_says_nothing_but_its_line(optuna, run, tmp_path):
    url = f"sqlite:///{tmp_path / 'new.db'}"
    command = [
        sys.executable,
        "-W",
        "error",
        "-m",
        "drake_gait",
        "export",
        str(run),
        "--optuna",
        url,
    ]
    ended = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == f"{url}, study one: 4 walks added, 0 were there\n"


def test_without_optuna_the_extra_is_named(run, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "drake_gait.report.optuna", None)
    text = refused(capsys, run, "--optuna", "sqlite:///optuna.db")
    assert "pip install 'drake-gait[optuna]'" in text
