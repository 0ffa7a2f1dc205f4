"""Code of the user's own, imported on the user's word alone: this executes it."""

import contextlib
import importlib
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from edge_runtime.common.signals import is_interrupt
from edge_runtime.errors import ConfigError

T = TypeVar("T")


def own_name(kind: type) -> str:
    """What files and logs call a class of the user's own: ``module:Class``."""
    return f"{kind.__module__}:{kind.__qualname__}"


def own_class(name: str, folder: Path, source: str, base: type[T], method: str) -> type[T]:
    """Import a class of the user's own.

    Args:
        name: ``module:Class``.
        folder: where the module may lie, if it is not installed.
        source: what named it, for errors.
        base: what it must be a subclass of.
        method: as the class must define it, such as ``read(view)``.

    Raises:
        ConfigError: if it cannot be imported, or is none such.
    """
    module_name, _, class_name = name.partition(":")
    if not (module_name and class_name):
        raise ConfigError(f"{source}: {name!r} is not of the form module:Class")
    with own_faults(source, f"cannot import {name!r}"):
        kind = getattr(import_own(module_name, folder), class_name)
    if not (isinstance(kind, type) and issubclass(kind, base)):
        home = base.__module__.rpartition(".")[0]
        raise ConfigError(f"{source}: {name!r} is not a subclass of {home}.{base.__name__}")
    stated = method.partition("(")[0]
    if getattr(kind, stated) is getattr(base, stated):
        raise ConfigError(f"{source}: {name!r} must define {method}")
    return kind


@contextlib.contextmanager
def own_faults(source: str, what: str) -> Iterator[None]:
    """Turn whatever the user's own code raises into one line that says what became of it.

    Raises:
        ConfigError: says ``what``, and what was raised.
    """
    try:
        yield
    except ConfigError:
        raise
    except BaseException as error:  # it may fail in any way
        if is_interrupt(error):
            raise
        raise ConfigError(f"{source}: {what} ({cause_of(error)})") from error


def cause_of(error: BaseException) -> str:
    """What was raised, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


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
