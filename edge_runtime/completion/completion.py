"""Shell completion: ``python -m edge_runtime.completion bash``.

The scripts are made by shtab from the commands' own parsers, for the commands that this environment can
run. They hold everything they need: no key press starts Python, as completion that asks the program itself
would, and the robot needs no further library.
"""

import importlib
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from typing import Final

from edge_runtime.common.command_line import CommandParser, command, need
from edge_runtime.common.commands import COMMANDS
from edge_runtime.run.bridges import BRIDGES
from edge_runtime.run.flags import make_parser as make_run_parser

SHELLS: Final = ("bash", "zsh")
BRIDGED: Final = ("edge-run", "edge-doctor")
"""Their flags depend on the bridge."""
EPILOG: Final = """\
exit codes:
  0  the script is printed
  2  shtab is not installed, or the shell is unknown
  130  interrupted

examples:
  python -m edge_runtime.completion bash > ~/.edge-completion    then in ~/.bashrc: source ~/.edge-completion
  eval "$(python -m edge_runtime.completion zsh)"                in ~/.zshrc, after compinit"""


def parsers() -> Iterator[ArgumentParser]:
    """Yield the parser of every command whose libraries are installed."""
    for name, module in COMMANDS.items():
        if name in BRIDGED:
            yield _bridge_parser(name)
            continue
        try:
            yield importlib.import_module(module).make_parser()
        except ImportError:
            continue  # a robot has no PyTorch, and no command that needs it


def _bridge_parser(name: str) -> ArgumentParser:
    """All flags of all bridges."""
    parser = make_run_parser()
    parser.prog = name
    parser.conflict_handler = "resolve"
    for modules in BRIDGES.values():
        importlib.import_module(modules.bridge).add_arguments(parser)
    return parser


def script(shell: str) -> str:
    """Return the completion of all commands for a shell.

    Raises:
        ConfigError: if shtab is not installed.
    """
    need("shtab", "completion")
    complete = importlib.import_module("shtab").complete
    return "\n".join(complete(parser, shell) for parser in parsers())


@command("completion")
def main(arguments: Sequence[str] | None = None) -> int:
    """Print a script; returns the exit code."""
    parser = CommandParser("python -m edge_runtime.completion", "Print completion for a shell.", EPILOG)
    parser.add_argument("shell", choices=SHELLS)
    print(script(parser.parse_args(arguments).shell))
    return 0
