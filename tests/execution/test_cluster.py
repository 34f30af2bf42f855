"""Walks on a Dask cluster: its schedulers and workers are processes of this machine."""

import contextlib
import functools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from strides import (
    abort,
    candidates,
    err,
    hang_and_compute,
    leave,
    number_of,
    numbers,
    refuse,
    stride,
    stride_or,
    wait_for_end_of,
)

from drake_gait.errors import GaitError, ModelError, SettingsError, WorkerError
from drake_gait.execution import dask as cluster
from drake_gait.execution.base import Serial
from drake_gait.execution.dask import DaskCluster, identity, walk_on_worker
from drake_gait.walk import Outcome

pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def expected():
    return [one.walk for one in Serial(stride).run(candidates(20))]


def dask(folder, *arguments):
    """A process of the command `dask`, as docs/howto/run_on_a_cluster.md starts it."""
    here = Path(__file__).parents[1]
    with (folder / "log").open("a") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *map(str, arguments)],
            cwd=folder,
            stdout=log,
            stderr=log,
            env={**os.environ, "PYTHONPATH": f"{here.parent}:{here}", **ON_CLUSTER},
            start_new_session=True,
        )


def stop(process):
    """End a process with all that it has started."""
    with contextlib.suppress(ProcessLookupError):  # It has ended by itself.
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def scheduler(folder):
    """A scheduler's process and its scheduler file."""
    path = folder / "scheduler.json"
    process = dask(folder, "scheduler", "--scheduler-file", path, "--port", 0, *QUIET)
    for _ in range(600):
        if path.exists() and path.read_text().endswith("}"):
            return process, path
        time.sleep(0.1)
    pytest.fail("no scheduler in a minute")


ON_CLUSTER = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
QUIET = ("--no-dashboard", "--host", "127.0.0.1")


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """The scheduler file of a cluster of two workers."""
    folder = tmp_path_factory.mktemp("cluster")
    processes = []
    try:
        process, path = scheduler(folder)
        processes.append(process)
        processes.append(
            dask(
                folder, "worker", "--scheduler-file", path, "--nworkers", 2, "--nthreads", 1, *QUIET
            )
        )
        yield path
    finally:
        for process in reversed(processes):
            stop(process)


def walks_of(walk, count, address, *, time_limit=30.0):
    with DaskCluster(walk, str(address), time_limit=time_limit) as workers:
        finished = sorted(workers.run(candidates(count)), key=lambda one: one.index)
    assert [one.index for one in finished] == list(range(count))
    return [one.walk for one in finished]


@pytest.mark.slow
def test_a_cluster_walks_as_one_process_does(running, expected):
    assert numbers(walks_of(stride, 20, running)) == numbers(expected)
    address = json.loads(running.read_text())["address"]
    assert numbers(walks_of(stride, 20, address)) == numbers(expected)


@pytest.mark.slow
def test_candidates_that_kill_or_hang_their_process_have_diverged_and_all_others_finish(
    running, expected
):
    for failure, reason in (
        (abort, "its process died with exit code -6, twice"),
        (leave, "its process died with exit code 3, twice"),
        (hang_and_compute, "gave no sign for 3 s"),
    ):
        walk = functools.partial(stride_or, failure, (2, 5))
        walks = walks_of(walk, 8, running, time_limit=3.0)
        assert [walk.reason for walk in walks] == ["", "", reason, "", "", reason, "", ""]
        assert walks[2].outcome is Outcome.DIVERGED
        assert numbers(walks[:2]) == numbers(expected[:2])
        assert numbers(walks[6:]) == numbers(expected[6:8])


@pytest.mark.slow
@pytest.mark.parametrize(("failure", "error"), [(refuse, ModelError), (err, ZeroDivisionError)])
def test_an_error_on_a_cluster_reaches_the_driver_with_its_text(running, failure, error):
    with pytest.raises(error, match="no joint 'hip'" if error is ModelError else "a bug"):
        walks_of(functools.partial(stride_or, failure, (1,)), 4, running)


def kill_dask_worker(folder, times, candidate):
    """A walk that takes the Dask worker with it, as a machine that goes down does."""
    if number_of(candidate) == 2:
        deaths = len(list(Path(folder).iterdir()))
        if deaths < times:
            (Path(folder) / str(deaths)).touch()
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60.0)
    return stride(candidate)


@pytest.mark.slow
def test_walks_of_a_lost_dask_worker_are_walked_by_another(running, expected, tmp_path):
    walk = functools.partial(kill_dask_worker, str(tmp_path), 1)
    assert numbers(walks_of(walk, 8, running)) == numbers(expected[:8])
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_a_candidate_that_kills_every_dask_worker_has_diverged_and_all_others_finish(
    running, expected, tmp_path
):
    walks = walks_of(functools.partial(kill_dask_worker, str(tmp_path), 100), 5, running)
    assert walks[2].outcome is Outcome.DIVERGED
    assert walks[2].reason == "its Dask workers died, 2 of them, twice"
    assert numbers(walks[:2]) == numbers(expected[:2])
    assert numbers(walks[3:]) == numbers(expected[3:5])


def note_and_hang(folder, candidate):
    (Path(folder) / str(os.getpid())).touch()
    hang_and_compute()


@pytest.mark.slow
def test_a_driver_that_ends_leaves_no_walk_on_the_cluster(running, tmp_path):
    class Stopped(BaseException):
        pass

    def drive():
        with DaskCluster(functools.partial(note_and_hang, str(tmp_path)), str(running)) as workers:
            workers.submit(candidates(1)[0])
            for _ in range(300):
                if list(tmp_path.iterdir()):
                    raise Stopped
                time.sleep(0.1)

    with pytest.raises(Stopped):
        drive()
    wait_for_end_of([int(path.name) for path in tmp_path.iterdir()])


def own_process_id():
    return {"drake": f"{os.getpid()}.0"}


@pytest.mark.slow
def test_a_worker_that_has_another_drake_is_refused_with_both_versions(running):
    with pytest.raises(WorkerError, match=rf"has drake \d+\.0, not {os.getpid()}\.0; install"):
        DaskCluster(stride, str(running), identity=own_process_id)


def known_here_only():
    if ON_CLUSTER.keys() <= os.environ.keys():
        raise ModelError("no robot description 'mine.sdf'")
    return {}


@pytest.mark.slow
def test_a_worker_that_has_not_the_robot_is_refused_by_its_address(running):
    with pytest.raises(WorkerError, match=r"Dask worker tcp://127.*no robot description 'mine"):
        DaskCluster(stride, str(running), identity=known_here_only)


def test_a_worker_that_joins_later_with_another_version_walks_nothing():
    found = walk_on_worker(
        candidates(1)[0], "a study", b"", 1.0, lambda: {"drake": "1.50"}, {"drake": "1.51"}
    )
    assert isinstance(found, WorkerError)
    assert "has drake 1.50, not 1.51" in str(found)


def test_the_same_machine_is_the_same_as_itself():
    # The robot is not among it: its content comes with the walks.
    assert identity() == identity()
    assert {"python", "drake", "numpy", "drake_gait"} == set(identity())


@pytest.mark.slow
def test_a_scheduler_without_workers_is_refused_with_the_command_that_starts_one(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(cluster, "_PATIENCE", 0.5)
    process, path = scheduler(tmp_path)
    try:
        with pytest.raises(WorkerError, match=r"0\.5 s.*`dask worker"):
            DaskCluster(stride, str(path))
    finally:
        stop(process)


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["scheduler", "worker"])
def test_a_lost_cluster_is_an_error_with_its_cure(monkeypatch, tmp_path, lost):
    monkeypatch.setattr(cluster, "_WATCH_INTERVAL", 0.2)
    processes = {}
    processes["scheduler"], path = scheduler(tmp_path)
    processes["worker"] = dask(tmp_path, "worker", "--scheduler-file", path, "--no-nanny", *QUIET)

    def drive():
        walk = functools.partial(stride_or, hang_and_compute, (3,))
        with DaskCluster(walk, str(path)) as workers:
            monkeypatch.setattr(cluster, "_PATIENCE", 3.0)
            for number, _ in enumerate(workers.run(candidates(4))):
                if number == 2:
                    processes[lost].kill()
                    processes[lost].wait()

    try:
        with pytest.raises(WorkerError, match=r"every finished walk is safe.*command again"):
            drive()
    finally:
        for process in processes.values():
            stop(process)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "tcp://nowhere.invalid:8786"])
def test_a_scheduler_that_does_not_answer_is_one_line_with_the_cure(monkeypatch, address):
    monkeypatch.setattr(cluster, "_CONNECTING_TIME", 1.0)
    with pytest.raises(WorkerError, match=f"{address} .*`dask scheduler") as caught:
        DaskCluster(stride, address)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("address", ["", "nonsense", "ftp://127.0.0.1:1", "10.0.0.1", "tcp://host"])
def test_an_unusable_address_is_refused_with_a_usable_one(address):
    with pytest.raises(SettingsError, match=f"tcp://HOST:PORT.*got {address}$"):
        DaskCluster(stride, address)


def test_a_scheduler_file_that_does_not_exist_is_refused_with_what_writes_it():
    with pytest.raises(SettingsError, match=r"none\.json.*`dask scheduler --sch"):
        DaskCluster(stride, "none.json")


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"address": ', "\0"])
def test_a_file_that_is_no_scheduler_file_is_refused(tmp_path, content):
    path = tmp_path / "scheduler.json"
    path.write_text(content)
    with pytest.raises(SettingsError, match="is no scheduler file"):
        DaskCluster(stride, str(path))


def test_without_dask_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    with pytest.raises(GaitError, match=r"pip install 'drake-gait\[cluster\]'"):
        DaskCluster(stride, "local")
