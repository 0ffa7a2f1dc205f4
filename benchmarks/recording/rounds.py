"""Four robots as four processes, robot 0 with and without its log and its watcher."""

import random
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec

from benchmarks.recording.rows import Reports, read_us
from edge_runtime.config.fleet import DEFAULT_FLEET
from edge_runtime.errors import FailedError
from edge_runtime.run.run_report import RunReport
from firmware_bridge.sil.measurement.processes import ProcessGroup
from firmware_bridge.sil.scenario.ports import HOST, free_ports
from firmware_bridge.sil.scenario.team_file import write_key

LONGEST_START_S = 300.0
"""A machine that is too busy for this is too busy for the measurement."""


def rounds(count: int, rate: float, duration: float, *, realtime: bool) -> Iterator[Reports]:
    """Run both ways in every round, in a new order.

    Raises:
        FailedError: if a robot's process failed.
    """
    order = random.Random(0)
    common = ["--rate", str(rate), "--duration", str(duration), "--stay", *["--realtime"] * realtime]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in range(count):
            both = {}
            for on in order.sample((False, True), 2):
                both[on] = _run(folder, common, duration, watched=on)
            p99 = [f"{read_us(both[on], 'tick p99'):.0f}" for on in (False, True)]
            print(f"round {number + 1} of {count}: tick p99 {' and '.join(p99)} us", file=sys.stderr)
            yield both


def _run(folder: Path, common: list[str], duration: float, *, watched: bool) -> RunReport:
    """Run the team once, robot 0 recorded and watched or not, and return its report."""
    output = folder / "run.json"
    plain, with_watch = _write_fleets(folder)
    unrecorded = ["--fleet", str(plain), "--no-log"]
    recorded = ["--fleet", str(with_watch), "--log-dir", str(folder / "logs")]
    with ProcessGroup(folder) as group:
        if watched:
            group.start("watch", "edge_runtime.tools.watch", ["--fleet", str(with_watch)])
        for robot in range(4):
            own = recorded if watched and robot == 0 else unrecorded
            own = [*own, "--json", str(output)] if robot == 0 else own
            group.start(f"robot_{robot}", "edge_runtime.run", ["--robot-id", str(robot), *own, *common])
        for name, child in group.children.items():
            if name != "watch" and child.popen.wait(duration + LONGEST_START_S):
                raise FailedError(f"{name}: {child.last_line()}")
    return msgspec.json.decode(output.read_bytes(), type=RunReport)


def _write_fleets(folder: Path) -> tuple[Path, Path]:
    """The packaged fleet over UDP, on ports that are free now: plain, and watched."""
    write_key(folder / "team.key")
    text = (DEFAULT_FLEET.parent / "udp.toml").read_text()
    *ports, watch = free_ports(5)
    for robot, port in enumerate(ports):
        text = text.replace(f"{HOST}:4700{robot}", f"{HOST}:{port}")
    plain, watched = folder / "plain.toml", folder / "watched.toml"
    plain.write_text(text)
    watched.write_text(text + f'\n[watch]\naddress = "{HOST}:{watch}"\n')
    return plain, watched
