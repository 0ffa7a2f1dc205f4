"""What all commands of this project share: a wrong flag is one line, a missing extra names its install."""

import argparse
import importlib
from typing import Final, NoReturn

from edge_runtime.errors import ConfigError

DISTRIBUTION: Final = "cfpg-edge"


class CommandParser(argparse.ArgumentParser):
    """A command's parser: description and epilog as they are written, flags in full, errors in one line.

    Raises:
        ConfigError: instead of exiting, where the command line is wrong.
    """

    def __init__(self, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong with the command line."""
        raise ConfigError(f"{message}; see {self.prog} --help")


def need(module: str, extra: str) -> None:
    """Import an optional library.

    Raises:
        ConfigError: says how to install it.
    """
    try:
        importlib.import_module(module)
    except ImportError as error:
        raise ConfigError(f"{module} is not installed; run: pip install '{DISTRIBUTION}[{extra}]'") from error
