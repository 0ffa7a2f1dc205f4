"""Records to MAVLink 2 bytes, from one sender to one autopilot, signed if there is a key."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as dialect  # type: ignore[import-untyped]

from firmware_bridge.mavlink.decoder import CRC_BYTES, MAGIC
from firmware_bridge.mavlink.messages import Command, Outgoing, ParameterRequest, Target, TimeSync
from firmware_bridge.mavlink.reading import DialectMessage
from firmware_bridge.mavlink.signing import SIGNED_FLAG, Signing

COMPANION = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER, the component as which this project speaks."""

_SETPOINT = dialect.MAVLink_set_position_target_local_ned_message
_SETPOINT_EXTRA = bytes([_SETPOINT.crc_extra])
_HEADER = struct.Struct("<BBBBBBBHB")


class Encoder:
    """Turns records into frames from one sender to one autopilot, signed if there is a key."""

    def __init__(self, system_id: int, target: tuple[int, int], signing: Signing | None = None) -> None:
        self._target = target
        self._signing = signing
        self._packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=COMPANION)
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
                return dialect.MAVLink_command_long_message(*self._target, content.command, 0, *seven)
            case ParameterRequest():
                return dialect.MAVLink_param_request_read_message(
                    *self._target, content.name.encode("ascii"), -1
                )
            case TimeSync():
                return dialect.MAVLink_timesync_message(content.remote_ns, content.asker_ns)
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_ONBOARD_CONTROLLER,
            dialect.MAV_AUTOPILOT_INVALID,
            base_mode=0,
            custom_mode=0,
            system_status=dialect.MAV_STATE_ACTIVE,
            mavlink_version=3,
        )

    def _setpoint(self, target: Target, now_s: float) -> bytes:
        """Return the frame that pymavlink makes, in a third of the time: it is in every command's way."""
        payload = _SETPOINT.unpacker.pack(
            int(now_s * 1e3) % 2**32,
            *(0.0, 0.0, 0.0),
            *target.velocity_m_s,
            *(0.0, 0.0, 0.0, 0.0),
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
        checksum = dialect.x25crc(checked + _SETPOINT_EXTRA).crc
        return b"%c%b%b" % (MAGIC, checked, checksum.to_bytes(CRC_BYTES, "little"))
