"""Files that are either the old version or the new one, whatever kills the writer."""

import os
from pathlib import Path


def replace_durably(path: Path, content: bytes) -> None:
    """Replace a file as a whole; on return the new version has reached the disk.

    Raises:
        OSError: if the system refuses; the old version is then still there. Who asks knows what it is for.
    """
    written = path.with_name(path.name + ".new")
    try:
        with written.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        written.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError:
        written.unlink(missing_ok=True)
        raise
