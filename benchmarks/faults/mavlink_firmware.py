"""An ArduPilot Rover, as far as a guard can tell, at the other end of a UDP socket."""

import contextlib
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
from pymavlink.dialects.v20 import common

from benchmarks.faults.firmware import DEADLINE_S, PERIOD_S, Firmware, Heard, free_port, to_monotonic
from edge_runtime.common.key_file import read_key
from edge_runtime.motion.dynamics import Dynamics
from firmware_bridge.guard.link import Limits
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.mavlink.link import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.signing import clock_ticks

_SO_TIMESTAMPNS = 35
_PROFILE = PROFILES["ardupilot_rover"]
_TIMESPEC = struct.Struct("@ll")


class MavlinkFirmware(Firmware):
    """Changes mode, arms, streams its pose and answers TIMESYNC and PARAM_REQUEST_READ."""

    name = "mavlink"

    def __init__(self, signing_key: Path | None = None) -> None:
        super().__init__()
        self._signing_key = signing_key
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket.setblocking(False)
        self._port = free_port()
        self._socket.bind(("127.0.0.1", self._port))
        self._companion: tuple[str, int] | None = None
        self._codec = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._mode, self._armed = 0, False
        if signing_key is not None:
            sign(self._codec, read_key(signing_key))

    def spec(self) -> GuardSpec:
        """Return what a guard of this rover is started with."""
        options = MavlinkOptions(
            _PROFILE.name,
            f"udpout:127.0.0.1:{self._port}",
            Dynamics(1.0, 0.25, PERIOD_S),
            point_ahead_m=0.2,
            signing_key="" if self._signing_key is None else str(self._signing_key),
        )
        raw = msgspec.Raw(msgspec.json.encode(options))
        return GuardSpec("mavlink", 0, DEADLINE_S, Limits(1.5, 1.0), raw, arm=True)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def commands(self) -> Iterator[tuple[float | str, ...]]:
        """Yield what each setpoint and each COMMAND_LONG asks for."""
        for _, message in self._arrived():
            if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                m = message
                yield m.type_mask, m.x, m.y, m.z, m.vx, m.vy, m.vz, m.afx, m.afy, m.afz, m.yaw, m.yaw_rate
            elif message.get_type() == "COMMAND_LONG":
                yield message.command, message.param1, message.param2

    def _receive(self) -> Iterator[Heard]:
        for time_s, message in self._arrived():
            drives = self._obey(message)
            if drives is not None:
                yield Heard(time_s, drives)

    def _arrived(self) -> Iterator[tuple[float, common.MAVLink_message]]:
        with contextlib.suppress(BlockingIOError):
            while True:
                data, (control,), _, self._companion = self._socket.recvmsg(2048, 64)
                seconds, nanoseconds = _TIMESPEC.unpack(control[2])
                yield to_monotonic(seconds + nanoseconds * 1e-9), self._codec.decode(bytearray(data))

    def send_bytes(self, frame: bytes) -> None:
        """Send anything to the companion; one that was killed refuses it, and the rover does not mind."""
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            self._socket.sendto(frame, self._companion)

    def pack(self, message: common.MAVLink_message) -> bytes:
        """Return the frame of a message, signed if this rover has a key."""
        return bytes(message.pack(self._codec))

    def _obey(self, message: common.MAVLink_message) -> bool | None:
        """Do what a message asks for; returns whether it drives the rover, None if it does not command it."""
        match message.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED":
                return message.vx != 0.0 or message.yaw_rate != 0.0
            case "COMMAND_LONG":
                return self._command(message)
            case "TIMESYNC" if message.tc1 == 0:
                self._send(common.MAVLink_timesync_message(time.monotonic_ns(), message.ts1))
            case "PARAM_REQUEST_READ":
                name = _PROFILE.timeout_parameter.encode()
                self._send(common.MAVLink_param_value_message(name, self.timeout_s, 9, 1, 0))
        return None

    def _command(self, message: common.MAVLink_message) -> bool | None:
        self._send(common.MAVLink_command_ack_message(message.command, common.MAV_RESULT_ACCEPTED))
        if message.command == common.MAV_CMD_COMPONENT_ARM_DISARM:
            self._armed = message.param1 == 1.0
        elif message.command == common.MAV_CMD_DO_SET_MODE:
            self._mode = int(message.param2)
        else:
            return None
        return False

    def _report(self) -> None:
        if self._companion is None:
            return
        boot_ms = time.monotonic_ns() // 1_000_000 % 2**32
        flags = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= common.MAV_MODE_FLAG_SAFETY_ARMED if self._armed else 0
        self._send(common.MAVLink_heartbeat_message(10, 3, flags, self._mode, 4, 3))
        self._send(common.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0))
        self._send(common.MAVLink_local_position_ned_message(boot_ms, 0, 0, 0, 0, 0, 0))

    def _send(self, message: common.MAVLink_message) -> None:
        self.send_bytes(self.pack(message))


def sign(codec: common.MAVLink, key: bytes) -> None:
    """Make pymavlink sign every frame that it packs, and check those that it reads."""
    codec.signing.secret_key = key
    codec.signing.timestamp = clock_ticks()
    codec.signing.sign_outgoing = True
