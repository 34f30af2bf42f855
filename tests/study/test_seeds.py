"""A seed is a whole number of any size, and every random number follows from it."""

import dataclasses
import functools

import numpy as np
import pytest
from conftest import MINIMAL, QUICK_NETWORK, run

from drake_gait.errors import SettingsError
from drake_gait.optimization import open_study
from drake_gait.study.reading import read_study
from drake_gait.study.store import Study
from drake_gait.study.toml import study_toml
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.baselines import compare
from drake_gait.surrogates.sensitivity import sensitivity

SEEDS = [0, 2**31, 2**32 - 1, 2**32, 2**63, 2**64 - 1, 2**64, 2**200, 10**3000]


@pytest.mark.parametrize("seed", SEEDS, ids=lambda seed: f"{seed.bit_length()} bits")
def test_a_seed_of_any_size_is_kept_and_comes_back(read, tmp_path, seed):
    settings = read(MINIMAL, {("study", "seed"): seed})
    open_study(settings, tmp_path / "run").close()
    with Study.open(tmp_path / "run") as study:
        assert study.description()["settings"]["study.seed"] == seed
    path = tmp_path / "again.toml"
    path.write_text(study_toml(settings))
    assert read_study(path).seed == seed


@pytest.mark.parametrize("mode", ["default", "paper", "isade", "cmaes"])
def test_a_search_takes_a_seed_of_any_size(study, path, mode):
    search = dataclasses.replace(study.search, mode=mode, samples=40, simulations=45)
    ours = run(dataclasses.replace(study, seed=2**200, search=search), path)
    assert len(ours) == 45
    theirs = run(
        dataclasses.replace(study, seed=2**200 + 1, search=search), path.with_name("other.db")
    )
    assert [walk.walk for walk in ours] != [walk.walk for walk in theirs]


@pytest.mark.parametrize("seed", [2**63, 2**64, 10**3000], ids=lambda seed: "huge")
def test_a_network_its_baselines_and_its_sensitivity_take_a_seed_of_any_size(space, seed):
    x = np.random.default_rng(0).uniform(-1, 1, (40, 16))
    outputs, survived = x[:, :4] * 0.1, x[:, 5] < 0.5
    fit = functools.partial(surrogate.fit, x, outputs, survived, settings=QUICK_NETWORK)
    network, again = fit(seed=seed), fit(seed=seed)
    assert (network.predict(x).mean == again.predict(x).mean).all()
    other = fit(seed=seed + 1)
    assert (network.predict(x).mean != other.predict(x).mean).any()
    compare(network, x, outputs, survived, seed=seed)
    surrogate.fit_single(x, outputs, seed=seed, settings=QUICK_NETWORK)
    sensitivity(lambda points: points[:, 0], space, seed=seed)


def test_a_seed_that_torch_takes_is_the_one_that_it_gets():
    assert [surrogate._seed_for_torch(seed) for seed in SEEDS[:6]] == SEEDS[:6]
    assert len({surrogate._seed_for_torch(seed) for seed in SEEDS}) == len(SEEDS)


@pytest.mark.parametrize(
    "seed", ["-1", "-" + "9" * 500, "9" * 4500, "0x" + "f" * 5000, "1.5", "1e3", "'7'", "true"]
)
def test_a_seed_that_is_none_is_one_line(read, seed):
    with pytest.raises(SettingsError) as caught:
        read(MINIMAL.replace("[box]", f"seed = {seed}\n[box]"))
    assert "\n" not in str(caught.value)
    assert "study.toml" in str(caught.value)
