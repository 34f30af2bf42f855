"""SIGTERM, as a cluster sends it at the end of a job's time."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from drake_gait.cli._signals import Terminated, exit_status, sigterm_interrupts


@pytest.fixture(autouse=True)
def as_python_begins():
    """Signals as Python has them at first, whatever another test has made of them."""
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


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
        (signal.default_int_handler, 130, "put in order\n"),
        # As in the background of a script, which has its jobs not hear it.
        (signal.SIG_IGN, 0, "went on\n"),
    ],
)
def test_ctrl_c_ends_a_command_in_one_line_until_it_begins_its_work(heard, status, text):
    slept = LOADING if heard is not signal.SIG_IGN else LOADING.replace("60.0", "0.0")
    ended = subprocess.run(
        [sys.executable, "-c", slept],
        check=False,
        capture_output=True,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, heard),
    )
    said = "stopped\n" if status else ""
    assert (ended.returncode, ended.stdout, ended.stderr) == (status, text, said)


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


MOMENTS = """
import os, signal, sys, threading
from drake_gait.cli._signals import begin, leave
begin()
moment, number = sys.argv[1], getattr(signal, sys.argv[2])
def hear(now):
    if now == moment:
        os.kill(os.getpid(), number)
        threading.Event().wait(0.05)
hear("imports")
from drake_gait.cli._command import conduct
def work():
    hear("parsing")
    try:
        hear("work")
    finally:
        print("put in order")
status = conduct(work, stopped="stopped here")
hear("afterwards")
leave(status)
"""


@pytest.mark.parametrize(("sent", "status"), [("SIGINT", 130), ("SIGTERM", 143)])
@pytest.mark.parametrize(
    ("moment", "said"),
    [
        ("imports", "stopped\n"),
        ("parsing", "stopped here\n"),
        ("work", "stopped here\n"),
        ("afterwards", "stopped\n"),
    ],
)
def test_a_signal_at_any_moment_is_one_line_and_its_status(sent, status, moment, said):
    ended = subprocess.run(
        [sys.executable, "-c", MOMENTS, moment, sent], check=False, capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (status, said)
    assert ("put in order" in ended.stdout) is (moment in ("work", "afterwards"))


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_finished_command_is_taken_down_changes_nothing(sent):
    code = (
        "import atexit, os, sys; from drake_gait.cli._signals import begin, leave; begin()\n"
        "atexit.register(os.kill, os.getpid(), int(sys.argv[1])); leave(0)"
    )
    command = [sys.executable, "-c", code, str(int(sent))]
    ended = subprocess.run(command, check=False, capture_output=True)
    assert (ended.returncode, ended.stderr) == (0, b"")
