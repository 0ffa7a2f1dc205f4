"""NatNet 4.0 and 4.1, the protocol of OptiTrack's Motive: what a client of rigid bodies reads and says.

Little endian throughout. A packet is a message id and a payload size of 16 bits each, then the payload. A
frame of data lists, one after the other: marker sets, unlabelled markers, rigid bodies, and more that is not
read here; from 4.1 on every list's count is followed by its size in bytes. The frame ends with time code,
time stamps, flags and an end mark, whose places are counted from the end.
"""

import math
import struct
from typing import Final, Literal, NamedTuple

import msgspec

from edge_runtime.messages import Vector2

COMMAND_PORT: Final = 1510
PACKET_BYTES: Final = 65535
_CONNECT, _SERVER_INFO, _FRAME_OF_DATA, _KEEP_ALIVE = 0, 1, 7, 10
_HEADER: Final = struct.Struct("<HH")
_SENDER: Final = struct.Struct("<256s4B4B")
_OPTIONS: Final = struct.Struct("<?4B")
_SERVER: Final = struct.Struct("<QH?4B")
_BODY: Final = struct.Struct("<i3f4ffh")
_SUFFIX: Final = {(4, 0): struct.Struct("<IIdQQQhi"), (4, 1): struct.Struct("<IIdQQQIIhi")}
_TRACKED: Final = 1
_VECTOR_BYTES: Final = 12

Up = Literal["y", "z"]
"""Which axis Motive streams as pointing up."""


class NatNetError(ValueError):
    """A packet that is not NatNet 4.0 or 4.1."""


class Server(NamedTuple):
    """What Motive says of itself."""

    version: tuple[int, int]
    """Of its bitstream."""
    group: tuple[str, int] | None
    """Where it multicasts frames; None if it sends them to whoever connects."""


class Body(msgspec.Struct, frozen=True, gc=False):
    """One rigid body as it was seen."""

    id: int
    position_m: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    """x, y, z, w."""
    tracked: bool

    def planar(self, up: Up) -> tuple[Vector2, float]:
        """Return position and heading in the plane; with y up, the plane's axes are x and -z."""
        x, y, z = self.position_m
        q_x, q_y, q_z, q_w = self.quaternion
        forward_x = 1.0 - 2.0 * (q_y * q_y + q_z * q_z)
        if up == "z":
            return (x, y), math.atan2(2.0 * (q_x * q_y + q_z * q_w), forward_x)
        return (x, -z), math.atan2(-2.0 * (q_x * q_z - q_y * q_w), forward_x)


class MocapFrame(NamedTuple):
    """One frame of data."""

    stamp_s: float
    """By Motive's clock."""
    bodies: tuple[Body, ...]


def connect_packet(version: tuple[int, int] = (4, 1)) -> bytes:
    """Ask a server who it is, and for this bitstream."""
    sender = _SENDER.pack(b"edge-pose", 1, 0, 0, 0, *version, 0, 0)
    return _packet(_CONNECT, sender + _OPTIONS.pack(False, *version, 0, 0))


def keep_alive_packet() -> bytes:
    """Say that frames are still wanted; servers that do not multicast forget silent clients."""
    return _packet(_KEEP_ALIVE, b"")


def read_server(packet: bytes) -> Server | None:
    """Read a server's description; None if the packet is another message.

    Raises:
        NatNetError: if it is malformed, or of a version that is not read here.
    """
    payload = _payload(packet, _SERVER_INFO)
    if payload is None:
        return None
    try:
        _, *versions = _SENDER.unpack_from(payload)
        _, port, multicasts, *group = _SERVER.unpack_from(payload, _SENDER.size)
    except struct.error as error:
        raise NatNetError(f"server description of {len(payload)} bytes") from error
    version = (versions[4], versions[5])
    if version not in _SUFFIX:
        raise NatNetError(f"NatNet {version[0]}.{version[1]}: only 4.0 and 4.1 are read; update Motive")
    return Server(version, (".".join(map(str, group)), port) if multicasts else None)


def read_frame(packet: bytes, version: tuple[int, int]) -> MocapFrame | None:
    """Read a frame of data; None if the packet is another message.

    Raises:
        NatNetError: if it is cut, or its lists do not fit into it.
    """
    payload = _payload(packet, _FRAME_OF_DATA)
    if payload is None:
        return None
    try:
        return MocapFrame(_stamp_s(payload, version), _bodies(payload, sized=version >= (4, 1)))
    except (struct.error, ValueError) as error:
        raise NatNetError(f"frame of data of {len(payload)} bytes: {error}") from error


def _packet(message: int, payload: bytes) -> bytes:
    return _HEADER.pack(message, len(payload)) + payload


def _payload(packet: bytes, message: int) -> bytes | None:
    if len(packet) < _HEADER.size:
        raise NatNetError(f"packet of {len(packet)} bytes")
    found, size = _HEADER.unpack_from(packet)
    if found != message:
        return None
    if len(packet) - _HEADER.size < size:
        raise NatNetError(f"packet with {len(packet) - _HEADER.size} of {size} bytes")
    return packet[_HEADER.size : _HEADER.size + size]


def _stamp_s(payload: bytes, version: tuple[int, int]) -> float:
    suffix = _SUFFIX[version]
    stamp_s = float(suffix.unpack_from(payload, len(payload) - suffix.size)[2])
    if not math.isfinite(stamp_s):
        raise ValueError("its time stamp is not finite")
    return stamp_s


def _bodies(payload: bytes, *, sized: bool) -> tuple[Body, ...]:
    head, at = (8, 4) if sized else (4, 4)  # the first four bytes are the frame's number
    count = _count(payload, at)
    at += head
    for _ in range(count):
        at = payload.index(b"\0", at) + 1  # the set's name
        at += 4 + _VECTOR_BYTES * _count(payload, at)
    at += head + _VECTOR_BYTES * _count(payload, at)
    count = _count(payload, at)
    at += head
    return tuple(_body(_BODY.unpack_from(payload, at + index * _BODY.size)) for index in range(count))


def _count(payload: bytes, at: int) -> int:
    (count,) = struct.unpack_from("<i", payload, at)
    if not 0 <= count <= len(payload):
        raise ValueError(f"a list of {count} entries")
    return int(count)


def _body(fields: tuple[float, ...]) -> Body:
    number, x, y, z, q_x, q_y, q_z, q_w, _, flags = fields
    tracked = bool(int(flags) & _TRACKED) and math.isfinite(sum(fields))
    return Body(int(number), (x, y, z), (q_x, q_y, q_z, q_w), tracked)
