"""A quantity of a user's own: stored, limited, optimised, reported, exported and gone on with."""

import csv
import dataclasses
import json

import numpy as np
import pytest
from conftest import MINIMAL, QUICK_ISADE, QUICK_NETWORK, Interruption, walk_at

from drake_gait import (
    Constraints,
    Finished,
    Limit,
    Objective,
    Quantity,
    Study,
    StudyResult,
    TrustRegion,
    read_study,
    run_study,
    write_report,
)
from drake_gait.cli.export import main as export
from drake_gait.cli.optimize import main as optimize
from drake_gait.errors import SettingsError, StudyError
from drake_gait.ranges import MM
from drake_gait.report import tables
from drake_gait.report.page import Run, write_study_page
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.study.toml import study_toml

FILE = """
import numpy as np
from drake_gait import Quantity
from drake_gait.ranges import MM

def sway(walk):
    return float(np.ptp(walk.history.com[:, 1]))

SWAY = Quantity(name="sway", label="sway of the body", unit=MM, needs="history", read=sway)
PAIR = Quantity(name="pair", parts=("right", "left"), read=lambda walk: (walk.yaw, walk.lateral))
"""

SHORT = Quantity(name="short", label="what is missing", unit=MM, read=lambda w: 0.5 - w.forward)
PAIR = Quantity(name="order", parts=("right", "left"), read=lambda walk: (walk.yaw, walk.lateral))


class Made:
    """An executor that makes walks up, and stops after some."""

    def __init__(self, space, stop_after=None):
        self.space, self.left, self.deaths = space, stop_after, {}

    def run(self, trials):
        for index, trial in enumerate(trials):
            if self.left == 0:
                raise Interruption
            self.left = None if self.left is None else self.left - 1
            walk = walk_at(self.space.encode(trial.candidate))
            yield Finished(index=index, walk=walk, seconds=0.0)


@pytest.fixture
def settings(study):
    return dataclasses.replace(
        study,
        search=SearchSettings(samples=20, simulations=28, batch=4),
        confirmation=ConfirmationSettings(walks=0),
    )


@pytest.fixture
def limited(settings):
    """A study that limits and minimises what nobody but its user knows."""
    return dataclasses.replace(
        settings,
        search=dataclasses.replace(settings.search, objective=Objective(SHORT)),
        constraints=Constraints(Limit(SHORT, upper=0.45), Limit(PAIR, lower=-1.0, upper=1.0)),
    )


def searched(settings, folder, **others):
    proposer = TrustRegion(settings, isade=QUICK_ISADE, network=QUICK_NETWORK)
    executor = others.pop("executor", None) or Made(settings.space)
    return run_study(settings, folder, proposer=proposer, executor=executor, **others)


def test_it_is_stored_limited_optimised_predicted_reported_and_exported(limited, tmp_path, capsys):
    result = searched(limited, tmp_path)
    with Study.open(tmp_path) as study:
        walks, table = study.walks(), study.table()
        again = study.settings()
    assert table["short"] == pytest.approx(0.5 - table["forward"])
    assert (table["order_left"] == table["lateral"]).all()
    assert [walk.walk.values["short"][0] for walk in walks] == table["short"].tolist()
    feasible = [walk for walk in walks if limited.assess(walk.walk).feasible]
    assert result.feasible_count == len(feasible) > 0
    assert all(walk.walk.forward >= 0.05 for walk in feasible)
    assert result.best.id == max(feasible, key=lambda walk: walk.walk.forward).id
    assert {"gain_of_short", "short", "order"} <= set(result.r2_heldout)
    assert result.quantities["short"] == result.best.walk.values["short"][0]
    assert StudyResult.read(tmp_path).plain() == result.plain()

    row = ["what is missing [mm]", tables.shown(result.quantities["short"], SHORT), ""]
    assert row in tables.manner(result.plain(), again.quantities).rows
    run = Run(folder=tmp_path, settings=again, result=result.plain(), walks=walks)
    write_study_page(run, tmp_path / "report.html")
    assert "what is missing [mm]" in (tmp_path / "report.html").read_text()
    assert export([str(tmp_path), "--csv", str(tmp_path / "walks.csv")]) == 0
    with (tmp_path / "walks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["short"]) for row in rows] == table["short"].tolist()


def test_a_study_goes_on_with_the_same_walks_and_refuses_other_quantities(limited, tmp_path):
    whole = searched(limited, tmp_path / "whole")
    with pytest.raises(Interruption):
        searched(limited, tmp_path / "parts", executor=Made(limited.space, stop_after=23))
    plain = dataclasses.replace(
        limited,
        search=dataclasses.replace(limited.search, objective="distance"),
        constraints=Constraints(),
        quantities=(),
    )
    with pytest.raises(StudyError, match=r"the quantities short, order, not with none; give"):
        searched(plain, tmp_path / "parts")
    with Study.open(tmp_path / "parts") as study:
        stored = study.settings()
    with pytest.raises(StudyError, match=r"needs the quantities short, order .*study\.quantities="):
        searched(stored, tmp_path / "parts")
    again = searched(stored, tmp_path / "parts", quantities=[SHORT, PAIR])
    assert dataclasses.replace(again, folder=whole.folder, wall_s=whole.wall_s).plain() == {
        **whole.plain(),
        "wall_s": whole.wall_s,
    }


def test_a_quantity_without_limit_is_kept_for_every_walk(settings, tmp_path):
    result = searched(settings, tmp_path, quantities=[SHORT])
    assert result.best.walk.values["short"] == (0.5 - result.best.walk.forward,)
    with Study.open(tmp_path) as study:
        assert len(study.table()["short"]) == result.simulations


@pytest.mark.parametrize("name", ["slip", "yaw", "roll_a", "outcome", "slip_right", "frames"])
def test_a_name_that_a_column_has_is_refused(settings, name):
    own = Quantity(name=name, read=float)
    with pytest.raises(SettingsError, match=f"the quantity {name} needs another name"):
        settings.with_quantities([own])


@pytest.fixture
def study_file(tmp_path):
    (tmp_path / "mine.py").write_text(FILE)
    path = tmp_path / "mine.toml"
    path.write_text(
        MINIMAL.replace("[study]", '[study]\nquantities = "mine.py"', 1)
        + "[constraints]\nsway_mm = 40\npair = [-1, 2]\n"
    )
    return path


def test_a_file_names_the_file_of_its_quantities(study_file, tmp_path):
    settings = read_study(study_file, {("search", "objective"): "maximise sway"})
    assert [one.name for one in settings.quantities] == ["sway", "pair"]
    assert settings.constraints.sway == pytest.approx(0.04)
    assert settings.constraints.pair == [-1.0, 2.0]
    assert str(settings.search.objective) == "maximise sway"
    written = tmp_path / "elsewhere"
    written.mkdir()
    (written / "study.toml").write_text(study_toml(settings))
    assert read_study(written / "study.toml").description() == settings.description()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "no file of quantities"),
        ("1 / 0", "mine.py cannot be run: ZeroDivisionError"),
        ("x = 1", "mine.py declares none"),
        ("def f(:", "SyntaxError"),
        ("from drake_gait import Quantity\nq = Quantity(name='slip', read=float)", "another name"),
    ],
)
def test_a_file_of_quantities_that_is_none_is_one_line(study_file, capsys, content, reason):
    path = study_file.with_name("mine.py")
    path.unlink() if content is None else path.write_text(content)
    assert optimize([str(study_file), "--out", str(study_file.parent / "run")]) == 2
    said = capsys.readouterr().err
    assert reason in said
    assert said.count("\n") == 1


def test_a_key_of_a_quantity_that_is_not_there_is_refused(study_file):
    with pytest.raises(SettingsError, match="sway_mm"):
        read_study(study_file, {("study", "quantities"): ""})


@pytest.mark.slow
def test_from_the_shell_two_workers_read_what_needs_a_history(study_file, tmp_path, capsys):
    plan = ["--samples", "6", "--simulations", "6", "--set", "confirmation.walks=0"]
    arguments = [str(study_file), *plan, "--workers", "2", "--out", str(tmp_path / "run")]
    assert optimize(arguments) == 0
    assert optimize([*arguments, "--simulations", "8"]) == 0
    with Study.open(tmp_path / "run") as study:
        table, walks = study.table(), study.walks()
    assert len(walks) == 8
    assert np.isfinite(table["sway"][table["outcome"] != "diverged"]).all()
    assert (table["sway"] > 0.0).any()
    assert all(walk.walk.history is None for walk in walks)
    study_file.with_name("mine.py").unlink()  # The study file says what they were.
    assert "sway of the body" in (tmp_path / "run" / "report.html").read_text()
    assert write_report(tmp_path / "run").quantities["sway"] > 0.0
    assert json.loads((tmp_path / "run" / "result.json").read_text())["quantities"]["sway"] > 0.0
