"""What a person sees of a running search, on a terminal and in a file."""

import dataclasses
import io
import types

import numpy as np
import pytest
from rich.console import Console

from drake_gait.cli.progress import Pace, display
from drake_gait.execution.base import Finished
from drake_gait.search.loop import search
from drake_gait.search.runner import Progress
from drake_gait.study.search_settings import SearchSettings
from drake_gait.study.store import Study
from drake_gait.walk import Outcome, Walk


class Terminal(io.StringIO):
    """A file that says it is a terminal."""

    def isatty(self):
        return True


class Clock:
    """Shows the time that it is set to [s]."""

    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def told(walks, *, total=400, **changes):
    """What a search reports after so many walks."""
    usual = {
        "survivors": walks // 2,
        "feasible": 0,
        "failures": {"fell": walks - walks // 2},
        "best": None,
        "network": None,
    }
    return Progress(walks=walks, total=total, **{**usual, **changes})


def trained(value):
    return types.SimpleNamespace(r2_train=np.full(4, 0.9), r2_heldout=np.full(4, value))


def shown(settings, reports, *, file, clock, before=0, seconds=0.5, **console):
    """What a display writes of reports that come every half a second."""
    console = Console(file=file, highlight=False, width=100, **console)
    with display(settings, before, console=console, clock=clock) as show:
        for report in reports:
            clock.now += seconds
            show(report)
    return file.getvalue()


@pytest.fixture
def of_400(study):
    return dataclasses.replace(study, search=SearchSettings(samples=200, simulations=400))


@pytest.mark.parametrize("environment", [{}, {"FORCE_COLOR": "1"}])
def test_a_file_gets_about_twenty_plain_lines_of_a_search_that_trains_twenty_networks(
    of_400, clock, environment
):
    networks = [trained(number / 20) for number in range(21)]
    reports = [
        told(n, network=networks[(n - 200) // 10] if n > 200 else None) for n in range(1, 401)
    ]
    text = shown(of_400, reports, file=io.StringIO(), clock=clock, _environ=environment)
    assert "\x1b" not in text
    assert "\r" not in text
    lines = text.splitlines()
    assert 20 <= len(lines) <= 23
    assert lines[0] == "study small, seed 0: 400 walks"
    assert lines[-1].startswith("walks 400/400   survivors 200   feasible 0   best feasible none")
    assert sum("held-out R² of Z" in line for line in lines) == 10


def test_a_line_says_all_that_is_known(of_400, clock, entry):
    reports = [
        told(99),
        told(101, failures={"fell": 7, "worker died": 40}, feasible=3, best=entry),
    ]
    text = shown(of_400, reports, file=io.StringIO(), clock=clock, seconds=2.0, before=90)
    assert text.splitlines()[0].endswith("400 walks, 90 of them done before")
    assert text.splitlines()[-1] == (
        "walks 101/400   survivors 50   feasible 3   best feasible 133.3 mm   1.0 walks/s   "
        "time left 4:59   worker died 40   fell 7"
    )


def test_the_last_line_is_where_the_search_ended_even_by_an_error(of_400, clock):
    file = io.StringIO()
    console = Console(file=file)

    def interrupted():
        with display(of_400, 0, console=console, clock=clock) as show:
            for walks in (1, 2, 3):
                show(told(walks))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    lines = file.getvalue().splitlines()
    assert [line.split()[1] for line in lines[1:]] == ["1/400", "3/400"]


def test_a_small_search_prints_no_line_twice(study, clock):
    tiny = dataclasses.replace(study, search=SearchSettings(samples=3, simulations=3))
    text = shown(tiny, [told(n, total=3) for n in (1, 2, 3)], file=io.StringIO(), clock=clock)
    assert [line.split()[1] for line in text.splitlines()[1:]] == ["1/3", "2/3", "3/3"]


@pytest.mark.parametrize("width", [45, 100])
def test_a_terminal_gets_a_picture_that_is_redrawn_in_place(of_400, clock, width, entry):
    reports = [told(1), told(200, network=trained(0.5), best=entry, failures={"time limit": 2})]
    file = Terminal()
    console = Console(file=file, width=width, force_terminal=True, highlight=False)
    with display(of_400, 0, console=console, clock=clock) as show:
        for report in reports:
            clock.now += 1.0
            show(report)
    first, last = file.getvalue().split("\x1b[1A")[0], file.getvalue().split("\x1b[1A")[-1]
    assert "1/400" in first
    for text in ("200/400", "survivors 100", "133.3 mm", "time limit 2", "R² training"):
        assert text in last
    assert file.getvalue().endswith("\x1b[?25h")  # The cursor is shown again.


def test_a_terminal_is_not_redrawn_faster_than_an_eye_sees(of_400, clock):
    def pictures(seconds):
        reports = [told(n) for n in range(1, 401)]
        text = shown(of_400, reports, file=Terminal(), clock=clock, seconds=seconds,
                     force_terminal=True)  # fmt: skip
        return text.count("/400")

    assert pictures(0.001) < 10
    assert pictures(1.0) >= 400


def test_a_terminal_that_cannot_move_its_cursor_gets_lines(of_400, clock):
    text = shown(of_400, [told(1)], file=Terminal(), clock=clock, _environ={"TERM": "dumb"})
    assert "\x1b" not in text
    assert "walks 1/400" in text


def test_the_speed_is_that_of_the_latest_walks(clock):
    pace = Pace(clock, memory=11)
    assert pace.speed is None
    for walks in range(100):
        clock.now += 0.1
        pace.note(walks)
    assert pace.speed == pytest.approx(10.0)
    for walks in range(100, 120):
        clock.now += 2.0
        pace.note(walks)
    assert pace.speed == pytest.approx(0.5)


def test_a_search_that_stands_has_no_speed(clock):
    pace = Pace(clock, memory=5)
    for _ in range(5):
        clock.now += 1.0
        pace.note(7)
    assert pace.speed is None


@pytest.mark.parametrize(
    ("walks", "left"), [(400, "0:00"), (389, "0:22"), (371, "0:58"), (340, "2:00")]
)
def test_the_time_left_is_that_of_the_walks_left(of_400, clock, walks, left):
    reports = [told(walks - 1), told(walks)]
    text = shown(of_400, reports, file=io.StringIO(), clock=clock, seconds=2.0)
    assert f"time left {left}" in text.splitlines()[-1]


def test_walks_that_confirm_others_are_told_in_the_place_of_the_time_left(of_400, clock):
    reports = [told(400, confirmations=number) for number in range(61)]
    lines = shown(of_400, reports, file=io.StringIO(), clock=clock).splitlines()
    assert "time left" in lines[1]
    assert [line.split("confirmations ")[1].split()[0] for line in lines[2:]] == ["20", "40", "60"]


def test_hours_left_are_told_as_hours(study, clock):
    long = dataclasses.replace(study, search=SearchSettings(samples=1, simulations=4002))
    reports = [told(1, total=4002), told(2, total=4002)]
    text = shown(long, reports, file=io.StringIO(), clock=clock, seconds=1.0)
    assert "time left 1:06:40" in text.splitlines()[-1]


class Stopped(BaseException):
    """What interrupts a search here."""


def test_failures_are_counted_by_cause_over_interruptions_too(study, tmp_path):
    settings = dataclasses.replace(study, search=SearchSettings(samples=12, simulations=12))
    walks = [
        Walk.diverged("solver: it gave up"),
        Walk.diverged("its process died with exit code -6"),
        *[
            Walk(outcome=outcome, frames=240, forward=0.1, lateral=0.0, yaw=0.0, com_height=0.245)
            for outcome in [Outcome.FELL, Outcome.WALKED] * 5
        ],
    ]
    seen = []

    def evaluate(candidates):
        for index in range(len(candidates)):
            if len(seen) == 5 and len(candidates) == 12:
                raise Stopped
            walk = walks[len(seen)]
            yield Finished(index=index, walk=walk, seconds=0.0)

    with Study.create(tmp_path / "study.db", {}) as opened:
        with pytest.raises(Stopped):
            search(settings, opened, evaluate, seen.append)
        search(settings, opened, evaluate, seen.append)
    assert [report.walks for report in seen] == list(range(1, 13))
    assert all(sum(one.failures.values()) + one.survivors == one.walks for one in seen)
    assert dict(seen[-1].failures) == {"solver": 1, "worker died": 1, "fell": 5}
