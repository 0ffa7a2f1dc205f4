"""Where poses come from: each feed publishes what it has until it ends."""

import contextlib
import math
import select
import socket
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from edge_runtime.errors import ConfigError
from edge_runtime.network.clock_offset import RemoteClock
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
        velocity = fit.follow(sample.t, (sample.x, sample.y))
        if sample.vx is not None and sample.vy is not None:
            velocity = sample.vx, sample.vy
        if velocity:
            host.publish(Kind.POSE, sample.robot, stamp_s, (sample.x, sample.y, *velocity, sample.heading))


class NatNetFeed:
    """Rigid bodies from Motive: a context manager.

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
        self._command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
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

    def __enter__(self) -> "NatNetFeed":
        """Nothing more needs opening."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the sockets."""
        self.close()

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
                self._ask(keep_alive_packet() if now - self._heard_s < SILENT_S else connect_packet())
                alive_s = now + KEEP_ALIVE_S
            if (packet := self._hear(self._data, LISTEN_S)) is not None:
                self._take(packet, time.monotonic(), host)
            host.listen()

    def _ask(self, packet: bytes) -> None:
        with contextlib.suppress(OSError):  # as good as lost: the next one may arrive
            self._command.sendto(packet, self._place)

    def _hear(self, data: socket.socket, seconds: float) -> bytes | None:
        """Return the next packet; None if none came, or one from a stranger."""
        if not select.select((data,), (), (), seconds)[0]:
            return None
        try:
            packet, (address, _) = data.recvfrom(PACKET_BYTES)
        except OSError:
            return None  # word that nobody is there
        return packet if data is not self._command or address == self._place[0] else None

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
            if velocity := self._fits[robot_id].follow(frame.stamp_s, position_m):
                host.publish(Kind.POSE, robot_id, stamp_s, (*position_m, *velocity, heading_rad))

    def _connect(self) -> Server:
        asked_s, end_s = -math.inf, time.monotonic() + CONNECT_S
        while (now := time.monotonic()) < end_s:
            if now - asked_s >= CONNECT_AGAIN_S:
                self._ask(connect_packet())
                asked_s = now
            packet = self._hear(self._command, LISTEN_S)
            with contextlib.suppress(NatNetError):  # junk is passed over
                if packet is not None and (server := read_server(packet)):
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


def _join(group: str, port: int, local: str) -> socket.socket:
    data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        data.bind((group, port))
        membership = socket.inet_aton(group) + socket.inet_aton(local)
        data.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    except OSError:
        data.close()
        raise
    return data
