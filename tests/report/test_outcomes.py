"""Every outcome of a study has its own words, its strict JSON and its page; with few walks too."""

import dataclasses
import json
import re

import numpy as np
import pytest

from drake_gait.cli import _sweep as sweep_command
from drake_gait.cli._optimize import _write_results
from drake_gait.cli.report import main as report
from drake_gait.files.strict_json import plain, to_json
from drake_gait.problem import Candidate
from drake_gait.report import build as outputs
from drake_gait.report.build import write_outputs
from drake_gait.report.page import Run, write_comparison_page
from drake_gait.report.result import in_words, manner_in_words, summary, verdict
from drake_gait.report.study_result import read_result
from drake_gait.report.tables import tiers
from drake_gait.robot.description import read_model
from drake_gait.study.records import CONFIRMATION, CONFIRMATIONS
from drake_gait.study.store import Study
from drake_gait.sweep.settings import PlannedStudy, Sweep
from drake_gait.walk import Measures, Outcome, Walk

LOST = Walk.diverged("took longer than 1 s", frames=3)
FELL = Walk(
    outcome=Outcome.FELL,
    frames=45,
    forward=0.14,
    lateral=0.01,
    yaw=0.1,
    com_height=0.1,
    reason="fell",
)
FAR = Walk(outcome=Outcome.WALKED, frames=240, forward=0.5, lateral=0.4, yaw=0.0, com_height=0.245)
WALKED = dataclasses.replace(FAR, lateral=0.0)

OUTCOMES = {
    "no walk": ([], "No walk has been simulated yet."),
    "one lost": ([LOST], "None of 1 walk could be simulated to its end (time limit 1)."),
    "all lost": (
        [LOST, Walk.diverged("solver: no convergence"), LOST],
        "None of 3 walks could be simulated to its end (time limit 2, solver 1).",
    ),
    "all fell": ([FELL, LOST], "None of 2 walks ends on its feet; the nearest is walk 0: 140.0 mm"),
    "one survivor": (
        [FELL, FAR],
        "None of 2 walks holds all constraints; the nearest is walk 1: 500.0 mm",
    ),
    "one feasible": ([LOST, WALKED], "No gait is known to hold: none was walked again"),
}


def refuse(constant):
    pytest.fail(f"{constant} is no JSON")


@pytest.fixture
def entries(study, entry):
    """Makes the walks of a study."""
    middle = Candidate(gait=study.space.decode(np.zeros(16)).gait)

    def make(walks):
        return [
            dataclasses.replace(entry, id=number, walk=walk, candidate=middle)
            for number, walk in enumerate(walks)
        ]

    return make


@pytest.fixture
def without_drake(monkeypatch):
    """A report whose best walk cannot be simulated again."""
    monkeypatch.setattr(outputs, "simulate", lambda *arguments, **options: LOST)


@pytest.mark.parametrize(("walks", "words"), OUTCOMES.values(), ids=OUTCOMES)
def test_every_outcome_has_a_sentence_and_strict_json(study, entries, walks, words):
    found = summary(study, entries(walks), None, wall_s=0.0)
    assert found["verdict"].startswith(words)
    text = to_json(found)
    assert json.loads(text, parse_constant=refuse) == found
    simulated = any(walk.outcome is not Outcome.DIVERGED for walk in walks)
    assert (found["forward_mm"] is not None) == simulated
    assert (found["walk"] is not None) == bool(walks)


@pytest.mark.parametrize(("walks", "words"), OUTCOMES.values(), ids=OUTCOMES)
def test_every_outcome_has_a_page_that_says_it_and_names_no_file_that_is_not_there(
    study, entries, tmp_path, without_drake, walks, words
):
    (tmp_path / "figures").mkdir()
    (tmp_path / "walk.html").write_text("of an earlier report")
    (tmp_path / "figures" / "paths.svg").write_text("of an earlier report")
    (tmp_path / "figures" / "pareto.svg").write_text("of an earlier report")
    written = write_outputs(study, entries(walks), tmp_path, wall_s=1.0)
    page = " ".join((tmp_path / "report.html").read_text(encoding="utf-8").split())
    shown = re.sub("<[^>]*>", "", page)
    if written.result["forward_mm"] is None:
        assert words in shown
        assert "0.0 mm" not in shown
    assert "walk.html" not in page
    assert not re.search(r"\b(nan|None|inf)\b(?! of)", shown)
    assert (tmp_path / "result.json").read_text() == to_json(written.result) + "\n"
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} | {
        "figures",
        "study.db",
    } == {*written.files, "figures", "study.db"}
    drawn = {path.stem for path in (tmp_path / "figures").iterdir()}
    assert ("figures" in written.files) == bool(drawn)
    assert not drawn & {"paths", "pareto"}
    assert ("coordinates" in drawn) == any(walk.survived for walk in walks)


def test_the_console_counts_search_walks_and_announces_what_is_there(
    study, entries, tmp_path, without_drake, capsys
):
    walks = entries([FELL, FAR, FELL])
    again = dataclasses.replace(
        walks[1], id=CONFIRMATIONS, stage=CONFIRMATION, nominal=1, variation=1
    )
    with Study.create(
        tmp_path / "study.db",
        {"settings": study.description(), "model_sha256": read_model().sha256},
    ) as opened:
        for walk in (*walks, again):
            opened.add(walk)
        opened.set("wall_s", 1.0)
        _write_results(study, opened, tmp_path)
    said = capsys.readouterr().out
    assert "1 of 3 walks survived" in said
    assert said.endswith(f"{tmp_path}: report.html, result.json, study.db, study.toml, figures\n")
    assert "nan" not in said


def test_a_study_without_walks_has_a_report_too(study, tmp_path, capsys):
    Study.create(
        tmp_path / "study.db",
        {"settings": study.description(), "model_sha256": read_model().sha256},
    ).close()
    assert report([str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'report.html'}\n"
    assert read_result(tmp_path)["verdict"] == "No walk has been simulated yet."


def test_studies_of_every_outcome_are_compared(study, entries, tmp_path):
    runs = [
        Run(
            folder=tmp_path / name,
            settings=dataclasses.replace(study, seed=2**200 + place),
            result=plain(
                {**summary(study, entries(walks), None, wall_s=0.0), "seed": 2**200 + place}
            ),
            walks=entries(walks),
        )
        for place, (name, (walks, _)) in enumerate(OUTCOMES.items())
    ]
    write_comparison_page(runs, tmp_path / "comparison.html")
    page = (tmp_path / "comparison.html").read_text(encoding="utf-8")
    assert "Furthest: <strong>one feasible</strong>" in page
    assert str(2**200 + 3) in page


def test_a_missing_measure_of_a_walk_is_a_dash(measures, walked):
    nan = float("nan")
    lacking = dataclasses.replace(
        measures, duty_factor=(nan, 0.5), clearance=(nan, nan), cost_of_transport=float("inf")
    )
    said = manner_in_words(dataclasses.replace(walked, measures=lacking))
    assert "duty - / 0.50" in said
    assert "clearance - / - mm" in said
    assert "yaw swing - degrees" in said
    assert said.endswith("cost of transport -")
    empty = Measures(
        **{
            name: tuple(nan for _ in value) if isinstance(value, tuple) else nan
            for name, value in dataclasses.asdict(measures).items()
        }
    )
    assert not re.search("nan|inf", manner_in_words(dataclasses.replace(walked, measures=empty)))
    swung = dataclasses.replace(walked, measures=measures, yaw_swing=np.radians(12.0))
    assert "yaw swing 12 degrees" in manner_in_words(swung)
    assert manner_in_words(walked) == ""


def test_a_walk_that_was_not_simulated_has_a_reason_in_the_place_of_numbers():
    assert in_words(LOST) == "not simulated to its end (took longer than 1 s), 3 frames"


def test_a_search_walk_is_what_the_search_asked_for(study, entries):
    walks = entries([WALKED, FELL])
    replica = dataclasses.replace(walks[1], nominal=0, variation=1)
    again = dataclasses.replace(replica, stage=CONFIRMATION, id=CONFIRMATIONS)
    mean = dataclasses.replace(again, nominal=None, variation=0)
    kinds = [
        (one.is_search_walk, one.is_nominal, one.is_mean, one.confirms)
        for one in (walks[0], replica, again, mean)
    ]
    assert kinds == [
        (True, True, False, None),
        (True, False, False, None),
        (False, False, False, 0),
        (False, False, True, None),
    ]
    said = verdict(study, [walks[0], again])
    assert said.startswith("No gait is known to hold")
    assert "The best of 1 walk, walked once, is walk 0" in said
    assert tiers(study, walks) is None


def test_a_sweep_of_studies_of_every_outcome_has_a_row_for_each_and_strict_json(
    study, entries, tmp_path, capsys
):
    nan = dataclasses.asdict(
        Measures(
            energy=1.0,
            positive_energy=float("nan"),
            cost_of_transport=float("inf"),
            peak_torque=1.0,
            peak_speed=1.0,
            saturated_fraction=0.0,
            slip=(float("nan"), 0.1),
            clearance=(0.0, 0.0),
            duty_factor=(float("nan"), 0.5),
            peak_ground_reaction=1.0,
            toe_range=(0.0, 0.0, 0.0, 0.0),
            torso_tilt=0.1,
        )
    )
    studies = tuple(
        PlannedStudy(variant=name.replace(" ", "-"), seed=0, settings=study, overrides={})
        for name in OUTCOMES
    )
    sweep = Sweep(name="all", question="", base=tmp_path / "base.toml", studies=studies)
    for one, (walks, _) in zip(studies, OUTCOMES.values(), strict=True):
        folder = one.folder(tmp_path)
        folder.mkdir(parents=True)
        found = {**summary(study, entries(walks), None, wall_s=0.0), "measures": nan}
        # As older versions wrote it.
        (folder / "result.json").write_text(json.dumps(found))
    (tmp_path / "pareto.png").write_text("of an earlier run")
    sweep_command._write_results(sweep, tmp_path)
    written = json.loads((tmp_path / "sweep.json").read_text(), parse_constant=refuse)
    by_variant = {row["variant"]: row for row in written["studies"]}
    assert len(by_variant) == len(OUTCOMES)
    assert by_variant["one-feasible"]["furthest_mm"] == pytest.approx(500.0)
    assert by_variant["all-lost"]["forward_mm"] is None
    assert by_variant["one-feasible"]["measures.duty_factor.0"] is None
    said = capsys.readouterr().out
    assert "nan" not in said
    assert said.endswith(
        f"{tmp_path}: sweep.csv, sweep.json, sweep.png, and a folder for each study\n"
    )
