"""Grids of feet, with walks that are computed, not simulated."""

import csv
import dataclasses
import json
import re

import numpy as np
import pytest

from drake_gait.cli import studies
from drake_gait.errors import GaitError, SettingsError, StudyError, WorkerError
from drake_gait.execution.base import Serial
from drake_gait.foot import FootDesign
from drake_gait.gait import Gait
from drake_gait.optimization import open_study
from drake_gait.robot.description import model_path
from drake_gait.search.confirmation import walked_as
from drake_gait.study._lock import driver_lock
from drake_gait.study.store import Study
from drake_gait.sweep.grid import candidate, places, run_grid, study_of
from drake_gait.sweep.grid_results import analysed, effects_table, means_table
from drake_gait.sweep.settings import Axis, Grid, read_sweep
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


class Track:
    """An executor whose walks depend on the candidate; a stiffer toe walks further.

    Args:
        falls: Says of a walk's number, from 0, whether it falls.
        stop_after: Walks after which it is interrupted.
        backwards: Yield the last walk first.
    """

    def __init__(self, falls=lambda number: False, stop_after=None, backwards=False):
        self.falls, self.stop_after, self.backwards = falls, stop_after, backwards
        self.seen = []
        self.deaths = {}

    def run(self, trials):
        found = list(Serial(self._walk).run(trials))
        yield from (found[::-1] if self.backwards else found)[: self.stop_after]

    def _walk(self, trial):
        asked = trial.candidate
        fell = self.falls(len(self.seen))
        self.seen.append(trial)
        noise = asked.gait.degrees[0, 0] - round(asked.gait.degrees[0, 0])
        return Walk(
            outcome=Outcome.FELL if fell else Outcome.WALKED,
            frames=100 if fell else 240,
            forward=0.2 + 5.0 * asked.foot.big_toe_stiffness + 0.01 * noise,
            lateral=0.0,
            yaw=0.0,
            com_height=0.24,
        )


def files(folder):
    return {name: (folder / name).read_bytes() for name in ("grid.csv", "anova.json", "grid.png")}


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


def test_the_factor_that_matters_is_found_and_the_best_foot(grid, tmp_path):
    track = Track(falls=lambda number: number == 4)
    found = run_grid(grid, tmp_path, executor=track)
    assert len(track.seen) == 36
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
    assert re.match(
        r"furthest: stiffness 0\.04, damping (0\.0001|0\.001), 4\d\d\.\d mm", found.best_in_words()
    )
    assert [row[0] for row in effects_table(found).rows][:2] == ["stiffness", "damping"]
    assert [row[0] for row in means_table(found).rows] == ["0.01", "0.02", "0.04"]
    assert (tmp_path / "grid.png").stat().st_size > 0


def test_every_walk_carries_the_robot_and_the_ground_of_the_base(grid, tmp_path):
    track = Track()
    run_grid(grid, tmp_path, executor=track)
    friction = {trial.settings.friction for trial in track.seen}
    assert friction == {grid.settings.walk.friction}
    assert {trial.settings.model.name for trial in track.seen} == {grid.settings.walk.model}


def test_an_interrupted_grid_walks_only_the_missing_walks(grid, tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    run_grid(grid, whole, executor=Track())
    with pytest.raises(WorkerError, match="36 trials"):
        run_grid(grid, parts, executor=Track(stop_after=20))
    rest = Track()
    run_grid(grid, parts, executor=rest)
    assert len(rest.seen) == 36 - 20
    assert files(parts) == files(whole)
    idle = Track()
    run_grid(grid, parts, executor=idle)
    assert idle.seen == []


def test_the_order_in_which_walks_finish_changes_no_file(grid, tmp_path):
    run_grid(grid, tmp_path / "one", executor=Track())
    run_grid(grid, tmp_path / "two", executor=Track(backwards=True))
    assert files(tmp_path / "one") == files(tmp_path / "two")


def test_a_grid_is_a_study_whose_walks_can_be_looked_at_and_replayed(grid, tmp_path, capsys):
    run_grid(grid, tmp_path, executor=Track())
    with Study.open(tmp_path) as study:
        settings, walks = study.settings(), study.walks()
    assert [walk.candidate for walk in walks] == [candidate(grid, one) for one in places(grid)]
    assert {walked_as(settings, walk).friction for walk in walks} == {settings.walk.friction}
    assert studies.main(["list", str(tmp_path)]) == 0
    assert "36/36" in capsys.readouterr().out


def test_a_search_does_not_resume_a_grid_nor_a_grid_a_search(grid, tmp_path):
    run_grid(grid, tmp_path / "grid", executor=Track())
    with pytest.raises(StudyError, match="proposer grid of feet"):
        open_study(study_of(grid), tmp_path / "grid")
    open_study(study_of(grid), tmp_path / "search").close()
    with pytest.raises(StudyError, match="search holds a study that is no grid"):
        run_grid(grid, tmp_path / "search", executor=Track())


def test_a_grid_at_work_is_not_walked_by_another_process(grid, tmp_path):
    with driver_lock(tmp_path / "study.db"), pytest.raises(StudyError, match=str(tmp_path)):
        run_grid(grid, tmp_path, executor=Track())


def test_walks_without_their_study_are_refused_by_their_file(grid, tmp_path):
    run_grid(grid, tmp_path, executor=Track())
    (tmp_path / "study.db").unlink()
    with pytest.raises(StudyError, match=r"grid\.csv .*study\.db.*--out"):
        run_grid(grid, tmp_path, executor=Track())
    (tmp_path / "grid.csv").unlink()
    run_grid(grid, tmp_path, executor=Track())


def test_a_file_that_cannot_be_written_is_named_before_anything_walks(grid, tmp_path):
    (tmp_path / "anova.json").mkdir()
    track = Track()
    with pytest.raises(GaitError, match=r"anova\.json"):
        run_grid(grid, tmp_path, executor=track)
    assert track.seen == []


def test_workers_beside_an_executor_are_refused(grid, tmp_path):
    with pytest.raises(SettingsError, match="workers=2"):
        run_grid(grid, tmp_path, workers=2, executor=Track())


@pytest.mark.parametrize("survivors", [0, 1, 2, 3])
def test_too_few_survivors_leave_out_the_analysis_alone(grid, tmp_path, survivors):
    found = run_grid(grid, tmp_path, executor=Track(falls=lambda number: number >= survivors))
    content = json.loads((tmp_path / "anova.json").read_text(), parse_constant=pytest.fail)
    assert (content["walks"], content["survivors"], content["effects"]) == (36, survivors, [])
    assert f"the {survivors} walks" in content["no_effects_because"] == found.obstacle
    assert found.best is None
    assert "none" in found.best_in_words()
    assert "nan" not in str(means_table(found).rows)
    assert (tmp_path / "grid.png").stat().st_size > 0


def test_more_replicas_extend_a_grid_and_fewer_are_refused(grid, tmp_path):
    run_grid(grid, tmp_path, executor=Track())
    more = Track()
    run_grid(dataclasses.replace(grid, replicas=4), tmp_path, executor=more)
    assert len(more.seen) == 12
    with pytest.raises(StudyError, match=r"48 walks.*grid\.replicas = 3"):
        run_grid(grid, tmp_path, executor=Track())


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"noise_deg": 0.1}, "noise_deg"),
        ({"gaits": (Gait.from_degrees(np.ones((4, 4))),) * 2}, "gaits_deg"),
    ],
)
def test_another_grid_is_refused_by_the_setting_that_differs(grid, tmp_path, changed, named):
    run_grid(grid, tmp_path, executor=Track())
    with pytest.raises(StudyError, match=rf"another grid.*{named}.*--out"):
        run_grid(dataclasses.replace(grid, **changed), tmp_path, executor=Track())


def test_a_grid_of_another_robot_is_another_grid(grid, tmp_path):
    robot = tmp_path / "mine.sdf"
    robot.write_bytes(model_path().read_bytes())
    walk = dataclasses.replace(grid.settings.walk, model=str(robot))
    other = dataclasses.replace(
        grid, settings=dataclasses.replace(grid.settings, walk=walk), replicas=1
    )
    run_grid(other, tmp_path / "out", executor=Track())
    robot.write_text(robot.read_text().replace(">1.373<", ">1.3<"))
    with pytest.raises(StudyError, match=r"mine\.sdf.*--out"):
        run_grid(other, tmp_path / "out", executor=Track())


def test_the_committed_grid_has_the_analysis_of_its_walks(repository):
    folder = repository / "studies" / "toe_stiffness"
    grid = read_sweep(folder.with_suffix(".toml")).grid
    walks = {}
    with (folder / "grid.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            place = tuple(int(row[key]) for key in ("first", "second", "gait", "replica"))
            walks[place] = Walk(
                outcome=Outcome(row["outcome"]),
                frames=int(row["steps"]),
                forward=1e-3 * float(row["forward_mm"]),
                lateral=1e-3 * float(row["lateral_mm"]),
                yaw=np.radians(float(row["yaw_deg"])),
                com_height=0.0,
            )
    assert sorted(walks) == sorted(places(grid))
    found = analysed(grid, walks)
    committed = json.loads((folder / "anova.json").read_text(encoding="utf-8"))
    assert (found.walks, found.survivors) == (committed["walks"], committed["survivors"])
    assert found.survivors_by_cell.tolist() == committed["survivors_by_cell"]
    means = np.array(committed["mean_forward_mm"], dtype=float)
    np.testing.assert_allclose(found.mean, means, rtol=1e-9)
    for effect, wanted in zip(found.effects, committed["effects"], strict=True):
        assert effect.name == wanted["name"]
        assert effect.squares == pytest.approx(wanted["squares"], rel=1e-6)
