"""A whole study in MuJoCo: it walks, goes on, is replayed and reported as one in Drake."""

import json

import pytest

from drake_gait.cli.optimize import main as optimize
from drake_gait.cli.replay import main as replay
from drake_gait.report.result import in_words
from drake_gait.search.confirmation import walked_as
from drake_gait.simulation.simulate import simulate
from drake_gait.study.reading import default_study
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Engine

PAPER = str(default_study().with_name("paper.toml"))
SHORT = ("--set", "confirmation.walks=0", "--samples", "20", "--workers", "2")


@pytest.mark.slow
def test_a_study_in_mujoco_goes_on_and_its_walks_are_walked_again_as_they_were(tmp_path, capsys):
    folder = tmp_path / "run"
    for budget in ("21", "23"):
        arguments = [PAPER, *SHORT, "--simulations", budget, "--set", 'walk.engine="mujoco"']
        assert optimize([*arguments, "--out", str(folder)]) == 0
        capsys.readouterr()
    with Study.open(folder / "study.db") as study:
        settings, walks = study_settings(study.description()["settings"]), study.walks()
    assert settings.walk.engine is Engine.MUJOCO
    assert len(walks) == 23
    survivor = next(walk for walk in walks if walk.walk.survived)
    again = simulate(survivor.candidate, walked_as(settings, survivor))
    assert (again.forward, again.lateral, again.yaw) == (
        survivor.walk.forward,
        survivor.walk.lateral,
        survivor.walk.yaw,
    )
    page = tmp_path / "walk.html"
    assert replay([str(folder), "--walk", str(survivor.id), "--out", str(page)]) == 0
    told = capsys.readouterr()
    assert in_words(survivor.walk) in told.out
    assert told.err == ""
    assert "mujoco" in json.loads((folder / "result.json").read_text(encoding="utf-8"))["versions"]
