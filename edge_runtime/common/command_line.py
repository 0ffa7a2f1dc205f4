"""What all commands of this project share: a wrong flag is one line, a missing extra names its install."""

import argparse
import importlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NoReturn

from edge_runtime.errors import ConfigError

DISTRIBUTION: Final = "cfpg-edge"


class CommandParser(argparse.ArgumentParser):
    """A command's parser: description and epilog as they are written, flags in full, errors in one line.

    A flag or argument of ``type=Path`` must name something: an empty path would be the current folder.

    Raises:
        ConfigError: instead of exiting, where the command line is wrong.
    """

    def __init__(self, prog: str, description: str = "", epilog: str = "", *, add_help: bool = True) -> None:
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
            add_help=add_help,
        )
        self.register("type", Path, _path)

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong with the command line."""
        raise ConfigError(f"{message}; see {self.prog} --help")


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("is empty, it must name a file or folder")
    return Path(text)


def check_output(flag: str, path: Path, inputs: Iterable[Path | None]) -> None:
    """Find out before the work starts whether a file can be written and is none of those to be read.

    Raises:
        ConfigError: if it cannot, or is.
    """
    if path.resolve() in [each.resolve() for each in inputs if each is not None]:
        raise ConfigError(f"{flag} {path}: would overwrite a file that is read; name another one")
    try:
        path.open("ab").close()
    except OSError as error:
        raise ConfigError(f"{flag} {path}: cannot be written ({error.strerror})") from error


def need(module: str, extra: str) -> None:
    """Import an optional library.

    Raises:
        ConfigError: says how to install it.
    """
    try:
        importlib.import_module(module)
    except ImportError as error:
        raise ConfigError(f"{module} is not installed; run: pip install '{DISTRIBUTION}[{extra}]'") from error
