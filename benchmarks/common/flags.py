"""Command lines of the measurements, and flags that several share."""

from pathlib import Path

from edge_runtime.common.command_line import CommandParser
from edge_runtime.common.flag_types import whole_number

COUNT = whole_number(1, 10**9)
POLICIES = Path(__file__).parents[1] / "policies"
"""The committed bundles of all seeds."""


def make_parser(name: str, description: str | None, epilog: str = "") -> CommandParser:
    """The command line of one measurement."""
    return CommandParser(f"python -m benchmarks {name}", description or "", epilog)


def add_policies(parser: CommandParser) -> None:
    """Add ``--policies``."""
    parser.add_argument(
        "--policies",
        type=Path,
        default=POLICIES,
        metavar="DIR",
        help="as python -m export.train_all leaves them",
    )


def add_result(parser: CommandParser, rows: Path) -> None:
    """Add ``--json``."""
    parser.add_argument("--json", type=Path, default=rows, metavar="FILE", help="where the rows go")


def add_rows(parser: CommandParser, tasks: tuple[str, ...], episodes: int, rows: Path) -> None:
    """Add what an evaluation asks: ``--tasks``, ``--episodes``, ``--policies``, ``--jobs``, ``--json``."""
    parser.add_argument("--tasks", nargs="*", choices=tasks, default=tasks, help="(all)")
    parser.add_argument("--episodes", type=COUNT, default=episodes, help=f"of each row ({episodes})")
    add_policies(parser)
    parser.add_argument("--jobs", type=COUNT, default=2, metavar="N", help="processes (2)")
    add_result(parser, rows)
