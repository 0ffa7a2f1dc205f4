"""``python -m benchmarks faults``: how fast the robot is stopped, and what never reaches it.

Runtime and guard are processes of their own, the firmware is this one: a chassis on a UDP multicast CAN bus,
a rover on a UDP socket, on a plane on which they brake with 2 and 1 m/s^2. Times are the kernel's stamps of
arrival at the firmware. The bus-off is an error frame put on the multicast bus; the tests on SocketCAN cause
one in a kernel. Rows of the file that are not measured again stay as they are.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from rich.progress import Progress

from benchmarks.common.flags import COUNT, add_result, make_parser
from benchmarks.common.result_file import read_result, replaced, write_result
from benchmarks.common.result_page import add_html_flag, check_writable, make_page, write_page
from benchmarks.faults.bad_commands import count_passed
from benchmarks.faults.forged_frames import count_accepted
from benchmarks.faults.latency import bus_latencies, guard_latencies
from benchmarks.faults.robot import CanRobot, MavlinkRobot
from benchmarks.faults.ros_robot import Ros1Robot, ros2_robot
from benchmarks.faults.rows import FaultRow, draw, faults_table, measured, render, timed
from benchmarks.faults.trials import FAULTS, Fault, Stop, ros_faults, run_trial, undisturbed

RESULTS = Path(__file__).parents[1] / "results" / "faults.json"
COMMANDS_A_TRIAL = 5000
"""Bad commands: 200 trials make a million."""
FRAMES_A_TRIAL = 500
LATENCIES_A_TRIAL = 5
LATENCIES_A_ROUND = 100
ROBOTS = (CanRobot, MavlinkRobot)
LATENCIES = {
    "none: latency through the guard": guard_latencies,
    "none: latency of the bus alone": bus_latencies,
}
BAD_COMMANDS = "NaN, infinite or over-limit command"
FORGED_FRAMES = "unsigned, replayed or altered frame"
NAMES = (*dict.fromkeys(fault.name for fault in FAULTS), *LATENCIES, BAD_COMMANDS, FORGED_FRAMES)
REALTIME = ", --realtime"
"""Added to the names of rows."""


def main(arguments: Sequence[str]) -> int:
    """Run all measurements, print the table and write the rows."""
    options = _parse(arguments)
    if options.html:
        check_writable(options.html)
    with Progress(disable=not sys.stderr.isatty()) as progress:
        rows = list(_measure(options, progress))
    print(faults_table(rows))
    print(f"{sum(row.repeated for row in rows)} trials were run again: a busy machine ended them too early")
    rows = replaced(read_result(options.json, list[FaultRow], default=[]), rows, measured)
    write_result(options.json, rows)
    if options.html:
        write_page(make_page(render(rows), drawings={"stops.svg": draw(rows)}), options.html)
    return 0


def _measure(options: argparse.Namespace, progress: Progress) -> Iterator[FaultRow]:
    wanted, trials, realtime = options.only or NAMES, options.trials, options.realtime
    faults = [fault for fault in ros_faults(options.ros) or FAULTS if fault.name in wanted]
    yield from _stops(faults, trials, realtime, _bar(progress, "stops", trials * len(faults)))
    latencies = [name for name in LATENCIES if name in wanted]
    yield from _latencies(latencies, trials, realtime, _bar(progress, "latencies", trials))
    if BAD_COMMANDS in wanted:
        yield from _bad_commands(trials, progress)
    if FORGED_FRAMES in wanted:
        yield _forged_frames(trials * FRAMES_A_TRIAL, progress)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = make_parser("faults", __doc__)
    parser.add_argument(
        "--trials",
        type=COUNT,
        default=200,
        help=f"of each fault; {COMMANDS_A_TRIAL} bad commands and {FRAMES_A_TRIAL} forged frames for each",
    )
    parser.add_argument("--only", nargs="+", choices=NAMES, metavar="FAULT", help="; ".join(NAMES))
    parser.add_argument(
        "--realtime",
        action="store_true",
        help=f"runtime and guard as under edge-run --realtime, rows {REALTIME!r}",
    )
    add_ros = parser.add_argument_group("robots of ROS alone, in place of the others").add_argument
    add_ros("--ros1", dest="ros", action="append_const", const=Ros1Robot, help="by rosmaster and rospy")
    add_ros("--ros2", dest="ros", action="append", type=ros2_robot, metavar="DIR", help="by rclpy in DIR")
    add_result(parser, RESULTS)
    add_html_flag(parser)
    options = parser.parse_args(arguments)
    options.ros = options.ros or []
    if options.ros:
        stops = {fault.name for fault in ros_faults(options.ros)}
        options.only = [name for name in options.only or NAMES if name in stops]
    if options.realtime:
        options.only = [name for name in options.only or NAMES if name not in (BAD_COMMANDS, FORGED_FRAMES)]
    return options


def _bar(progress: Progress, name: str, total: int) -> Callable[[int], None]:
    task = progress.add_task(name, total=total)
    return lambda count: progress.advance(task, count)


def _stops(
    faults: Sequence[Fault], trials: int, realtime: bool, advance: Callable[[int], None]
) -> Iterator[FaultRow]:
    """Run every fault in every round, so that a slow minute is slow for all of them."""
    results: list[list[tuple[Stop, int]]] = [[] for _ in faults]
    for _ in range(trials):
        for fault, kept in zip(faults, results, strict=True):
            kept.append(undisturbed(partial(run_trial, fault, realtime)))
            advance(1)
    for fault, kept in zip(faults, results, strict=True):
        stops, repeated = zip(*kept, strict=True)
        seconds, metres = zip(*stops, strict=True)
        name = _named(fault.name, realtime)
        yield timed(name, fault.robot.name, seconds, sum(repeated), metres=metres)


def _latencies(
    names: Sequence[str], trials: int, realtime: bool, advance: Callable[[int], None]
) -> Iterator[FaultRow]:
    """Send LATENCIES_A_ROUND commands each way in every round, for the same reason."""
    ways = [(name, kind) for name in names for kind in ROBOTS]
    seconds: list[list[float]] = [[] for _ in ways]
    repeats = [0] * len(ways)
    rounds = math.ceil(trials * LATENCIES_A_TRIAL / LATENCIES_A_ROUND)
    for _ in range(rounds):
        for index, (name, kind) in enumerate(ways):
            trial = partial(LATENCIES[name], kind, LATENCIES_A_ROUND, realtime)
            delays, repeated = undisturbed(trial)
            seconds[index] += delays
            repeats[index] += repeated
        advance(trials // rounds)
    for (name, kind), delays, repeated in zip(ways, seconds, repeats, strict=True):
        yield timed(_named(name, realtime), kind.name, delays, repeated)


def _named(name: str, realtime: bool) -> str:
    return name + REALTIME if realtime else name


def _bad_commands(trials: int, progress: Progress) -> list[FaultRow]:
    rows = []
    for kind in ROBOTS:
        commands = trials * COMMANDS_A_TRIAL
        bar = _bar(progress, f"bad commands, {kind.name}", commands)
        with kind() as robot:
            passed = count_passed(robot, commands, bar)
        rows.append(FaultRow(BAD_COMMANDS, kind.name, commands, passed=passed))
    return rows


def _forged_frames(frames: int, progress: Progress) -> FaultRow:
    accepted = count_accepted(frames, _bar(progress, "forged frames", frames))
    return FaultRow(FORGED_FRAMES, MavlinkRobot.name, frames, passed=accepted)
