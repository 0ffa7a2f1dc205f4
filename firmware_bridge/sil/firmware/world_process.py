"""``python -m firmware_bridge.sil.firmware.world_process SPEC``: plant and all firmware in one process.

One process for all firmware nodes, because two cores hold them so with less disturbance than N more processes
would make; each has its own bus or port, its own state and its own timeout. Everything is paced on one grid
of absolute deadlines. No firmware tells its pose before a line comes on the standard input: all robots then
begin to drive together. A second line says that all do: it prints the moment from which the run counts, once
all firmware hears them. On SIGTERM it writes its record beside SPEC.
"""

import gc
import os
import select
import sys
import time
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.realtime import enter_realtime, freeze_garbage
from edge_runtime.common.signals import StopSignals
from edge_runtime.config.fleet import load_fleet
from firmware_bridge.sil.firmware.can_node import CanNode
from firmware_bridge.sil.firmware.mavlink_node import MavlinkNode
from firmware_bridge.sil.firmware.node import FirmwareNode, NodeRecord, Pace
from firmware_bridge.sil.firmware.truth import RobotOutcome, Truth
from firmware_bridge.sil.firmware.world import World
from firmware_bridge.sil.measurement.samples import Samples
from firmware_bridge.sil.scenario.faults import AnyFault, CorruptFrames, NanPose, StalePose
from firmware_bridge.sil.scenario.scenario import BridgeKind, Station, robot_bundle
from firmware_bridge.sil.scenario.start_gate import RunStart

STEP_S: Final = 0.01
"""Of the plant."""
LONGEST_POSE_PERIOD_S: Final = 0.02
SETTLING_S: Final = 0.5
"""From the moment at which all robots drive to the beginning of the measurement."""
SETPOINTS: Final = 5
"""After so many setpoints a robot counts as driving."""


class WorldSpec(msgspec.Struct, frozen=True):
    """What the process is started with."""

    bridge: BridgeKind
    rate_hz: float
    duration_s: float
    ahead_m: float
    policy: str
    """Directory of the bundle; empty: the fleet's."""
    realtime: bool
    stations: tuple[Station, ...]
    faults: tuple[AnyFault, ...]


class WorldRecord(msgspec.Struct, frozen=True):
    """What it writes."""

    nodes: tuple[NodeRecord, ...]
    outcomes: tuple[RobotOutcome, ...]
    late_s: list[float]
    """How late each step of the plant was, from the beginning of the measurement."""


class WorldProcess:
    """The world and its firmware."""

    def __init__(self, spec: WorldSpec) -> None:
        fleet = load_fleet(Path(spec.stations[0].fleet_file))
        robots = [fleet.robot(station.robot_id) for station in spec.stations]
        manifests = [robot_bundle(fleet, robot, spec.policy).manifest for robot in robots]
        starts = [station.start_m for station in spec.stations]
        headings = [station.heading_rad for station in spec.stations]
        self._world = World(manifests, starts, headings, spec.ahead_m, STEP_S)
        goals = [station.goal_m for station in spec.stations]
        self._truth = Truth(self._world, goals, fleet.objective_set.objectives, STEP_S)
        self._pose_steps = max(1, round(min(LONGEST_POSE_PERIOD_S, 0.5 / spec.rate_hz) / STEP_S))
        pace = Pace(spec.rate_hz, 1.0 / (self._pose_steps * STEP_S), spec.duration_s)
        self._nodes = [make_node(spec.bridge, station, pace) for station in spec.stations]
        self._spec, self._poll = spec, select.poll()
        self._late_s = Samples(1.0 / STEP_S, spec.duration_s)
        self._lines = 0
        self.t0_s = float("inf")

    def run(self, signals: StopSignals) -> None:
        """Serve until a signal."""
        by_descriptor = {node.fileno(): node.receive for node in self._nodes}
        by_descriptor[sys.stdin.fileno()] = self._hear
        for descriptor in by_descriptor:
            self._poll.register(descriptor, select.POLLIN)
        origin_s, step = time.monotonic(), 0
        while not signals.reason:
            due_s = origin_s + step * STEP_S
            wait_s = due_s - time.monotonic()
            for descriptor, _ in self._poll.poll(max(1e3 * wait_s, 0.0)):
                by_descriptor[descriptor]()
            if (now_s := time.monotonic()) >= due_s:
                if self.t0_s < now_s:
                    self._late_s.append(now_s - due_s)
                self._advance(now_s, reports=step % self._pose_steps == 0)
                step += 1

    def record(self) -> WorldRecord:
        """Return everything so far."""
        nodes = tuple(node.record() for node in self._nodes)
        return WorldRecord(nodes, self._truth.outcomes(), self._late_s.tolist())

    def close(self) -> None:
        """Let the wires go."""
        for node in self._nodes:
            node.close()

    def _hear(self) -> None:
        """Take the harness's lines; with the first, let the robots know where they are."""
        words = os.read(sys.stdin.fileno(), 64)
        self._lines += words.count(b"\n")
        if not words:
            self._poll.unregister(sys.stdin.fileno())
        for node in self._nodes:
            node.located = self._lines >= 1

    def _advance(self, now_s: float, *, reports: bool) -> None:
        self._world.step([node.motion(now_s) for node in self._nodes])
        if self.t0_s <= now_s < self.t0_s + self._spec.duration_s:
            self._truth.follow()
        if reports:
            self._mind_faults(now_s - self.t0_s)
            for index, node in enumerate(self._nodes):
                node.report(self._world.pose(index))
        is_driving = self._lines >= 2 and all(node.setpoints >= SETPOINTS for node in self._nodes)
        if is_driving and self.t0_s == float("inf"):
            self.t0_s = now_s + SETTLING_S
            print(msgspec.json.encode(RunStart(self.t0_s)).decode(), flush=True)

    def _mind_faults(self, elapsed_s: float) -> None:
        nodes = {node.robot_id: node for node in self._nodes}
        for fault in self._spec.faults:
            acts = fault.at_s <= elapsed_s < fault.end_s
            match fault:
                case StalePose():
                    nodes[fault.robot].stale = acts
                case NanPose():
                    nodes[fault.robot].not_finite = acts
                case CorruptFrames():
                    nodes[fault.robot].corrupt = acts


def make_node(bridge: BridgeKind, station: Station, pace: Pace) -> FirmwareNode:
    """Return the firmware of one robot."""
    if bridge == "can":
        return CanNode(station.robot_id, station.wire, pace)
    return MavlinkNode(station.robot_id, int(station.wire), pace)


def record_path(spec: Path) -> Path:
    """Return where the record goes."""
    return spec.with_suffix(".record")


def main(arguments: list[str]) -> int:
    """Run as the harness's child."""
    path = Path(arguments[0])
    spec = msgspec.json.decode(path.read_bytes(), type=WorldSpec)
    with StopSignals() as signals:
        process = WorldProcess(spec)
        if spec.realtime:
            enter_realtime()
        freeze_garbage()
        gc.disable()  # nothing here makes cycles, and a pause would look like a late robot
        process.run(signals)
    process.close()
    record_path(path).write_bytes(msgspec.msgpack.encode(process.record()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
