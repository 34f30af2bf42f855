"""Everything that a notebook's server calls works in a thread that is not the main one."""

import asyncio
import dataclasses
import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from conftest import DESCRIPTION

from drake_gait.cli import optimize
from drake_gait.optimization import open_study, search_study, workers_of
from drake_gait.study.search_settings import ConfirmationSettings, SearchSettings
from drake_gait.study.store import Study

COUNT = """
from drake_gait.cli._signals import begin
begin()
import json, scipy.linalg, sklearn, torch
from threadpoolctl import threadpool_info
print(json.dumps([one["num_threads"] for one in threadpool_info()] + [torch.get_num_threads()]))
"""


def in_a_thread(function, *arguments):
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(function, *arguments).result()


def test_a_study_that_one_thread_has_opened_is_used_and_closed_by_another(path, entry):
    study = Study.create(path, DESCRIPTION)
    in_a_thread(study.add, entry)
    assert [walk.id for walk in study.walks()] == [0]
    assert in_a_thread(lambda: [walk.id for walk in study.walks()]) == [0]
    in_a_thread(study.close)
    with in_a_thread(Study.open, path) as opened:
        assert len(opened.walks()) == 1


@pytest.mark.parametrize(
    ("said", "used"), [({}, {1}), ({"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}, {2})]
)
def test_a_command_computes_in_one_thread_unless_its_environment_says_how_many(said, used):
    own = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    found = subprocess.run(
        [sys.executable, "-c", COUNT], env={**own, **said}, capture_output=True, check=True
    )
    assert set(json.loads(found.stdout)) == used


@pytest.mark.slow
def test_a_study_opened_in_the_main_thread_is_searched_in_another(study, tmp_path):
    settings = dataclasses.replace(
        study,
        search=SearchSettings(samples=20, simulations=24, batch=4),
        confirmation=ConfirmationSettings(walks=0),
    )
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    numbers = []
    for name, runs in (("here", lambda function, *a: function(*a)), ("there", in_a_thread)):
        with (
            open_study(settings, tmp_path / name) as opened,
            workers_of(settings, opened, 1) as executor,
        ):
            runs(search_study, settings, opened, executor, lambda progress: None)
            numbers.append([dataclasses.astuple(walk.walk) for walk in opened.walks()])
    assert numbers[0] == numbers[1]
    assert len(numbers[0]) == 24
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


@pytest.mark.slow
def test_the_command_runs_in_threads_of_a_running_loop(paper_study, tmp_path, capsys):
    def command(name):
        options = ["--samples", "20", "--simulations", "20", "--workers", "1"]
        options += ["--set", "confirmation.walks=0", "--out", str(tmp_path / name)]
        return optimize.main([str(paper_study), *options])

    async def both():
        return await asyncio.gather(*(asyncio.to_thread(command, name) for name in "ab"))

    assert asyncio.run(both()) == [0, 0]
    walks = []
    for name in "ab":
        with Study.open(tmp_path / name) as study:
            walks.append([dataclasses.astuple(walk.walk) for walk in study.walks()])
    assert walks[0] == walks[1]
    assert all((tmp_path / name / "walk.html").is_file() for name in "ab")
    assert "Traceback" not in capsys.readouterr().err
