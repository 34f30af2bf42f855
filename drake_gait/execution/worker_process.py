"""One expendable process that walks trials.

It shares nothing with its driver but a pipe of its own. So it may die at any instant, in C++ or by
`kill -9`. The driver reads the end of the pipe and knows which trial was being walked. A pool whose
processes share a queue and its locks does not survive that.
"""

import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from drake_gait.errors import WorkerError
from drake_gait.execution.machine import ONE_THREAD
from drake_gait.problem import Trial
from drake_gait.walk import Walk

WalkFunction = Callable[[Trial], Walk]

_MOST_MEMORY = 220e6
"""A process that holds more is replaced [bytes]: robots that it has built stay in its memory."""
_MOST_WALKS = 120
"""After so many walks it is replaced where the system does not tell what it holds."""

_START_LIMIT = 300.0  # To import Drake from the network disk of a busy cluster [s].
_STARTS = 5  # Some other cause than a stray kill when so many in a row fail.
_IDLE_LIMIT = 600.0  # After so long without a walk a process gives back its memory [s].
_LOOKING = 1.0  # How often to look whether a process hangs [s].
_GRACE = 10.0  # How long after its driver a process ends a walk that hangs by itself [s].
_AT_LAST = 20  # As many times longer it may take on the clock.


class WorkerDiedError(Exception):
    """Death of a process during a walk; the text says how."""


@dataclass(kw_only=True)
class Vigil:
    """Tells whether a process hangs, which is not that a busy machine lets it wait.

    Asked again and again, with what it has computed [s] and the time [s].
    """

    limit: float
    """What it may compute, and how long it may stand still [s]."""
    _first: float | None = None
    _last: float = 0.0
    _moved: float = 0.0

    def __call__(self, computed: float, now: float) -> bool:
        """Return whether it has computed, or stood still, for its limit since the first call."""
        if self._first is None:
            self._first, self._last, self._moved = computed, computed, now
        if computed > self._last:
            self._last, self._moved = computed, now
        return computed - self._first >= self.limit or now - self._moved >= self.limit


class WorkerProcess:
    """A process that is started when it is needed, and replaced when it died, hung or is old.

    Args:
        function: What it runs, pickled: importable by its name, or a functools.partial of such.
        time_limit: Computing time after which a walk is given up and the process replaced, or
            time on the clock in which it has computed nothing [s].
    """

    def __init__(self, function: bytes, *, time_limit: float) -> None:
        self._function = function
        self._time_limit = time_limit
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection[Any, Any] | None = None
        self._worn = False
        self._stopped = False
        self._lock = threading.Lock()

    def walk(self, trial: Trial) -> tuple[Walk, float]:
        """Walk a trial; returns what it did and how long it took [s].

        Raises:
            WorkerDiedError: the process died of it, or was killed.
            WorkerError: no process can be started.
            Exception: what the walk raised, with the worker's traceback as a note.
        """
        connection = self._ready()
        try:
            connection.send(trial)
            if not self._answers(connection):
                self.close()
                reason = f"gave no sign for {self._time_limit:g} s"
                return Walk.diverged(reason), self._time_limit
            answer: _Answer = connection.recv()
        except (EOFError, OSError):
            raise WorkerDiedError(f"its process died with {self.close()}") from None
        self._worn = answer.worn
        walk, seconds = answer.value()
        return walk, seconds

    def _answers(self, connection: "Connection[Any, Any]") -> bool:
        """Wait for an answer of the process; False if it hangs."""
        hangs = Vigil(limit=self._time_limit)
        hangs(self._computing_time(), time.monotonic())
        while not connection.poll(min(_LOOKING, self._time_limit)):
            if hangs(self._computing_time(), time.monotonic()):
                return False
        return True

    def _computing_time(self) -> float:
        """Return the computing time of the process [s]; 0 where it is not known."""
        try:
            stat = Path(f"/proc/{self._process.pid}/stat").read_text() if self._process else ""
        except OSError:
            stat = ""
        # After the name, in brackets: user and system time are the 12th and 13th (proc(5)).
        ticks = stat.rpartition(")")[2].split()[11:13]
        return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> None:
        """Kill the process, whatever it does, and start no other; for another thread to call."""
        with self._lock:
            self._stopped, process = True, self._process
        if process is not None:
            process.kill()

    def close(self) -> str:
        """Kill the process and wait for its end; returns how it ended, in words."""
        if self._process is None or self._connection is None:
            return "no exit code"
        # One that closed its pipe is about to end by itself, and its own exit code says more.
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(0.5 if self._connection.poll() else 0.0)
        self._process.kill()
        code = self._process.wait()
        self._connection.close()
        self._process = self._connection = None
        return f"exit code {code}"

    def _ready(self) -> "Connection[Any, Any]":
        """The pipe to a process that waits for a trial."""
        if self._worn:
            self.close()
        if self._process is not None and self._process.poll() is not None:
            self.close()  # It was killed, or ended by itself, while it had nothing to do.
        for _ in range(_STARTS):
            if self._connection is None:
                self._start()
            if self._connection is not None:
                return self._connection
        raise WorkerError(
            f"{_STARTS} worker processes in a row died before their first walk; "
            "what they wrote above says why"
        )

    def _start(self) -> None:
        """Start a process; it may be dead again when this returns."""
        ours, theirs = Pipe()
        code = (
            f"import sys; sys.path[:] = {sys.path!r}; "
            f"from drake_gait.execution.worker_process import serve; "
            f"serve({theirs.fileno()}, {self._time_limit + _GRACE!r})"
        )
        with self._lock, theirs:
            if self._stopped:
                raise WorkerDiedError("its process was stopped")
            with _signals_blocked():
                self._process = subprocess.Popen(
                    [sys.executable, "-c", code],
                    stdin=subprocess.DEVNULL,
                    env={**os.environ, **ONE_THREAD},
                    pass_fds=[theirs.fileno()],
                )
        self._connection, self._worn = ours, False
        try:
            ours.send_bytes(self._function)
            if not ours.poll(_START_LIMIT):
                raise WorkerError(f"a worker process is not ready after {_START_LIMIT:g} s")
            ready: _Answer = ours.recv()
        except (EOFError, OSError):
            self.close()
            return
        ready.value()


@dataclass(frozen=True, kw_only=True)
class _Answer:
    """Outcome of a function in a worker process."""

    result: Any = None
    """What it returned."""
    error: BaseException | None = None
    """What it raised."""
    worn: bool = False
    """Whether another process is to take its place."""

    def value(self) -> Any:
        """The result; raises the error if there was one."""
        if self.error is not None:
            raise self.error
        return self.result


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Keep Ctrl-C and SIGTERM from a process that is started inside: it inherits the mask.

    A terminal and a cluster send them to all processes; the driver alone decides what they mean.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(descriptor: int, longest: float) -> None:
    """Walk all that comes through the pipe until it closes, in a worker process.

    Args:
        descriptor: File descriptor of its end of the pipe.
        longest: Computing time after which a walk is ended by the system, driver or not [s].
    """
    connection: Connection[Any, Any] = Connection(descriptor)
    threading.Thread(target=_end_with_driver, args=(descriptor,), daemon=True).start()
    function: WalkFunction | None = None

    def load(pickled: bytes) -> None:
        nonlocal function
        function = pickle.loads(pickled)

    def timed(trial: Trial) -> tuple[Walk, float]:
        start = time.perf_counter()
        walk = function(trial)  # type: ignore[misc]
        return walk, time.perf_counter() - start

    with suppress(EOFError, ConnectionError):
        connection.send(_answer(load, connection.recv_bytes()))
        walks = 0
        while connection.poll(_IDLE_LIMIT):
            trial = connection.recv()
            # Their default action needs no Python, which may be what hangs.
            signal.setitimer(signal.ITIMER_PROF, longest)
            signal.setitimer(signal.ITIMER_REAL, _AT_LAST * longest)
            answer = _answer(timed, trial)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            walks += 1
            connection.send(replace(answer, worn=_is_worn(walks)))


def _is_worn(walks: int) -> bool:
    """Return whether this process, which has walked so often, has grown or may have."""
    try:
        return resident_memory() > _MOST_MEMORY
    except OSError:
        return walks >= _MOST_WALKS


def resident_memory() -> int:
    """Return the memory of this process [bytes]; OSError if the system does not tell (proc(5))."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def _answer(function: Callable[[Any], Any], argument: Any) -> _Answer:
    """Return a function's outcome, in a form that survives the way through a pipe."""
    try:
        return _Answer(result=function(argument))
    except BaseException as error:
        text = traceback.format_exc()
        error.add_note(f"In a worker process:\n{text}")
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return _Answer(error=RuntimeError(text))
        return _Answer(error=error)


def _end_with_driver(descriptor: int) -> None:
    """End this process when its driver is gone, even during a walk."""
    parent = os.getppid()
    poll = select.poll()
    poll.register(descriptor, 0)  # Reports the other end's closing, and nothing else.
    # Not every system reports it to who asks for nothing else; all give orphans another parent.
    while not poll.poll(1e3 * _LOOKING) and os.getppid() == parent:
        pass
    os._exit(1)
