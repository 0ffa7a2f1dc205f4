"""NatNet 4.0 to 4.2, the protocol of OptiTrack's Motive: what a client of rigid bodies reads and says.

Little endian throughout. A packet is a message id and a payload size of 16 bits each, then the payload. A
frame of data lists, one after the other: marker sets, unlabelled markers, rigid bodies, and more that is not
read here; from 4.1 on every list's count is followed by its size in bytes. The frame ends with time code,
time stamps, flags and an end mark, whose places are counted from the end. 4.2 (Motive 3.3) is 4.1 here.
"""

import math
import struct
from typing import Final, Literal, NamedTuple

import msgspec

from edge_runtime.errors import ConfigError
from edge_runtime.messages import Vector

COMMAND_PORT: Final = 1510
PACKET_BYTES: Final = 65535
_CONNECT, _SERVER_INFO, _FRAME_OF_DATA, _KEEP_ALIVE = 0, 1, 7, 10
_HEADER: Final = struct.Struct("<HH")
_SENDER: Final = struct.Struct("<256s4B4B")
_OPTIONS: Final = struct.Struct("<?4B")
_SERVER: Final = struct.Struct("<QH?4B")
_BODY: Final = struct.Struct("<i3f4ffh")
_OLDEST: Final = (4, 0)
_SIZED: Final = (4, 1)
"""From here on lists tell their sizes, and the frame's end is longer."""
_NEWEST: Final = (4, 2)
_SUFFIX: Final = {False: struct.Struct("<IIdQQQhi"), True: struct.Struct("<IIdQQQIIhi")}
"""By whether lists tell their sizes."""
_LATEST_S: Final = 1e9
"""No Motive has streamed for so long."""
_TRACKED: Final = 1
_VECTOR_BYTES: Final = 12

Up = Literal["y", "z"]
"""Which axis Motive streams as pointing up."""


class NatNetError(ValueError):
    """A packet that is not NatNet."""


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

    def seen(self, up: Up, dims: int) -> tuple[Vector, float]:
        """Return position, of 2 or 3 components, and heading; with y up, the plane's axes are x and -z."""
        x, y, z = self.position_m
        q_x, q_y, q_z, q_w = self.quaternion
        forward_x = 1.0 - 2.0 * (q_y * q_y + q_z * q_z)
        if up == "z":
            return (x, y, z)[:dims], math.atan2(2.0 * (q_x * q_y + q_z * q_w), forward_x)
        return (x, -z, y)[:dims], math.atan2(-2.0 * (q_x * q_z - q_y * q_w), forward_x)


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
        NatNetError: if it is malformed.
    """
    payload = _payload(packet, _SERVER_INFO)
    if payload is None:
        return None
    try:
        _, *versions = _SENDER.unpack_from(payload)
        _, port, multicasts, *group = _SERVER.unpack_from(payload, _SENDER.size)
    except struct.error as error:
        raise NatNetError(f"server description of {len(payload)} bytes") from error
    return Server((versions[4], versions[5]), (".".join(map(str, group)), port) if multicasts else None)


def check_version(version: tuple[int, int]) -> None:
    """Check that frames of this version can be read.

    Raises:
        ConfigError: says what to update.
    """
    if not _OLDEST <= version <= _NEWEST:
        update = "Motive" if version < _OLDEST else "cfpg-edge"
        raise ConfigError(f"NatNet {version[0]}.{version[1]}: only 4.0 to 4.2 are read; update {update}")


def read_frame(packet: bytes, version: tuple[int, int]) -> MocapFrame | None:
    """Read a frame of data; None if the packet is another message.

    Raises:
        NatNetError: if it is cut, or its lists do not fit into it.
    """
    payload = _payload(packet, _FRAME_OF_DATA)
    if payload is None:
        return None
    sized = version >= _SIZED
    try:
        return MocapFrame(_stamp_s(payload, sized=sized), _bodies(payload, sized=sized))
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


def _stamp_s(payload: bytes, *, sized: bool) -> float:
    suffix = _SUFFIX[sized]
    stamp_s = float(suffix.unpack_from(payload, len(payload) - suffix.size)[2])
    if not 0.0 <= stamp_s <= _LATEST_S:
        raise ValueError(f"its time stamp is {stamp_s:g} s")
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
