"""The command that records a walk of a study again."""

import re
import subprocess
import sys

import pytest
from browser import in_a_browser, opened

from drake_gait.cli import _replay as replay
from drake_gait.cli.replay import main
from drake_gait.report.result import in_words
from drake_gait.robot.description import read_model
from drake_gait.search.confirmation import walked_as
from drake_gait.simulation.simulate import simulate
from drake_gait.study.finalists import winner
from drake_gait.study.ranking import best_walk
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.visualization.meshcat import start_meshcat
from drake_gait.walk import Outcome


def refused(capsys, *arguments):
    """What a refusal says: one line on standard error, exit status 2."""
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.fixture(scope="module")
def run(finished_run):
    """Folder, settings and walks of a study."""
    folder, _ = finished_run
    with Study.open(folder / "study.db") as study:
        return folder, study_settings(study.description()["settings"]), study.walks()


@pytest.mark.slow
def test_a_walk_simulated_again_has_exactly_the_numbers_of_the_study(run):
    _, settings, walks = run
    ends = [next(walk for walk in walks if walk.walk.survived), walks[-1]]
    fallen = [walk for walk in walks if walk.walk.outcome is Outcome.FELL][:1]
    for entry in ends + fallen:
        again = simulate(entry.candidate, walked_as(settings, entry), history=True)
        for name in ("outcome", "frames", "forward", "lateral", "yaw", "com_height", "reason"):
            assert getattr(again, name) == getattr(entry.walk, name)


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 23])
def test_any_walk_of_a_study_is_recorded_as_a_page(run, capsys, tmp_path, number):
    folder, _, walks = run
    out = tmp_path / "walk.html"
    assert main([str(folder), "--walk", str(number), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert f"walk {number}: {in_words(walks[number].walk)}" in printed
    assert f"walk {number}" in out.read_text(encoding="utf-8")


@pytest.mark.slow
def test_without_a_number_the_best_walk_is_recorded(run, capsys, tmp_path):
    folder, settings, walks = run
    assert main([str(folder), "--out", str(tmp_path / "best.html")]) == 0
    robust = winner(settings, walks)
    best = robust.walk if robust else best_walk(walks, settings.constraints)
    assert f"walk {best.id}: " in capsys.readouterr().out


@pytest.mark.slow
def test_a_walk_that_comes_out_otherwise_than_stored_is_told(run, capsys, tmp_path, monkeypatch):
    folder, _, walks = run

    def otherwise(candidate, walk_settings, *, history):
        # What another version of Drake may do: another walk's numbers.
        return simulate(walks[1].candidate, walk_settings, history=history)

    monkeypatch.setattr(replay, "simulate", otherwise)
    assert main([str(folder), "--walk", "0", "--out", str(tmp_path / "walk.html")]) == 0
    assert re.search(r"study .* has .* mm forward", capsys.readouterr().err)


@pytest.mark.slow
@pytest.mark.parametrize("number", [24, -1, 1000])
def test_a_walk_that_the_study_does_not_have_is_one_line_with_those_it_has(
    run, capsys, tmp_path, number
):
    folder, _, _ = run
    out = tmp_path / "walk.html"
    text = refused(capsys, folder, f"--walk={number}", "--out", out)
    assert f"no walk {number}; the study has walks 0 to 23" in text
    assert not out.exists()


@pytest.mark.slow
def test_a_page_that_cannot_be_written_is_one_line(run, capsys, tmp_path):
    folder, _, _ = run
    blocked = tmp_path / "file"
    blocked.write_text("mine")
    assert "file" in refused(capsys, folder, "--walk", 0, "--out", blocked / "walk.html")
    assert "cannot write" in refused(capsys, folder, "--walk", 0, "--out", tmp_path)


def test_a_folder_that_does_not_exist_is_one_line_with_the_command_that_makes_one(capsys, tmp_path):
    text = refused(capsys, tmp_path / "nowhere", "--out", tmp_path / "walk.html")
    assert "no study file" in text
    assert "drake_gait.optimize" in text
    assert not (tmp_path / "nowhere").exists()


def test_a_study_without_walks_is_one_line(capsys, tmp_path, study):
    model = read_model()
    description = {"settings": study.description(), "model_sha256": model.sha256}
    with Study.create(tmp_path / "study.db", description):
        pass
    assert "no walks yet" in refused(capsys, tmp_path, "--out", tmp_path / "walk.html")


def test_a_study_of_a_robot_that_has_changed_is_one_line(capsys, tmp_path, study):
    with Study.create(
        tmp_path / "study.db", {"settings": study.description(), "model_sha256": "abc"}
    ):
        pass
    text = refused(capsys, tmp_path, "--out", tmp_path / "walk.html")
    assert "another version of khr3hv.sdf" in text


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "--out"),
        (["--live", "--out", "a.html"], "--out"),
        (["--port", "7001", "--out", "a.html"], "--port: is for --live"),
        (["--live", "--port", "80"], "from 1024 to 65535, got 80"),
        (["--live", "--gallery"], "--live shows one walk"),
        (["--live", "--rigid-toes"], "--live shows one walk"),
    ],
)
def test_options_that_contradict_each_other_are_refused(capsys, tmp_path, arguments, text):
    with pytest.raises(SystemExit) as ended:
        main([str(tmp_path), *arguments])
    assert ended.value.code == 2
    assert text in capsys.readouterr().err


@pytest.mark.slow
def test_a_gallery_shows_each_study_s_best_walk_with_and_without_bending_toes(
    run, capsys, tmp_path
):
    folder, _, _ = run
    out = tmp_path / "gallery.html"
    assert main([str(folder), "--gallery", str(folder), "--rigid-toes", "--out", str(out)]) == 0
    *labels, last = capsys.readouterr().out.splitlines()
    assert last == str(out)
    assert len(labels) == 4
    assert ["rigid toes" in label for label in labels] == [False, True, False, True]
    text = out.read_text(encoding="utf-8")
    assert all(label in text for label in labels)


@pytest.mark.slow
def test_a_live_page_on_a_taken_port_is_one_line(run, capsys):
    folder, _, _ = run
    taken = start_meshcat()
    text = refused(capsys, folder, "--live", "--port", taken.port())
    assert f"port {taken.port()} is taken" in text


@pytest.mark.slow
@in_a_browser
def test_a_walk_is_seen_in_a_browser_while_it_is_simulated(run):
    folder, _, _ = run
    command = [sys.executable, "-m", "drake_gait", "replay", str(folder), "--live"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        told = process.stdout.readline()
        place = re.search(r"http://localhost:\d+", told)[0]
        with opened(place, offline=False) as seen:
            # Meshcat names its objects by their paths.
            torso = """() => {
                let found = null;
                viewer.scene.traverse(object => {
                    if (object.name === "torso") found = object.matrixWorld.elements[12];
                });
                return found;
            }"""
            seen.page.wait_for_function(f"window.viewer && ({torso})() !== null")
            result = process.stdout.readline()
            seen.page.wait_for_timeout(300)
            ended = 1e3 * seen.page.evaluate(torso)  # it begins above the origin
            forward = float(re.search(r"(-?[0-9.]+) mm forward", result)[1])
            assert ended == pytest.approx(forward, abs=40.0)
            assert abs(ended) > 50.0
            elsewhere = [url for url in seen.requests if not url.startswith((place, "ws://local"))]
            assert elsewhere == []
        assert process.wait(timeout=60) == 0  # its last reader has gone
