"""The comparison of searches: what can be trusted of one, and where half of its walks hold."""

import dataclasses
import importlib.util

import numpy as np
import pytest
from conftest import walk_at

from drake_gait.errors import SettingsError
from drake_gait.study.reading import default_study
from drake_gait.study.search_settings import Mode
from drake_gait.walk import Fidelity


@pytest.fixture(scope="module")
def bench(repository):
    path = repository / "tools" / "bench_search.py"
    spec = importlib.util.spec_from_file_location("bench_search", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_arm_is_a_mode_and_settings_of_its_own(bench):
    one = bench.settings_of(default_study(), "cmaes+search.grounds=false+search.batch=8", 4, 300)
    assert (one.search.mode, one.search.grounds, one.search.batch) == (Mode.CMAES, False, 8)
    assert (one.seed, one.search.simulations) == (4, 300)
    assert bench.settings_of(default_study(), "paper", 0, None).search.samples == 200
    with pytest.raises(SettingsError, match=r"search\.mode .*'cmeas'"):
        bench.settings_of(default_study(), "cmeas", 0, None)


def test_every_candidate_meets_the_same_noise_and_both_grounds(bench, study, space, monkeypatch):
    walked = []
    monkeypatch.setattr(bench, "walk_trial", walked.append)
    candidates = [space.decode(np.full(16, value)) for value in (0.0, 0.3)]
    for one in candidates:
        for number in (1, 2):
            bench.fresh(study, one, number, Fidelity.REFERENCE)
    noise = [
        trial.candidate.gait.coefficients - candidates[place // 2].gait.coefficients
        for place, trial in enumerate(walked)
    ]
    assert noise[0] == pytest.approx(noise[2], abs=1e-15)
    assert noise[1] == pytest.approx(noise[3], abs=1e-15)
    assert (noise[0] != noise[1]).all()
    assert [trial.settings.friction for trial in walked] == pytest.approx([0.9, 1.1] * 2)
    assert {trial.settings.fidelity for trial in walked} == {Fidelity.REFERENCE}


def test_a_candidate_is_trusted_if_seven_of_eight_are_feasible(bench, study, space, monkeypatch):
    good = dataclasses.replace(walk_at(np.zeros(16)), lateral=0.0, yaw=0.0, com_height=0.245)
    for failing, expected in ((1, 180.0), (2, 0.0)):
        walks = iter(
            [dataclasses.replace(good, forward=0.18, lateral=0.5 * (n < failing)) for n in range(8)]
        )
        monkeypatch.setattr(bench, "walk_trial", lambda trial, walks=walks: next(walks))
        found = bench._walked(study, space.decode(np.zeros(16)), Fidelity.SEARCH)
        assert found["trusted_mm"] == pytest.approx(expected)
        assert found["feasible"] == 8 - failing


def test_half_of_the_walks_hold_where_they_were_drawn_to(bench):
    rng = np.random.default_rng(0)
    distance = rng.uniform(200.0, 600.0, 4000)
    held = rng.random(4000) < 1.0 / (1.0 + np.exp((distance - 430.0) / 40.0))
    assert bench.half_hold(distance, held) == pytest.approx(430.0, abs=8.0)


def test_where_none_holds_no_distance_does(bench):
    distance = np.linspace(200.0, 600.0, 80)
    assert bench.half_hold(distance, np.zeros(80, dtype=bool)) == 0.0
    assert bench.half_hold(np.empty(0), np.empty(0, dtype=bool)) == 0.0
    assert bench.half_hold(distance, np.ones(80, dtype=bool)) == 600.0
