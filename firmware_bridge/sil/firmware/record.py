"""What came and went at one firmware while a team drove."""

from typing import Any, NamedTuple

import msgspec

from firmware_bridge.sil.firmware.firmware import Firmware, Heard
from firmware_bridge.sil.measurement.samples import Samples


class Pace(NamedTuple):
    """What a recorder will have to hold."""

    commands_hz: float
    poses_hz: float
    duration_s: float


class NodeRecord(msgspec.Struct, frozen=True):
    """What came and went at one firmware; all times are of CLOCK_MONOTONIC, which the processes share."""

    robot_id: int
    command_s: list[float]
    """When the kernel took each setpoint off the wire."""
    forward_m_s: list[float]
    """What each asked for."""
    lateral_m_s: list[float]
    yaw_rad_s: list[float]
    pose_s: list[float]
    """When each pose was measured, which is when it was sent."""
    timeouts: int
    """How many times this firmware stopped by itself."""
    pose_x_m: list[float] = []
    """Where each pose was, if it came in a stream: by that a robot's log tells which one it used."""


class NodeRecorder:
    """Listens to one firmware.

    Args:
        robot_id: whose it is.
        firmware: what it listens to.
        pace: how much will come.
        streamed: the robot hears its poses from a stream, see `take_pose`, not from its firmware.
    """

    def __init__(self, robot_id: int, firmware: Firmware[Any], pace: Pace, *, streamed: bool = False) -> None:
        self._robot_id, self._firmware = robot_id, firmware
        commands_hz, poses_hz, duration_s = pace
        commands = (Samples(commands_hz, duration_s) for _ in range(4))
        self._command_s, self._forward, self._lateral, self._yaw = commands
        self._pose_s, self._pose_x_m = (Samples(poses_hz, duration_s) for _ in range(2))
        firmware.on_command = self._take
        if not streamed:
            firmware.on_pose = self._pose_s.append

    def take_pose(self, measured_s: float, x_m: float) -> None:
        """Take in a pose of the robot's stream."""
        self._pose_s.append(measured_s)
        self._pose_x_m.append(x_m)

    def record(self) -> NodeRecord:
        """Return everything so far."""
        return NodeRecord(
            self._robot_id,
            self._command_s.tolist(),
            self._forward.tolist(),
            self._lateral.tolist(),
            self._yaw.tolist(),
            self._pose_s.tolist(),
            self._firmware.timeouts,
            self._pose_x_m.tolist(),
        )

    def _take(self, heard: Heard) -> None:
        if heard.motion is not None:
            self._command_s.append(heard.arrival_s)
            self._forward.append(heard.motion.forward_m_s)
            self._lateral.append(heard.motion.lateral_m_s)
            self._yaw.append(heard.motion.yaw_rad_s)
