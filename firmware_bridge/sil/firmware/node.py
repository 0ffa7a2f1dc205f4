"""A firmware node: the robot's end of the wire, with a command timeout of its own and a record of its own."""

import abc
import time
from typing import Final, NamedTuple

import msgspec

from edge_runtime.messages import Vector2
from firmware_bridge.sil.firmware.world import Pose
from firmware_bridge.sil.measurement.samples import Samples

REST: Vector2 = (0.0, 0.0)
LONGEST_QUEUE_S: Final = 1.0
"""No frame waits longer to be read."""


class Pace(NamedTuple):
    """What a node will have to record."""

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
    yaw_rad_s: list[float]
    pose_s: list[float]
    """When each pose was measured, which is when it was sent."""
    timeouts: int
    """How many times this firmware stopped by itself."""


class FirmwareNode(abc.ABC):
    """What both kinds share: the newest motion, how long it holds, and the record."""

    timeout_s = 0.5
    """Silence after which this firmware stops by itself."""

    def __init__(self, robot_id: int, pace: Pace) -> None:
        self.robot_id = robot_id
        self.stale = self.corrupt = self.not_finite = False
        """Faults: the pose stands still in time, frames are damaged, the pose is not a number."""
        self.located = False
        """Whether it tells its pose already. Before, its runtime commands nothing, and its guard waits."""
        self._motion = REST
        self._fresh_until_s = 0.0
        self._timeouts = self._obeyed = 0
        commands_hz, poses_hz, duration_s = pace
        self._command_s, self._forward, self._yaw = (Samples(commands_hz, duration_s) for _ in range(3))
        self._pose_s = Samples(poses_hz, duration_s)

    @property
    def setpoints(self) -> int:
        """How many setpoints have arrived that this firmware obeyed."""
        return self._obeyed

    @abc.abstractmethod
    def fileno(self) -> int:
        """Return the wire's descriptor."""

    @abc.abstractmethod
    def close(self) -> None:
        """Let the wire go."""

    @abc.abstractmethod
    def receive(self) -> None:
        """Take in and obey everything that has arrived."""

    @abc.abstractmethod
    def report(self, pose: Pose) -> None:
        """Send the pose, and what else is due."""

    def motion(self, now_s: float) -> Vector2:
        """Return the (forward m/s, yaw rad/s) to follow: rest, once the commands have ended."""
        if self._motion != REST and now_s > self._fresh_until_s:
            self._motion = REST
            self._timeouts += 1
        return self._motion

    def record(self) -> NodeRecord:
        """Return everything so far."""
        return NodeRecord(
            self.robot_id,
            self._command_s.tolist(),
            self._forward.tolist(),
            self._yaw.tolist(),
            self._pose_s.tolist(),
            self._timeouts,
        )

    def _follow(self, arrival_s: float, motion: Vector2, *, obeys: bool) -> None:
        self._motion, self._fresh_until_s = motion if obeys else REST, arrival_s + self.timeout_s
        self._obeyed += obeys
        self._command_s.append(arrival_s)
        self._forward.append(motion[0])
        self._yaw.append(motion[1])

    def _halt(self) -> None:
        self._motion = REST

    def _sent_pose(self, stamp_s: float) -> None:
        self._pose_s.append(stamp_s)


def to_monotonic(stamp_s: float) -> float:
    """Turn a kernel's stamp of arrival, which is of the wall clock, into monotonic time.

    A stamp from before the wall clock was set means nothing: then the frame counts as arriving now.
    """
    now_s = time.monotonic()
    waited_s = time.time() - stamp_s
    return now_s - waited_s if 0.0 <= waited_s < LONGEST_QUEUE_S else now_s
