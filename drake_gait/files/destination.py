"""Files are written as a whole or not at all, and to what a path stands for.

A path may name a file or a link to one, a device, a pipe or an open descriptor (`/dev/stdout`,
`>(command)` in a shell). As `-` it is standard output. A file is written beside itself and renamed:
who reads it finds the old one or the new one, also after the disk was full. It keeps its mode, and
a link stays a link. Devices, pipes and descriptors are written directly.
"""

import errno
import io
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from drake_gait.errors import GaitError

STANDARD_OUTPUT = Path("-")
"""The path that means standard output where a command writes a single file."""

_DESCRIPTORS = re.compile(r"/dev/fd|/proc/(self|thread-self|\d+(/task/\d+)?)/fd")
_MOST_LINKS = 40  # As Linux follows them.

# A rename can be impossible where writing is not: a folder that is read-only or whose files are
# others', a file that is mounted by itself.
_NO_RENAME = (errno.EACCES, errno.EPERM, errno.EROFS, errno.EBUSY, errno.EXDEV)


def write(path: Path, content: str | bytes, *, what: str = "") -> None:
    """Write a file as a whole, or to the device, pipe or descriptor that its path stands for.

    Args:
        path: The file; `-` is standard output.
        content: What it is to hold; text becomes UTF-8, on standard output the stream's encoding.
            What cannot be encoded is replaced.
        what: What it is, for the message: "the report ".

    Raises:
        GaitError: it cannot be written; a file that was there is as it was.
        BrokenPipeError: who reads the pipe has closed it.
    """
    with _named(path, what):
        if path == STANDARD_OUTPUT:
            _to_stream(sys.stdout, content)
            return
        data = content.encode("utf-8", "replace") if isinstance(content, str) else content
        place = _resolved(path)
        if isinstance(place, int):
            _to_descriptor(os.dup(place), data)
            return
        there = _status(place)
        if there is not None and not (stat.S_ISREG(there.st_mode) and _has_name(place)):
            _to_descriptor(os.open(place, os.O_WRONLY | os.O_NOCTTY), data)
        elif _is_standard_output(there):
            _to_descriptor(os.dup(1), data)
        else:
            _to_file(place, there, data)


def check(path: Path, *, what: str = "") -> None:
    """Refuse a path that `write` could not write, before any work is done for it.

    Raises:
        GaitError: there is no such folder, it cannot be written, or its name is too long.
    """
    with _named(path, what):
        if path == STANDARD_OUTPUT:
            return
        place = _resolved(path)
        if isinstance(place, int):
            os.fstat(place)
            return
        there = _status(place)
        if there is not None and stat.S_ISDIR(there.st_mode):
            raise _error(errno.EISDIR)
        if there is not None:
            if not os.access(place, os.W_OK):
                raise _error(errno.EACCES)
            return
        folder = place.parent
        folder.stat()
        if not os.access(folder, os.W_OK | os.X_OK):
            raise _error(errno.EACCES)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, where they are missing.

    Raises:
        GaitError: it cannot be made.
    """
    with _named(path, "the folder "):
        path.mkdir(parents=True, exist_ok=True)


def messages(path: Path) -> TextIO:
    """Return the stream for what a command that writes to `path` says: not its own product."""
    try:
        place = path if path == STANDARD_OUTPUT else _resolved(path)
        into = place == STANDARD_OUTPUT or (
            place == 1 if isinstance(place, int) else _is_standard_output(_status(place))
        )
    except OSError:
        into = False
    return sys.stderr if into else sys.stdout


@contextmanager
def _named(path: Path, what: str) -> Iterator[None]:
    """Turns what the system says into one line with the path."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise GaitError(f"cannot write {what}{path}: {_reason(path, error)}") from None
    except ValueError as error:  # A name with a NUL, or one that the locale cannot spell.
        raise GaitError(f"cannot write {what}{str(path)!r}: {error}") from None


def _reason(path: Path, error: OSError) -> str:
    said = error.strerror or str(error)
    if error.errno == errno.ENOENT:
        return f"{said}; there is no folder {path.parent}"
    if error.errno == errno.ENOTDIR:
        return f"{said}; {path.parent} is no folder"
    if error.errno == errno.EISDIR:
        return f"{said}; name a file"
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG) and path.is_file():
        return f"{said}; what was there before is unchanged; free space, and try again"
    return said


def _error(number: int) -> OSError:
    return OSError(number, os.strerror(number))


def _status(path: Path) -> os.stat_result | None:
    """Return the status of a path; None where nothing is."""
    try:
        return path.stat()
    except FileNotFoundError:
        return None


def _resolved(path: Path) -> Path | int:
    """The end of a chain of links, or the open descriptor of this process that it stands for.

    A descriptor's entry looks like a link to a file, and is none: it has a position, and may stand
    for something without a name.
    """
    for _ in range(_MOST_LINKS):
        folder = os.path.realpath(path.parent)
        place = Path(folder, path.name)
        if not _has_name(place):
            own = folder in ("/dev/fd", os.path.realpath("/proc/self/fd"))
            return int(path.name) if own else place
        if not place.is_symlink():
            return place
        path = Path(folder, place.readlink())
    raise _error(errno.ELOOP)


def _has_name(path: Path) -> bool:
    """Return true for the name of a file, false for a descriptor's entry."""
    return not (path.name.isdigit() and _DESCRIPTORS.fullmatch(str(path.parent)))


def _is_standard_output(there: os.stat_result | None) -> bool:
    try:
        return there is not None and os.path.samestat(there, os.fstat(1))
    except OSError:
        return False


def _to_stream(stream: TextIO | None, content: str | bytes) -> None:
    if stream is None:
        raise _error(errno.EBADF)
    if isinstance(content, str):
        stream.write(content)
        stream.flush()
        return
    try:
        descriptor = os.dup(stream.fileno())
    except io.UnsupportedOperation:  # It is not the system's, as in a notebook.
        stream.buffer.write(content)
        stream.buffer.flush()
    else:
        _to_descriptor(descriptor, content)


def _to_descriptor(descriptor: int, data: bytes) -> None:
    """Write to an open descriptor, and close it."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()  # What was said before comes before.
        _all(descriptor, data)
    finally:
        os.close(descriptor)


def _all(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def _to_file(path: Path, there: os.stat_result | None, data: bytes) -> None:
    """Replace a file by one with this content, or write it in place where it has other names."""
    if there is not None and not os.access(path, os.W_OK):
        raise _error(errno.EACCES)  # A rename would not ask.
    if there is not None and there.st_nlink > 1:
        _in_place(path, data)
        return
    try:
        _by_rename(path, there, data)
    except OSError as error:
        if there is None or error.errno not in _NO_RENAME:
            raise
        _in_place(path, data)


def _by_rename(path: Path, there: os.stat_result | None, data: bytes) -> None:
    beginning = path.with_name(f".{secrets.token_hex(6)}.new")
    # The mode is what the umask, or the folder's default, leaves of it.
    descriptor = os.open(beginning, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        try:
            if there is not None:
                _resemble(path, there, beginning)
            _all(descriptor, data)
            _sync(descriptor)
        finally:
            os.close(descriptor)
        beginning.replace(path)
    except BaseException:
        beginning.unlink(missing_ok=True)
        raise


def _sync(descriptor: int) -> None:
    """Wait until it is on the disk, which a network's may refuse only now."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
            raise


def _resemble(path: Path, there: os.stat_result, other: Path) -> None:
    """Give another file the mode, the access list and, where permitted, the owner of this one."""
    with suppress(PermissionError):
        if (there.st_uid, there.st_gid) != (os.geteuid(), os.getegid()):
            os.chown(other, there.st_uid, there.st_gid)
    with suppress(PermissionError):
        shutil.copystat(path, other)


def _in_place(path: Path, data: bytes) -> None:
    """Write over a file: first what makes it longer, which is all that a full disk can refuse."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
    try:
        size = os.fstat(descriptor).st_size
        try:
            os.lseek(descriptor, size, os.SEEK_SET)
            _all(descriptor, data[size:])
        except OSError:
            os.ftruncate(descriptor, size)
            raise
        os.lseek(descriptor, 0, os.SEEK_SET)
        _all(descriptor, data[:size])
        os.ftruncate(descriptor, len(data))
    finally:
        os.close(descriptor)
