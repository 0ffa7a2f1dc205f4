"""Files that users name: regular ones up to a stated size, whatever their paths lead to.

A pipe holds up who opens it, a device has no end, some of the system's files never yield what they hold: all
are refused as a missing file is, by an OSError whose ``strerror`` says what is wrong.
"""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO, Final

BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
"""What some editors put in front of text; it is no part of it."""


def open_regular(path: Path, largest: int) -> BinaryIO:
    """Open a regular file of at most ``largest`` bytes for reading.

    Raises:
        OSError: if there is none, it is larger, or it cannot be opened.
    """
    try:
        file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC), "rb")
    except ValueError as error:  # a NUL, or half of a character
        raise OSError(errno.EINVAL, "no file can have this name") from error
    try:
        _check(file.fileno(), largest)
    except OSError:
        file.close()
        raise
    return file


def read_regular(path: Path, largest: int) -> bytes:
    """Read a regular file of at most ``largest`` bytes, no further than it reached when it was opened.

    Raises:
        OSError: if there is none, it is larger, or it cannot be read.
    """
    with open_regular(path, largest) as file:
        return file.read(os.fstat(file.fileno()).st_size)


def _check(descriptor: int, largest: int) -> None:
    status = os.fstat(descriptor)
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    # The system's own files have no size, whatever they yield; some never do.
    if not stat.S_ISREG(status.st_mode) or (status.st_size == 0 and os.read(descriptor, 1)):
        raise OSError(errno.EINVAL, "not a regular file")
    if status.st_size > largest:
        raise OSError(errno.EFBIG, f"{status.st_size} bytes, at most {largest} are read")
