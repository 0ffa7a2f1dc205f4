"""A base behind ROS, and the wire to its node, which is a process of its own; see `ros_node`."""

import contextlib
import math
from collections.abc import Iterable, Iterator

import msgspec

from edge_runtime.common.child import start_child
from firmware_bridge.sil.firmware.firmware import Firmware, Heard
from firmware_bridge.sil.firmware.ros_node import PACKET_BYTES, NodeTask, Twisted
from firmware_bridge.sil.firmware.world import BaseState

RosPacket = Twisted | BaseState


class RosBase(Firmware[RosPacket]):
    """Follows each command until its controller's timeout; tells its odometry."""

    def _take(self, packet: RosPacket, arrival_s: float) -> Iterable[RosPacket]:
        if isinstance(packet, Twisted):
            motion = (packet.forward_m_s, packet.yaw_rad_s)
            self._follow(motion, arrival_s)
            self.on_command(Heard(arrival_s, motion, packet))
        return ()

    def _telemetry(self, state: BaseState) -> Iterator[RosPacket]:
        if self.located and not self.stale:
            yield state._replace(forward_m_s=math.nan) if self.not_finite else state
            self.on_pose(self.clock())

    def _obeys(self) -> bool:
        return True

    def _damaged(self, packet: RosPacket) -> RosPacket:
        """Nothing that ROS carries arrives damaged; what is not finite stands for it."""
        return packet._replace(forward_m_s=math.nan) if isinstance(packet, BaseState) else packet


class RosWire:
    """The socket to a robot's node."""

    def __init__(self, task: NodeTask) -> None:
        self._socket, self._node = start_child("firmware_bridge.sil.firmware.ros_node", task)
        self._socket.setblocking(False)

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def receive(self) -> Iterator[tuple[RosPacket, float]]:
        """Yield the commands that have arrived."""
        with contextlib.suppress(BlockingIOError):
            while packet := self._socket.recv(PACKET_BYTES):
                heard = msgspec.json.decode(packet, type=Twisted)
                yield heard, heard.arrival_s

    def send(self, packet: RosPacket) -> None:
        """Hand over a state; a node that hangs loses it, the next one comes soon."""
        with contextlib.suppress(OSError):
            self._socket.send(msgspec.json.encode(packet))

    def close(self) -> None:
        """End the node."""
        self._socket.close()
        self._node.wait()
