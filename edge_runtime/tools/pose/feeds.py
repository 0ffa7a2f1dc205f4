"""Where poses come from: each feed publishes what it has until it ends."""

import contextlib
import math
import socket
import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Final

from edge_runtime.common.closing import Closing
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Vector
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
from edge_runtime.tools.pose.velocity import MotionFit

Subject = int | str
"""A robot by its id, or a tracked object by its name."""
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
    streams = {(sample.robot, sample.ranges is None) for sample in samples if sample.object is None}
    objects = {sample.object for sample in samples if sample.object is not None}
    while host.listening < len(streams) + len(objects) * host.robots:
        if ending():
            return
        host.listen(LISTEN_S)
    fits: dict[Subject | None, MotionFit] = defaultdict(MotionFit)
    start_s = time.monotonic() - samples[0].t
    for sample in samples:
        while (left_s := start_s + sample.t - time.monotonic()) > 0.0:
            if ending():
                return
            host.listen(min(left_s, LISTEN_S))
        subject = sample.robot if sample.object is None else sample.object
        _publish(sample, fits[subject], host, start_s + sample.t)


def _publish(sample: Sample, fit: MotionFit, host: StreamHost, stamp_s: float) -> None:
    subject = sample.robot if sample.object is None else sample.object
    if sample.ranges is not None and sample.robot is not None:
        host.publish(Kind.RANGES, sample.robot, stamp_s, sample.ranges)
    elif subject is not None and sample.x is not None and sample.y is not None:
        place: Vector = (sample.x, sample.y) if sample.z is None else (sample.x, sample.y, sample.z)
        motion = fit.add(sample.t, place, sample.heading)
        if sample.vx is not None and sample.vy is not None:
            velocity = (sample.vx, sample.vy) if sample.vz is None else (sample.vx, sample.vy, sample.vz)
            motion = velocity, motion[1] if motion else 0.0
        if motion:
            _tell(host, subject, stamp_s, place, sample.heading, *motion)


def _tell(
    host: StreamHost,
    subject: Subject,
    stamp_s: float,
    position_m: Vector,
    heading_rad: float,
    velocity_m_s: Vector,
    yaw_rate_rad_s: float,
) -> None:
    """Publish the motion of a robot, told by its id, or of an object, told by its name."""
    values = (*position_m, *velocity_m_s, heading_rad, yaw_rate_rad_s)
    if isinstance(subject, str):
        host.publish_object(subject, stamp_s, values)
    else:
        host.publish(Kind.POSE, subject, stamp_s, values)


class NatNetFeed(Closing):
    """Rigid bodies from Motive.

    Args:
        server: Motive's IP address.
        carriers: who carries a rigid body, a robot's id or an object's name, by the body's streaming id.
        up: see `edge_runtime.tools.pose.natnet.Up`.
        flying: ids of the robots that move in space, and names of the objects among them.

    Raises:
        ConfigError: if nobody answers there, or speaks a version that is not read here.
    """

    def __init__(
        self,
        server: str,
        carriers: Mapping[int, Subject],
        up: Up,
        port: int = COMMAND_PORT,
        flying: Collection[int | str] = (),
    ) -> None:
        self._place, self._carriers, self._up, self._flying = (server, port), carriers, up, flying
        self._fits: dict[Subject, MotionFit] = defaultdict(MotionFit)
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
            subject = self._carriers.get(body.id)
            if subject is None or not body.tracked:
                continue
            position_m, heading_rad = body.seen(self._up, 3 if subject in self._flying else 2)
            if motion := self._fits[subject].add(frame.stamp_s, position_m, heading_rad):
                _tell(host, subject, stamp_s, position_m, heading_rad, *motion)

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
