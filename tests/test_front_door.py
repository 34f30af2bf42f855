"""The package as Python code uses it: its names, `run_study`, and parts that a user hands over."""

import dataclasses
import json
import subprocess
import sys
import threading
from collections import Counter

import numpy as np
import pytest
from conftest import QUICK_ISADE, QUICK_NETWORK, Interruption, walk_at

import drake_gait
from drake_gait import (
    Finished,
    Proposal,
    Study,
    StudyResult,
    TrustRegion,
    Walk,
    run_study,
    simulate,
    write_report,
)
from drake_gait.cli.optimize import main as optimize
from drake_gait.errors import SettingsError, StudyError, WorkerError
from drake_gait.report.study_result import as_written_today
from drake_gait.report.tables import quantities
from drake_gait.search.confirmation import walked_as
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings

HEAVY = ("torch", "matplotlib", "pydrake", "scipy", "sklearn", "cmaes", "distributed", "jinja2")


STANDS = """
from drake_gait import Candidate, gait, simulate
simulate(Candidate(gait=gait.STANDING))
"""


def loaded_by(code):
    """Heavy libraries that a fresh Python has loaded after some code."""
    code += f"\nimport sys; print(*(name for name in {HEAVY!r} if name in sys.modules))"
    return set(
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True
        ).stdout.split()
    )


@pytest.mark.parametrize(
    ("code", "allowed"),
    [
        ("import drake_gait; dir(drake_gait)", set()),
        ("from drake_gait import Candidate, DesignSpace, FootDesign, Gait, Walk, assess", set()),
        ("from drake_gait import Study, StudyResult, StudySettings, read_study", set()),
        ("from drake_gait import DaskCluster, Executor, LocalProcesses, Serial", set()),
        ("from drake_gait import IsadeSettings, NetworkSettings, Proposal, Proposer", set()),
        ("from drake_gait.optimizers import Isade, minimize", {"scipy"}),
        (
            STANDS,
            {"pydrake"},
        ),
    ],
    ids=["package", "parts", "studies", "executors", "proposers", "optimizers", "simulate"],
)
def test_a_part_loads_only_the_libraries_that_it_needs(code, allowed):
    assert loaded_by(code) <= allowed


@pytest.mark.parametrize("name", drake_gait.__all__)
def test_every_exported_name_is_there_and_documented(name):
    assert getattr(drake_gait, name).__doc__


def test_a_name_that_is_not_exported_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = drake_gait.no_such_name


@pytest.fixture
def settings(study):
    return dataclasses.replace(
        study,
        search=SearchSettings(samples=20, simulations=28, batch=4),
        confirmation=ConfirmationSettings(walks=8, feasible=1),
    )


class Made:
    """An executor that makes walks up, in another order than they are asked for."""

    def __init__(self, space, *, stop_after=None):
        self.space, self.stop_after, self.models = space, stop_after, set()
        self.deaths = Counter({"from before": 3})

    def run(self, trials):
        for index in reversed(range(len(trials))):
            if self.stop_after == 0:
                raise Interruption
            if self.stop_after is not None:
                self.stop_after -= 1
            self.models.add(trials[index].settings.model)
            self.deaths["made up"] += 1
            walk = walk_at(self.space.encode(trials[index].candidate))
            yield Finished(index=index, walk=walk, seconds=0.0)


class Corners:
    """A proposer that looks in the corners of the box."""

    samples, batch = 6, 3

    def __init__(self, settings, name="Corners"):
        self.settings, self.name = settings, name

    def vintage(self, iteration):
        return iteration

    def learn(self, iteration, known):
        return None

    def propose(self, iteration, known, network, count):
        rng = np.random.default_rng([self.settings.seed, iteration])
        assert len(known) == (self.samples + self.batch * (iteration - 1) if iteration else 0)
        x = 0.9 * rng.choice([-1.0, 1.0], (count, self.settings.space.dimension))
        return Proposal(x=x, stage="infill" if iteration else "design")


def quick(settings):
    return TrustRegion(settings, isade=QUICK_ISADE, network=QUICK_NETWORK)


def walks_in(folder):
    with Study.open(folder) as study:
        return [(walk.id, dataclasses.astuple(walk.walk)) for walk in study.walks()]


def test_a_study_is_run_read_again_and_gone_on_with(settings, tmp_path):
    told, executor = [], Made(settings.space)
    proposer = quick(settings)
    result = run_study(
        settings, str(tmp_path / "run"), progress=told.append, proposer=proposer, executor=executor
    )
    assert result.simulations == 28
    assert [one.walks for one in told][:28] == list(range(1, 29))
    assert result.proposer == proposer.name
    assert result.winner is not None
    assert (
        result.winner.walk.forward
        == walk_at(settings.space.encode(result.winner.candidate)).forward
    )
    assert f"walk {result.winner.id}" in result.verdict
    # The robot comes with every trial, and only deaths of this study are its own.
    assert all(type(model).__name__ == "RobotModel" for model in executor.models)
    with Study.open(tmp_path / "run") as study:
        assert study.description()["worker_deaths"] == {"made up": len(study.walks())}

    again = StudyResult.read(tmp_path / "run")
    assert again.plain() == result.plain()
    kept, found = again.winner.candidate, result.winner.candidate
    assert kept.gait.coefficients.tobytes() == found.gait.coefficients.tobytes()
    assert kept.foot == found.foot
    nothing = run_study(settings, tmp_path / "run", proposer=proposer, executor=Made(None))
    assert nothing.plain() == result.plain()

    larger = dataclasses.replace(
        settings, search=dataclasses.replace(settings.search, simulations=32)
    )
    more = run_study(
        larger, tmp_path / "run", proposer=quick(larger), executor=Made(settings.space)
    )
    assert more.simulations == 32


@pytest.mark.parametrize("walks", [0, 3, 20, 25])
def test_a_study_that_was_stopped_goes_on_to_the_same_result(settings, tmp_path, walks):
    whole = run_study(
        settings, tmp_path / "whole", proposer=Corners(settings), executor=Made(settings.space)
    )
    with pytest.raises(Interruption):
        run_study(
            settings,
            tmp_path / "run",
            proposer=Corners(settings),
            executor=Made(settings.space, stop_after=walks),
        )
    result = run_study(
        settings, tmp_path / "run", proposer=Corners(settings), executor=Made(settings.space)
    )
    assert walks_in(tmp_path / "run") == walks_in(tmp_path / "whole")
    assert {**result.plain(), "wall_s": 0} == {**whole.plain(), "wall_s": 0}


@pytest.mark.parametrize(("first", "second"), [("one", "two"), ("one", None), (None, "one")])
def test_a_study_does_not_go_on_with_another_proposer(settings, tmp_path, first, second):
    def proposer(name):
        return name and Corners(settings, name)

    with pytest.raises(Interruption):
        run_study(
            settings,
            tmp_path,
            proposer=proposer(first),
            executor=Made(settings.space, stop_after=2),
        )
    with pytest.raises(StudyError, match="one"):
        run_study(settings, tmp_path, proposer=proposer(second), executor=Made(settings.space))
    assert len(walks_in(tmp_path)) == 2


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda x: x[:-1], "shape"),
        (lambda x: x[:, :-1], "shape"),
        (lambda x: x[0], "shape"),
        (lambda x: np.where(np.arange(16) == 2, np.nan, x), "roll_c = nan"),
        (lambda x: 1e3 * x, "roll_a"),
    ],
    ids=["too few", "too short", "one vector", "NaN", "outside"],
)
def test_what_cannot_be_walked_is_refused_with_the_proposer_that_proposed_it(
    settings, tmp_path, wrong, named
):
    class Wrong(Corners):
        def propose(self, *arguments):
            proposal = super().propose(*arguments)
            return dataclasses.replace(proposal, x=wrong(proposal.x))

    with pytest.raises(SettingsError, match="Corners") as caught:
        run_study(settings, tmp_path, proposer=Wrong(settings), executor=Made(settings.space))
    assert named in str(caught.value)


@pytest.mark.parametrize("indices", [[], [0], [0, 0, 1], [0, 99], [-1]], ids=str)
def test_an_executor_that_yields_other_walks_than_asked_for_is_refused(settings, tmp_path, indices):
    class Wrong(Made):
        def run(self, trials):
            for index in indices:
                yield Finished(index=index, walk=Walk.diverged("made up"), seconds=0.0)

    with pytest.raises(WorkerError, match="the executor"):
        run_study(settings, tmp_path, proposer=Corners(settings), executor=Wrong(settings.space))


@pytest.mark.parametrize(
    ("change", "named"),
    [({"walk": None}, "None"), ({"seconds": np.nan}, "nan"), ({"seconds": "1"}, "'1'")],
    ids=["no walk", "NaN", "text"],
)
def test_what_an_executor_yields_is_a_walk_and_its_time(settings, tmp_path, change, named):
    class Wrong(Made):
        def run(self, trials):
            for finished in super().run(trials):
                yield dataclasses.replace(finished, **change)

    with pytest.raises(WorkerError, match=named):
        run_study(settings, tmp_path, proposer=Corners(settings), executor=Wrong(settings.space))


@pytest.mark.parametrize("workers", [0, -1, 1.5, "2"])
def test_a_number_of_workers_that_is_none_is_refused_before_anything_is_written(
    settings, tmp_path, workers
):
    with pytest.raises(SettingsError, match=str(workers)):
        run_study(settings, tmp_path / "run", workers=workers)
    with pytest.raises(SettingsError, match="executor"):
        run_study(settings, tmp_path / "run", workers=2, executor=Made(settings.space))
    assert not (tmp_path / "run").exists()


def test_a_result_is_strict_json_whatever_became_of_its_walks(settings, tmp_path):
    class Lost(Made):
        def run(self, trials):
            for index in range(len(trials)):
                yield Finished(index=index, walk=Walk.diverged("made up"), seconds=0.0)

    def refuse(constant):
        pytest.fail(constant)

    plan = dataclasses.replace(settings.search, simulations=20)
    settings = dataclasses.replace(settings, search=plan)
    result = run_study(settings, tmp_path, proposer=Corners(settings), executor=Lost(None))
    content = json.loads((tmp_path / "result.json").read_bytes(), parse_constant=refuse)
    assert content == result.plain() == StudyResult.read(tmp_path).plain()
    assert result.winner is None
    assert "None of 20 walks" in result.verdict


@pytest.mark.parametrize(
    "content", ["{}", '{"walk": 3}', "[]", "{", '{"walk": null, "winner": null, "seed": []}']
)
def test_a_file_that_is_no_result_is_named_with_the_cure(tmp_path, content):
    (tmp_path / "result.json").write_text(content)
    with pytest.raises(StudyError, match=r"result\.json"):
        StudyResult.read(tmp_path)


@pytest.mark.parametrize("name", ["best", "reference"])
def test_the_result_of_a_committed_study_is_read_and_written_as_it_is(repository, name):
    folder = repository / "studies" / name
    result = StudyResult.read(folder)
    known = as_written_today(json.loads((folder / "result.json").read_bytes()))
    for key, value in known.items():
        if key not in (
            "finalists",
            "measures",
            "coefficients_deg",
            "com_height_mm",
            "yaw_deg",
            "yaw_swing",
        ):
            same = pytest.approx(value, rel=1e-12) if isinstance(value, float) else value
            assert result.plain()[key] == same, key
    assert result.winner.id == known["winner"]
    assert result.winner.candidate.gait.degrees == pytest.approx(
        np.array(known["coefficients_deg"])
    )


def test_a_result_that_calls_frames_steps_is_read_as_one_that_does_not(settings, tmp_path):
    proposer = Corners(settings)
    result = run_study(settings, tmp_path, proposer=proposer, executor=Made(settings.space))
    path = tmp_path / "result.json"
    now = path.read_text()
    path.write_text(now.replace('"frames"', '"steps"'))
    assert path.read_text() != now
    assert StudyResult.read(tmp_path).plain() == result.plain()


def test_a_result_that_has_the_range_of_the_heading_among_the_measures_is_read_too(repository):
    older = {"energy": 7.0, "yaw_swing": 0.31}
    content = {"measures": older, "best": {"walk": {"yaw_swing": None, "measures": older}}}
    content["finalists"] = [{"walk": 3, "measures": older}]
    today = as_written_today(content)
    for one in (today, today["best"]["walk"], today["finalists"][0]):
        assert (one["yaw_swing"], one["measures"]) == (0.31, {"energy": 7.0})
    assert quantities(today)["yaw_swing"] == 0.31
    assert as_written_today(today) == today
    kept = json.loads((repository / "studies" / "best" / "result.json").read_bytes())
    assert "yaw_swing" in kept["measures"]
    assert (
        StudyResult.read(repository / "studies" / "best").finalists[0].yaw_swing
        == (kept["finalists"][0]["measures"]["yaw_swing"])
    )


@pytest.mark.slow
def test_a_thread_runs_what_the_command_runs_and_reports_it(settings, paper_study, tmp_path):
    plan = ["--samples", "8", "--simulations", "8", "--set", "confirmation.walks=0"]
    assert optimize([str(paper_study), *plan, "--workers", "1", "--out", str(tmp_path / "a")]) == 0
    overrides = {("search", "samples"): 8, ("search", "simulations"): 8}
    read = drake_gait.read_study(paper_study, {**overrides, ("confirmation", "walks"): 0})
    found = []
    thread = threading.Thread(
        target=lambda: found.append(run_study(read, tmp_path / "b", workers=1))
    )
    thread.start()
    thread.join()
    assert walks_in(tmp_path / "a") == walks_in(tmp_path / "b")
    best = found[0].best
    assert simulate(best.candidate, walked_as(read, best)).forward == best.walk.forward
    reported = write_report(tmp_path / "b")
    assert reported.measures is not None
    assert (tmp_path / "b" / "report.html").is_file()
    # A finished study keeps what its report found out.
    assert run_study(read, tmp_path / "b").plain() == reported.plain()
