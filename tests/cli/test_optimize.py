"""The command that runs a study, as a person runs it."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drake_gait.cli import _optimize
from drake_gait.cli.optimize import main, parse
from drake_gait.study.reading import default_study
from drake_gait.study.records import CONFIRMATIONS
from drake_gait.study.store import Study

# Of the paper's study: among so few walks of it some are feasible.
PAPER = str(default_study().with_name("paper.toml"))
TINY = (PAPER, "--samples", "20", "--simulations", "24")

FILES = {"study.db", "study.toml", "result.json", "report.html", "walk.html", "figures"}
FIGURES = {
    *("waveforms", "paths", "postures", "ground_reaction", "torques"),
    *("convergence", "coordinates"),
}
OF_THE_NETWORK = {"network", "sensitivity"}


def walks_in(folder):
    """All that a study says of its walks but when they ran and how long they took."""
    connection = sqlite3.connect(folder / "study.db")
    columns = [row[1] for row in connection.execute("pragma table_info(walks)")]
    kept = [name for name in columns if name not in ("seconds", "finished")]
    rows = connection.execute(f"select {', '.join(kept)} from walks order by id").fetchall()
    connection.close()
    return rows


def refused(capsys, *arguments):
    """What a refusal says: one line on standard error, exit status 2."""
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_without_arguments_the_default_study_runs():
    options = parse([])
    assert options.study == default_study()
    assert options.settings().name == "steady"
    assert options.workers is None  # As many as there is room and work for.
    assert options.out is None


def test_the_command_line_overrides_the_study():
    settings = parse(["--samples", "30", "--simulations", "50", "--seed", "9"]).settings()
    assert (settings.search.samples, settings.search.simulations, settings.seed) == (30, 50, 9)


def test_any_setting_of_the_file_is_overridden_and_the_last_word_counts():
    arguments = ["--set", "walk.time_limit_s=7", "--seed", "3", "--set", "study.seed = 4"]
    settings = parse([*arguments, "--set", "study.name=my toes"]).settings()
    assert (settings.walk.time_limit, settings.seed, settings.name) == (7.0, 4, "my toes")
    assert parse([*arguments, "--seed", "5"]).settings().seed == 5


@pytest.mark.parametrize(
    "arguments", [("--workers", "0"), ("--workers", "-1"), ("--workers", "two"), ("--sample", "x")]
)
def test_an_option_that_cannot_be_used_ends_with_status_2_and_its_name(capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert arguments[0] in capsys.readouterr().err


def test_the_help_names_every_option(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    for option in (
        "--set",
        "--samples",
        "--simulations",
        "--seed",
        "--workers",
        "--out",
        "STUDY.toml",
    ):
        assert option in text


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("--samples", "0"), "search.samples"),
        (("--samples", "50", "--simulations", "40"), "search.simulations"),
        (("--seed", "-1"), "study.seed"),
        (("--seed", "two"), "study.seed must be a whole number >= 0, got 'two'"),
        (("--simulations", "4e2"), "search.simulations must be a whole number >= 1, got 400.0"),
        (("--set", "search.batch=ten"), "search.batch must be a whole number >= 4, got 'ten'"),
        (("--set", "serach.batch=10"), "no section is called 'serach'; the nearest is 'search'"),
        (("--set", "search.bach=10"), "'bach'; the nearest is 'batch'"),
        (("--set", "samples=10"), "section.key=value, like search.samples=..., got 'samples=10'"),
        (("--set", "search.samples"), "section.key=value, like search.samples=..."),
        (("--set", "box.centre_deg=[[1, 2]"), "the value of box.centre_deg is not TOML"),
        (("--set", "walk.fidelity=coarse"), "walk.fidelity must be one of"),
        (("nowhere.toml",), "nowhere.toml"),
    ],
)
def test_a_setting_that_cannot_be_used_is_one_line(capsys, tmp_path, arguments, name):
    out = tmp_path / "run"
    assert name in refused(capsys, *arguments, "--out", out)
    assert not out.exists()


def test_a_slip_in_a_study_is_one_line_without_a_traceback(paper_study, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(paper_study.read_text().replace("samples =", "sampels ="))
    ended = subprocess.run(
        [sys.executable, "-m", "drake_gait.optimize", study, "--out", tmp_path / "run"],
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert ended.stderr.count("\n") == 1
    assert "'sampels'; the nearest is 'samples'" in ended.stderr


@pytest.fixture
def study_of(paper_study, tmp_path):
    """Writes the paper's study with another robot."""

    def write(model):
        path = tmp_path / "study.toml"
        text = paper_study.read_text()
        path.write_text(re.sub(r'(?m)^model = ".*"', f'model = "{model}"', text))
        return path

    return write


def test_a_robot_that_does_not_exist_is_one_line_with_those_that_do(capsys, study_of, tmp_path):
    out = tmp_path / "run"
    text = refused(capsys, study_of("khr4hv.sdf"), "--out", out)
    assert "khr4hv.sdf'" in text
    assert "khr3hv.sdf" in text
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", "broken.sdf is not a well-formed XML file"),
        ("<sdf", "broken.sdf is not a well-formed XML file"),
        ("Not XML at all.", "broken.sdf is not a well-formed XML file"),
        ("<sdf version='1.9'></sdf>", "must be one <model>, got 0"),
        (None, "broken.sdf is not a well-formed XML file"),
    ],
    ids=["empty", "one tag", "text", "no model", "cut in half"],
)
def test_a_broken_robot_is_one_line(capsys, repository, study_of, tmp_path, content, text):
    robot = tmp_path / "broken.sdf"
    if content is None:
        whole = (repository / "models" / "khr3hv.sdf").read_text()
        content = whole[: len(whole) // 2]
    robot.write_text(content)
    out = tmp_path / "run"
    assert text in refused(capsys, study_of(robot), "--out", out)
    assert not out.exists()


def test_a_file_in_the_place_of_the_folder_is_one_line(capsys, tmp_path):
    out = tmp_path / "file"
    out.write_text("mine")
    assert "cannot write in" in refused(capsys, *TINY, "--out", out)
    assert out.read_text() == "mine"


def test_a_folder_with_something_else_called_study_is_one_line(capsys, tmp_path):
    (tmp_path / "study.db").write_text("My studies, by hand. " * 500)
    assert "is no study" in refused(capsys, *TINY, "--out", tmp_path)


def test_ctrl_c_at_any_moment_is_one_line_and_status_130(capsys, monkeypatch, tmp_path):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    for name in ("open_study", "search_study", "_write_results"):
        with monkeypatch.context() as patch:
            if name == "_write_results":
                patch.setattr(_optimize, "search_study", lambda *arguments, **options: None)
            patch.setattr(_optimize, name, interrupt)
            assert main([*TINY, "--workers", "1", "--out", str(tmp_path)]) == 130
        captured = capsys.readouterr()
        assert "the same command goes on" in captured.out
        assert captured.err == ""


@pytest.mark.slow
def test_a_study_leaves_its_files(finished_run):
    folder, _ = finished_run
    found = {path.name for path in folder.iterdir()}
    assert found >= FILES
    assert found <= {*FILES, "study.lock"}
    drawn = {path.name for path in (folder / "figures").iterdir()}
    endings = (".png", ".svg")
    assert drawn >= {name + ending for name in FIGURES for ending in endings}
    allowed = FIGURES | OF_THE_NETWORK | {"pareto", "portrait"}
    assert drawn <= {name + ending for name in allowed for ending in endings}
    assert all(path.stat().st_size > 0 for path in folder.rglob("*") if path.name != "study.lock")


@pytest.mark.slow
def test_a_study_s_result_is_that_of_its_walks(finished_run):
    folder, _ = finished_run
    result = json.loads((folder / "result.json").read_text())
    assert (result["study"], result["seed"], result["simulations"]) == ("paper", 0, 24)
    with Study.open(folder / "study.db") as study:
        walks = [walk for walk in study.walks() if walk.is_search_walk]
    assert [walk.id for walk in walks] == list(range(24))
    best = walks[result["walk"]]
    assert result["forward_mm"] == 1e3 * best.walk.forward
    assert result["coefficients_deg"] == best.candidate.gait.degrees.tolist()
    assert result["survivors"] == sum(walk.walk.survived for walk in walks)
    assert result["wall_s"] > 0.0


@pytest.mark.slow
def test_a_study_prints_its_progress_and_a_table_beside_the_paper_s(finished_run):
    folder, output = finished_run
    assert "study paper, seed 0: 24 walks" in output
    assert re.search(r"walks \d+/24 +survivors \d+ +feasible \d+ +best feasible .* left", output)
    assert "those of the paper, Table II" in output
    assert len(re.findall(r"F\d +-?\d+\.\d\d +\d+\.\d\d +-?\d+\.\d\d +240\n", output)) == 8
    assert str(folder) in output.splitlines()[-1]


@pytest.mark.slow
def test_a_finished_study_says_so_and_is_left_as_it_is(finished_run, capsys):
    folder, _ = finished_run
    before = walks_in(folder)
    assert main([*TINY, "--workers", "1", "--out", str(folder)]) == 0
    assert f"{folder} is finished" in capsys.readouterr().out
    assert walks_in(folder) == before
    assert json.loads((folder / "result.json").read_text())["simulations"] == 24


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((*TINY, "--seed", "1"), "study.seed = 0, not 1"),
        (
            (PAPER, "--samples", "20", "--simulations", "22"),
            "24 walks already, more than search.simul",
        ),
        ((PAPER, "--samples", "21", "--simulations", "24"), "search.samples = 20, not 21"),
    ],
)
def test_other_settings_for_a_study_s_folder_are_refused_by_name(
    finished_run, capsys, arguments, text
):
    folder, _ = finished_run
    assert text in refused(capsys, *arguments, "--out", folder)


@pytest.mark.slow
def test_a_larger_budget_extends_a_finished_study(finished_run, capsys, tmp_path):
    folder, _ = finished_run
    (tmp_path / "study.db").write_bytes((folder / "study.db").read_bytes())
    larger = (PAPER, "--samples", "20", "--simulations", "26", "--workers", "1")
    assert main([*larger, "--out", str(tmp_path)]) == 0
    assert "24 of them done before" in capsys.readouterr().out
    walks, before = (
        [walk for walk in walks_in(place) if walk[0] < CONFIRMATIONS]
        for place in (tmp_path, folder)
    )
    assert len(walks) == 26
    assert walks[:24] == before
    assert json.loads((tmp_path / "result.json").read_text())["simulations"] == 26


@pytest.mark.slow
@pytest.mark.parametrize("name", ["result.json", "report.html", "walk.html", "figures/paths.png"])
def test_a_result_that_cannot_be_written_is_one_line(finished_run, capsys, tmp_path, name):
    folder, _ = finished_run
    (tmp_path / "study.db").write_bytes((folder / "study.db").read_bytes())
    (tmp_path / name).mkdir(parents=True)
    assert name in refused(capsys, *TINY, "--out", tmp_path)


def start(*arguments):
    """The command in a session of its own, as a terminal runs it."""
    return subprocess.Popen(
        [sys.executable, "-m", "drake_gait.optimize", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A job in the background of a script inherits a deaf ear.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def wait_for_end_of_session(session):
    for _ in range(200):
        if not any(running_processes(session)):
            return
        time.sleep(0.05)
    pytest.fail("a process is left")


def running_processes(session):
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            # After the name, in brackets: state, parent, group, session (proc(5)).
            state, _, _, found = path.read_text().rpartition(")")[2].split()[:4]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(found) == session and state != "Z":
            yield path


def wait_for_walks(folder, count):
    for _ in range(1200):
        if (folder / "study.db").exists() and len(walks_in(folder)) >= count:
            return
        time.sleep(0.05)
    pytest.fail("no walk in a minute")


@pytest.mark.slow
def test_signals_end_a_study_that_the_same_command_then_finishes(finished_run, tmp_path):
    folder, _ = finished_run
    arguments = (*TINY, "--workers", "1", "--out", tmp_path)
    for sent, status, walks in ((signal.SIGINT, 130, 0), (signal.SIGTERM, 143, 5)):
        driver = start(*arguments)
        wait_for_walks(tmp_path, walks)
        if walks == 0:
            time.sleep(0.5)  # Its workers are busy with their imports.
        os.killpg(driver.pid, sent)  # A terminal and a cluster send it to workers too.
        output, errors = driver.communicate()
        assert driver.returncode == status
        assert errors == ""
        assert "the same command goes on" in output
        wait_for_end_of_session(driver.pid)  # No worker is left.
        assert walks <= len(walks_in(tmp_path)) < 24
    # One worker, interrupted: the same walks as two workers without.
    again = start(*arguments)
    output, errors = again.communicate()
    assert (again.returncode, errors) == (0, "")
    assert walks_in(tmp_path) == walks_in(folder)


@pytest.mark.slow
def test_a_study_on_a_dask_cluster_has_the_same_walks(finished_run, tmp_path):
    pytest.importorskip("distributed")
    folder, _ = finished_run
    driver = start(*TINY, "--workers", "2", "--dask", "local", "--out", tmp_path)
    _, errors = driver.communicate()
    assert (driver.returncode, errors) == (0, "")
    wait_for_end_of_session(driver.pid)
    assert walks_in(tmp_path) == walks_in(folder)


@pytest.mark.parametrize(
    ("address", "text"), [("nonsense", "tcp://HOST:PORT"), ("none.json", "no scheduler file")]
)
def test_an_unusable_cluster_is_one_line(capsys, tmp_path, address, text):
    assert text in refused(capsys, *TINY, "--dask", address, "--out", tmp_path)


@pytest.mark.slow
def test_a_killed_study_is_resumed_with_the_same_walks(finished_run, tmp_path):
    folder, _ = finished_run
    arguments = (*TINY, "--workers", "2", "--out", tmp_path)
    driver = start(*arguments)
    wait_for_walks(tmp_path, 8)
    os.kill(driver.pid, signal.SIGKILL)
    driver.communicate()
    kept = walks_in(tmp_path)
    assert len(kept) >= 8
    again = start(*arguments)
    output, errors = again.communicate()
    assert (again.returncode, errors) == (0, "")
    assert "of them done before" in output
    assert walks_in(tmp_path) == walks_in(folder)


@pytest.mark.slow
def test_a_second_command_on_a_running_study_is_refused(tmp_path, capsys):
    driver = start(*TINY, "--workers", "1", "--out", tmp_path)
    try:
        wait_for_walks(tmp_path, 1)
        assert "another process is working on" in refused(capsys, *TINY, "--out", tmp_path)
        assert driver.poll() is None
    finally:
        driver.kill()
        driver.communicate()


def test_the_default_folder_is_named_after_the_study(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    folders = []
    monkeypatch.setattr(_optimize, "work", lambda settings, folder, *rest: folders.append(folder))
    assert main([]) == 0
    assert folders == [Path("runs") / "steady"]
