"""Where walks run, with stand-ins for the walk that fail as a simulation can."""

import functools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from strides import (
    DeadlyToLoad,
    ForeignToLoad,
    abort,
    blocked_or_dead,
    brief,
    candidates,
    die_the_first_time,
    err,
    hang,
    hang_and_compute,
    leave,
    log_of_times,
    numbers,
    process_id,
    process_id_and_grow,
    refuse,
    run,
    segfault,
    stride,
    stride_or,
    threads_per_walk,
    wait_for_end_of,
)

from drake_gait.errors import ModelError, SettingsError, WorkerError
from drake_gait.execution import worker_process
from drake_gait.execution.base import Serial
from drake_gait.execution.local import LocalProcesses
from drake_gait.walk import Outcome


@pytest.fixture(scope="module")
def expected():
    return [one.walk for one in Serial(stride).run(candidates(20))]


def test_one_process_walks_the_candidates_in_order(expected):
    finished = list(Serial(stride).run(candidates(5)))
    assert [one.index for one in finished] == [0, 1, 2, 3, 4]
    assert [walk.lateral for walk in expected[:5]] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert all(one.seconds >= 0.0 for one in finished)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_any_number_of_processes_walks_as_one_does(expected, workers):
    assert numbers(run(stride, 20, workers=workers)) == numbers(expected)


def test_several_batches_run_in_the_same_processes():
    with LocalProcesses(process_id, count=2, time_limit=30.0) as processes:
        batches = [list(processes.run(candidates(8))) for _ in range(3)]
    used = {one.walk.reason for batch in batches for one in batch}
    assert 1 <= len(used) <= 2
    assert str(os.getpid()) not in used


def test_no_candidates_are_no_walks():
    with LocalProcesses(stride, count=1) as processes:
        assert list(processes.run([])) == []
    assert list(Serial(stride).run([])) == []


def test_a_worker_stays_until_it_has_grown():
    assert len({walk.reason for walk in run(process_id, 130, workers=1)}) == 1
    used = [walk.reason for walk in run(process_id_and_grow, 6, workers=1)]
    assert len(set(used)) >= 3  # Of two hoards at most.


def test_a_worker_that_cannot_tell_its_memory_is_replaced_after_many_walks(monkeypatch):
    monkeypatch.setattr(Path, "read_text", no_such_file)
    assert [worker_process._is_worn(walks) for walks in (1, 119, 120)] == [False, False, True]


def no_such_file(path):
    raise FileNotFoundError(path)


def test_a_worker_walks_with_one_thread():
    assert run(threads_per_walk, 1, workers=1)[0].reason == "1"


@pytest.mark.parametrize(
    ("failure", "reason"),
    [
        (abort, "died with exit code -6"),
        (segfault, "died with exit code -11"),
        (leave, "died with exit code 3"),
    ],
)
def test_a_candidate_that_kills_its_process_has_diverged_and_all_others_finish(
    expected, failure, reason
):
    walks = run(functools.partial(stride_or, failure, (2, 5)), 8)
    for number in (2, 5):
        assert walks[number].outcome is Outcome.DIVERGED
        assert walks[number].frames == 0
        assert reason in walks[number].reason
        assert "twice" in walks[number].reason
    others = [number for number in range(8) if number not in (2, 5)]
    assert numbers(walks[number] for number in others) == numbers(
        expected[number] for number in others
    )


@pytest.mark.parametrize(("failure", "limit"), [(hang, 3.0), (hang_and_compute, 1.5)])
def test_a_candidate_that_never_ends_has_diverged_and_all_others_finish(expected, failure, limit):
    walks = run(functools.partial(stride_or, failure, (0,)), 6, time_limit=limit)
    assert walks[0].outcome is Outcome.DIVERGED
    assert f"for {limit:g} s" in walks[0].reason
    assert numbers(walks[1:]) == numbers(expected[1:6])


def test_processes_that_all_die_are_so_many_walks_that_diverged():
    walks = run(functools.partial(stride_or, leave, range(3)), 3)
    assert [walk.outcome for walk in walks] == [Outcome.DIVERGED] * 3


@pytest.mark.parametrize(("failure", "error"), [(refuse, ModelError), (err, ZeroDivisionError)])
def test_an_error_in_a_worker_reaches_the_driver_with_its_text(failure, error):
    text = "no joint 'hip'" if error is ModelError else "a bug"
    with pytest.raises(error, match=text):
        run(functools.partial(stride_or, failure, (1,)), 4)
    with pytest.raises(error, match=text):
        list(Serial(functools.partial(stride_or, failure, (1,))).run(candidates(4)))


def test_an_error_in_the_driver_ends_workers_during_a_walk():
    def drive():
        walk = functools.partial(stride_or, hang, (0,))
        with LocalProcesses(walk, count=1, time_limit=2000.0) as processes:
            assert next(processes.run(candidates(2)[::-1])).walk.lateral == 1.0
            raise RuntimeError("mishap")

    with pytest.raises(RuntimeError, match="mishap"):
        drive()
    assert children(os.getpid()) == set()


def children(process):
    """Ids of the living processes that a process has started."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(parent) == process and state != "Z":
            found.add(int(path.parent.name))
    return found


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_for_the_driver_reaches_no_worker_nor_one_that_takes_its_place(sent):
    # Blocked from its first instant: it must not break off while a worker still imports.
    walk = functools.partial(blocked_or_dead, sent)
    with LocalProcesses(walk, count=1, time_limit=30.0) as processes:
        walks = [one.walk for one in processes.run(candidates(3))]
    assert [walk.outcome for walk in walks].count(Outcome.DIVERGED) == 1
    assert [walk.reason for walk in walks if walk.survived] == ["True", "True"]
    assert sent not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_walk_whose_worker_was_killed_is_walked_again(expected, tmp_path):
    walk = functools.partial(die_the_first_time, str(tmp_path), (2, 5, 7))
    with LocalProcesses(walk, count=2, time_limit=30.0) as processes:
        finished = sorted(processes.run(candidates(8)), key=lambda one: one.index)
    assert numbers(one.walk for one in finished) == numbers(expected[:8])
    assert processes.deaths == {"its process died with exit code -9": 3}


def test_a_walk_whose_worker_died_is_walked_again_alone(tmp_path):
    with LocalProcesses(functools.partial(log_of_times, str(tmp_path)), count=3) as processes:
        assert len(list(processes.run(candidates(8)))) == 8
    times = {
        int(path.stem): tuple(map(float, path.read_text().split()))
        for path in tmp_path.glob("*.times")
    }
    for again in (0, 2, 4, 6):
        start, end = times.pop(again)
        assert all(others[1] <= start or end <= others[0] for others in times.values())
        times[again] = (start, end)


def test_workers_killed_while_idle_are_replaced(expected):
    with LocalProcesses(stride, count=2, time_limit=30.0) as processes:
        for _ in range(3):
            assert len(list(processes.run(candidates(6)))) == 6
            workers = children(os.getpid())
            for worker in workers:
                os.kill(worker, signal.SIGKILL)
            wait_for_end_of(workers)  # Of all their threads, not of their first ones alone.
        finished = sorted(processes.run(candidates(6)), key=lambda one: one.index)
    assert numbers(one.walk for one in finished) == numbers(expected[:6])
    assert processes.deaths == {}


def test_workers_killed_again_and_again_cost_no_walk(expected):
    rng = np.random.default_rng(0)
    finished, killed = [], 0
    with LocalProcesses(brief, count=2, time_limit=30.0) as processes:
        for one in processes.run(candidates(20) * 20):
            finished.append(one)
            if len(finished) % 40 == 0 and (workers := sorted(children(os.getpid()))):
                time.sleep(rng.uniform(0.0, 0.02))  # Anywhere in a walk.
                os.kill(workers[rng.integers(len(workers))], signal.SIGKILL)
                killed += 1
    finished.sort(key=lambda one: one.index)
    assert numbers(one.walk for one in finished) == 20 * numbers(expected)
    assert killed >= 8
    assert 1 <= processes.deaths["its process died with exit code -9"] <= killed


def test_workers_that_cannot_start_are_an_error_and_no_walks_that_diverged():
    with pytest.raises(WorkerError, match="5 worker processes"):
        run(DeadlyToLoad(), 2, workers=1)
    with pytest.raises(ModelError, match="no joint 'hip'"):
        run(ForeignToLoad(), 2, workers=1)


DRIVER = """
import sys
sys.path.insert(0, sys.argv[1])
import strides
from drake_gait.execution.local import LocalProcesses

with LocalProcesses(getattr(strides, sys.argv[2]), count=2, time_limit=1e6) as processes:
    print("started", flush=True)
    for _ in processes.run(strides.candidates(200)):
        print("walked", flush=True)
"""


@pytest.mark.parametrize("walk", ["pause", "pause_or_hang"])
def test_workers_end_when_their_driver_is_killed(tmp_path, walk):
    script = tmp_path / "driver.py"
    script.write_text(DRIVER)
    here = Path(__file__).parents[1]
    driver = subprocess.Popen(
        [sys.executable, script, here, walk],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(here.parent)},
    )
    for _ in range(3):
        driver.stdout.readline()
    workers = children(driver.pid)
    assert len(workers) == 2
    driver.kill()
    driver.communicate()
    wait_for_end_of(workers)


@pytest.mark.parametrize("count", [0, -1])
def test_no_workers_are_refused(count):
    with pytest.raises(SettingsError, match=rf"workers.*>= 1, got {count}"):
        LocalProcesses(stride, count=count)
