"""``python -m firmware_bridge.sil.network.relay SPEC``: a network with faults between the robots' sockets.

Each robot has a port here; the others' fleet files name it instead of the robot's own. What arrives goes on
to the robot, unless the timeline's faults lose, repeat, hold back or change it. On Zenoh each pair of robots
has a port.
"""

import resource
import selectors
import sys
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.realtime import enter_realtime
from edge_runtime.common.signals import StopSignals
from edge_runtime.network.datagrams import Datagrams, listen
from firmware_bridge.sil.network.disturbance import Disturbance
from firmware_bridge.sil.network.packet_queue import PacketQueue
from firmware_bridge.sil.network.tunnel import TunnelEnds
from firmware_bridge.sil.scenario.faults import AnyFault
from firmware_bridge.sil.scenario.ports import HOST, TAKEN, Tunnel
from firmware_bridge.sil.scenario.start_gate import await_start

_PACKET_BYTES: Final = 65535


class Line(msgspec.Struct, frozen=True):
    """One robot's two ends."""

    robot_id: int
    relay_port: int
    robot_port: int


class RelaySpec(msgspec.Struct, frozen=True):
    """What the process is started with."""

    lines: tuple[Line, ...]
    tunnels: tuple[Tunnel, ...]
    faults: tuple[AnyFault, ...]
    seed: int
    realtime: bool
    """Scheduled like the robots: a network does not wait for a processor."""


class Relay:
    """The sockets, and the packets that are under way."""

    def __init__(self, spec: RelaySpec) -> None:
        self.queue = PacketQueue(Disturbance(spec.faults, spec.seed))
        self._senders = {line.robot_port: line.robot_id for line in spec.lines}
        self._selector = selectors.DefaultSelector()
        for line in spec.lines:
            one = listen((HOST, line.relay_port), _PACKET_BYTES, TAKEN)
            self._selector.register(one, selectors.EVENT_READ, partial(self._take, one, line))
        for tunnel in spec.tunnels:
            TunnelEnds(tunnel, self.queue, self._selector)

    def pass_on(self) -> None:
        """Wait for packets, or for the time of those under way, and pass them on."""
        for key, _ in self._selector.select(self.queue.wait_s):
            if self._selector.get_map().get(key.fd) == key:  # else one before it has closed it
                key.data()
        self.queue.flush()

    def _take(self, one: Datagrams, line: Line) -> None:
        send = partial(one.send, target=(HOST, line.robot_port))
        for datagram in one.receive():
            sender = self._senders.get(datagram.source[1], -1)
            self.queue.deliver(datagram.content, sender, line.robot_id, send)


def main(arguments: list[str]) -> int:
    """Run as the harness's child; before the run begins, the network is in order."""
    spec = msgspec.json.decode(Path(arguments[0]).read_bytes(), type=RelaySpec)
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))  # a tunnel takes five
    relay = Relay(spec)
    started = selectors.DefaultSelector()
    started.register(sys.stdin, selectors.EVENT_READ)
    with StopSignals() as signals:
        if spec.realtime:
            enter_realtime()
        while not signals.reason:
            if relay.queue.t0_s == float("inf") and started.select(0):
                relay.queue.t0_s = await_start()
            relay.pass_on()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
