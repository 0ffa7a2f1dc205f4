"""``python -m firmware_bridge.sil.relay SPEC``: a network with faults, between the robots' own sockets.

Each robot has a port here; the others' fleet files name it instead of the robot's own. What arrives goes on
to the robot, unless the timeline's faults lose, repeat, hold back or change it. Seeded.
"""

import heapq
import random
import selectors
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from edge_runtime.realtime import enter_realtime
from edge_runtime.signals import StopSignals
from firmware_bridge.sil.faults import (
    AnyFault,
    Blackout,
    CorruptPackets,
    Delay,
    Duplicate,
    NetworkFault,
    Reorder,
    SharedFault,
)
from firmware_bridge.sil.helper import await_start
from firmware_bridge.sil.team_file import HOST

_PACKET_BYTES = 65535
_IDLE_S = 0.1


class Line(msgspec.Struct, frozen=True):
    """One robot's two ends."""

    robot_id: int
    relay_port: int
    robot_port: int


class RelaySpec(msgspec.Struct, frozen=True):
    """What the process is started with."""

    lines: tuple[Line, ...]
    faults: tuple[AnyFault, ...]
    seed: int
    realtime: bool
    """Scheduled like the robots: a network does not wait for a processor."""


class Disturbance:
    """What the faults make of packets.

    Args:
        faults: those that are not of the network are passed over.
        seed: of the draws.
    """

    def __init__(self, faults: tuple[AnyFault, ...], seed: int) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, NetworkFault)]
        self._draw = random.Random(seed)

    def deliveries(
        self, packet: bytes, sender: int, receiver: int, elapsed_s: float
    ) -> Iterator[tuple[float, bytes]]:
        """Yield (delay in s, packet) of each copy that arrives."""
        copies = [(0.0, packet)]
        for fault in self._faults:
            if fault.at_s <= elapsed_s < fault.end_s and self._concerns(fault, sender, receiver):
                copies = [changed for copy in copies for changed in self._change(fault, *copy)]
        yield from copies

    def _concerns(self, fault: NetworkFault, sender: int, receiver: int) -> bool:
        return fault.robots is None or sender in fault.robots or receiver in fault.robots

    def _change(self, fault: NetworkFault, delay_s: float, packet: bytes) -> list[tuple[float, bytes]]:
        chance = self._draw.random()
        match fault:
            case Blackout():
                return []
            case Delay():
                return [(delay_s + 1e-3 * (fault.delay_ms + fault.jitter_ms * chance), packet)]
            case SharedFault() if chance < fault.share:
                return self._strike(fault, delay_s, packet)
        return [(delay_s, packet)]

    def _strike(self, fault: SharedFault, delay_s: float, packet: bytes) -> list[tuple[float, bytes]]:
        match fault:
            case Duplicate():
                return [(delay_s, packet)] * 2
            case Reorder():
                return [(delay_s + 1e-3 * fault.hold_ms, packet)]
            case CorruptPackets():
                return [(delay_s, self._changed(packet))]
        return []  # lost

    def _changed(self, packet: bytes) -> bytes:
        changed = bytearray(packet)
        changed[self._draw.randrange(len(changed))] ^= 1 << self._draw.randrange(8)
        return bytes(changed)


class Relay:
    """The sockets, and the packets that are under way."""

    def __init__(self, spec: RelaySpec) -> None:
        self._disturbance = Disturbance(spec.faults, spec.seed)
        self._senders = {line.robot_port: line.robot_id for line in spec.lines}
        self._selector = selectors.DefaultSelector()
        for line in spec.lines:
            one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            one.setblocking(False)
            one.bind((HOST, line.relay_port))
            self._selector.register(one, selectors.EVENT_READ, line)
        self._under_way: list[tuple[float, int, socket.socket, int, bytes]] = []
        self._count = 0

    def pass_on(self, t0_s: float) -> None:
        """Wait for packets, or for the time of those under way, and pass them on."""
        wait_s = min(self._under_way[0][0] - time.monotonic() if self._under_way else _IDLE_S, _IDLE_S)
        for key, _ in self._selector.select(max(wait_s, 0.0)):
            assert isinstance(key.fileobj, socket.socket)  # noqa: S101 - for the type checker
            self._take(key.fileobj, key.data, t0_s)
        while self._under_way and self._under_way[0][0] <= time.monotonic():
            _, _, one, port, packet = heapq.heappop(self._under_way)
            self._send(one, port, packet)

    def _take(self, one: socket.socket, line: Line, t0_s: float) -> None:
        while True:
            try:
                packet, (_, port) = one.recvfrom(_PACKET_BYTES)
            except (BlockingIOError, ConnectionRefusedError):
                return
            now_s, sender = time.monotonic(), self._senders.get(port, -1)
            for delay_s, copy in self._disturbance.deliveries(packet, sender, line.robot_id, now_s - t0_s):
                if delay_s == 0.0:
                    self._send(one, line.robot_port, copy)
                else:
                    self._count += 1  # packets due at the same time leave in the order of arrival
                    item = (now_s + delay_s, self._count, one, line.robot_port, copy)
                    heapq.heappush(self._under_way, item)

    def _send(self, one: socket.socket, port: int, packet: bytes) -> None:
        try:
            one.sendto(packet, (HOST, port))
        except (BlockingIOError, ConnectionRefusedError):
            return  # a robot that is gone, or a full queue: the packet is lost, as on any network


def main(arguments: list[str]) -> int:
    """Run as the harness's child; before the run begins, the network is in order."""
    spec = msgspec.json.decode(Path(arguments[0]).read_bytes(), type=RelaySpec)
    relay = Relay(spec)
    started = selectors.DefaultSelector()
    started.register(sys.stdin, selectors.EVENT_READ)
    t0_s = float("inf")
    with StopSignals() as signals:
        if spec.realtime:
            enter_realtime()
        while not signals.reason:
            if t0_s == float("inf") and started.select(0):
                t0_s = await_start()
            relay.pass_on(t0_s)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
