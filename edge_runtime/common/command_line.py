"""What all commands of this project share: how they are read, and how they end.

A wrong flag, a missing extra and every other error of the family is one line on standard error, with exit
code 2, or 1 where what was asked for had begun. Whoever stops reading, or interrupts, gets no traceback.
"""

import argparse
import contextlib
import functools
import importlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Final, NoReturn

import msgspec

from edge_runtime import __version__
from edge_runtime.common.printable import printable
from edge_runtime.common.streams import lost, open_streams
from edge_runtime.errors import ConfigError, EdgeError, FailedError

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

DISTRIBUTION: Final = "cfpg-edge"
INTERRUPTED: Final = 130
"""Exit code after Ctrl-C, as shells have it."""

Main = Callable[[Sequence[str] | None], int]


def command(name: str) -> Callable[[Main], Callable[..., int]]:
    """Make a command of a function that is given its arguments and returns the exit code.

    Args:
        name: in front of every line that says what is wrong.
    """

    def decorate(main: Main) -> Callable[..., int]:
        @functools.wraps(main)
        def framed(arguments: Sequence[str] | None = None) -> int:
            open_streams()
            return _flushed(name, _outcome(name, main, arguments))

        return framed

    return decorate


def complain(name: str, text: str) -> None:
    """Say in one line what is wrong, if anybody reads it."""
    with contextlib.suppress(OSError):
        print(f"{name}: {printable(text)}", file=sys.stderr)


@contextlib.contextmanager
def begun() -> Iterator[None]:
    """Let errors of the family count as failures of what was asked for, which has begun: exit code 1."""
    try:
        yield
    except EdgeError as error:
        raise FailedError(str(error)) from error


def _outcome(name: str, main: Main, arguments: Sequence[str] | None) -> int:
    """Run a command to its exit code."""
    try:
        _check_encoding(sys.argv[1:] if arguments is None else arguments)
        return main(arguments)
    except SystemExit as left:  # argparse, after --help
        return left.code if isinstance(left.code, int) else int(left.code is not None)
    except EdgeError as error:
        complain(name, str(error))
        return 1 if isinstance(error, FailedError) else 2
    except KeyboardInterrupt as interrupt:  # with a text where there is more to say
        complain(name, str(interrupt) or "interrupted")
        return INTERRUPTED
    except OSError as error:
        return _refused(name, error, 1)
    except UnicodeEncodeError as error:  # a folder's name, from the system: records and children repeat it
        complain(name, f"{os.fsencode(error.object)!r} is not UTF-8; rename the folder")
        return 2


def _flushed(name: str, code: int) -> int:
    """Write out what is held back; the interpreter would fail to, after the exit code is decided."""
    error = lost(sys.stdout)
    lost(sys.stderr)
    return code if error is None else _refused(name, error, code)


def _refused(name: str, error: OSError, code: int) -> int:
    """Say what the system refused, as a rule to take text; who reads only the first lines of a pipe knows."""
    if not isinstance(error, BrokenPipeError):
        complain(name, f"{error.filename or 'input or output'}: {error.strerror or error}")
        code = code or 1
    return code


def _check_encoding(arguments: Sequence[str]) -> None:
    """Refuse names that no record, log or child process could repeat."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise ConfigError(f"{os.fsencode(argument)!r} is not UTF-8; rename the file") from error


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
        if add_help:
            self.add_argument("--version", action="version", version=f"%(prog)s {__version__}")

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong with the command line."""
        raise ConfigError(f"{message}; see {self.prog} --help")

    def print_help(self, file: "SupportsWrite[str] | None" = None) -> None:
        """Print the help; argparse's own hides that it could not."""
        (file or sys.stdout).write(self.format_help())


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("is empty, it must name a file or folder")
    return Path(text)


def check_output(flag: str, path: Path, inputs: Iterable[Path | None]) -> None:
    """Find out before the work starts whether a file can be written and is none of those to be read.

    Raises:
        ConfigError: if it cannot, or is.
    """
    # pathlib's resolve raises for links that lead to one another.
    if os.path.realpath(path) in [os.path.realpath(each) for each in inputs if each is not None]:
        raise ConfigError(f"{flag} {path}: would overwrite a file that is read; name another one")
    check_writable(path, f"{flag} {path}")


def check_writable(path: Path, name: str = "") -> None:
    """Find out before the work starts whether a file can be written, without waiting for a pipe's reader.

    Raises:
        ConfigError: if it cannot, by the name that is given, or its path.
    """
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NONBLOCK | os.O_CLOEXEC, 0o666))
    except OSError as error:
        raise ConfigError(f"{name or path}: cannot be written ({error.strerror})") from error


def write_report(flag: str, path: Path, record: msgspec.Struct) -> None:
    """Write a record as JSON.

    Raises:
        ConfigError: if the system refuses it.
    """
    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(record)) + b"\n")
    except OSError as error:
        raise ConfigError(f"{flag} {path}: the report could not be written ({error.strerror})") from error


def need(module: str, extra: str) -> ModuleType:
    """Import what is there only with an extra of this distribution.

    Raises:
        ConfigError: says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = f"{error.name or module} is not installed; run: pip install '{DISTRIBUTION}[{extra}]'"
        raise ConfigError(missing) from error
