"""Runs a scenario: starts everything, follows the timeline, ends everything, hands back what was recorded."""

import os
import select
import time

import msgspec

from edge_runtime.common.signals import StopSignals
from edge_runtime.errors import BridgeError
from edge_runtime.tools.ctl.operator_link import OperatorLink
from firmware_bridge.sil.harness.injector import Injector
from firmware_bridge.sil.harness.launch import Launch
from firmware_bridge.sil.harness.lookout import Lookout
from firmware_bridge.sil.harness.recording import Recording, read_logs, read_records, read_reports
from firmware_bridge.sil.harness.robots import open_operator
from firmware_bridge.sil.measurement.process_meter import PERIOD_S, Meter
from firmware_bridge.sil.measurement.processes import Child, ProcessGroup
from firmware_bridge.sil.scenario.scenario import Scenario
from firmware_bridge.sil.scenario.start_gate import RunStart

STARTING_S = 30.0
STARTING_A_ROBOT_S = 3.0
"""Longest wait until all robots drive: so long, and so much more for each."""
LOOK_S = 0.05
"""How often the harness looks whether everybody is alive."""


class Harness:
    """One run of one scenario."""

    def __init__(self, scenario: Scenario, processes: ProcessGroup, signals: StopSignals) -> None:
        self._scenario, self._processes = scenario, processes
        self._lookout = Lookout(processes, signals)
        self._meter = Meter(processes, os.getpid(), scenario.request.duration_s)

    def run(self) -> Recording:
        """Run to the end.

        Raises:
            StartError: if the team never drove.
            BridgeError: if the plant died, or a signal asked to end.
        """
        launch = Launch(self._scenario, self._processes, self._lookout)
        masters = launch.master()
        world, helpers, robots = launch.world(), launch.helpers(), launch.robots()
        start = self._await_start(world)
        for helper in helpers:
            helper.tell(msgspec.json.encode(start).decode())
        injector = Injector(self._scenario.faults, self._processes, self._scenario.stations[0].fleet_file)
        try:
            self._follow(start.t0_s, injector)
        finally:
            injector.restore()
        for name in self._processes.ask_to_end(robots):
            self._lookout.ended[name] = f"{name} did not end when asked to"
        self._processes.ask_to_end([*helpers, world, *masters])
        return self._recording(start.t0_s, world, injector)

    def _await_start(self, world: Child) -> RunStart:
        """Let the robots know where they are once all of them tick, and wait until they drive."""
        end_s = time.monotonic() + STARTING_S + STARTING_A_ROBOT_S * len(self._scenario.stations)
        with open_operator(self._scenario) as operator:
            self._await_robots(operator, end_s)
            world.tell("go")
            self._await_driving(operator, end_s)
        world.tell("all drive")
        assert world.popen.stdout is not None  # noqa: S101 - for the type checker
        while not select.select((world.popen.stdout,), (), (), LOOK_S)[0]:
            self._lookout.look_before(end_s, "not all robots drove in time")
        return msgspec.json.decode(world.popen.stdout.readline(), type=RunStart)

    def _await_robots(self, operator: OperatorLink, end_s: float) -> None:
        """Wait until every robot's loop ticks: no guard's deadline may run while a sibling still starts."""
        while silent := operator.ask():
            complaint = f"robots {', '.join(map(str, silent))} did not answer in time"
            self._lookout.look_before(end_s, complaint)

    def _await_driving(self, operator: OperatorLink, end_s: float) -> None:
        """Wait until no robot waits for a state or a teammate: some carriers take seconds to connect."""
        while waiting := operator.await_driving():
            reasons = {robot_id: operator.standings[robot_id].stop_reason for robot_id in waiting}
            words = "; ".join(f"robot {robot_id}: {reason}" for robot_id, reason in reasons.items())
            self._lookout.look_before(end_s, f"not all robots drove in time ({words})")

    def _follow(self, t0_s: float, injector: Injector) -> None:
        end_s, sample_s = t0_s + self._scenario.request.duration_s, t0_s
        while (now_s := time.monotonic()) < end_s:
            if now_s >= sample_s:
                self._meter.sample(now_s)
                sample_s += PERIOD_S
            injector.act(now_s - t0_s)
            self._lookout.look()
            if "world" in self._lookout.ended:
                raise BridgeError(self._lookout.ended["world"])
            next_s = min(end_s, sample_s, t0_s + injector.next_s, now_s + LOOK_S)
            time.sleep(max(next_s - time.monotonic(), 0.0))
        self._meter.sample(time.monotonic())

    def _recording(self, t0_s: float, world: Child, injector: Injector) -> Recording:
        try:
            record, probe = read_records(self._scenario)
        except OSError as error:
            raise BridgeError(f"the plant left no record: {world.last_line()}") from error
        return Recording(
            t0_s,
            t0_s + self._scenario.request.duration_s,
            record,
            probe,
            read_reports(self._scenario),
            read_logs(self._scenario),
            self._meter.costs(),
            self._meter.others_cpu_cores(),
            injector.done_s,
            tuple(self._lookout.ended.values()),
        )
