"""``python -m benchmarks faults``: how fast the robot is stopped, and what never reaches it.

Runtime and guard are processes of their own, the firmware is this one: a chassis on a UDP multicast CAN bus,
a rover on a UDP socket. Times are the kernel's stamps of arrival at the firmware. The bus-off is an error
frame put on the multicast bus; the tests on SocketCAN cause one in a kernel.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import msgspec
from rich.progress import Progress

from benchmarks.faults.bad_commands import count_passed
from benchmarks.faults.can_firmware import CanFirmware
from benchmarks.faults.forged_frames import count_accepted
from benchmarks.faults.latency import guard_latencies
from benchmarks.faults.mavlink_firmware import MavlinkFirmware
from benchmarks.faults.rows import Row, table, timed
from benchmarks.faults.trials import FAULTS, run_trial, undisturbed

RESULTS = Path(__file__).parents[1] / "results" / "faults.json"
COMMANDS_A_TRIAL = 5000
"""Bad commands: 200 trials make a million."""
FRAMES_A_TRIAL = 500
LATENCIES_A_TRIAL = 5
LATENCIES_AT_LEAST, LATENCIES_AT_MOST = 100, 1000
FIRMWARES = (CanFirmware, MavlinkFirmware)


def main(arguments: Sequence[str]) -> int:
    """Run all measurements, print the table and write the rows."""
    options = _parse(arguments)
    with Progress(disable=not sys.stderr.isatty()) as progress:
        rows = [
            *_stops(options.trials, _bar(progress, "stops", options.trials * len(FAULTS))),
            *_latencies(options.trials, _bar(progress, "guard latency", len(FIRMWARES))),
            *_bad_commands(options.trials, progress),
            _forged_frames(options.trials * FRAMES_A_TRIAL, progress),
        ]
    print(table(rows))
    print(f"{sum(row.repeated for row in rows)} trials were run again: a busy machine ended them too early")
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")
    return 0


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks faults", description=__doc__)
    parser.add_argument(
        "--trials",
        type=int,
        default=200,
        help=f"of each fault; {COMMANDS_A_TRIAL} bad commands and {FRAMES_A_TRIAL} forged frames for each",
    )
    parser.add_argument("--json", type=Path, default=RESULTS, help="where the rows go")
    options = parser.parse_args(arguments)
    if options.trials < 1:
        parser.error(f"--trials must be positive, got {options.trials}")
    return options


def _bar(progress: Progress, name: str, total: int) -> Callable[[int], None]:
    task = progress.add_task(name, total=total)
    return lambda count: progress.advance(task, count)


def _stops(trials: int, advance: Callable[[int], None]) -> list[Row]:
    """Run every fault in every round, so that a slow minute is slow for all of them."""
    results: list[list[tuple[float, int]]] = [[] for _ in FAULTS]
    for _ in range(trials):
        for fault, kept in zip(FAULTS, results, strict=True):
            kept.append(undisturbed(partial(run_trial, fault)))
            advance(1)
    rows = []
    for fault, kept in zip(FAULTS, results, strict=True):
        seconds, repeated = zip(*kept, strict=True)
        rows.append(timed(fault.name, fault.firmware.name, seconds, sum(repeated)))
    return rows


def _latencies(trials: int, advance: Callable[[int], None]) -> list[Row]:
    commands = min(max(trials * LATENCIES_A_TRIAL, LATENCIES_AT_LEAST), LATENCIES_AT_MOST)
    rows = []
    for kind in FIRMWARES:
        seconds, repeated = undisturbed(partial(guard_latencies, kind, commands))
        rows.append(timed("none: latency through the guard", kind.name, seconds, repeated))
        advance(1)
    return rows


def _bad_commands(trials: int, progress: Progress) -> list[Row]:
    rows = []
    for kind in FIRMWARES:
        commands = trials * COMMANDS_A_TRIAL
        bar = _bar(progress, f"bad commands, {kind.name}", commands)
        with kind() as firmware:
            passed = count_passed(firmware, commands, bar)
        rows.append(Row("NaN, infinite or over-limit command", kind.name, commands, passed=passed))
    return rows


def _forged_frames(frames: int, progress: Progress) -> Row:
    accepted = count_accepted(frames, _bar(progress, "forged frames", frames))
    return Row("unsigned, replayed or altered frame", MavlinkFirmware.name, frames, passed=accepted)
