"""The same robot behind ROS 1 or ROS 2: its node is a process of its own, in a ROS that nobody else uses."""

import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import ClassVar

import msgspec

from benchmarks.faults.robot import DEADLINE_S, LIMITS, Robot
from edge_runtime.common.child import python_command
from edge_runtime.errors import BridgeError
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.ros.link import RosOptions
from firmware_bridge.ros.profile import profile_path
from firmware_bridge.sil.firmware.firmware import REST, Heard
from firmware_bridge.sil.firmware.ros_base import RosBase, open_wires
from firmware_bridge.sil.firmware.ros_node import NodesTask
from firmware_bridge.sil.scenario.ports import answers
from firmware_bridge.sil.scenario.ros_place import free_ros
from firmware_bridge.sil.scenario.vehicle import ROS, ros_folders

STARTING_S = 30.0
"""For a master to answer."""


class RosRobot(Robot):
    """A Husky; what ROS reads from its environment is set for its node and its guard."""

    braking_m_s2 = 3.0
    profile: ClassVar[str] = ""
    """Where it is another than the harness's."""
    namespace: ClassVar[str] = "/a200_0000"
    python_path: ClassVar[tuple[str, ...]] = ()
    """Where its ROS lies; empty: where the profile says."""

    def __init__(self) -> None:
        kind = ROS[self.name]
        self._ros, self._path = kind.ros, profile_path(self.profile or kind.profile)
        self._folders = ros_folders(self.name, self.python_path)
        self._home = tempfile.TemporaryDirectory()
        place = free_ros(kind.ros, Path(self._home.name))
        os.environ |= place.environment
        self._master = _start_master(place.port, self._folders) if place.port else None
        task = NodesTask(kind.ros, str(self._path), (self.namespace,), self._folders, kind.timeout_s)
        super().__init__(RosBase(kind.timeout_s), open_wires(task)[0])

    def close(self) -> None:
        """End node and master."""
        super().close()
        if self._master is not None:
            self._master.terminate()
            self._master.wait()
        self._home.cleanup()

    def spec(self) -> GuardSpec:
        """Return what a guard of this robot is started with."""
        options = RosOptions(self._ros, str(self._path), self.namespace, python_path=self._folders)
        raw = msgspec.Raw(msgspec.json.encode(options))
        return GuardSpec(self.name, 0, DEADLINE_S, LIMITS, raw, arm=True)

    def drives(self, heard: Heard) -> bool:
        """Whether it asks for any motion."""
        return heard.motion != REST


class Ros1Robot(RosRobot):
    """Under a master of its own."""

    name = "ros1"


class Ros2Robot(RosRobot):
    """In a domain of its own."""

    name = "ros2"


def ros2_robot(folder: str) -> type[Ros2Robot]:
    """Return the robot of a ROS 2 whose Python packages lie in a folder."""
    return type("Ros2Robot", (Ros2Robot,), {"python_path": (folder,)})


def _start_master(port: int, folders: tuple[str, ...]) -> "subprocess.Popen[bytes]":
    command = python_command("firmware_bridge.sil.firmware.ros_master", port, *folders)
    master = subprocess.Popen(command, stdout=subprocess.DEVNULL)  # noqa: S603 - our own interpreter and module
    end_s = time.monotonic() + STARTING_S
    while not answers(port):
        if time.monotonic() > end_s:
            raise BridgeError(f"no ROS master answers within {STARTING_S:g} s")
        time.sleep(0.05)
    return master
