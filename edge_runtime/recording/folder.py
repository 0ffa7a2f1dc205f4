"""The folder where logs go: names, and the cap on how much of the disk they take."""

import contextlib
import fcntl
import os
import re
from pathlib import Path
from typing import Final

_NAME: Final = re.compile(r"\d{8}T\d{6}Z_robot\d+_[0-9a-f]{8}_\d{3,}\.mcap")


def default_folder() -> Path:
    """Return the user's own folder for logs, after the XDG base directory specification."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "cfpg-edge" / "logs"


def file_name(run: str, part: int) -> str:
    """Name of one file; names sort by age. ``run`` is as `run_name` makes it."""
    return f"{run}_{part:03d}.mcap"


def run_name(started_at: str, robot_id: int, identity: int) -> str:
    """Name of a run: when (``20260131T235959Z``), which robot, and 32 bits that no other run has."""
    return f"{started_at}_robot{robot_id}_{identity:08x}"


def make_room(folder: Path, most_bytes: int) -> None:
    """Delete the oldest finished logs, and nothing else, until at most so much is left.

    Raises:
        OSError: if the folder cannot be read.
    """
    names = sorted(entry.name for entry in folder.iterdir() if _NAME.fullmatch(entry.name))
    sizes = {folder / name: _size(folder / name) for name in names}
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
    with contextlib.suppress(OSError), path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        path.unlink()
        return True
    return False
