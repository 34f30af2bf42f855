"""Gaits on a grid of feet."""

import dataclasses
import json
import re

import numpy as np
import pytest

from drake_gait.errors import StudyError
from drake_gait.execution.base import Serial
from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.robot.description import model_path
from drake_gait.sweep import grid as foot_grid
from drake_gait.sweep.grid import candidate, places, run_grid
from drake_gait.sweep.settings import Axis, Grid
from drake_gait.walk import Outcome, Walk


@pytest.fixture
def grid(study):
    stiffness, damping = (0.01, 0.02, 0.04), (1e-4, 1e-3)
    return Grid(
        settings=study,
        gaits=(Gait.from_degrees(np.zeros((4, 4))), Gait.from_degrees(np.ones((4, 4)))),
        axes=(
            Axis(name="stiffness", levels=tuple({"big": value} for value in stiffness)),
            Axis(name="damping", levels=tuple({"toe": value} for value in damping)),
        ),
        feet=tuple(
            tuple(FootDesign(big_toe_stiffness=one, toe_damping=two) for two in damping)
            for one in stiffness
        ),
        replicas=3,
        noise_deg=0.05,
    )


@pytest.fixture
def walked(monkeypatch):
    """Candidates that were walked; a stiffer toe walks further, and the second gait falls once."""
    seen = []

    def walk(trial, model):
        assert model.name == trial.settings.model
        asked = trial.candidate
        seen.append(asked)
        noise = asked.gait.degrees[0, 0] - round(asked.gait.degrees[0, 0])
        fell = len(seen) == 5
        return Walk(
            outcome=Outcome.FELL if fell else Outcome.WALKED,
            frames=100 if fell else 240,
            forward=0.2 + 5.0 * asked.foot.big_toe_stiffness + 0.01 * noise,
            lateral=0.0,
            yaw=0.0,
            com_height=0.24,
        )

    class Here(Serial):
        def __init__(self, walk, *, count, time_limit):
            super().__init__(walk)

        def __enter__(self):
            return self

        def __exit__(self, *exception):
            pass

    monkeypatch.setattr(foot_grid, "walk_trial", walk)
    monkeypatch.setattr(foot_grid, "LocalProcesses", Here)
    return seen


def test_every_gait_walks_every_replica_on_every_foot(grid):
    found = places(grid)
    assert len(found) == len(set(found)) == 3 * 2 * 2 * 3
    # An interrupted grid is as even as can be.
    assert [place[3] for place in found] == sorted(place[3] for place in found)


def test_a_walk_s_noise_is_its_own_and_within_what_was_asked_for(grid):
    seen = {candidate(grid, place).gait for place in places(grid)}
    assert len(seen) == len(places(grid))
    for place in places(grid):
        asked = candidate(grid, place)
        assert asked == candidate(grid, place)
        assert asked.foot == grid.feet[place[0]][place[1]]
        noise = asked.gait.degrees - grid.gaits[place[2]].degrees
        assert 0.0 < np.abs(noise).max() <= 0.05 + 1e-12


def test_the_factor_that_matters_is_found_and_the_best_foot(grid, walked, tmp_path):
    text = run_grid(grid, tmp_path, 1)
    assert len(walked) == 36
    content = json.loads((tmp_path / "anova.json").read_text())
    stiffness, damping, _, residual = content["effects"]
    assert (stiffness["name"], damping["name"]) == ("stiffness", "damping")
    assert stiffness["share"] > 0.9
    assert stiffness["p_value"] < 1e-6 < damping["p_value"]
    # One of 36 fell; gaits and cells take 1 + 6 degrees of freedom.
    assert residual["degrees"] == 35 - 7
    assert (content["walks"], content["survivors"]) == (36, 35)
    assert np.sum(content["survivors_by_cell"]) == 35
    assert np.diff(np.array(content["mean_forward_mm"]), axis=0).min() > 30.0
    assert re.search(r"furthest: stiffness 0\.04, damping (0\.0001|0\.001), 4\d\d\.\d mm", text)
    assert (tmp_path / "grid.png").stat().st_size > 0


def test_an_interrupted_grid_walks_only_what_is_missing(grid, walked, tmp_path):
    run_grid(grid, tmp_path, 1)
    whole = (tmp_path / "grid.csv").read_text()
    result = (tmp_path / "anova.json").read_text()
    lines = whole.splitlines()
    # The last line was cut off in the middle.
    (tmp_path / "grid.csv").write_text("\n".join(lines[:21]) + "\n" + lines[21][:9])
    del walked[:]
    walked.extend([None] * 10)  # The fifth of all has fallen already.
    run_grid(grid, tmp_path, 1)
    assert len(walked) - 10 == 36 - 20
    assert (tmp_path / "grid.csv").read_text() == whole
    assert (tmp_path / "anova.json").read_text() == result


@pytest.mark.parametrize(
    "damage",
    [
        "",
        "nonsense\n",
        "first,second\n0,0,0,0,walked,240,nan,0,0\n1,0,0,0,jumped,240,1,0,0\n\xff\n",
        "first,second\n2,0,0,0.5,walked,240,1,0,0\n0,0,0,0,walked,240,1,0,0",
        None,
    ],
)
def test_walks_that_cannot_be_read_are_walked_again(grid, walked, tmp_path, damage):
    run_grid(grid, tmp_path, 1)
    whole = (tmp_path / "grid.csv").read_text()
    path = tmp_path / "grid.csv"
    path.unlink() if damage is None else path.write_text(damage, encoding="latin-1")
    del walked[:]
    run_grid(grid, tmp_path, 1)
    assert len(walked) == 36
    assert path.read_text() == whole


def test_a_grid_that_is_not_known_is_refused_by_its_file(grid, walked, tmp_path):
    run_grid(grid, tmp_path, 1)
    (tmp_path / "grid.json").write_text("{")
    with pytest.raises(StudyError, match=r"grid\.json is damaged.*--out"):
        run_grid(grid, tmp_path, 1)
    (tmp_path / "grid.json").unlink()
    with pytest.raises(StudyError, match=r"grid\.csv .*grid\.json is missing.*--out"):
        run_grid(grid, tmp_path, 1)
    (tmp_path / "grid.csv").unlink()
    run_grid(grid, tmp_path, 1)


@pytest.mark.parametrize("survivors", [0, 1, 2, 3])
def test_where_too_few_walks_survive_the_analysis_alone_is_left_out(
    grid, monkeypatch, walked, tmp_path, survivors
):
    walk = foot_grid.walk_trial

    def mostly_falls(trial, model=None):
        fell = len(walked) >= survivors
        found = walk(trial, model)
        return dataclasses.replace(found, outcome=Outcome.FELL if fell else Outcome.WALKED)

    monkeypatch.setattr(foot_grid, "walk_trial", mostly_falls)
    text = run_grid(grid, tmp_path, 1)
    content = json.loads((tmp_path / "anova.json").read_text(), parse_constant=pytest.fail)
    assert (content["walks"], content["survivors"], content["effects"]) == (36, survivors, [])
    assert f"the {survivors} walks" in content["no_effects_because"]
    assert content["no_effects_because"] in text
    assert "furthest: none" in text
    assert "nan" not in text
    assert (tmp_path / "grid.png").stat().st_size > 0


def test_more_replicas_go_on_with_a_grid_and_another_grid_is_refused(grid, walked, tmp_path):
    run_grid(grid, tmp_path, 1)
    run_grid(dataclasses.replace(grid, replicas=4), tmp_path, 1)
    assert len(walked) == 48
    with pytest.raises(StudyError, match=r"holds another grid; give --out"):
        run_grid(dataclasses.replace(grid, noise_deg=0.1), tmp_path, 1)


def test_a_grid_of_another_robot_is_another_grid(grid, walked, tmp_path):
    robot = tmp_path / "mine.sdf"
    robot.write_bytes(model_path().read_bytes())
    walk = dataclasses.replace(grid.settings.walk, model=str(robot))
    other = dataclasses.replace(
        grid, settings=dataclasses.replace(grid.settings, walk=walk), replicas=1
    )
    run_grid(other, tmp_path / "out", 1)
    robot.write_text(robot.read_text().replace(">1.373<", ">1.3<"))
    with pytest.raises(StudyError, match=r"holds another grid; give --out"):
        run_grid(other, tmp_path / "out", 1)
