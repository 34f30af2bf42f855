"""An RCB-4 on a pseudo-terminal: memory, servos, and every packet that it was sent."""

import os
import pty
import threading
import time
import tty
from contextlib import suppress

SERVOS = (12, 13, 14, 15, 16, 17, 18, 19, 20, 21)
_ASSIGNED, _RECORDS, _RECORD = 0x0044, 0x0090, 20
_MOVE, _MANY, _VERSION, _ACK = 0x00, 0x10, 0xFD, 0xFE
HELD, FREE = 32767, 32768


class Board:
    """Answers as the controller does; `moves` has what servos were told, and when."""

    def __init__(self, servos=SERVOS, silent_after=None):
        self.servos, self.silent_after = servos, silent_after
        self.memory = bytearray(0x0490)
        self.memory[0:2] = (0x8021).to_bytes(2, "little")
        for number in range(35):
            self._write(_RECORDS + _RECORD * number + 6, FREE)
        self.moves, self.wrong = [], []
        self._master, self._slave = pty.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self):
        for descriptor in (self._slave, self._master):
            with suppress(OSError):
                os.close(descriptor)
        self._thread.join(timeout=5.0)

    def _write(self, address, value):
        self.memory[address : address + 2] = int(value).to_bytes(2, "little")

    def _serve(self):
        waiting = b""
        with suppress(OSError):
            while chunk := os.read(self._master, 1024):
                waiting += chunk
                while waiting and len(waiting) >= waiting[0] > 0:
                    packet, waiting = waiting[: waiting[0]], waiting[waiting[0] :]
                    answer = self._answer(packet)
                    if answer is not None:
                        body = bytes([len(answer) + 2]) + answer
                        os.write(self._master, body + bytes([sum(body) & 0xFF]))

    def _answer(self, packet):
        if sum(packet[:-1]) & 0xFF != packet[-1]:
            self.wrong.append(packet)
        command, body = packet[1], packet[2:-1]
        if command == _VERSION:
            return b"\xfdCB-4 V1.0      090715          \xc7"[0:]
        if command == _ACK:
            return bytes([_ACK, 0x06])
        if command == _MOVE and body[0] == 0x20:
            address, size = int.from_bytes(body[4:6], "little"), body[6]
            return bytes([_MOVE]) + bytes(self.memory[address : address + size])
        if command == _MOVE and body[0] == 0x02:
            address = int.from_bytes(body[1:3], "little")
            self.memory[address : address + len(body) - 4] = body[4:]
            self._servos_answer()
            return bytes([_MOVE, 0x06])
        if command == _MANY:
            return self._move(body)
        self.wrong.append(packet)
        return None

    def _servos_answer(self):
        for number in self.servos:
            record = _RECORDS + _RECORD * number
            place = _ASSIGNED + 2 * number
            if int.from_bytes(self.memory[place : place + 2], "little") == record:
                self._write(record + 4, 7500)

    def _move(self, body):
        if self.silent_after is not None and len(self.moves) >= self.silent_after:
            return None
        bits = int.from_bytes(body[:5], "little")
        ids = [number for number in range(40) if bits >> number & 1]
        velocity, places = body[5], body[6:]
        values = [
            int.from_bytes(places[2 * k : 2 * k + 2], "little") for k in range(len(places) // 2)
        ]
        assert len(ids) == len(values)
        self.moves.append((time.monotonic(), velocity, dict(zip(ids, values, strict=True))))
        for number, value in zip(ids, values, strict=True):
            if value != HELD:
                self._write(_RECORDS + _RECORD * number + 6, value)
            else:
                self._write(_RECORDS + _RECORD * number + 6, 7500)
        return bytes([_MANY, 0x06])
