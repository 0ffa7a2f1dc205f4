"""The frames of a pose or range stream, and a robot's requests for them: authenticated like the team's.

Little endian: kind, number of values, robot, tag, boot id, sequence, challenge, answer, stamp, the values.
What the session fields are for: `edge_runtime.network.session`.
"""

import enum
import math
import struct
from typing import Final, NamedTuple

import msgspec

from edge_runtime.common.bounds import GREATEST, is_motion
from edge_runtime.messages import TrackedObject, Vector, Vector2
from edge_runtime.network.seal import FrameError, Magic, Refusal, seal, unseal

MOST_VALUES: Final = 1024
_HEAD: Final = struct.Struct("<BxHHHQQQQd")


class Kind(enum.IntEnum):
    """What a frame is."""

    POSE_REQUEST = 1
    """From a robot, without values: it wants poses."""
    RANGES_REQUEST = 2
    POSE = 3
    """Position and velocity of two components, or of three; then heading and yaw rate."""
    RANGES = 4
    """Distances in m, one a ray, in the order and along the directions of the policy's sensor."""
    OBJECT_REQUEST = 5
    """It wants the poses of the tracked object of the frame's tag."""
    OBJECT = 6
    """Values as of a pose."""
    SENSOR_REQUEST = 7
    """It wants the readings of its sensor of the frame's tag."""
    SENSOR = 8


COUNTS: Final[dict[int, tuple[int, ...]]] = {
    Kind.POSE_REQUEST: (0,),
    Kind.RANGES_REQUEST: (0,),
    Kind.OBJECT_REQUEST: (0,),
    Kind.SENSOR_REQUEST: (0,),
    Kind.POSE: (6, 8),
    Kind.OBJECT: (6, 8),
}
"""How many values frames of a kind have, where not any number will do."""


class Pose(NamedTuple):
    """The motion of a robot or an object in the team's frame."""

    position_m: Vector
    velocity_m_s: Vector
    heading_rad: float
    yaw_rate_rad_s: float


class StreamFrame(msgspec.Struct, frozen=True, gc=False):
    """One frame from or to a robot."""

    kind: Kind
    robot_id: int
    """Which robot asks, or is told."""
    boot_id: int
    """Drawn by the sender at each start."""
    sequence: int
    challenge: int
    """What the receiver is to answer."""
    answer: int
    """The newest challenge that the sender had from the receiver; 0 before the first."""
    stamp_s: float
    """When it was measured, by the sender's monotonic clock."""
    values: tuple[float, ...] = ()
    tag: int = 0
    """Which object or sensor it is about: `edge_runtime.config.tracked.tag_of` its name; else 0."""

    def pose(self) -> Pose:
        """Return what a frame of kind POSE or OBJECT says."""
        *motion, heading, yaw_rate = self.values
        half = len(motion) // 2
        return Pose(tuple(motion[:half]), tuple(motion[half:]), heading, yaw_rate)

    def tracked(self, name: str, age_s: float, goal_m: Vector2 | None, dims: int) -> TrackedObject:
        """Return what a frame of kind OBJECT says of the object of that name, in so many dimensions."""
        position, velocity, heading, yaw_rate = self.pose()
        place = position[:dims], velocity[:dims]
        return TrackedObject(name, self.stamp_s, *place, heading, yaw_rate, age_s, goal_m)


def encode_stream(frame: StreamFrame, key: bytes) -> bytes:
    """Return the authenticated packet of a frame."""
    head = _HEAD.pack(
        frame.kind,
        len(frame.values),
        frame.robot_id,
        frame.tag,
        frame.boot_id,
        frame.sequence,
        frame.challenge,
        frame.answer,
        frame.stamp_s,
    )
    body = head + struct.pack(f"<{len(frame.values)}d", *frame.values)
    return seal(Magic.STREAM, body, key)


def decode_stream(packet: bytes, key: bytes) -> StreamFrame:
    """Read a packet.

    Raises:
        FrameError: if it is malformed, not made with this key, or a number is not finite or absurd.
    """
    body = unseal(packet, Magic.STREAM, key, _HEAD.size + 8 * MOST_VALUES, _HEAD.size)
    kind, count, robot_id, tag, boot_id, sequence, challenge, answer, stamp_s = _HEAD.unpack_from(body)
    fits = count in COUNTS.get(kind, (count,)) and len(body) == _HEAD.size + 8 * count
    if kind not in set(Kind) or not fits:
        raise FrameError(Refusal.MALFORMED)
    values = struct.unpack_from(f"<{count}d", body, _HEAD.size)
    if not (math.isfinite(stamp_s) and all(map(math.isfinite, values))):
        raise FrameError(Refusal.NOT_FINITE)
    absurd = any(abs(value) > GREATEST for value in values)
    dims = 3 if count == 8 else 2
    moves = kind in (Kind.POSE, Kind.OBJECT)
    if absurd or (moves and not is_motion(values[:dims], values[dims : 2 * dims])):
        raise FrameError(Refusal.MALFORMED)
    return StreamFrame(Kind(kind), robot_id, boot_id, sequence, challenge, answer, stamp_s, values, tag)
