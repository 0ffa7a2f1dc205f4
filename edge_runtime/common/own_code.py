"""Code of the user's own, imported on the user's word alone: this executes it."""

import importlib
import importlib.machinery
import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def import_own(name: str, folder: Path) -> ModuleType:
    """Import a module that is installed, or else lies in a folder.

    Nothing but this module is looked for in the folder: what lies beside it, of whatever name, takes nobody's
    place. A module that needs others of its own has them in its package, and imports them from there.

    Raises:
        ModuleNotFoundError: if there is none.
        BaseException: whatever the module raises while it is imported.
    """
    top = name.partition(".")[0]
    if not any(finder.find_spec(top, None) for finder in sys.meta_path):
        _load(top, folder)
    return importlib.import_module(name)


def _load(top: str, folder: Path) -> None:
    """Execute a module or package of a folder, unless that has been done."""
    spec = importlib.machinery.PathFinder.find_spec(top, [str(folder)])
    if spec is None or spec.loader is None or spec.origin is None:
        raise ModuleNotFoundError(f"No module named {top!r} is installed, or lies in {folder}", name=top)
    known = sys.modules.get(top)
    if known is not None and known.__spec__ is not None and known.__spec__.origin == spec.origin:
        return
    for stale in [other for other in sys.modules if other == top or other.startswith(f"{top}.")]:
        del sys.modules[stale]  # of another folder
    module = sys.modules[top] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[top]
        raise
