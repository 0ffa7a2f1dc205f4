"""edge-report: one page from the logs of a team, or from edge-sil's report."""

import argparse
import importlib
import sys
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.command_line import CommandParser, check_output, command, complain, need
from edge_runtime.errors import ConfigError
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import Record, Start
from edge_runtime.tools.report.digest import RunDigest, digest
from edge_runtime.tools.report.page.document import Page, write_page
from edge_runtime.tools.report.page.progress import steps
from edge_runtime.tools.report.sections import make_page
from edge_runtime.tools.report.team import team_of

DESCRIPTION: Final = """\
Write one page about a run: where robots went, separation and speed against their limits, costs and conflicts
of the objectives, faults, timing, message ages, machine and versions. The page fetches nothing and runs no
script; it reads on a phone, on paper, in light and dark.
Give the logs of all robots of the team, in any order; or one JSON that edge-sil --json wrote."""
EPILOG: Final = """\
exit codes:
  0  the page is written
  1  the page is written, but a log breaks off or is damaged; the page and one line say where
  2  a flag or file does not hold together; one line says what, nothing was written
  130  interrupted

examples:
  edge-report ~/.local/state/cfpg-edge/logs/*.mcap -o report.html
  edge-report robot0.mcap robot1.mcap robot2.mcap -o team.html
  edge-sil --json sil.json; edge-report sil.json -o sil.html
  python -m edge_runtime.tools.report run.mcap -o report.html     the same command"""


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = CommandParser("edge-report", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("logs", nargs="+", type=Path, metavar="LOG", help="MCAP files of edge-run, or one JSON of edge-sil")
    add("-o", "--output", type=Path, required=True, metavar="FILE", help="where the page goes")
    return parser


class _Opened(msgspec.Struct):
    """One log file, read as far as its start."""

    path: Path
    start: Start
    rest: Iterator[Record | Damage]


def log_page(paths: Sequence[Path]) -> tuple[Page, tuple[str, ...]]:
    """Compose the page of a team's logs; returns it and what was wrong with them.

    Raises:
        ConfigError: if one is no log, or two are of one robot's different runs.
    """
    opened = sorted(map(_open, paths), key=lambda each: (each.start.robot_id, each.start.part))
    notes: list[str] = []
    runs: list[RunDigest] = []
    by_run: dict[str, list[_Opened]] = {}
    for each in opened:
        by_run.setdefault(each.start.run, []).append(each)
    _check_robots(by_run)
    for parts in steps(list(by_run.values()), "reading logs"):
        runs.append(digest(chain.from_iterable(_records(part, notes) for part in parts), str(parts[0].path)))
    return make_page(team_of(runs), tuple(notes)), tuple(notes)


def _open(path: Path) -> _Opened:
    records = read_log(path)
    first = next(records, None)
    if not isinstance(first, Start):
        reason = first.message if isinstance(first, Damage) else "does not begin with a run's start"
        raise ConfigError(f"{path}: {reason}")
    return _Opened(path, first, records)


def _records(opened: _Opened, notes: list[str]) -> Iterator[Record]:
    yield opened.start
    for record in opened.rest:
        if isinstance(record, Damage):
            notes.append(f"{opened.path}: {record.message}")
        else:
            yield record


def _check_robots(by_run: dict[str, list[_Opened]]) -> None:
    seen: dict[int, Path] = {}
    dims = {parts[0].start.fleet.dims for parts in by_run.values()}
    for parts in by_run.values():
        robot_id, path = parts[0].start.robot_id, parts[0].path
        if len(dims) > 1:
            raise ConfigError(f"{path}: some logs are of robots in the plane, others of robots in space")
        if robot_id in seen:
            raise ConfigError(
                f"{path}: is another run of robot {robot_id} than {seen[robot_id]}; "
                "give one run of each robot"
            )
        seen[robot_id] = path


def sil_page(path: Path) -> Page:
    """Compose the page of edge-sil's report.

    Raises:
        ConfigError: if the file is none.
    """
    page: Page = importlib.import_module("edge_runtime.tools.report.sil_page").load_page(path)
    return page


@command("edge-report")
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``edge-report``; returns the exit code."""
    no_notes: tuple[str, ...] = ()
    flags = make_parser().parse_args(arguments)
    need("matplotlib", "report")
    check_output("-o", flags.output, flags.logs)
    if len(flags.logs) == 1 and flags.logs[0].suffix == ".json":
        page, notes = sil_page(flags.logs[0]), no_notes
    else:
        page, notes = log_page(flags.logs)
    write_page(page, flags.output)
    for note in notes:
        complain("edge-report", note)
    print(f"{flags.output}: {flags.output.stat().st_size / 1e3:.0f} kB")
    return 1 if notes else 0


if __name__ == "__main__":
    sys.exit(main())
