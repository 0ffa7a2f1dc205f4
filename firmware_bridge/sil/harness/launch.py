"""Starts the processes of a run: the world, the robots, and whoever helps or hinders them."""

import time
from types import ModuleType
from typing import Final

import msgspec

from firmware_bridge.sil.firmware import ros_master, world_process
from firmware_bridge.sil.firmware.world_process import WorldSpec
from firmware_bridge.sil.harness import cpu_hog
from firmware_bridge.sil.harness.lookout import Lookout
from firmware_bridge.sil.harness.robots import MODULE, probe_path, robot_arguments
from firmware_bridge.sil.measurement import wake_probe
from firmware_bridge.sil.measurement.processes import Child, ProcessGroup
from firmware_bridge.sil.network import attacker, relay
from firmware_bridge.sil.network.attacker import HostileSpec
from firmware_bridge.sil.network.relay import Line, RelaySpec
from firmware_bridge.sil.scenario.faults import CpuHog, Hostile
from firmware_bridge.sil.scenario.ports import answers
from firmware_bridge.sil.scenario.scenario import Scenario
from firmware_bridge.sil.scenario.vehicle import ros_folders

MASTER_S = 30.0
"""Longest wait for a ROS master."""
LOOK_S = 0.05
APART_S = 0.5
"""Between two robots' starts: a runtime that starts takes a core, and waits only so long for its guard."""
ONE_THREAD: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class Launch:
    """Starts what a scenario asks for; looks between any two starts."""

    def __init__(self, scenario: Scenario, processes: ProcessGroup, lookout: Lookout) -> None:
        self._scenario, self._processes, self._lookout = scenario, processes, lookout
        self._environment = {**ONE_THREAD, **scenario.ros.environment}
        self._ports = {station.robot_id: station.port for station in scenario.stations}

    def master(self) -> list[Child]:
        """Start ROS 1's master, where the robots need one, and wait until it answers.

        Raises:
            StartError: if it does not.
        """
        request, port = self._scenario.request, self._scenario.ros.port
        if not port:
            return []
        master = self._start("master", ros_master, str(port), *ros_folders(request.bridge, request.ros_path))
        end_s = time.monotonic() + MASTER_S
        while not answers(port):
            self._lookout.look_before(end_s, "the ROS master did not answer in time")
            time.sleep(LOOK_S)
        return [master]

    def world(self) -> Child:
        """Start plant and firmware."""
        scenario, request = self._scenario, self._scenario.request
        spec = WorldSpec(
            request.bridge,
            request.rate_hz,
            request.duration_s,
            str(request.policy or ""),
            request.realtime,
            scenario.stations,
            scenario.faults,
            request.pose_hz,
            request.ros_path,
            scenario.fleet.obstacles,
        )
        return self._start("world", world_process, self._write("world", spec), answers=True)

    def helpers(self) -> list[Child]:
        """Start the probe, the network with faults, and those that the timeline sets on the team."""
        request = self._scenario.request
        realtime = ["realtime"] if request.realtime else []
        helpers = [
            self._start(
                "probe", wake_probe, str(probe_path(self._scenario)), str(request.duration_s), *realtime
            )
        ]
        if self._scenario.relays or self._scenario.tunnels:
            helpers.append(self._relay())
        for index, fault in enumerate(self._scenario.faults):
            match fault:
                case CpuHog():
                    times = (str(fault.at_s), str(fault.for_s))
                    hogs = [f"hog_{index}_{number}" for number in range(fault.processes)]
                    helpers += [self._start(name, cpu_hog, *times) for name in hogs]
                case Hostile():
                    path = self._write(f"hostile_{index}", HostileSpec(self._ports, fault))
                    helpers.append(self._start(f"hostile_{index}", attacker, path))
        return helpers

    def robots(self) -> list[Child]:
        """Start the robots, one after the other."""
        robots = []
        for station in self._scenario.stations:
            self._lookout.look()
            name, arguments = f"robot_{station.robot_id}", robot_arguments(self._scenario, station)
            robots.append(self._processes.start(name, MODULE, arguments, self._environment))
            time.sleep(APART_S)
        return robots

    def _relay(self) -> Child:
        scenario = self._scenario
        lines = tuple(Line(robot_id, port, self._ports[robot_id]) for robot_id, port in scenario.relays)
        spec = RelaySpec(lines, scenario.tunnels, scenario.faults, seed=0, realtime=scenario.request.realtime)
        return self._start("relay", relay, self._write("relay", spec))

    def _start(self, name: str, module: ModuleType, *arguments: str, answers: bool = False) -> Child:
        self._lookout.look()
        return self._processes.start(name, module.__name__, arguments, self._environment, answers=answers)

    def _write(self, name: str, spec: msgspec.Struct) -> str:
        path = self._scenario.folder / f"{name}.json"
        path.write_bytes(msgspec.json.encode(spec))
        return str(path)
