"""Where poses come from: each feed publishes what it has until it ends."""

import contextlib
import math
import socket
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from edge_runtime.common.closing import Closing
from edge_runtime.errors import ConfigError
from edge_runtime.network.clock_offset import RemoteClock
from edge_runtime.network.datagrams import Datagram, Datagrams, speak
from edge_runtime.network.stream_wire import Kind
from edge_runtime.tools.pose.natnet import (
    COMMAND_PORT,
    PACKET_BYTES,
    NatNetError,
    Server,
    Up,
    check_version,
    connect_packet,
    keep_alive_packet,
    read_frame,
    read_server,
)
from edge_runtime.tools.pose.recording import Sample
from edge_runtime.tools.pose.stream_host import StreamHost
from edge_runtime.tools.pose.velocity import VelocityFit

CONNECT_S: Final = 5.0
"""How long a server may take to answer."""
CONNECT_AGAIN_S: Final = 0.5
KEEP_ALIVE_S: Final = 1.0
SILENT_S: Final = 2.0
"""A server that has sent no frame for so long is asked again as at first: it may have started anew."""
LISTEN_S: Final = 0.002
"""How long robots' requests are waited for at a time."""


def replay(samples: Sequence[Sample], host: StreamHost, ending: Callable[[], str]) -> None:
    """Publish a recording in its own time, from when all its robots' streams are asked for."""
    streams = {(sample.robot, sample.ranges is None) for sample in samples}
    while host.listening < len(streams):
        if ending():
            return
        host.listen(LISTEN_S)
    fits: dict[int, VelocityFit] = defaultdict(VelocityFit)
    start_s = time.monotonic() - samples[0].t
    for sample in samples:
        while (left_s := start_s + sample.t - time.monotonic()) > 0.0:
            if ending():
                return
            host.listen(min(left_s, LISTEN_S))
        _publish(sample, fits[sample.robot], host, start_s + sample.t)


def _publish(sample: Sample, fit: VelocityFit, host: StreamHost, stamp_s: float) -> None:
    if sample.ranges is not None:
        host.publish(Kind.RANGES, sample.robot, stamp_s, sample.ranges)
    elif sample.x is not None and sample.y is not None:
        velocity = fit.add(sample.t, (sample.x, sample.y))
        if sample.vx is not None and sample.vy is not None:
            velocity = sample.vx, sample.vy
        if velocity:
            host.publish(Kind.POSE, sample.robot, stamp_s, (sample.x, sample.y, *velocity, sample.heading))


class NatNetFeed(Closing):
    """Rigid bodies from Motive.

    Args:
        server: Motive's IP address.
        robots: id of the robot that carries a rigid body, by the body's streaming id.
        up: see `edge_runtime.tools.pose.natnet.Up`.

    Raises:
        ConfigError: if nobody answers there, or speaks a version that is not read here.
    """

    def __init__(self, server: str, robots: Mapping[int, int], up: Up, port: int = COMMAND_PORT) -> None:
        self._place, self._robots, self._up = (server, port), robots, up
        self._fits: dict[int, VelocityFit] = defaultdict(VelocityFit)
        self._clock = RemoteClock()
        self._command = speak(server, PACKET_BYTES)
        self._data = self._command
        self.refused = 0
        """Packets that were not NatNet."""
        self._heard_s = time.monotonic()
        """When the newest frame came."""
        try:
            self._server = self._connect()
            if self._server.group:
                self._data = _join(*self._server.group, self._local_address())
        except OSError as error:
            self.close()
            raise ConfigError(f"--natnet {server}: {error.strerror or error}") from error
        except ConfigError as error:
            self.close()
            raise ConfigError(f"--natnet {server}: {error}") from error

    def close(self) -> None:
        """Give the network back."""
        self._command.close()
        self._data.close()

    def publish(self, host: StreamHost, ending: Callable[[], str]) -> None:
        """Publish every tracked body as it comes; a network that is gone for a while is waited for."""
        alive_s = 0.0
        while not ending():
            now = time.monotonic()
            if now >= alive_s:
                packet = keep_alive_packet() if now - self._heard_s < SILENT_S else connect_packet()
                self._command.send(packet, self._place)
                alive_s = now + KEEP_ALIVE_S
            for datagram in self._hear(self._data):
                self._take(datagram.content, datagram.arrival_s, host)
            host.listen()

    def _hear(self, data: Datagrams) -> Iterator[Datagram]:
        """Yield the packets that arrive in `LISTEN_S`, but no stranger's."""
        data.wait(LISTEN_S)
        for datagram in data.receive():
            if data is not self._command or datagram.source[0] == self._place[0]:
                yield datagram

    def _take(self, packet: bytes, arrival_s: float, host: StreamHost) -> None:
        try:
            frame = read_frame(packet, self._server.version)
        except NatNetError:
            self.refused += 1
            return
        if frame is None:
            return
        self._heard_s = arrival_s
        self._clock.heard(frame.stamp_s, arrival_s)
        stamp_s = self._clock.local_s(frame.stamp_s)
        for body in frame.bodies:
            robot_id = self._robots.get(body.id)
            if robot_id is None or not body.tracked:
                continue
            position_m, heading_rad = body.planar(self._up)
            if velocity := self._fits[robot_id].add(frame.stamp_s, position_m):
                host.publish(Kind.POSE, robot_id, stamp_s, (*position_m, *velocity, heading_rad))

    def _connect(self) -> Server:
        asked_s, end_s = -math.inf, time.monotonic() + CONNECT_S
        while (now := time.monotonic()) < end_s:
            if now - asked_s >= CONNECT_AGAIN_S:
                self._command.send(connect_packet(), self._place)
                asked_s = now
            for datagram in self._hear(self._command):
                with contextlib.suppress(NatNetError):  # junk is passed over
                    if server := read_server(datagram.content):
                        check_version(server.version)
                        return server
        raise ConfigError(
            f"no answer on port {self._place[1]} within {CONNECT_S:g} s; "
            "is streaming enabled in Motive, and does it use this network?"
        )

    def _local_address(self) -> str:
        """Our own address on the way to the server: where its group is to be joined."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
            way.connect(self._place)
            return str(way.getsockname()[0])


def _join(group: str, port: int, local: str) -> Datagrams:
    data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        data.bind((group, port))
        membership = socket.inet_aton(group) + socket.inet_aton(local)
        data.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    except OSError:
        data.close()
        raise
    return Datagrams(data, PACKET_BYTES)
