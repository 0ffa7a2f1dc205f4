"""MAVLink 2 bytes to records and back: pymavlink's ``common`` dialect behind a typed face.

This file is the only one that touches pymavlink. What arrives is cut, checked and, with a key, authenticated
before anything looks at its content; every frame that is not taken is counted under the reason.
"""

import math
import struct
from collections.abc import Iterator
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common  # type: ignore[import-untyped]

from edge_runtime.errors import ConfigError
from firmware_bridge.mavlink.messages import (
    Attitude,
    Command,
    CommandResult,
    Content,
    Heartbeat,
    LocalPosition,
    Odometry,
    Outgoing,
    Parameter,
    ParameterRequest,
    Received,
    StatusText,
    Target,
    TimeSync,
)
from firmware_bridge.mavlink.signing import SIGNATURE_BYTES, SIGNED_FLAG, SignatureCheck, Signing

MAGIC = 0xFD
HEADER_BYTES = 10
CRC_BYTES = 2
COMPANION = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER, the component as which this project speaks."""

_SETPOINT = common.MAVLink_set_position_target_local_ned_message
_SETPOINT_EXTRA = bytes([_SETPOINT.crc_extra])
_HEADER = struct.Struct("<BBBBBBBHB")

DialectMessage: TypeAlias = Any
"""An object of pymavlink, which has no types."""


class Tally:
    """How many frames came, and why some were not taken."""

    def __init__(self) -> None:
        self.accepted = 0
        self.damaged = 0
        """Noise, wrong checksum, unknown flag, truncated."""
        self.unknown = 0
        """Messages outside the ``common`` dialect: their checksum cannot be computed."""
        self.unusable = 0
        """Authentic, but not finite, or in axes that say nothing about north."""
        self.refused = {SignatureCheck.UNSIGNED: 0, SignatureCheck.ALTERED: 0, SignatureCheck.REPLAYED: 0}


class Decoder:
    """Cuts a byte stream into frames and yields the content of those that may be believed."""

    def __init__(self, signing: Signing | None = None) -> None:
        if common.MAVLINK_IGNORE_CRC:
            raise ConfigError("MAV_IGNORE_CRC is set: pymavlink would take damaged frames; unset it")
        self.tally = Tally()
        self._signing = signing
        self._parser = common.MAVLink(None)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[Received]:
        """Take in bytes in any portions; yields messages that this project knows, silent about the others."""
        self._buffer += data
        while (frame := self._cut()) is not None:
            received = self._judge(frame)
            if received is not None:
                yield received

    def end_of_datagram(self) -> None:
        """Drop what is left: a frame never spans two datagrams."""
        self.tally.damaged += bool(self._buffer)
        self._buffer.clear()

    def _cut(self) -> bytes | None:
        """Return the next stretch that begins like a frame, as long as its header claims."""
        start = self._buffer.find(MAGIC)
        noise = len(self._buffer) if start < 0 else start
        self.tally.damaged += bool(noise)
        del self._buffer[:noise]
        if len(self._buffer) < HEADER_BYTES:
            return None
        length = HEADER_BYTES + self._buffer[1] + CRC_BYTES
        length += SIGNATURE_BYTES if self._buffer[2] & SIGNED_FLAG else 0
        return bytes(self._buffer[:length]) if len(self._buffer) >= length else None

    def _judge(self, frame: bytes) -> Received | None:
        message = self._parse(frame)
        if message is None:
            # The length may have been noise too: the next frame can begin right behind this magic byte.
            self.tally.damaged += 1
            del self._buffer[:1]
            return None
        del self._buffer[: len(frame)]
        if isinstance(message, common.MAVLink_unknown):
            self.tally.unknown += 1
            return None
        verdict = SignatureCheck.ACCEPTED if self._signing is None else self._signing.verify(frame)
        if verdict is not SignatureCheck.ACCEPTED:
            self.tally.refused[verdict] += 1
            return None
        self.tally.accepted += 1
        return self._received(message)

    def _parse(self, frame: bytes) -> DialectMessage | None:
        """Return pymavlink's message, or None if flags, length or checksum are wrong."""
        if frame[2] & ~SIGNED_FLAG:
            return None
        try:
            return self._parser.decode(bytearray(frame))
        except common.MAVError:
            return None

    def _received(self, message: DialectMessage) -> Received | None:
        read = _READERS.get(message.get_msgId())
        if read is None:
            return None
        content = read(message)
        if content is None:
            self.tally.unusable += 1
            return None
        return Received(message.get_srcSystem(), message.get_srcComponent(), content)


def _heartbeat(message: DialectMessage) -> Content:
    return Heartbeat(message.custom_mode, bool(message.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED))


def _attitude(message: DialectMessage) -> Content | None:
    if not _finite(message.yaw, message.yawspeed):
        return None
    return Attitude(message.time_boot_ms * 1e-3, message.yaw, message.yawspeed)


def _local_position(message: DialectMessage) -> Content | None:
    position, velocity = (message.x, message.y), (message.vx, message.vy)
    if not _finite(*position, *velocity):
        return None
    return LocalPosition(message.time_boot_ms * 1e-3, position, velocity)


def _odometry(message: DialectMessage) -> Content | None:
    axes = (message.frame_id, message.child_frame_id)
    if axes != (common.MAV_FRAME_LOCAL_NED, common.MAV_FRAME_BODY_FRD):
        return None
    position, velocity, attitude = (message.x, message.y), (message.vx, message.vy), tuple(message.q)
    if not _finite(*position, *velocity, *attitude, message.yawspeed):
        return None
    return Odometry(message.time_usec * 1e-6, position, velocity, attitude, message.yawspeed)


def _time_sync(message: DialectMessage) -> Content:
    return TimeSync(message.tc1, message.ts1)


def _parameter(message: DialectMessage) -> Content | None:
    # PX4 puts the bytes of an integer into the float field: only real parameters can be read as they stand.
    if message.param_type != common.MAV_PARAM_TYPE_REAL32 or not _finite(message.param_value):
        return None
    return Parameter(message.param_id, message.param_value)


def _status_text(message: DialectMessage) -> Content:
    return StatusText(message.severity, message.text)


def _command_result(message: DialectMessage) -> Content:
    return CommandResult(message.command, message.result)


_READERS = {
    common.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    common.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    common.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    common.MAVLINK_MSG_ID_TIMESYNC: _time_sync,
    common.MAVLINK_MSG_ID_PARAM_VALUE: _parameter,
    common.MAVLINK_MSG_ID_STATUSTEXT: _status_text,
    common.MAVLINK_MSG_ID_COMMAND_ACK: _command_result,
}


def _finite(*numbers: float) -> bool:
    return all(math.isfinite(number) for number in numbers)


class Encoder:
    """Turns records into frames from one sender to one autopilot, signed if there is a key."""

    def __init__(self, system_id: int, target: tuple[int, int], signing: Signing | None = None) -> None:
        self._target = target
        self._signing = signing
        self._packer = common.MAVLink(None, srcSystem=system_id, srcComponent=COMPANION)
        if signing is not None:
            self._packer.signing.secret_key = signing.key
            self._packer.signing.sign_outgoing = True

    def encode(self, content: Outgoing, now_s: float) -> bytes:
        """Return one frame; ``now_s`` is monotonic.

        Raises:
            BridgeError: if the signing timestamp cannot be kept on disk.
        """
        tick = 0 if self._signing is None else self._signing.timestamps.next()
        frame = self._frame(content, now_s, tick)
        self._packer.seq = (self._packer.seq + 1) % 256
        return frame

    def rehearse(self, content: Outgoing, now_s: float) -> None:
        """Pack one frame and forget it: neither its number nor a signing timestamp is used up."""
        self._frame(content, now_s, 0)

    def _frame(self, content: Outgoing, now_s: float, tick: int) -> bytes:
        if isinstance(content, Target):
            frame = self._setpoint(content, now_s)
            return frame if self._signing is None else self._signing.sign(frame, tick)
        self._packer.signing.timestamp = tick
        return bytes(self._message(content).pack(self._packer))

    def _message(self, content: Outgoing) -> DialectMessage:
        match content:
            case Command():
                seven = (*content.parameters, *(0.0,) * (7 - len(content.parameters)))
                return common.MAVLink_command_long_message(*self._target, content.command, 0, *seven)
            case ParameterRequest():
                return common.MAVLink_param_request_read_message(
                    *self._target, content.name.encode("ascii"), -1
                )
            case TimeSync():
                return common.MAVLink_timesync_message(content.remote_ns, content.asker_ns)
        return common.MAVLink_heartbeat_message(
            common.MAV_TYPE_ONBOARD_CONTROLLER,
            common.MAV_AUTOPILOT_INVALID,
            base_mode=0,
            custom_mode=0,
            system_status=common.MAV_STATE_ACTIVE,
            mavlink_version=3,
        )

    def _setpoint(self, target: Target, now_s: float) -> bytes:
        """Return the frame that pymavlink makes, in a third of the time: it is in every command's way."""
        payload = _SETPOINT.unpacker.pack(
            int(now_s * 1e3) % 2**32,
            *(0.0, 0.0, 0.0),
            *target.velocity_m_s,
            0.0,
            *target.acceleration_m_s2,
            0.0,
            0.0,
            target.yaw_rate_rad_s,
            target.type_mask,
            *self._target,
            target.frame,
        ).rstrip(b"\0")
        packer = self._packer
        header = _HEADER.pack(
            MAGIC,
            len(payload),
            SIGNED_FLAG if self._signing is not None else 0,
            0,
            packer.seq,
            packer.srcSystem,
            packer.srcComponent,
            _SETPOINT.id,
            0,
        )
        checked = header[1:] + payload
        checksum = common.x25crc(checked + _SETPOINT_EXTRA).crc
        return b"%c%b%b" % (MAGIC, checked, checksum.to_bytes(CRC_BYTES, "little"))
