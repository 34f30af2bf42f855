"""A motion on the controller: every packet decoded from a pseudo-terminal."""

import io
import sys

import numpy as np
import pytest
from rcb4_board import HELD, SERVOS, Board

from drake_gait.errors import HardwareError
from drake_gait.gait import JOINTS, Gait, Start
from drake_gait.hardware.motion import Motion
from drake_gait.hardware.player import open_board, play
from drake_gait.hardware.servo_map import read_servo_map

pytest.importorskip("rcb4")


class Clock:
    """A time that passes only while somebody sleeps."""

    def __init__(self):
        self.now, self.slept = 100.0, []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


@pytest.fixture
def board():
    found = Board()
    yield found
    found.close()


@pytest.fixture(scope="module")
def motion():
    coefficients = np.zeros((4, 4))
    coefficients[0, 2], coefficients[1, 1], coefficients[2, 0] = 0.05, 0.2, 0.4
    return Motion(angles=Gait(coefficients=coefficients).commands_from(Start.RAMP)[:60])


def played(board, motion, agreed=lambda: True, clock=None):
    clock, log = clock or Clock(), io.StringIO()
    opened = open_board(board.port, log=log)
    try:
        servos = read_servo_map()
        return play(motion, servos, opened, agreed=agreed, clock=clock, sleep=clock.sleep, log=log)
    finally:
        opened.close()


def test_every_frame_arrives_with_its_checksum_its_ids_and_its_positions(board, motion):
    clock = Clock()
    account = played(board, motion, clock=clock)
    assert not board.wrong
    hold, first, *frames = [(velocity, places) for _, velocity, places in board.moves]
    assert set(hold[1].values()) == {HELD}
    expected = read_servo_map().positions(motion.angles)
    ids = read_servo_map().ids
    assert first[1] == dict(zip(ids, expected[0], strict=True))
    assert first[0] == 200  # Cycles of 15 ms: three seconds.
    assert [places for _, places in frames] == [
        dict(zip(ids, row, strict=True)) for row in expected.tolist()
    ]
    assert {velocity for velocity, _ in frames} == {1}
    assert account.frames == len(motion.angles)
    assert account.late == 0
    # Slowly to the first posture, then a frame every 20 ms.
    assert clock.slept[0] == pytest.approx(3.0)
    assert clock.slept[1:] == pytest.approx([0.02] * (len(motion.angles) - 1))


def test_nothing_is_played_without_a_yes(board, motion):
    assert played(board, motion, agreed=lambda: False) is None
    assert len(board.moves) == 2


def test_ctrl_c_stops_the_frames_and_the_servos_hold(board, motion):
    class Interrupting(Clock):
        def sleep(self, seconds):
            super().sleep(seconds)
            if len(self.slept) == 10:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        played(board, motion, clock=Interrupting())
    *frames, last = board.moves
    assert set(last[2].values()) == {HELD}
    assert set(last[2]) == set(SERVOS)
    assert len(frames) == 2 + 9


def test_a_servo_that_does_not_answer_is_named_and_nothing_moves(motion):
    board = Board(servos=tuple(number for number in SERVOS if number != 17))
    try:
        with pytest.raises(HardwareError, match="17"):
            played(board, motion)
    finally:
        board.close()
    assert not any(set(places.values()) - {HELD} for _, _, places in board.moves)


def test_a_port_where_nothing_answers_is_named(tmp_path):
    with pytest.raises(HardwareError, match="nowhere"):
        open_board(str(tmp_path / "nowhere"), log=io.StringIO())


def test_a_controller_that_falls_silent_is_told(motion, monkeypatch):
    board = Board(silent_after=5)
    from rcb4.rcb4interface import RCB4Interface

    read = RCB4Interface.serial_read
    monkeypatch.setattr(RCB4Interface, "serial_read", lambda self, timeout=10: read(self, 0.2))
    try:
        with pytest.raises(HardwareError, match="stopped answering"):
            played(board, motion)
    finally:
        board.close()
    assert len(board.moves) == 5


def test_playing_without_the_library_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "rcb4.rcb4interface", None)
    with pytest.raises(HardwareError, match=r"drake-gait\[robot\]"):
        open_board("/dev/null", log=io.StringIO())


def test_the_ten_servos_of_the_shipped_robot_are_those_of_its_legs():
    assert sorted(read_servo_map().ids) == sorted(SERVOS)
    assert len(JOINTS) == len(SERVOS)
