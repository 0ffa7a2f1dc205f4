"""The same robot behind ROS 1 or ROS 2: its node is a process of its own, in a ROS that nobody else uses."""

import contextlib
import os
import random
import socket
import subprocess
import time
from typing import ClassVar, Literal

import msgspec

from benchmarks.faults.robot import DEADLINE_S, LIMITS, Robot
from edge_runtime.errors import BridgeError
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.ros.link import RosOptions
from firmware_bridge.ros.profile import load_profile, profile_path
from firmware_bridge.sil.firmware.firmware import REST, Heard
from firmware_bridge.sil.firmware.ros_base import RosBase, RosWire
from firmware_bridge.sil.firmware.ros_node import NodeTask
from firmware_bridge.sil.scenario.ports import HOST, free_ports

STARTING_S = 30.0
"""For a master to answer."""


class RosRobot(Robot):
    """A Husky; what ROS reads from its environment is set for its node and its guard."""

    braking_m_s2 = 3.0
    ros: ClassVar[Literal[1, 2]]
    profile: ClassVar[str]
    namespace: ClassVar[str] = ""
    python_path: ClassVar[tuple[str, ...]] = ()
    """Where its ROS lies; empty: where the profile says."""
    timeout_s: ClassVar[float]

    def __init__(self) -> None:
        self._path = profile_path(self.profile)
        self._folders = self.python_path or load_profile(self._path).python_path
        task = NodeTask(self.ros, str(self._path), self.namespace, self._folders, self.timeout_s)
        super().__init__(RosBase(self.timeout_s), RosWire(task))

    def spec(self) -> GuardSpec:
        """Return what a guard of this robot is started with."""
        options = RosOptions(self.ros, str(self._path), self.namespace, python_path=self._folders)
        raw = msgspec.Raw(msgspec.json.encode(options))
        return GuardSpec(self.name, 0, DEADLINE_S, LIMITS, raw, arm=True)

    def drives(self, heard: Heard) -> bool:
        """Whether it asks for any motion."""
        return heard.motion != REST


class Ros1Robot(RosRobot):
    """Under a master of its own."""

    name, ros, profile, timeout_s = "ros1", 1, "husky_noetic", 0.25

    def __init__(self) -> None:
        (port,) = free_ports(1)
        os.environ |= {"ROS_MASTER_URI": f"http://{HOST}:{port}", "ROS_IP": HOST}
        self._master = subprocess.Popen(  # noqa: S603 - ROS's own program
            ["rosmaster", "--core", "-p", str(port)],  # noqa: S607 - wherever ROS has put it
            stdout=subprocess.DEVNULL,
        )
        _await_port(port)
        super().__init__()

    def close(self) -> None:
        """End node and master."""
        super().close()
        self._master.terminate()
        self._master.wait()


class Ros2Robot(RosRobot):
    """In a domain of its own."""

    name, ros, profile, timeout_s = "ros2", 2, "clearpath_jazzy", 0.5
    namespace = "/a200_0000"

    def __init__(self) -> None:
        os.environ |= {
            "ROS_DOMAIN_ID": str(random.randrange(1, 100)),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        super().__init__()


def ros2_robot(folder: str) -> type[Ros2Robot]:
    """Return the robot of a ROS 2 whose Python packages lie in a folder."""
    return type("Ros2Robot", (Ros2Robot,), {"python_path": (folder,)})


def _await_port(port: int) -> None:
    end_s = time.monotonic() + STARTING_S
    while time.monotonic() < end_s:
        with contextlib.suppress(OSError), socket.create_connection((HOST, port)):
            return
        time.sleep(0.05)
    raise BridgeError(f"no rosmaster answers within {STARTING_S:g} s")
