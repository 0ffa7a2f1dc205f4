"""The sending end of pose and range streams: tells robots that ask, and only those."""

import contextlib
import math
import time
from collections.abc import Collection, Mapping
from typing import Final

from edge_runtime.common.closing import Closing
from edge_runtime.config.network import Endpoint
from edge_runtime.config.tracked import tag_of
from edge_runtime.network.datagrams import listen
from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.network.session import Session, random_nonce
from edge_runtime.network.stream_wire import Kind, StreamFrame, decode_stream, encode_stream

REQUEST_BYTES: Final = 2048
QUESTION: Final = "is this the machine that the fleet names, and does no other edge-pose run on it?"
SILENT_S: Final = 1.0
"""A robot that has not asked for so long is not told any more."""
CONTENT_OF: Final = {
    Kind.POSE_REQUEST: Kind.POSE,
    Kind.RANGES_REQUEST: Kind.RANGES,
    Kind.OBJECT_REQUEST: Kind.OBJECT,
    Kind.SENSOR_REQUEST: Kind.SENSOR,
}


class Listener:
    """A robot that asks for one stream."""

    def __init__(self) -> None:
        self.session: Session[StreamFrame] = Session()
        self.asked_s = -math.inf
        """When it asked last."""
        self.sequence = 0


class StreamHost(Closing):
    """Publishes poses and ranges.

    Args:
        place: where robots ask.
        robots: where each one listens, by id; nothing is sent anywhere else.
        poses: ids of those whose poses it tells.
        ranges: ids of those whose ranges it tells.
        key: the team's.
        objects: names of the tracked objects whose poses it tells, to every robot.
        sensors: (id, name) of the further sensors whose readings it tells.

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
        objects: Collection[str] = (),
        sensors: Collection[tuple[int, str]] = (),
    ) -> None:
        self._robots, self._key, self._boot_id = robots, key, random_nonce()
        self.robots = len(robots)
        """How many it may tell of objects."""
        streams = [(Kind.POSE, robot_id, 0) for robot_id in poses]
        streams += [(Kind.RANGES, robot_id, 0) for robot_id in ranges]
        streams += [(Kind.OBJECT, robot_id, tag_of(name)) for robot_id in robots for name in objects]
        streams += [(Kind.SENSOR, robot_id, tag_of(name)) for robot_id, name in sensors]
        self._listeners = {stream: Listener() for stream in streams}
        self._datagrams = listen(place, REQUEST_BYTES, QUESTION)

    def close(self) -> None:
        """Close the socket; the robots will find the streams silent, and stop."""
        self._datagrams.close()

    @property
    def listening(self) -> int:
        """How many streams are asked for."""
        now = time.monotonic()
        return sum(now - listener.asked_s < SILENT_S for listener in self._listeners.values())

    def listen(self, seconds: float = 0.0) -> None:
        """Take requests for so long."""
        end_s = time.monotonic() + seconds
        while True:
            self._datagrams.wait(end_s - time.monotonic())
            for datagram in self._datagrams.receive():
                with contextlib.suppress(FrameError):  # a stranger's packet
                    self._take(decode_stream(datagram.content, self._key), datagram.arrival_s)
            if time.monotonic() >= end_s:
                return

    def publish_object(self, name: str, stamp_s: float, values: tuple[float, ...]) -> None:
        """Tell every robot that asks of a tracked object; see `publish`."""
        for robot_id in self._robots:
            self.publish(Kind.OBJECT, robot_id, stamp_s, values, name)

    def publish(
        self, kind: Kind, robot_id: int, stamp_s: float, values: tuple[float, ...], name: str = ""
    ) -> None:
        """Tell a robot, if it asks, what was measured at a time of this machine's monotonic clock.

        Args:
            kind: of the stream.
            robot_id: whom it is for.
            stamp_s: when it was measured.
            values: as the kind wants them.
            name: of the object or sensor, where the kind has several.

        Raises:
            KeyError: if this stream was not announced.
        """
        tag = tag_of(name) if name else 0
        listener = self._listeners[kind, robot_id, tag]
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
            tag,
        )
        # What does not get out is as good as lost: the robot judges by age.
        self._datagrams.send(encode_stream(frame, self._key), self._robots[robot_id])

    def _take(self, frame: StreamFrame, arrival_s: float) -> None:
        kind = CONTENT_OF.get(frame.kind)
        listener = self._listeners.get((kind, frame.robot_id, frame.tag)) if kind else None
        if listener is None:
            raise FrameError(Refusal.MISDIRECTED)
        try:
            listener.session.admit(frame, arrival_s)
        except FrameError as error:
            if error.cause is not Refusal.UNANSWERED:
                raise
            # It may have started anew, and needs our challenge to prove that.
        listener.asked_s = arrival_s
