"""The frames of a pose or range stream, and a robot's requests for them: authenticated like the team's.

Little endian: kind, number of values, robot, boot id, sequence, challenge, answer, stamp, the values. What
the session fields are for: `edge_runtime.network.session`.
"""

import enum
import math
import struct
from typing import Final, NamedTuple

import msgspec

from edge_runtime.common.bounds import GREATEST, is_motion
from edge_runtime.messages import Vector2
from edge_runtime.network.seal import FrameError, Magic, Refusal, seal, unseal

MOST_VALUES: Final = 1024
_HEAD: Final = struct.Struct("<BxHHxxQQQQd")


class Kind(enum.IntEnum):
    """What a frame is."""

    POSE_REQUEST = 1
    """From a robot, without values: it wants poses."""
    RANGES_REQUEST = 2
    POSE = 3
    """Values as in `Pose`."""
    RANGES = 4
    """Distances in m, one a ray, in the order and along the directions of the policy's sensor."""


class Pose(NamedTuple):
    """A robot's motion in the team's frame."""

    position_m: Vector2
    velocity_m_s: Vector2
    heading_rad: float


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

    def pose(self) -> Pose:
        """Return what a frame of kind POSE says."""
        x, y, v_x, v_y, heading = self.values
        return Pose((x, y), (v_x, v_y), heading)


def encode_stream(frame: StreamFrame, key: bytes) -> bytes:
    """Return the authenticated packet of a frame."""
    head = _HEAD.pack(
        frame.kind,
        len(frame.values),
        frame.robot_id,
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
    kind, count, robot_id, boot_id, sequence, challenge, answer, stamp_s = _HEAD.unpack_from(body)
    expected = {Kind.POSE_REQUEST: 0, Kind.RANGES_REQUEST: 0, Kind.POSE: 5}.get(kind, count)
    if kind not in set(Kind) or count != expected or len(body) != _HEAD.size + 8 * count:
        raise FrameError(Refusal.MALFORMED)
    values = struct.unpack_from(f"<{count}d", body, _HEAD.size)
    if not (math.isfinite(stamp_s) and all(map(math.isfinite, values))):
        raise FrameError(Refusal.NOT_FINITE)
    absurd = any(abs(value) > GREATEST for value in values)
    if absurd or (kind == Kind.POSE and not is_motion(values[:2], values[2:4])):
        raise FrameError(Refusal.MALFORMED)
    return StreamFrame(Kind(kind), robot_id, boot_id, sequence, challenge, answer, stamp_s, values)
