"""The frame of every command: its streams, its signals, and the one line and status of its end.

A command is done (0), or was stopped by its user (130, 143). Or it says in one line of standard
error which input is at fault (2).
"""

import errno
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO, cast

from drake_gait.cli._signals import exit_status, signals_ignored, sigterm_interrupts
from drake_gait.errors import GaitError

FAILED = 2
"""Exit status where an input is at fault."""


def conduct(work: Callable[[], None], *, stopped: str = "stopped", searches: bool = False) -> int:
    """Run a command's work; returns its exit status.

    Args:
        work: All of it.
        stopped: What to say when its user stops it.
        searches: Whether its product are files: then it goes on where nobody reads its output, or
            nobody can, and says so. Else such an output is an error, unless its reader has closed
            a pipe because it has seen enough.
    """
    with _lasting_streams(searches) as output:
        try:
            with sigterm_interrupts():
                status = _status_of(work)
                output.flush()
        except KeyboardInterrupt as interruption:
            with signals_ignored():
                # A search says it where its progress is; a terminal has shown ^C in this line.
                heard = sys.stdout if searches and not output.lost else sys.stderr
                print(f"\n{stopped}" if heard.isatty() else stopped, file=heard, flush=True)
            return exit_status(interruption)
        if status == 0 and output.lost and not searches and not output.closed_by_reader:
            _say(f"error: cannot write to standard output: {output.lost}")
            return FAILED
        return status


def require_studies(folders: Iterable[Path]) -> None:
    """Refuse folders that hold no study, before the imports that take seconds.

    Raises:
        StudyError: names the folder.
    """
    from drake_gait.study.store import Study

    for folder in folders:
        with Study.open(folder / "study.db"):
            pass


def _status_of(work: Callable[[], None]) -> int:
    """Run a command's work, and say in one line which input is at fault."""
    try:
        work()
    except GaitError as error:
        _say(f"error: {_one_line(error)}")
    except BrokenPipeError:
        return 0  # Who reads the product has seen enough.
    except UnicodeEncodeError as error:
        _say(
            f"error: {error.object!r} has characters that the locale's {error.encoding} has not; "
            "set LC_ALL=C.UTF-8 or PYTHONUTF8=1"
        )
    except MemoryError:
        _say("error: out of memory; give fewer --workers")
    except OSError as error:
        named = f"cannot use {error.filename}: " if error.filename else ""
        _say(f"error: {named}{error.strerror or _one_line(error)}")
    else:
        return 0
    return FAILED


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split("\n"))


def _say(text: str) -> None:
    """Say it on standard error, if there is one."""
    with suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


class LastingStream:
    """A stream of text whose end, or whose encoding, breaks off nothing.

    What it cannot encode is replaced; what nobody can read any more is dropped.

    Args:
        stream: Where it writes.
        warning: What to say when that is lost; nothing if empty.
    """

    def __init__(self, stream: TextIO | None, warning: str = "") -> None:
        self._stream, self._warning = stream, warning
        self.lost: str | None = None
        """Why it can be written no more."""
        self.closed_by_reader = False
        """Whether that is because its reader has closed it."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write text."""
        self._try(lambda stream: stream.write(self._encodable(text)))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Pass on what was written."""
        if self._stream is not None:
            self._try(lambda stream: stream.flush())

    def isatty(self) -> bool:
        """Return whether a person reads it."""
        return self._stream is not None and self._stream.isatty()

    def _encodable(self, text: str) -> str:
        encoding = getattr(self._stream, "encoding", None) or "utf-8"
        return text.encode(encoding, "replace").decode(encoding)

    def _try(self, action: Callable[[TextIO], object]) -> None:
        if self.lost is not None:
            return
        try:
            if self._stream is None:
                raise OSError(errno.EBADF, "it is closed")
            action(self._stream)
        except OSError as error:
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        self.lost = error.strerror or str(error)
        self.closed_by_reader = error.errno in (errno.EPIPE, errno.ECONNRESET)
        if self._stream is not None:
            with suppress(OSError, ValueError):
                # Python would complain again when it closes its own end.
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
        if self._warning:
            _say(f"warning: cannot write to standard output ({self.lost}); {self._warning}")


@contextmanager
def _lasting_streams(searches: bool) -> Iterator[LastingStream]:
    before = sys.stdout, sys.stderr
    output = LastingStream(before[0], "the work goes on" if searches else "")
    errors = LastingStream(before[1])
    sys.stdout, sys.stderr = cast(TextIO, output), cast(TextIO, errors)
    try:
        yield output
    finally:
        output.flush()
        errors.flush()
        sys.stdout, sys.stderr = before
