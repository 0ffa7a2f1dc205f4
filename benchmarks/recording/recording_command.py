"""``python -m benchmarks recording``: what a run's log and its watcher cost the loop.

Four robots as four processes on one machine, at one rate, again and again. Robot 0 is judged: with
``--no-log`` and nobody watching, and with its log and edge-watch; each round has both, in a new order. The
others stand for other machines and do the same in both: no log, nobody watching. The loop's own record of a
tick (wake-up to the command's departure) and of its lateness tells what the other processes do to it. What
the loop itself spends on handing a tick over comes after the command; it is measured apart.
"""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.flags import COUNT, make_parser
from benchmarks.common.result_file import write_result
from benchmarks.common.result_page import add_html_flag, check_writable, make_page, write_page
from benchmarks.recording.hand_over import measure_hand_over
from benchmarks.recording.rounds import rounds
from benchmarks.recording.rows import QUANTITIES, Overhead, draw, make_row, render, verdicts
from edge_runtime.common.flag_types import number
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.machine import realtime


def main(arguments: Sequence[str]) -> int:
    """Measure, print, write the rows."""
    parser = make_parser("recording", __doc__)
    parser.add_argument("--rounds", type=COUNT, default=8, help="(8)")
    parser.add_argument("--rate", type=number(1.0, 1000.0), default=100.0, metavar="HZ", help="(100)")
    parser.add_argument("--duration", type=number(1.0, 3600.0), default=10.0, metavar="S", help="(10)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where the rows go")
    add_html_flag(parser)
    flags = parser.parse_args(arguments)
    if flags.html:
        check_writable(flags.html)
    permitted = realtime(wanted=True).verdict is Verdict.OK
    hand_over = measure_hand_over(flags.rate, flags.duration)
    runs = list(rounds(flags.rounds, flags.rate, flags.duration, realtime=permitted))
    rows = [make_row(quantity, flags.rate, runs, realtime=permitted) for quantity in QUANTITIES]
    measured = Overhead(rows, hand_over)
    print(render(measured))
    if flags.json:
        write_result(flags.json, measured)
    if flags.html:
        drawings = {"ticks.svg": draw(rows)}
        write_page(make_page(render(measured), drawings=drawings, verdicts=verdicts(measured)), flags.html)
    return 0
