"""Shell completion: ``python -m edge_runtime.completion bash``.

The scripts are made by shtab from the commands' own parsers, for the commands that this environment can
run. They hold everything they need: no key press starts Python, as completion that asks the program itself
would, and the robot needs no further library.
"""

import importlib
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from typing import Final

from edge_runtime.common.command_line import CommandParser, need
from edge_runtime.errors import EdgeError
from edge_runtime.run.edge_run import BRIDGES
from edge_runtime.run.flags import make_parser as make_run_parser

SHELLS: Final = ("bash", "zsh")
MODULES: Final = {
    "edge-replay": "edge_runtime.tools.replay.edge_replay",
    "edge-sil": "firmware_bridge.sil.edge_sil",
    "edge-watch": "edge_runtime.tools.watch.edge_watch",
    "edge-report": "edge_runtime.tools.report.edge_report",
    "edge-ctl": "edge_runtime.tools.ctl.edge_ctl",
    "edge-pose": "edge_runtime.tools.pose.edge_pose",
    "edge-train": "export.edge_train",
    "edge-export": "export.edge_export",
}
"""Each offers ``make_parser``; edge-run's and edge-doctor's flags depend on the bridge."""
EPILOG: Final = """\
exit codes:
  0  the script is printed
  2  shtab is not installed, or the shell is unknown

examples:
  python -m edge_runtime.completion bash > ~/.edge-completion    then in ~/.bashrc: source ~/.edge-completion
  eval "$(python -m edge_runtime.completion zsh)"                in ~/.zshrc, after compinit"""


def parsers() -> Iterator[ArgumentParser]:
    """Yield the parser of every command whose libraries are installed."""
    for name in ("edge-run", "edge-doctor"):
        yield _bridge_parser(name)
    for module in MODULES.values():
        try:
            yield importlib.import_module(module).make_parser()
        except ImportError:
            continue  # a robot has no PyTorch, and no command that needs it


def _bridge_parser(name: str) -> ArgumentParser:
    """All flags of all bridges."""
    parser = make_run_parser(tuple(BRIDGES))
    parser.prog = name
    parser.conflict_handler = "resolve"
    for module in BRIDGES.values():
        importlib.import_module(module).add_arguments(parser)
    return parser


def script(shell: str) -> str:
    """Return the completion of all commands for a shell.

    Raises:
        ConfigError: if shtab is not installed.
    """
    need("shtab", "completion")
    complete = importlib.import_module("shtab").complete
    return "\n".join(complete(parser, shell) for parser in parsers())


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a script; returns the exit code."""
    try:
        parser = CommandParser("python -m edge_runtime.completion", "Print completion for a shell.", EPILOG)
        parser.add_argument("shell", choices=SHELLS)
        print(script(parser.parse_args(arguments).shell))
    except EdgeError as error:
        print(f"completion: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
