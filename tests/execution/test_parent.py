"""Processes that end with the one that started them."""

import os
import signal
import subprocess
import sys
import time

import pytest

STARTER = """
import subprocess, sys, time
from drake_gait.execution.parent import Lifeline

with Lifeline() as lifeline:
    children = [
        subprocess.Popen(
            lifeline.command("sleeper", [str(number)]),
            pass_fds=[lifeline.descriptor],
            start_new_session=True,
        )
        for number in range(2)
    ]
    time.sleep({seconds})
for child in children:
    print("ended with", child.wait(), flush=True)
"""

SLEEPER = """
import os, signal, sys, time
from drake_gait.execution import parent

{beginning}
try:
    os.write(1, f"sleeps {{sys.argv[1:]}} {{__name__}}\\n".encode())
    time.sleep(300.0)
finally:
    print("put in order", flush=True)
"""

HEARS = """
from drake_gait.cli._signals import sigterm_interrupts
inside = sigterm_interrupts()
inside.__enter__()
"""
DEAF = "signal.signal(signal.SIGTERM, signal.SIG_IGN); parent.GRACE = 0.3"


@pytest.fixture
def started(tmp_path, monkeypatch):
    """Starts a process with two children whose output is its own."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    running = []

    def start(beginning="", seconds=300.0):
        (tmp_path / "sleeper.py").write_text(SLEEPER.format(beginning=beginning))
        starter = subprocess.Popen(
            [sys.executable, "-c", STARTER.format(seconds=seconds)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        running.append(starter)
        said = [starter.stdout.readline() for _ in range(2)]
        assert sorted(said) == [f"sleeps ['{number}'] __main__\n" for number in range(2)]
        return starter

    yield start
    for starter in running:
        starter.kill()
        starter.wait()
        starter.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_children_end_in_order_with_their_parent_however_it_ends(started, number):
    starter = started(HEARS)
    starter.send_signal(number)
    # The pipe closes when the last of the three is gone.
    assert starter.stdout.read().count("put in order") == 2


def test_a_child_that_does_not_stop_by_itself_is_killed(started):
    starter = started(DEAF)
    before = time.monotonic()
    starter.kill()
    assert starter.stdout.read() == ""
    assert time.monotonic() - before > 0.25


def test_children_end_when_their_parent_lets_go_of_them(started):
    starter = started(seconds=1.0)
    assert starter.stdout.read() == 2 * f"ended with {-signal.SIGTERM}\n"
    assert starter.wait() == 0
