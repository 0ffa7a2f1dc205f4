"""The sending end of pose and range streams: tells robots that ask, and only those."""

import math
import select
import socket
import time
from collections.abc import Collection, Mapping
from typing import Final

from edge_runtime.config.network import Endpoint
from edge_runtime.errors import ConfigError
from edge_runtime.network.session import Session, random_nonce
from edge_runtime.network.stream_wire import Kind, StreamFrame, decode_stream, encode_stream
from edge_runtime.network.team_wire import FrameError, Refusal

REQUEST_BYTES: Final = 2048
SILENT_S: Final = 1.0
"""A robot that has not asked for so long is not told any more."""
CONTENT_OF: Final = {Kind.POSE_REQUEST: Kind.POSE, Kind.RANGES_REQUEST: Kind.RANGES}


class Listener:
    """A robot that asks for one stream."""

    def __init__(self) -> None:
        self.session: Session[StreamFrame] = Session()
        self.asked_s = -math.inf
        """When it asked last."""
        self.sequence = 0


class StreamHost:
    """Publishes poses and ranges: a context manager.

    Args:
        place: where robots ask.
        robots: where each one listens, by id; nothing is sent anywhere else.
        poses: ids of those whose poses it tells.
        ranges: ids of those whose ranges it tells.
        key: the team's.

    Raises:
        ConfigError: if this machine does not have the address, or another process holds the port.
    """

    def __init__(
        self,
        place: Endpoint,
        robots: Mapping[int, Endpoint],
        poses: Collection[int],
        ranges: Collection[int],
        key: bytes,
    ) -> None:
        self._robots, self._key, self._boot_id = robots, key, random_nonce()
        self._listeners = {
            **{(Kind.POSE, robot_id): Listener() for robot_id in poses},
            **{(Kind.RANGES, robot_id): Listener() for robot_id in ranges},
        }
        self._socket = socket.socket(
            socket.AF_INET6 if ":" in place[0] else socket.AF_INET, socket.SOCK_DGRAM
        )
        self._socket.setblocking(False)
        try:
            self._socket.bind(place)
        except OSError as error:
            self._socket.close()
            raise ConfigError(f"cannot listen on {place[0]} port {place[1]} ({error.strerror})") from error

    def __enter__(self) -> "StreamHost":
        """Nothing needs opening."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the socket; the robots will find the streams silent, and stop."""
        self._socket.close()

    @property
    def listening(self) -> int:
        """How many streams are asked for."""
        now = time.monotonic()
        return sum(now - listener.asked_s < SILENT_S for listener in self._listeners.values())

    def listen(self, seconds: float = 0.0) -> None:
        """Take requests for so long."""
        end_s = time.monotonic() + seconds
        while select.select((self._socket,), (), (), max(0.0, end_s - time.monotonic()))[0]:
            try:
                self._take(decode_stream(self._socket.recv(REQUEST_BYTES), self._key))
            except (OSError, FrameError):
                continue  # a stranger's packet, or word that a robot is gone

    def publish(self, kind: Kind, robot_id: int, stamp_s: float, values: tuple[float, ...]) -> None:
        """Tell a robot, if it asks, what was measured at a time of this machine's monotonic clock.

        Raises:
            KeyError: if this stream was not announced.
        """
        listener = self._listeners[kind, robot_id]
        if time.monotonic() - listener.asked_s > SILENT_S:
            return
        listener.sequence += 1
        session = listener.session
        frame = StreamFrame(
            kind,
            robot_id,
            self._boot_id,
            listener.sequence,
            session.challenge,
            session.answer,
            stamp_s,
            values,
        )
        try:
            self._socket.sendto(encode_stream(frame, self._key), self._robots[robot_id])
        except OSError:
            return  # as good as lost: the robot judges by age

    def _take(self, frame: StreamFrame) -> None:
        kind = CONTENT_OF.get(frame.kind)
        listener = self._listeners.get((kind, frame.robot_id)) if kind else None
        if listener is None:
            raise FrameError(Refusal.MISDIRECTED)
        now = time.monotonic()
        try:
            listener.session.admit(frame, now)
        except FrameError as error:
            if error.cause is not Refusal.UNANSWERED:
                raise
            # It may have started anew, and needs our challenge to prove that.
        listener.asked_s = now
