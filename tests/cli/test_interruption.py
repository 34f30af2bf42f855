"""SIGTERM, as a cluster sends it at the end of a job's time."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from drake_gait.cli._signals import Terminated, exit_status, sigterm_interrupts


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


LOADING = """
import os, signal, time
from drake_gait.cli._signals import ctrl_c_ends_at_once, sigterm_interrupts

ctrl_c_ends_at_once()
try:
    with sigterm_interrupts():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(60.0)
except KeyboardInterrupt:
    print("put in order", flush=True)
ctrl_c_ends_at_once()
os.kill(os.getpid(), signal.SIGINT)
print("went on")
"""


@pytest.mark.parametrize(
    ("heard", "status", "text"),
    [
        (signal.default_int_handler, -signal.SIGINT, "put in order\n"),
        # As in the background of a script, which has its jobs not hear it.
        (signal.SIG_IGN, 0, "went on\n"),
    ],
)
def test_ctrl_c_ends_a_command_without_a_word_until_it_begins_its_work(heard, status, text):
    slept = LOADING if heard is not signal.SIG_IGN else LOADING.replace("60.0", "0.0")
    ended = subprocess.run(
        [sys.executable, "-c", slept],
        check=False,
        capture_output=True,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, heard),
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (status, text, "")


def test_a_search_hears_ctrl_c_as_it_did_before_where_nothing_was_changed():
    before = signal.getsignal(signal.SIGINT)
    with sigterm_interrupts():
        assert signal.getsignal(signal.SIGINT) is before
    assert signal.getsignal(signal.SIGINT) is before


LEAVING = """
import atexit, sys
from drake_gait.cli._signals import leave

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


def test_another_thread_hears_no_signals_and_leaves_them_as_they_are():
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    seen = []

    def work():
        with sigterm_interrupts():
            seen.append((signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]
