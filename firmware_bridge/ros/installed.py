"""The one place where ROS's own Python packages are loaded, and only from the folders that the user names."""

import importlib
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from edge_runtime.common.printable import first_line
from edge_runtime.errors import BridgeError


def load(names: Sequence[str], folders: Sequence[str]) -> tuple[ModuleType, ...]:
    """Import ROS's modules from this interpreter's own packages, and after them from ``folders``.

    What the shell's PYTHONPATH names is left out: a workspace that somebody sourced must not decide which
    code commands a robot.

    Args:
        names: modules, the one that stands for the installation first.
        folders: appended to Python's path, so that nothing of ours is taken from there.

    Raises:
        BridgeError: if one is missing or cannot be loaded, with the remedy.
    """
    foreign = {folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if folder}
    sys.path[:] = [folder for folder in sys.path if folder not in foreign or folder in folders]
    sys.path.extend(folder for folder in folders if folder not in sys.path)
    try:
        return tuple(map(importlib.import_module, names))
    except Exception as error:
        raise BridgeError(_said(names[0], folders, error)) from error


def _said(name: str, folders: Sequence[str], error: Exception) -> str:
    places = (
        f"neither this Python's packages nor {', '.join(folders)}" if folders else "this Python's packages"
    )
    if isinstance(error, ModuleNotFoundError) and error.name == name:
        have = "have it" if folders else "do not have it"
        return f"{name} is not installed: {places} {have}; install ROS, or pass --ros-path DIR"
    return (
        f"{name} does not load ({first_line(error)}): source your ROS's setup.bash first, with Python "
        f"{sys.version_info.major}.{sys.version_info.minor}, and check --ros-path"
    )
