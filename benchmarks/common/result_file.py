"""Results as JSON: checked as they are read, replaced at once as they are written."""

from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from edge_runtime.common.durable_file import replace_durably
from edge_runtime.errors import ConfigError

Result = TypeVar("Result")
Row = TypeVar("Row")


def read_result(path: Path, kind: type[Result], default: Result | None = None) -> Result:
    """Return what `write_result` wrote; the default, if there is one, where nothing was written yet.

    Raises:
        ConfigError: if the file cannot be read or holds something else.
    """
    if default is not None and not path.exists():
        return default
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(f"{path}: holds no results of this benchmark ({error}): move it away") from error


def write_result(path: Path, result: Any) -> None:  # noqa: ANN401 - whatever msgspec encodes
    """Replace the file, so that an interruption leaves the old results or the new ones; a row is a line.

    Raises:
        ConfigError: if it cannot be written.
    """
    if isinstance(result, list):
        content = b"[\n" + b",\n".join(map(msgspec.json.encode, result)) + b"\n]"
    else:
        content = msgspec.json.format(msgspec.json.encode(result), indent=1)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_durably(path, content + b"\n")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror}), and is as it was") from error


def replaced(rows: Iterable[Row], newer: Iterable[Row], measured: Callable[[Row], Hashable]) -> list[Row]:
    """Return rows with the newer ones in the places of what they measured again; the others come last."""
    again = {measured(row): row for row in newer}
    kept = [again.pop(measured(row), row) for row in rows]
    return [*kept, *again.values()]
