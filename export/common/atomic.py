"""Files that are either the old version or the new one, whatever kills the writer."""

import os
from pathlib import Path

from edge_runtime.errors import ConfigError


def write_atomic(path: Path, content: bytes) -> None:
    """Write a temporary file beside ``path``, flush it to the disk, and move it into place.

    Raises:
        ConfigError: if the file cannot be written; the old version is then still there.
    """
    temporary = path.with_name(path.name + ".tmp")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_directory(path.parent)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise ConfigError(
            f"cannot write {path}: {error.strerror}; what was written before is intact, "
            "make room and continue with --resume"
        ) from error


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
