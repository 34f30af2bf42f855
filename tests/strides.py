"""Stand-ins for the simulation, which workers import by their names: nothing heavy is in here."""

import ctypes
import dataclasses
import os
import signal
import time
from pathlib import Path

import numpy as np

from drake_gait.errors import ModelError
from drake_gait.execution.local import LocalProcesses
from drake_gait.gait import Gait
from drake_gait.problem import Candidate
from drake_gait.walk import Outcome, Walk

# A gait that walks from a ramp; laws do not follow the default study.
MIDDLE = Gait.from_degrees(
    [
        [0.5, 2.3, 5.8, -0.4],
        [12.7, -13.1, 9.4, -0.6],
        [22.2, -2.4, 13.0, 0.2],
        [10.0, 6.2, 6.4, 0.7],
    ]
)


def candidates(count):
    """Gaits that differ in their first coefficient: 0, 0.01, 0.02 ..."""
    values = np.zeros((count, 4, 4))
    values[:, 0, 0] = 0.01 * np.arange(count)
    return [Candidate(gait=Gait(coefficients=value)) for value in values]


def number_of(candidate):
    return round(candidate.gait.coefficients[0, 0] / 0.01)


# Stand-ins for the simulation; a worker imports them by their names.

HOARD = []


def stride(candidate):
    """A walk with the candidate's number in it, computed with more digits than a text keeps."""
    forward = float(np.sin(candidate.gait.coefficients[0, 0] + 1.0) / 3.0)
    return Walk(
        outcome=Outcome.WALKED,
        frames=240,
        forward=forward,
        lateral=float(number_of(candidate)),
        yaw=0.0,
        com_height=0.245,
    )


def stride_or(failure, bad, candidate):
    if number_of(candidate) in bad:
        failure()
    return stride(candidate)


def abort():
    os.abort()


def segfault():
    ctypes.string_at(0)


def leave():
    os._exit(3)


def hang():
    time.sleep(1000)


def hang_and_compute():
    while True:
        pass


def pause(candidate):
    time.sleep(0.2)
    return stride(candidate)


def refuse():
    raise ModelError("no joint 'hip' in made_up.sdf")


def err():
    raise ZeroDivisionError("a bug")


def process_id(candidate):
    return dataclasses.replace(stride(candidate), reason=str(os.getpid()))


def process_id_and_grow(candidate):
    HOARD.append(b"x" * 130_000_000)
    return process_id(candidate)


def threads_per_walk(candidate):
    return dataclasses.replace(stride(candidate), reason=os.environ["OMP_NUM_THREADS"])


def run(walk, count, *, workers=2, time_limit=30.0):
    """Walks in the order of the candidates."""
    with LocalProcesses(walk, count=workers, time_limit=time_limit) as processes:
        finished = list(processes.run(candidates(count)))
    assert sorted(one.index for one in finished) == list(range(count))
    return [one.walk for one in sorted(finished, key=lambda one: one.index)]


def numbers(walks):
    return [dataclasses.astuple(walk) for walk in walks]


def wait_for_end_of(processes):
    for _ in range(300):
        if not any(is_running(process) for process in processes):
            return
        time.sleep(0.1)
    raise AssertionError(f"of the processes {processes} one is left")


def is_running(process):
    folder = Path(f"/proc/{process}")
    try:
        ended = (folder / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
        # Its first thread may have ended before the others.
        return not ended or len(list((folder / "task").iterdir())) > 1
    except (FileNotFoundError, ProcessLookupError):
        return False


def refuse_to_load():
    os._exit(7)


class DeadlyToLoad:
    def __reduce__(self):
        return refuse_to_load, ()

    def __call__(self, candidate):
        raise AssertionError("never loaded")


class ForeignToLoad(DeadlyToLoad):
    def __reduce__(self):
        return refuse, ()


def pause_or_hang(candidate):
    if number_of(candidate) >= 2:
        hang_and_compute()
    return pause(candidate)


def blocked_or_dead(sent, candidate):
    if number_of(candidate) == 1:
        os._exit(3)
    blocked = sent in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    return dataclasses.replace(stride(candidate), reason=str(blocked))


def die_the_first_time(folder, bad, candidate):
    """A walk that is killed from outside, as by a system that is out of memory."""
    first = Path(folder) / str(number_of(candidate))
    if number_of(candidate) in bad and not first.exists():
        first.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return stride(candidate)


def log_of_times(folder, candidate):
    """A walk that dies if its number is even, and says from when to when it ran if not."""
    start = time.monotonic()
    first = Path(folder) / f"{number_of(candidate)}.first"
    if number_of(candidate) % 2 == 0 and not first.exists():
        first.touch()
        os._exit(3)
    time.sleep(0.1)
    (Path(folder) / f"{number_of(candidate)}.times").write_text(f"{start} {time.monotonic()}")
    return stride(candidate)


def brief(candidate):
    time.sleep(0.01)
    return stride(candidate)
