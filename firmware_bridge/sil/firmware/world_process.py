"""``python -m firmware_bridge.sil.firmware.world_process SPEC``: plant and all firmware in one process.

One process for all firmware nodes, because two cores hold them so with less disturbance than N more processes
would make; each has its own bus or port, its own state and its own timeout. Everything is paced on one grid
of absolute deadlines. No firmware tells its pose before a line comes on the standard input: all robots then
begin to drive together. A second line says that all do: it prints the moment from which the run counts, once
all firmware hears them. On SIGTERM it writes its record beside SPEC.
"""

import gc
import importlib
import os
import sys
import time
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from edge_runtime.common.realtime import enter_realtime, freeze_garbage
from edge_runtime.common.signals import StopSignals
from edge_runtime.config.fleet import Obstacle, load_fleet
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.ros.profile import profile_path
from firmware_bridge.sil.firmware.agilex import AgilexChassis
from firmware_bridge.sil.firmware.autopilot import Autopilot
from firmware_bridge.sil.firmware.node import STEP_S, FirmwareLoop, FirmwareNode
from firmware_bridge.sil.firmware.record import NodeRecord, NodeRecorder, Pace
from firmware_bridge.sil.firmware.ros_base import RosBase, open_wires
from firmware_bridge.sil.firmware.ros_node import NodesTask
from firmware_bridge.sil.firmware.sources import Sources
from firmware_bridge.sil.firmware.stops import Stops
from firmware_bridge.sil.firmware.truth import ObjectOutcome, RobotOutcome, Truth
from firmware_bridge.sil.firmware.wires import CanWire, UdpWire
from firmware_bridge.sil.firmware.world import Standing, World
from firmware_bridge.sil.measurement.samples import Samples
from firmware_bridge.sil.report.records import FaultStop
from firmware_bridge.sil.scenario.faults import AnyFault, CorruptFrames, EmergencyStop, NanPose, StalePose
from firmware_bridge.sil.scenario.scenario import Station, robot_bundle
from firmware_bridge.sil.scenario.start_gate import RunStart
from firmware_bridge.sil.scenario.vehicle import AUTOPILOT, ROS, BridgeKind, ros_folders
from firmware_bridge.simulation.plants import PLANTS

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
    policy: str
    """Directory of the bundle; empty: the fleet's."""
    realtime: bool
    stations: tuple[Station, ...]
    faults: tuple[AnyFault, ...]
    pose_hz: float = 0.0
    """Of the streams that tell poses, where they have a rate of their own."""
    ros_path: tuple[str, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()


class WorldRecord(msgspec.Struct, frozen=True):
    """What it writes."""

    nodes: tuple[NodeRecord, ...]
    outcomes: tuple[RobotOutcome, ...]
    stops: tuple[tuple[FaultStop, ...], ...]
    """After each fault of the timeline, of the robots that it was to stop."""
    late_s: list[float]
    """How late each step of the plant was, from the beginning of the measurement."""
    objects: tuple[ObjectOutcome, ...]


class WorldProcess:
    """The world and its firmware."""

    def __init__(self, spec: WorldSpec) -> None:
        fleet = replace(load_fleet(Path(spec.stations[0].fleet_file)), obstacles=spec.obstacles)
        robots = [fleet.robot(station.robot_id) for station in spec.stations]
        manifests = [robot_bundle(fleet, robot, spec.policy).manifest for robot in robots]
        standings = [Standing(one.start_m, one.heading_rad, one.vehicle.ahead_m) for one in spec.stations]
        make_world = importlib.import_module(PLANTS[fleet.simulation.plant].world).make_world
        world: World = make_world(fleet, manifests, standings, STEP_S, 1.0 / spec.rate_hz)
        goals = [station.goal_m for station in spec.stations]
        self._truth = Truth(world, goals, fleet.objective_set.objectives, STEP_S, fleet.tracked)
        self._stops = Stops(world, [robot.id for robot in robots], spec.faults, STEP_S)
        nodes = make_nodes(spec)
        self._firmware = {s.robot_id: node.firmware for s, node in zip(spec.stations, nodes, strict=True)}
        for firmware in self._firmware.values():
            firmware.located = False
        pose_steps = max(1, round(min(LONGEST_POSE_PERIOD_S, 0.5 / spec.rate_hz) / STEP_S))
        self._pose_steps, self._fleet, self._world = pose_steps, fleet, world
        pace = Pace(spec.rate_hz, spec.pose_hz or 1.0 / (pose_steps * STEP_S), spec.duration_s)
        streamed = spec.pose_hz > 0.0
        self._recorders = [NodeRecorder(*one, pace, streamed=streamed) for one in self._firmware.items()]
        sensors = [manifest.body.sensor() for manifest in manifests]
        self._sources = Sources(fleet, world, self._take_pose, spec.pose_hz, time.monotonic(), sensors)
        self._pose_turn = 0
        self._loop = FirmwareLoop(world, nodes, pose_steps)
        self._spec, self._late_s = spec, Samples(1.0 / STEP_S, spec.duration_s)
        self._lines, self._t0_s = 0, float("inf")

    def run(self, signals: StopSignals) -> None:
        """Serve until a signal."""
        self._loop.listen(sys.stdin.fileno(), self._hear)
        with self._loop, self._sources:
            while not signals.reason:
                late_s = self._loop.turn(self._sources.due_s)
                if self._lines:
                    self._sources.tell_due(time.monotonic())
                if late_s is not None:
                    self._look(time.monotonic(), late_s)

    def record(self) -> WorldRecord:
        """Return everything so far."""
        nodes = tuple(recorder.record() for recorder in self._recorders)
        outcomes, objects = self._truth.outcomes(), self._truth.objects()
        return WorldRecord(nodes, outcomes, self._stops.stops(), self._late_s.tolist(), objects)

    def _hear(self) -> None:
        """Take the harness's lines; with the first, let the robots know where they are."""
        words = os.read(sys.stdin.fileno(), 64)
        self._lines += words.count(b"\n")
        if not words:
            self._loop.forget(sys.stdin.fileno())
        for firmware in self._firmware.values():
            firmware.located = self._lines >= 1

    def _look(self, now_s: float, late_s: float) -> None:
        """Measure after a step, and see to what the timeline wants of the next one."""
        if self._lines and self._pose_turn % self._pose_steps == 0 and not self._spec.pose_hz:
            self._sources.tell(now_s)
        self._pose_turn += 1
        if self._t0_s < now_s:
            self._late_s.append(late_s)
            self._mind_faults(now_s - self._t0_s)
        if self._t0_s <= now_s < self._t0_s + self._spec.duration_s:
            self._truth.follow()
            self._stops.follow(now_s - self._t0_s)
        drive = self._lines >= 2 and all(one.obeyed >= SETPOINTS for one in self._firmware.values())
        if drive and self._t0_s == float("inf"):
            self._t0_s = now_s + SETTLING_S
            print(msgspec.json.encode(RunStart(self._t0_s)).decode(), flush=True)

    def _take_pose(self, robot_id: int, measured_s: float, x_m: float) -> None:
        if self._spec.pose_hz:
            place = list(self._firmware).index(robot_id)
            self._recorders[place].take_pose(measured_s, x_m)

    def _mind_faults(self, elapsed_s: float) -> None:
        for fault in self._spec.faults:
            acts = fault.at_s <= elapsed_s < fault.end_s
            match fault:
                case StalePose():
                    self._firmware[fault.robot].stale = acts
                case NanPose():
                    self._firmware[fault.robot].not_finite = acts
                case CorruptFrames():
                    self._firmware[fault.robot].corrupt = acts
                case EmergencyStop():
                    self._firmware[fault.robot].pressed = acts


def make_nodes(spec: WorldSpec) -> list[FirmwareNode[Any]]:
    """Return the firmware of each robot on its wire."""
    bridge, wires = spec.bridge, [station.wire for station in spec.stations]
    if bridge == "can":
        return [FirmwareNode(AgilexChassis(), CanWire(wire)) for wire in wires]
    if bridge == "mavlink":
        return [FirmwareNode(Autopilot(PROFILES[AUTOPILOT]), UdpWire(int(wire))) for wire in wires]
    kind, folders = ROS[bridge], ros_folders(bridge, spec.ros_path)
    path = str(profile_path(spec.stations[0].vehicle.profile))
    task = NodesTask(kind.ros, path, tuple(wires), folders, kind.timeout_s, spec.realtime)
    return [FirmwareNode(RosBase(kind.timeout_s), wire) for wire in open_wires(task)]


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
    record_path(path).write_bytes(msgspec.msgpack.encode(process.record()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
