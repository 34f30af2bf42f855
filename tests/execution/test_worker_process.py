"""One expendable process: when it hangs, and what it tells of an error."""

import functools
import pickle

import pytest
from strides import err, run, stride_or

from drake_gait.errors import GaitError
from drake_gait.execution.worker_process import Vigil


def first_hang(computed, *, limit=10.0):
    """When a process is found to hang that has computed so much after each second; or None."""
    hangs = Vigil(limit=limit)
    answers = [hangs(work, float(second)) for second, work in enumerate(computed)]
    return answers.index(True) if True in answers else None


def test_a_process_that_computes_for_longer_than_its_limit_hangs():
    assert first_hang([float(second) for second in range(30)]) == 10
    assert first_hang([0.5 * second for second in range(30)]) == 20


def test_computing_time_of_earlier_walks_does_not_count():
    assert first_hang([500.0 + second for second in range(30)]) == 10


def test_a_process_that_stands_still_for_its_limit_hangs():
    assert first_hang([7.0] * 30) == 10
    assert first_hang([0.0, 1.0, 2.0] + [2.0] * 30) == 12


def test_a_process_that_a_busy_machine_lets_wait_does_not_hang():
    # A hundredth of a second, which is a tick of its clock, every nine seconds.
    assert first_hang([0.01 * (second // 9) for second in range(3600)]) is None


@pytest.mark.parametrize("limit", [1.0, 30.0])
def test_a_process_whose_computing_cannot_be_told_has_its_limit_on_the_clock(limit):
    assert first_hang([0.0] * 60, limit=limit) == limit


class HomelyError(Exception):
    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def err_strangely():
    raise HomelyError("this", "that")


def test_an_error_that_cannot_be_pickled_still_says_what_it_was():
    with pytest.raises(RuntimeError, match=r"(?s)err_strangely.*this and that"):
        run(functools.partial(stride_or, err_strangely, (0,)), 1)


def test_an_error_in_a_worker_tells_where_it_was_raised():
    with pytest.raises(ZeroDivisionError) as caught:
        run(functools.partial(stride_or, err, (0,)), 1)
    assert "in err" in "".join(caught.value.__notes__)


@pytest.mark.parametrize("error", GaitError.__subclasses__())
def test_every_error_of_the_library_survives_the_way_from_another_process(error):
    again = pickle.loads(pickle.dumps(error("what was wanted, what came")))
    assert type(again) is error
    assert str(again) == "what was wanted, what came"
