"""Processes that end with the one that started them, however it ends: `kill -9`, a closed terminal.

The starter holds one end of a pipe. The system closes it when the starter is gone, and the others
read the end of the pipe. This needs nothing that only Linux has.
"""

import os
import runpy
import signal
import sys
import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import Self

GRACE = 10.0
"""Time that a process whose starter is gone may take to stop by itself [s]."""


class Lifeline:
    """A tie of other processes to this one: `with Lifeline() as lifeline`.

    A process that is started inside ends, as at SIGTERM, when the block is left or this process
    ends. It needs `lifeline.command(...)` as its command and `lifeline.descriptor` in `pass_fds`.
    """

    def __init__(self) -> None:
        self.descriptor, self._ours = os.pipe()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._ours)
        os.close(self.descriptor)

    def command(self, module: str, arguments: Sequence[str]) -> list[str]:
        """Return a command that does what `python -m module arguments` does."""
        code = f"from drake_gait.execution.parent import run; run({self.descriptor}, {module!r})"
        return [sys.executable, "-c", code, *arguments]


def run(descriptor: int, module: str) -> None:
    """Run a module as a command in a process that a Lifeline holds.

    Args:
        descriptor: The lifeline's.
        module: Name of the module; its arguments are those of this process.
    """
    threading.Thread(target=_end_with_parent, args=(descriptor,), daemon=True).start()
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def _end_with_parent(descriptor: int) -> None:
    """Send this process SIGTERM when the other end of its lifeline is closed; kill it later."""
    os.read(descriptor, 1)  # Nobody writes.
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os.kill(os.getpid(), signal.SIGKILL)
