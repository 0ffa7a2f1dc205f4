"""The files of a training run: either the old version or the new one, whatever kills the writer."""

from pathlib import Path

from edge_runtime.common.durable_file import replace_durably
from edge_runtime.errors import ConfigError


def write_run_file(path: Path, content: bytes) -> None:
    """Replace a file of a run.

    Raises:
        ConfigError: if it cannot be written; the old version is then still there.
    """
    try:
        replace_durably(path, content)
    except OSError as error:
        raise ConfigError(
            f"cannot write {path}: {error.strerror}; what was written before is intact, "
            "make room and continue with --resume"
        ) from error
