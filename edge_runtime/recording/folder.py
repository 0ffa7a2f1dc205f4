"""The folder where logs go: names, and the cap on how much of the disk they take."""

import contextlib
import fcntl
import re
import sys
from pathlib import Path
from typing import Final

from edge_runtime.common.paths import state_folder
from edge_runtime.common.regular_file import open_regular
from edge_runtime.errors import ConfigError

_NAME: Final = re.compile(r"((?:(\d{6,})_)?\d{8}T\d{6}Z_robot\d+_[0-9a-f]{8})_(\d{3,})\.mcap")
"""Logs of earlier versions have no number: they are older than all that have one."""


def default_folder() -> Path:
    """Return the user's own folder for logs.

    Raises:
        ConfigError: if this system does not know where the user's files are.
    """
    try:
        return state_folder() / "logs"
    except ConfigError as error:
        raise ConfigError(f"{error}; say with --log-dir where logs go, or --no-log") from error


def file_name(run: str, part: int) -> str:
    """Name of one file; ``run`` is as `run_name` makes it."""
    return f"{run}_{part:03d}.mcap"


def run_name(number: int, started_at: str, robot_id: int, identity: int) -> str:
    """Name of a run.

    Args:
        number: counts the runs in a folder, see `next_number`.
        started_at: when, such as ``20260131T235959Z``: by a clock that may be wrong.
        robot_id: of its robot.
        identity: 32 bits that no other run has.
    """
    return f"{number:06d}_{started_at}_robot{robot_id}_{identity:08x}"


def next_number(folder: Path) -> int:
    """Return a number greater than that of every run in a folder; 1 where there is no folder yet."""
    try:
        ages = [_age(entry.name) for entry in folder.iterdir()]
    except OSError:  # whoever is to write there says why that fails
        ages = []
    return 1 + max((number for number, *_ in filter(None, ages)), default=0)


def _age(name: str) -> tuple[int, str, int] | None:
    """What orders logs, the oldest first: the run's number, its name, the file's within it; None for others.

    No clock does: a machine that keeps no time while it is off begins in 1970.
    """
    found = _NAME.fullmatch(name)
    return (int(found[2] or 0), found[1], int(found[3])) if found else None


def make_room(folder: Path, most_bytes: int) -> None:
    """Delete the oldest finished logs, and nothing else, until at most so much is left.

    Raises:
        OSError: if the folder cannot be read.
    """
    aged = sorted((age, entry) for entry in folder.iterdir() if (age := _age(entry.name)))
    sizes = {path: _size(path) for _, path in aged}
    total = sum(sizes.values())
    for path, size in sizes.items():
        if total <= most_bytes:
            return
        if _delete_unless_open(path):
            total -= size


def _size(path: Path) -> int:
    """Size of a file; 0 if another robot's process on this machine has just deleted it."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _delete_unless_open(path: Path) -> bool:
    with contextlib.suppress(OSError), open_regular(path, sys.maxsize) as file:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        path.unlink()
        return True
    return False
