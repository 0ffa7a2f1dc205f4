"""Runs a scenario: starts everything, follows the timeline, ends everything, hands back what was recorded."""

import os
import select
import time
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import msgspec

from edge_runtime.common.signals import StopSignals
from edge_runtime.errors import BridgeError
from edge_runtime.run.run_report import RunReport
from edge_runtime.tools.ctl.operator_link import OperatorLink
from firmware_bridge.sil.firmware import world_process
from firmware_bridge.sil.firmware.world_process import WorldRecord, WorldSpec, record_path
from firmware_bridge.sil.harness import cpu_hog
from firmware_bridge.sil.harness.injector import Injector
from firmware_bridge.sil.harness.robots import MODULE, log_folder, open_operator, report_path, robot_arguments
from firmware_bridge.sil.measurement import wake_probe
from firmware_bridge.sil.measurement.process_meter import PERIOD_S, Meter
from firmware_bridge.sil.measurement.processes import Child, ProcessGroup
from firmware_bridge.sil.measurement.robot_log import RobotLog, read_robot_log
from firmware_bridge.sil.measurement.wake_probe import ProbeRecord
from firmware_bridge.sil.network import attacker, relay
from firmware_bridge.sil.network.attacker import HostileSpec
from firmware_bridge.sil.network.relay import Line, RelaySpec
from firmware_bridge.sil.report.records import ProcessCost
from firmware_bridge.sil.scenario.faults import CpuHog, Hostile
from firmware_bridge.sil.scenario.scenario import Scenario
from firmware_bridge.sil.scenario.start_gate import RunStart

STARTING_S = 30.0
STARTING_A_ROBOT_S = 3.0
"""Longest wait until all robots drive: so long, and so much more for each."""
APART_S = 0.5
"""Between two robots' starts: a runtime that starts takes a core, and waits only so long for its guard."""
LOOK_S = 0.05
"""How often the harness looks whether everybody is alive."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class StartError(BridgeError):
    """The team did not come to drive: one of its processes ended, or took too long."""


@dataclass(frozen=True)
class Recording:
    """What a run left behind."""

    t0_s: float
    end_s: float
    world: WorldRecord
    probe: ProbeRecord
    reports: dict[int, RunReport]
    logs: dict[int, RobotLog]
    costs: tuple[ProcessCost, ...]
    others_cpu_cores: float
    done_s: dict[int, float]
    ended: tuple[str, ...]


class Harness:
    """One run of one scenario."""

    def __init__(self, scenario: Scenario, processes: ProcessGroup, signals: StopSignals) -> None:
        self._scenario, self._processes, self._signals = scenario, processes, signals
        self._ended: dict[str, str] = {}
        self._meter = Meter(processes, os.getpid(), scenario.request.duration_s)

    def run(self) -> Recording:
        """Run to the end.

        Raises:
            StartError: if the team never drove.
            BridgeError: if the plant died, or a signal asked to end.
        """
        world, helpers = self._start_world(), self._start_helpers()
        self._start_robots()
        end_s = time.monotonic() + STARTING_S + STARTING_A_ROBOT_S * len(self._scenario.stations)
        with open_operator(self._scenario) as operator:
            self._await_robots(operator, end_s)
            world.tell("go")
            self._await_driving(operator, end_s)
        world.tell("all drive")
        start = self._await_start(world, end_s)
        for helper in helpers:
            helper.tell(msgspec.json.encode(start).decode())
        injector = Injector(self._scenario.faults, self._processes, self._scenario.stations[0].fleet_file)
        try:
            self._follow(start.t0_s, injector)
        finally:
            injector.restore()
        end_s = start.t0_s + self._scenario.request.duration_s
        return self._end(start.t0_s, end_s, world, helpers, injector)

    def _start_world(self) -> Child:
        scenario, request = self._scenario, self._scenario.request
        spec = WorldSpec(
            request.bridge,
            request.rate_hz,
            request.duration_s,
            scenario.ahead_m,
            str(request.policy or ""),
            request.realtime,
            scenario.stations,
            scenario.faults,
        )
        return self._start("world", world_process, self._write("world", spec), answers=True)

    def _start_helpers(self) -> list[Child]:
        scenario = self._scenario
        realtime = ["realtime"] if scenario.request.realtime else []
        duration = str(scenario.request.duration_s)
        helpers = [self._start("probe", wake_probe, str(self._probe_file), duration, *realtime)]
        if scenario.relays or scenario.tunnels:
            ports = {station.robot_id: station.port for station in scenario.stations}
            lines = tuple(Line(robot_id, port, ports[robot_id]) for robot_id, port in scenario.relays)
            in_realtime = scenario.request.realtime
            spec = RelaySpec(lines, scenario.tunnels, scenario.faults, seed=0, realtime=in_realtime)
            helpers.append(self._start("relay", relay, self._write("relay", spec)))
        for index, fault in enumerate(scenario.faults):
            match fault:
                case CpuHog():
                    times = (str(fault.at_s), str(fault.for_s))
                    hogs = [f"hog_{index}_{number}" for number in range(fault.processes)]
                    helpers += [self._start(name, cpu_hog, *times) for name in hogs]
                case Hostile():
                    ports = {station.robot_id: station.port for station in scenario.stations}
                    path = self._write(f"hostile_{index}", HostileSpec(ports, fault))
                    helpers.append(self._start(f"hostile_{index}", attacker, path))
        return helpers

    def _start_robots(self) -> None:
        for station in self._scenario.stations:
            self._look()
            arguments = robot_arguments(self._scenario, station)
            self._processes.start(f"robot_{station.robot_id}", MODULE, arguments, ONE_THREAD)
            time.sleep(APART_S)

    def _start(self, name: str, module: ModuleType, *arguments: str, answers: bool = False) -> Child:
        self._look()
        return self._processes.start(name, module.__name__, arguments, ONE_THREAD, answers=answers)

    def _write(self, name: str, spec: msgspec.Struct) -> str:
        path = self._scenario.folder / f"{name}.json"
        path.write_bytes(msgspec.json.encode(spec))
        return str(path)

    @property
    def _probe_file(self) -> Path:
        return self._scenario.folder / "probe.record"

    def _await_robots(self, operator: OperatorLink, end_s: float) -> None:
        """Wait until every robot's loop ticks: no guard's deadline may run while a sibling still starts."""
        while silent := operator.ask():
            self._look_before(end_s, f"robots {', '.join(map(str, silent))} did not answer in time")

    def _await_driving(self, operator: OperatorLink, end_s: float) -> None:
        """Wait until no robot waits for a state or a teammate: some carriers take seconds to connect."""
        while waiting := operator.await_driving():
            reasons = {robot_id: operator.standings[robot_id].stop_reason for robot_id in waiting}
            words = "; ".join(f"robot {robot_id}: {reason}" for robot_id, reason in reasons.items())
            self._look_before(end_s, f"not all robots drove in time ({words})")

    def _await_start(self, world: Child, end_s: float) -> RunStart:
        assert world.popen.stdout is not None  # noqa: S101 - for the type checker
        while not select.select((world.popen.stdout,), (), (), LOOK_S)[0]:
            self._look_before(end_s, "not all robots drove in time")
        return msgspec.json.decode(world.popen.stdout.readline(), type=RunStart)

    def _look_before(self, end_s: float, complaint: str) -> None:
        self._look()
        if self._ended:
            raise StartError(f"the team did not start: {'; '.join(self._ended.values())}")
        if time.monotonic() > end_s:
            words = "; ".join(f"{c.name} said: {c.last_line()}" for c in self._robots())
            raise StartError(f"{complaint}: {words}")

    def _follow(self, t0_s: float, injector: Injector) -> None:
        end_s, sample_s = t0_s + self._scenario.request.duration_s, t0_s
        while (now_s := time.monotonic()) < end_s:
            if now_s >= sample_s:
                self._meter.sample(now_s)
                sample_s += PERIOD_S
            injector.act(now_s - t0_s)
            self._look()
            if "world" in self._ended:
                raise BridgeError(self._ended["world"])
            next_s = min(end_s, sample_s, t0_s + injector.next_s, now_s + LOOK_S)
            time.sleep(max(next_s - time.monotonic(), 0.0))
        self._meter.sample(time.monotonic())

    def _look(self) -> None:
        """Notice who has ended, and whether a signal asks to."""
        if self._signals.reason:
            raise BridgeError(f"ended by {self._signals.reason}")
        for child in self._processes.children.values():
            code = child.popen.poll()
            surprising = code is not None and not child.expected_end and not _is_done(child, code)
            if surprising and child.name not in self._ended:
                self._ended[child.name] = f"{child.name} ended with {code}: {child.last_line()}"

    def _end(
        self, t0_s: float, end_s: float, world: Child, helpers: list[Child], injector: Injector
    ) -> Recording:
        for name in self._processes.ask_to_end(self._robots()):
            self._ended[name] = f"{name} did not end when asked to"
        self._processes.ask_to_end([*helpers, world])
        try:
            record = msgspec.msgpack.decode(
                record_path(self._scenario.folder / "world.json").read_bytes(), type=WorldRecord
            )
            probe = msgspec.msgpack.decode(self._probe_file.read_bytes(), type=ProbeRecord)
        except OSError as error:
            raise BridgeError(f"the plant left no record: {world.last_line()}") from error
        ended = tuple(self._ended.values())
        return Recording(
            t0_s,
            end_s,
            record,
            probe,
            self._reports(),
            self._logs(),
            self._meter.costs(),
            self._meter.others_cpu_cores(),
            injector.done_s,
            ended,
        )

    def _reports(self) -> dict[int, RunReport]:
        reports = {}
        for station in self._scenario.stations:
            path = report_path(self._scenario, station.robot_id)
            if path.is_file() and path.stat().st_size:
                reports[station.robot_id] = msgspec.json.decode(path.read_bytes(), type=RunReport)
        return reports

    def _logs(self) -> dict[int, RobotLog]:
        robots = [station.robot_id for station in self._scenario.stations]
        return {robot_id: read_robot_log(log_folder(self._scenario, robot_id)) for robot_id in robots}

    def _robots(self) -> list[Child]:
        return [self._processes.children[f"robot_{station.robot_id}"] for station in self._scenario.stations]


def _is_done(child: Child, code: int) -> bool:
    """Whether a helper ended because its part was over."""
    return code == 0 and child.name.startswith(("hog_", "hostile_", "operator_"))
