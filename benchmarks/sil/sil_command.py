"""``python -m benchmarks sil``: what must be seen of a team in the loop, and how it grows.

Each row is a run of edge-sil: real edge-run processes with their guards and loggers, firmware and plant on
the wire. ``--short`` is what CI runs, ``--soak`` adds ten minutes of eight robots, ``--scale`` measures teams
of 4 to 32. A row that a busy machine disturbed says so; its figures prove nothing. A run that shows nothing
because it came late or was disturbed is repeated, twice at most, and its row says that too. Rows of the file
that are not measured again stay as they are.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.common.flags import make_parser
from benchmarks.sil.cases import Case, cases, soak
from benchmarks.sil.rows import (
    HEAD,
    CaseRow,
    SilResults,
    Size,
    failed,
    keep,
    line,
    settled_row,
    size_of,
    sizes_table,
)
from benchmarks.sil.run import run_case
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.machine import realtime as permitted
from edge_runtime.errors import EdgeError
from firmware_bridge.sil.scenario.team_file import NEAREST

RESULTS = Path(__file__).parents[1] / "results"
SIZES = ((4, 20.0), (8, 20.0), (16, 20.0), (32, 10.0))
"""(robots, rate): what two cores carry with firmware and plant beside the robots."""


def main(arguments: Sequence[str]) -> int:
    """Run the cases, print the tables, write the rows.

    Returns 1 if a quiet machine did not show what was asked, 3 if only a disturbed one did not.
    """
    options = _parse(arguments)
    realtime = permitted(wanted=True).verdict is Verdict.OK
    if not realtime:
        print("real-time scheduling is not permitted here: all rows run without", file=sys.stderr)
    chosen = [case for case in (*cases(), soak()) if options.only in case.name]
    if not options.soak and not options.only:
        chosen = chosen[:-1]
    print(HEAD)
    rows = []
    for case in chosen:
        rows.append(_row(case, short=options.short, realtime=realtime))
        print(line(rows[-1]), flush=True)
    sizes = []
    for robots, rate_hz in SIZES if options.scale else ():
        try:
            sizes.append(_size(robots, rate_hz, realtime=realtime))
        except EdgeError as error:
            print(f"{robots} robots: {error}", file=sys.stderr)
    if sizes:
        print(sizes_table(sizes))
    keep(options.json, SilResults(len(os.sched_getaffinity(0)), tuple(rows), tuple(sizes)))
    lacking = [row for row in rows if row.missing]
    return 1 if any(not row.disturbed for row in lacking) else 3 if lacking else 0


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = make_parser("sil", __doc__)
    add = parser.add_argument
    add("--short", action="store_true", help="a few seconds a row")
    add("--soak", action="store_true", help="also the ten minutes of eight robots")
    add("--scale", action="store_true", help="also teams of 4, 8, 16 and 32")
    add("--only", default="", metavar="TEXT", help="rows whose name contains it")
    add("--json", type=Path, help="where the rows go (default: sil.json or sil_short.json, with the others)")
    options = parser.parse_args(arguments)
    options.json = options.json or RESULTS / ("sil_short.json" if options.short else "sil.json")
    return options


def _row(case: Case, *, short: bool, realtime: bool) -> CaseRow:
    try:
        return settled_row(case, partial(run_case, case, short=short, realtime=realtime))
    except EdgeError as error:
        return failed(case, str(error))


def _size(robots: int, rate_hz: float, *, realtime: bool) -> Size:
    case = soak()._replace(robots=robots, rate_hz=rate_hz, long_s=10.0)
    return size_of(run_case(case, short=False, realtime=realtime), min(NEAREST, robots - 1))
