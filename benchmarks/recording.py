"""``python -m benchmarks recording``: what a run's log and its watcher cost the loop.

Four robots as four processes on one machine, at one rate, again and again. Robot 0 is judged: with
``--no-log`` and nobody watching, and with its log and edge-watch; each round has both, in a new order. The
others stand for other machines and do the same in both: no log, nobody watching. The loop's own record of a
tick (wake-up to the command's departure) and of its lateness tells what the other processes do to it. What
the loop itself spends on handing a tick over comes after the command; it is measured apart.
"""

import argparse
import contextlib
import json
import random
import secrets
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.common.result_file import write_result
from benchmarks.common.result_page import add_html_flag, check_writable, page, table, write_html
from edge_runtime.common.child import python_command
from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.recording.folder import run_name
from edge_runtime.recording.recorder import Recorder
from edge_runtime.recording.wire import LogPlan
from edge_runtime.run.loop import STAGES
from edge_runtime.tools.report.page import chart
from edge_runtime.tools.report.page.document import Verdict

ALLOWED = 1.05
"""p99 with recording and watching, in parts of p99 without."""
LONGEST_START_S = 300.0
"""A machine that is too busy for this is too busy for the measurement."""


class OverheadRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One quantity, medians over the rounds; ratios are of the same round."""

    quantity: str
    rate_hz: float
    realtime: bool
    rounds: int
    off_us: float
    on_us: float
    ratio: float
    ratio_low: float
    """The smallest of any round."""
    ratio_high: float
    lost: int
    """Ticks that were not recorded."""


class HandOver(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the loop spends on handing one tick to its logger, in microseconds."""

    rate_hz: float
    p50_us: float
    p99_us: float
    max_us: float


class Overhead(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that was measured."""

    rows: list[OverheadRow]
    hand_over: HandOver


def main(arguments: Sequence[str]) -> int:
    """Measure, print, write the rows."""
    parser = argparse.ArgumentParser(prog="benchmarks recording", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ")
    parser.add_argument("--duration", type=float, default=10.0, metavar="S")
    parser.add_argument("--json", type=Path, metavar="FILE")
    add_html_flag(parser)
    flags = parser.parse_args(arguments)
    if flags.html:
        check_writable(flags.html)
    realtime = _realtime_permitted()
    hand_over = measure_hand_over(flags.rate, flags.duration)
    rounds = list(_rounds(flags.rounds, flags.rate, flags.duration, realtime=realtime))
    rows = [_row(quantity, flags.rate, rounds, realtime=realtime) for quantity in QUANTITIES]
    print("\n".join(_lines(rows, hand_over)))
    if flags.json:
        write_result(flags.json, Overhead(rows, hand_over))
    if flags.html:
        drawings = {"ticks.svg": draw(rows)}
        write_html(
            flags.html, render(rows, hand_over), drawings=drawings, verdicts=_verdicts(rows, hand_over)
        )
    return 0


def render(rows: Sequence[OverheadRow], hand_over: HandOver) -> str:
    """The results as Markdown; ``ticks.svg`` is what `draw` returns."""
    head = ["quantity", "off us", "on us", "on / off", "lowest", "highest"]
    cells = [
        [row.quantity, *(f"{value:.1f}" for value in (row.off_us, row.on_us)),
         *(f"{value:.3f}" for value in (row.ratio, row.ratio_low, row.ratio_high))]
        for row in rows
    ]  # fmt: skip
    row, handed = rows[0], hand_over
    spent = [f"{value:.1f}" for value in (handed.rate_hz, handed.p50_us, handed.p99_us, handed.max_us)]
    return page(
        "What recording and watching cost the loop",
        "recording",
        f"Four robots at {row.rate_hz:g} Hz, {row.rounds} rounds, {_scheduling(row)} scheduling.",
        "## A tick without (off) and with (on) its log and its watcher",
        "Medians over the rounds; a ratio is of one round, whose runs follow each other.",
        table(head, cells),
        "![The same medians in microseconds](ticks.svg)",
        "## Handing a tick over to the logger, after the command is out",
        table(["rate Hz", "p50 us", "p99 us", "max us"], [spent]),
    )


def draw(rows: Sequence[OverheadRow]) -> str:
    """Off beside on, as SVG."""
    return chart.bars({row.quantity: {"off": row.off_us, "on": row.on_us} for row in rows}, "us")


def _verdicts(rows: Sequence[OverheadRow], hand_over: HandOver) -> list[Verdict]:
    (p99,) = (row for row in rows if row.quantity == "tick p99")
    return [
        Verdict("Tick p99, on / off", f"{p99.ratio:.3f}", f"at most {ALLOWED:g} asked", p99.ratio <= ALLOWED),
        Verdict("Ticks lost", str(p99.lost), good=p99.lost == 0),
        Verdict("Hand-over", f"{hand_over.p50_us:.0f} us", "median, after the command"),
    ]


def _scheduling(row: OverheadRow) -> str:
    return "real-time" if row.realtime else "ordinary, as real-time was refused,"


def _lines(rows: Sequence[OverheadRow], hand_over: HandOver) -> Iterator[str]:
    for row in rows:
        yield (
            f"{row.quantity:<10}off {row.off_us:8.1f} us   on {row.on_us:8.1f} us   on / off {row.ratio:.3f} "
            f"({row.ratio_low:.3f} to {row.ratio_high:.3f})"
        )
    row = rows[0]
    scheduling = "real-time" if row.realtime else "ordinary, real-time was refused"
    yield f"{row.rounds} rounds at {row.rate_hz:g} Hz, scheduling {scheduling}"
    yield f"tick p99 within {ALLOWED - 1.0:.0%} asked; {row.lost} ticks lost"
    yield f"hand-over p50 {hand_over.p50_us:.1f} us, p99 {hand_over.p99_us:.1f}, max {hand_over.max_us:.1f}"


QUANTITIES = {
    "tick p50": lambda report: report["tick_us"]["p50"],
    "tick p99": lambda report: report["tick_us"]["p99"],
    "wake p50": lambda report: report["stage_us"]["wake"]["p50"],
    "wake p99": lambda report: report["stage_us"]["wake"]["p99"],
}
Reports = dict[bool, dict]
"""Robot 0's, without and with recording and watching."""


def _rounds(count: int, rate: float, duration: float, *, realtime: bool) -> Iterator[Reports]:
    draw, read = random.Random(0), QUANTITIES["tick p99"]
    with tempfile.TemporaryDirectory() as folder:
        plain, watched = _write_fleets(Path(folder))
        for number in range(count):
            reports = {}
            for on in draw.sample((False, True), 2):
                common = ["--rate", str(rate), "--duration", str(duration), "--stay"]
                common += ["--realtime"] if realtime else []
                with _watching(watched) if on else contextlib.nullcontext():
                    reports[on] = _team(plain, watched if on else None, common, duration)
            p99 = [read(reports[on]) for on in (False, True)]
            print(
                f"round {number + 1} of {count}: tick p99 {p99[0]:.0f} and {p99[1]:.0f} us", file=sys.stderr
            )
            yield reports


def _write_fleets(folder: Path) -> tuple[Path, Path]:
    """The packaged fleet over UDP, on ports that are free now: plain, and watched."""
    (folder / "team.key").write_text(secrets.token_hex(32))
    (folder / "team.key").chmod(0o600)
    text = (DEFAULT_FLEET.parent / "udp.toml").read_text()
    for robot_id in range(4):
        text = text.replace(f"127.0.0.1:4700{robot_id}", f"127.0.0.1:{_free_port()}")
    plain, watched = folder / "plain.toml", folder / "watched.toml"
    plain.write_text(text)
    watched.write_text(text + f'\n[watch]\naddress = "127.0.0.1:{_free_port()}"\n')
    return plain, watched


def _team(plain: Path, watched: Path | None, common: list[str], duration: float) -> dict:
    """Run the team once, robot 0 recorded and watched if there is a file for that; return its report."""
    output = plain.parent / "run.json"
    unrecorded = ["--fleet", str(plain), "--no-log"]
    judged = ["--fleet", str(watched), "--log-dir", str(plain.parent / "logs")] if watched else unrecorded
    robots = [_start("edge_runtime.run", "--robot-id", "0", *judged, *common, "--json", str(output))]
    robots += [_start("edge_runtime.run", "--robot-id", str(i), *unrecorded, *common) for i in (1, 2, 3)]
    try:
        codes = [robot.wait(timeout=duration + LONGEST_START_S) for robot in robots]
    finally:
        for robot in robots:
            robot.kill()
    if any(codes):
        raise ConfigError(f"edge-run ended with exit codes {codes}")
    return json.loads(output.read_bytes())


@contextlib.contextmanager
def _watching(fleet: Path) -> Iterator[None]:
    watch = _start("edge_runtime.tools.watch", "--fleet", str(fleet))
    try:
        yield
    finally:
        watch.terminate()
        watch.wait()


def _start(module: str, *flags: str) -> subprocess.Popen:
    return subprocess.Popen(python_command(module, *flags), stdout=subprocess.DEVNULL)  # noqa: S603


def _row(quantity: str, rate: float, rounds: list[Reports], *, realtime: bool) -> OverheadRow:
    read = QUANTITIES[quantity]
    off, on = (np.array([read(reports[way]) for reports in rounds]) for way in (False, True))
    ratios = on / off
    return OverheadRow(
        quantity,
        rate,
        realtime,
        len(rounds),
        float(np.median(off)),
        float(np.median(on)),
        float(np.median(ratios)),
        float(ratios.min()),
        float(ratios.max()),
        sum(reports[True]["log"]["lost"] for reports in rounds),
    )


def measure_hand_over(rate: float, duration: float) -> HandOver:
    """Time `Recorder.follow` in a paced loop with a real logger."""
    fleet = load_fleet(DEFAULT_FLEET)
    mission = Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, rate)
    controller: Controller = mission.controller(0)
    grid, timing, spent = DeadlineGrid(1.0 / rate), TimingRecord(STAGES), []
    mates = tuple(Teammate(RobotState(i, 0.0, (float(i), 0.5), (0.1, 0.2))) for i in (1, 2, 3))
    with tempfile.TemporaryDirectory() as folder:
        plan = LogPlan(folder, run_name("20260101T000000Z", 0, 0), 10**8, 600.0, 10**9)
        with Recorder(plan) as recorder:
            recorder.begin(mission, controller, grid, timing, bridge="none", dry_run=True)
            while grid.next_s < duration:
                deadline_s = grid.wait()
                timing.begin(deadline_s)
                team = TeamState(RobotState(0, time.monotonic(), (0.0, 0.0), (0.1, 0.2)), mates)
                observation = controller.observe(team)
                guided = controller.act(observation, team)
                command = controller.limit(guided, team, time.monotonic())
                for _ in STAGES:
                    timing.lap()
                timing.end()
                begin = time.perf_counter()
                recorder.follow(deadline_s, team, observation, guided, command)
                spent.append(1e6 * (time.perf_counter() - begin))
            recorder.end("duration", failed=False)
    p50, p99 = np.percentile(spent[10:], [50.0, 99.0]).tolist()
    return HandOver(rate, p50, p99, max(spent[10:]))


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _realtime_permitted() -> bool:
    """Whether a child may have it: this process is to stay an ordinary one."""
    code = "from edge_runtime.common.realtime import enter_realtime; enter_realtime()"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0  # noqa: S603
