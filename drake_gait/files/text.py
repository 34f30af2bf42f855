"""Text that people have written, in whatever encoding their editor saved it."""

import codecs
import io
from pathlib import Path

from drake_gait.errors import SettingsError

# The longer mark first: that of UTF-32 begins with that of UTF-16.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def read_text(path: Path, what: str) -> str:
    """Return a file's text, every end of a line as a line feed.

    UTF-8, and UTF-16 and UTF-32 in either order of bytes; a byte order mark is dropped.

    Args:
        path: The file.
        what: What it is, for the message: "the study".

    Raises:
        SettingsError: it cannot be read, or is in another encoding.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SettingsError(f"cannot read {what} {path}: {error.strerror}") from None
    except ValueError as error:  # A name with a NUL, or one that the locale cannot spell.
        raise SettingsError(f"cannot read {what} {str(path)!r}: {error}") from None
    try:
        return decode(data)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SettingsError(
            f"{what} {path}, line {line}: byte 0x{data[error.start]:02x} is no text in UTF-8 or "
            "UTF-16; save the file as UTF-8"
        ) from None


def decode(data: bytes) -> str:
    """Return the text that bytes stand for, every end of a line as a line feed.

    Raises:
        UnicodeDecodeError: they are in none of the encodings.
    """
    return io.TextIOWrapper(io.BytesIO(data), encoding=_encoding(data), newline=None).read()


def _encoding(data: bytes) -> str:
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return encoding
    # The first characters of our files are ASCII, whose other bytes are 0 (RFC 4627, section 3).
    zeros = tuple(byte == 0 for byte in data[:4])
    if zeros[1:] == (True, True, True):
        return "utf-32-le"
    if zeros[:3] == (True, True, True):
        return "utf-32-be"
    if zeros[:2] == (False, True):
        return "utf-16-le"
    return "utf-16-be" if zeros[:2] == (True, False) else "utf-8"
