"""A motion played on an RCB-4 controller, through the library `rcb4`."""

import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from typing import Any, Protocol, TextIO

import numpy as np

from drake_gait.errors import HardwareError
from drake_gait.hardware.motion import Motion
from drake_gait.hardware.servo_map import ServoMap

BAUD_RATE = 1_250_000
"""Baud rate of an RCB-4 mini [1/s]; the KHR-3HV's board leaves the works with 115200."""
SLOWLY = 3.0
"""Time that the move to the first frame takes [s]."""
_AT_ONCE = 1  # A move of one output cycle of the board.


class Board(Protocol):
    """Part of `rcb4.rcb4interface.RCB4Interface` that is used."""

    def search_servo_ids(self) -> Any:
        """Return the ids of the servos that answer."""

    def hold(self, servo_ids: Sequence[int]) -> Any:
        """Switch servos on, where they are."""

    def time_to_velocity(self, seconds: float) -> int:
        """Return the velocity of a move that takes some time [s]."""

    def servo_angle_vector(self, servo_ids: Sequence[int], servo_vector: Any, velocity: int) -> Any:
        """Move servos to positions."""

    def close(self) -> None:
        """Close the port."""


@dataclass(frozen=True, kw_only=True)
class Played:
    """Account of a motion that was played."""

    frames: int
    """Frames sent."""
    late: int
    """Frames sent more than half a frame too late."""
    worst: float
    """Longest delay of a frame [s]."""


def open_board(port: str, baud_rate: int = BAUD_RATE, *, log: TextIO) -> Board:
    """Return the controller at a serial port, its servos assigned and free.

    Args:
        port: The device, such as /dev/ttyUSB0.
        baud_rate: What the board uses now.
        log: Takes what the library prints.

    Raises:
        HardwareError: the library is not installed, or nothing answers at the port.
    """
    try:
        from rcb4.rcb4interface import RCB4Interface
    except ImportError as error:
        raise HardwareError(
            f"playing needs the extra 'robot' ({error}): pip install 'drake-gait[robot]'"
        ) from None
    board = RCB4Interface()
    try:
        with redirect_stdout(log):
            answered = board.open(port=port, baudrate=baud_rate, target_baudrate=None)
    except (OSError, RuntimeError, ValueError) as error:  # pyserial's errors are OSErrors.
        board.close()
        raise HardwareError(f"cannot use the controller at {port}: {error}") from None
    if not answered:
        board.close()
        raise HardwareError(
            f"nothing answers at {port} with {baud_rate} baud; switch the robot on, or give "
            "another --port or --baud-rate"
        )
    found: Board = board
    return found


def play(
    motion: Motion,
    servos: ServoMap,
    board: Board,
    *,
    agreed: Callable[[], bool],
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    log: TextIO,
) -> Played | None:
    """Move slowly to the first frame, ask, play, and hold the last one.

    The servos hold where they are if anything ends the motion early, Ctrl-C included.

    Args:
        motion: Joint angles by frame.
        servos: Ids, signs and trims.
        board: The controller.
        agreed: Asked when the robot has its first posture; False ends it there.
        clock: Returns the time [s].
        sleep: Waits for some time [s].
        log: Takes what the library prints.

    Returns:
        How it went; None where the user did not agree.

    Raises:
        HardwareError: a servo of the motion does not answer, or the controller stops answering.
    """
    ids, positions = list(servos.ids), servos.positions(motion.angles)
    with redirect_stdout(log):
        try:
            there = {int(number) for number in board.search_servo_ids()}
            missing = [number for number in ids if number not in there]
            if missing:
                raise HardwareError(
                    f"servos {missing} do not answer, of {ids}; those that do are {sorted(there)}: "
                    "check their cables, or the ids in the robot's file"
                )
            board.hold(ids)
            _send(board, ids, positions[0], board.time_to_velocity(SLOWLY))
            sleep(SLOWLY)
            if not agreed():
                return None
            return _stream(positions, motion.frame_time, ids, board, clock, sleep)
        except OSError as error:
            raise HardwareError(f"the controller stopped answering: {error}") from None
        except BaseException:
            with suppress(Exception):  # What ended the motion matters more.
                board.hold(ids)
            raise


def _stream(
    positions: np.ndarray[Any, np.dtype[np.int64]],
    frame_time: float,
    ids: Sequence[int],
    board: Board,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> Played:
    begin, late, worst = clock(), 0, 0.0
    for frame, row in enumerate(positions):
        due = begin + frame * frame_time
        if (ahead := due - clock()) > 0.0:
            sleep(ahead)
        delay = clock() - due
        late, worst = late + (delay > 0.5 * frame_time), max(worst, delay)
        _send(board, ids, row, _AT_ONCE)
    return Played(frames=len(positions), late=late, worst=worst)


def _send(board: Board, ids: Sequence[int], row: Any, velocity: int) -> None:
    board.servo_angle_vector(ids, [int(one) for one in row], velocity)
