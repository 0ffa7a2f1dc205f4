"""Files that other files name."""

import os
from pathlib import Path

from edge_runtime.errors import ConfigError


def named_file(folder: Path, name: str) -> Path:
    """Return the file of a name, which is relative to a folder; ``~`` is the user's own.

    Raises:
        ConfigError: if this system does not know the user's folder.
    """
    try:
        return folder / Path(name).expanduser()
    except RuntimeError as error:  # no HOME, and no entry for the user
        raise ConfigError(f"{name}: this user has no home directory; name the file in full") from error


def state_folder() -> Path:
    """Return the folder for what programs keep of the user's, after the XDG base directory specification.

    Raises:
        ConfigError: if this system does not know where the user's files are.
    """
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    if not state.is_absolute():
        try:
            state = Path.home() / ".local" / "state"
        except RuntimeError as error:
            raise ConfigError("this user has no home directory") from error
    return state / "cfpg-edge"
