"""A base behind ROS, and the wire to its node, which is in a process of its own; see `ros_node`."""

import contextlib
import math
import socket
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import msgspec

from edge_runtime.common.child import python_command
from edge_runtime.errors import BridgeError
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.firmware import Firmware, Heard
from firmware_bridge.sil.firmware.ros_node import PACKET_BYTES, NodesTask, Stop, Told, Twisted
from firmware_bridge.sil.firmware.world import BaseState

STOP_PERIOD_S: Final = 0.2
"""Of what the emergency stop says."""
RosPacket = Twisted | Told | Stop


class RosBase(Firmware[RosPacket]):
    """Follows each command until its controller's timeout; tells its odometry, and its emergency stop.

    It tells its odometry whether it is `located` or not: no guard opens a robot of ROS without.
    """

    def __init__(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(timeout_s, clock)
        self._stop_due_s = -math.inf

    def _take(self, packet: RosPacket, arrival_s: float) -> Iterable[RosPacket]:
        if isinstance(packet, Twisted):
            motion = BaseMotion(packet.forward_m_s, packet.lateral_m_s, packet.yaw_rad_s)
            self._follow(motion, arrival_s)
            self.on_command(Heard(arrival_s, motion, packet))
        return ()

    def _telemetry(self, state: BaseState) -> Iterator[RosPacket]:
        now_s = self.clock()
        if now_s >= self._stop_due_s:
            self._stop_due_s = now_s + STOP_PERIOD_S
            yield Stop(self.pressed)
        if not self.stale:
            told = Told(state, time.time())
            yield _not_finite(told) if self.not_finite else told
            self.on_pose(now_s)

    def _obeys(self) -> bool:
        return True

    def _damaged(self, packet: RosPacket) -> RosPacket:
        """Nothing that ROS carries arrives damaged; what is not finite stands for it."""
        return _not_finite(packet) if isinstance(packet, Told) else packet


def _not_finite(told: Told) -> Told:
    return Told(told.state._replace(forward_m_s=math.nan), told.stamp_s)


class RosWire:
    """The socket to a robot's node, and the process that has it."""

    def __init__(self, end: socket.socket, process: "subprocess.Popen[bytes]") -> None:
        self._socket, self._process = end, process
        self._socket.setblocking(False)

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def receive(self) -> Iterator[tuple[RosPacket, float]]:
        """Yield the commands that have arrived.

        Raises:
            BridgeError: if the nodes have ended.
        """
        while True:
            try:
                packet = self._socket.recv(PACKET_BYTES)
            except BlockingIOError:
                return
            except OSError:
                packet = b""
            if not packet:
                raise BridgeError("the robots' ROS nodes have ended")
            heard = msgspec.msgpack.decode(packet, type=Twisted)
            yield heard, heard.arrival_s

    def send(self, packet: RosPacket) -> None:
        """Hand over a state; a node that hangs loses it, the next one comes soon."""
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(packet))

    def close(self) -> None:
        """End the nodes, all of them."""
        self._socket.close()
        self._process.wait()


def open_wires(task: NodesTask) -> list[RosWire]:
    """Start the robots' nodes and return the wire to each, in the task's order."""
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in task.namespaces]
    ends = [theirs.fileno() for _, theirs in pairs]
    process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
        python_command(
            "firmware_bridge.sil.firmware.ros_node",
            ",".join(map(str, ends)),
            msgspec.json.encode(task).decode(),
        ),
        pass_fds=ends,
        stdin=subprocess.DEVNULL,
    )
    for _, theirs in pairs:
        theirs.close()
    return [RosWire(ours, process) for ours, _ in pairs]
