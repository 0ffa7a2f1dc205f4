"""One process at a time trains in a directory."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from edge_runtime.errors import ConfigError

LOCK = "edge-train.lock"
"""What counts is the system's lock on it, which ends with its process, however that ends."""


@contextlib.contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Keep a directory, which is made if need be, to this process.

    Raises:
        ConfigError: if it cannot be made or written to, or another process trains there.
    """
    path = directory / LOCK
    try:
        directory.mkdir(parents=True, exist_ok=True)
        file = path.open("ab")
    except OSError as error:
        raise ConfigError(
            f"--out {directory}: nothing can be written there ({error.strerror}); choose another"
        ) from error
    with file:
        if not _taken(file.fileno()):
            raise ConfigError(
                f"--out {directory}: another edge-train is at work there; wait for its end or choose another"
            )
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def wait_until_free(directory: Path) -> None:
    """Wait for the end of a process that trains in a directory, if one does."""
    with contextlib.suppress(FileNotFoundError), (directory / LOCK).open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_SH)


def _taken(descriptor: int) -> bool:
    """Lock a file, unless another has it or has just removed it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return os.fstat(descriptor).st_nlink > 0
