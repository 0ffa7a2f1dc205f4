"""What a robot hears of its own pose and ranges from others: a motion-capture host, a LIDAR's driver.

The robot asks each source for its stream a few times a second; the requests carry the challenge that makes
recordings worthless, and a source speaks to robots that ask. A pose or ranges older than 100 ms are not used.
"""

from collections import deque
from collections.abc import Sequence
from typing import Final

from msgspec.structs import replace

from edge_runtime.config.tracked import tag_of
from edge_runtime.messages import Command, Reading, RobotState, TrackedObject, Vector2
from edge_runtime.network.datagrams import Datagram
from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.network.session import Session, random_nonce
from edge_runtime.network.stream_wire import Kind, StreamFrame, decode_stream, encode_stream
from edge_runtime.network.udp import Carrier
from edge_runtime.team.frame_rotation import ActionAxes, turned

POSE_SOURCE: Final = -1
RANGES_SOURCE: Final = -2
FIRST_SOURCE: Final = -3
"""In the place of a robot's id, for the carrier; no robot has them. Tracked objects and further sensors count
down from the last one."""
STALE_S: Final = 0.1
REQUEST_S: Final = 0.1
"""Time between two requests."""
MOST_NEW: Final = 64
"""Frames of which the stamps are kept until somebody asks for them."""


class Stream:
    """One source, as a robot hears it.

    Args:
        source: in the carrier.
        robot_id: of this robot.
        request: the kind of its requests.
        content: the kind of what it wants.
        values: how many a frame may have; any number that the kind allows where None.
        key: the team's.
        carrier: takes the requests.
        name: of the object or sensor that it tells of; empty where the kind says all.
    """

    def __init__(
        self,
        source: int,
        robot_id: int,
        request: Kind,
        content: Kind,
        values: Sequence[int] | None,
        key: bytes,
        carrier: Carrier,
        name: str = "",
    ) -> None:
        self.content, self.tag = content, tag_of(name) if name else 0
        self.name = name or content.name.lower()
        self._source, self._robot_id, self._request, self._values = source, robot_id, request, values
        self._key, self._carrier = key, carrier
        self._session: Session[StreamFrame] = Session()
        self._new: deque[float] = deque(maxlen=MOST_NEW)
        self._boot_id, self._sequence, self._due_s = random_nonce(), 0, 0.0

    def ask(self, now_s: float) -> None:
        """Ask for the stream, if it is time to."""
        if now_s < self._due_s:
            return
        self._due_s, self._sequence = now_s + REQUEST_S, self._sequence + 1
        session = self._session
        request = StreamFrame(
            self._request,
            self._robot_id,
            self._boot_id,
            self._sequence,
            session.challenge,
            session.answer,
            now_s,
            tag=self.tag,
        )
        self._carrier.send(self._source, encode_stream(request, self._key))

    def admit(self, frame: StreamFrame, arrival_s: float) -> None:
        """Take in an authentic frame for this robot; raises FrameError if it is of no use."""
        if self._values is not None and len(frame.values) not in self._values:
            raise FrameError(Refusal.MALFORMED)
        self._session.admit(frame, arrival_s)
        self._new.append(self._session.measured_s)

    def stamps(self) -> Sequence[float]:
        """Return when what came since the last call was measured, by our clock."""
        stamps = tuple(self._new)
        self._new.clear()
        return stamps

    def newest(self) -> StreamFrame | None:
        """Return the newest frame, stamped in our clock; None before the first."""
        newest = self._session.newest
        return newest and replace(newest, stamp_s=self._session.measured_s)


class Streams:
    """All sources of one robot.

    Args:
        robot_id: of this robot.
        pose: its pose stream; None where the bridge tells the pose.
        ranges: its range stream; None where ranges are computed from the teammates.
        key: the team's.
        objects: the tracked objects' streams, each with where the object is to go, if anywhere.
        sensors: the streams of further sensors.
        axes: how commands are turned for a base whose pose comes as a stream.
        dims: components of its position; of objects that are told in space the plane's count in a plane.
    """

    def __init__(
        self,
        robot_id: int,
        pose: Stream | None,
        ranges: Stream | None,
        key: bytes,
        objects: Sequence[tuple[Stream, Vector2 | None]] = (),
        sensors: Sequence[Stream] = (),
        axes: ActionAxes | None = None,
        dims: int = 2,
    ) -> None:
        self.pose = pose
        self._robot_id, self._ranges, self._key = robot_id, ranges, key
        self._objects, self._sensors, self._axes = objects, sensors, axes or ActionAxes()
        every = (pose, ranges, *(stream for stream, _ in objects), *sensors)
        self._all = {(stream.content, stream.tag): stream for stream in every if stream}
        self._turn_rad, self._dims = 0.0, dims

    def ask(self, now_s: float) -> None:
        """Ask every source that is due."""
        for stream in self._all.values():
            stream.ask(now_s)

    def handle(self, datagram: Datagram) -> None:
        """Take in a packet; raises FrameError if it is not a source's, or of no use."""
        frame = decode_stream(datagram.content, self._key)
        stream = self._all.get((frame.kind, frame.tag))
        if stream is None or frame.robot_id != self._robot_id:
            raise FrameError(Refusal.MISDIRECTED)
        stream.admit(frame, datagram.arrival_s)

    def locate(self, bridge: RobotState) -> RobotState | None:
        """Return the own state in the team's frame, or None where the stream has not told it yet.

        How it moves and turns is the stream's. The stamp is the older one of stream and bridge: a base whose
        feedback is stale must not be driven by a fresh pose.
        """
        if self.pose is None:
            return bridge
        newest = self.pose.newest()
        if newest is None:
            return None
        pose = newest.pose()
        self._turn_rad = bridge.heading_rad - pose.heading_rad
        stamp_s = min(bridge.stamp_s, newest.stamp_s)
        return RobotState(bridge.robot_id, stamp_s, *pose)

    def ranges_m(self) -> tuple[float, ...] | None:
        """Return the newest ranges, or None where they are computed from the teammates."""
        newest = self._ranges.newest() if self._ranges else None
        return newest.values if newest else None

    def tracked(self, now_s: float) -> tuple[TrackedObject, ...]:
        """Return the tracked objects that were heard of."""
        heard = ((stream.name, stream.newest(), goal_m) for stream, goal_m in self._objects)
        return tuple(
            newest.tracked(name, now_s - newest.stamp_s, goal_m, self._dims)
            for name, newest, goal_m in heard
            if newest
        )

    def readings(self) -> tuple[Reading, ...]:
        """Return the newest readings of further sensors."""
        heard = ((stream.name, stream.newest()) for stream in self._sensors)
        return tuple(Reading(name, newest.values) for name, newest in heard if newest)

    def fault(self, now_s: float) -> str:
        """Say which stream is silent or old; empty if all are fresh."""
        for stream in self._all.values():
            newest, name = stream.newest(), stream.name
            if newest is None:
                return f"waits for the {name} stream: not heard yet"
            if now_s - newest.stamp_s > STALE_S:
                return f"the {name} stream is older than {STALE_S:g} s"
        return ""

    def for_base(self, command: Command) -> Command:
        """Turn a command from the team's frame into the one in which the bridge's odometry lives."""
        return turned(command, self._turn_rad, self._axes) if self.pose else command
