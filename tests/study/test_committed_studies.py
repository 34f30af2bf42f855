"""The studies of studies/ are what their files say, and their winners walk as they are said to."""

import json
import re
from dataclasses import replace

import pytest

from drake_gait.provenance import file_sha256
from drake_gait.robot.description import model_path
from drake_gait.search.confirmation import walked_as
from drake_gait.simulation.plant import stall_torques
from drake_gait.simulation.simulate import simulate
from drake_gait.study.finalists import finalists, winner
from drake_gait.study.reading import read_study
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.walk import Integrator


@pytest.fixture(params=["best", "reference"])
def committed(request, repository):
    """Settings, the study and its result."""
    folder = repository / "studies" / request.param
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    with Study.open(folder) as study:
        yield read_study(repository / "studies" / f"{request.param}.toml"), study, result


def test_a_committed_study_is_that_of_its_file_and_of_the_shipped_robot(committed):
    settings, study, _ = committed
    known = study.description()
    # Its file says also what came later, with what it walked with.
    assert study_settings(known["settings"]).description() == settings.description()
    assert known["model_sha256"] == file_sha256(model_path())


def test_its_winner_walks_again_as_it_did(committed):
    settings, study, result = committed
    found = winner(settings, study.walks())
    assert found is not None
    assert found.walk.id == result["winner"]
    assert 1e3 * found.median == pytest.approx(result["finalists"][0]["median_mm"])
    again = simulate(found.walk.candidate, walked_as(settings, found.walk))
    assert again.forward == pytest.approx(found.walk.walk.forward, abs=1e-9)
    assert again.lateral == pytest.approx(found.walk.walk.lateral, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("committed", ["reference"], indirect=True)
def test_the_refined_walk_that_bears_all_noise_is_feasible_at_other_steps_too(committed):
    settings, study, _ = committed
    (steady,) = (one for one in finalists(settings, study.walks()) if one.feasible == 8)
    for integrator in (Integrator(step=0.001), Integrator(step=0.02, accuracy=1e-5)):
        walk = simulate(steady.walk.candidate, replace(settings.walk, integrator=integrator))
        assert settings.assess(walk).feasible
        assert walk.forward == pytest.approx(steady.walk.walk.forward, abs=5e-3)


def test_the_page_of_braking_servos_counts_the_walks_beyond_them(committed, repository):
    settings, study, _ = committed
    servo, stall = settings.walk.servo, stall_torques().max()
    measured = [walk.walk.measures for walk in study.walks() if walk.walk.measures]
    page = repository / "docs" / "experiments" / "2026-11-27-braking-servos.md"
    row = re.search(rf"^\| `studies/{settings.name}` \|(.*)\|$", page.read_text("utf-8"), re.M)[1]
    row = row.split(" | ")
    assert list(map(int, row[:3])) == [
        len(measured),
        sum(measures.peak_torque > stall for measures in measured),
        sum(measures.peak_speed > servo.no_load_speed for measures in measured),
    ]
    torque, speed = (max(map(float, cell.split(" / "))) for cell in row[3:5])
    assert torque == round(max(measures.peak_torque for measures in measured), 2)
    assert speed == round(max(measures.peak_speed for measures in measured), 2)
