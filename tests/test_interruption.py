"""SIGTERM, as a cluster sends it at the end of a job's time."""

import os
import signal
import subprocess
import sys

import pytest

from drake_gait.interruption import Terminated, exit_status, sigterm_interrupts


def send_sigterm():
    os.kill(os.getpid(), signal.SIGTERM)


def test_sigterm_interrupts_as_ctrl_c_does():
    with pytest.raises(KeyboardInterrupt) as caught, sigterm_interrupts():
        send_sigterm()
    assert exit_status(caught.value) == 143
    assert exit_status(KeyboardInterrupt()) == 130


def test_a_second_sigterm_does_not_break_off_the_cleaning_up():
    cleaned = []

    def work():
        try:
            send_sigterm()
        finally:
            send_sigterm()
            cleaned.append("all")

    with pytest.raises(Terminated), sigterm_interrupts():
        work()
    assert cleaned == ["all"]


def test_sigterm_means_afterwards_what_it_meant_before():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda *_: heard.append("SIGTERM"))
    try:
        with pytest.raises(Terminated), sigterm_interrupts():
            send_sigterm()
        send_sigterm()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == ["SIGTERM"]


LEAVING = """
import atexit, sys
from drake_gait.interruption import leave

class TakenDown:
    def __del__(self):
        print("taken down", end="")

kept = TakenDown()
atexit.register(print, "put away, ", end="")
print("said, ", end="")
leave(int(sys.argv[1]))
"""


@pytest.mark.parametrize(
    ("status", "taken_down"), [(0, True), (2, True), (130, False), (143, False)]
)
def test_an_interrupted_command_leaves_without_being_taken_down(status, taken_down):
    ended = subprocess.run(
        [sys.executable, "-c", LEAVING, str(status)], check=False, stdout=subprocess.PIPE, text=True
    )
    assert ended.returncode == status
    assert ended.stdout == "said, put away, " + taken_down * "taken down"
