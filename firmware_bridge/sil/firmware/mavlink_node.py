"""An ArduPilot Rover on a UDP socket, as far as its MAVLink 2 tells.

Source: ArduPilot's "Rover commands in guided mode" and the MAVLink ``common`` message set. It changes mode,
arms, follows forward speed and yaw rate in GUIDED, streams at the intervals it is asked for, and answers
TIMESYNC and PARAM_REQUEST_READ.
"""

import contextlib
import math
import random
import socket
import struct
import time
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import common  # type: ignore[import-untyped]

from firmware_bridge.kinematics.frames import rotate, swap_enu_ned, swap_heading_yaw
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.sil.firmware.node import FirmwareNode, Pace, to_monotonic
from firmware_bridge.sil.firmware.world import Pose
from firmware_bridge.sil.scenario.scenario import AUTOPILOT

STREAM_PERIOD_S: Final = 0.25
"""Until SET_MESSAGE_INTERVAL asks for another."""
_PROFILE: Final = PROFILES[AUTOPILOT]
_TIMESPEC: Final = struct.Struct("@ll")
_SO_TIMESTAMPNS: Final = 35
_DATAGRAM_BYTES: Final = 2048
_STREAMS: Final = ("heartbeat", "attitude", "local_position_ned")

Message: TypeAlias = Any
"""An object of pymavlink, which has no types."""


class MavlinkNode(FirmwareNode):
    """Listens on a port of this machine and answers whoever spoke last."""

    def __init__(self, robot_id: int, port: int, pace: Pace) -> None:
        super().__init__(robot_id, pace)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", port))
        self._companion: tuple[str, int] | None = None
        self._codec = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._born_s = time.monotonic() - 100.0  # the autopilot's clock is not ours
        self._mode, self._armed = 0, False
        self._period_s = dict.fromkeys(_STREAMS, STREAM_PERIOD_S)
        self._due_s = dict.fromkeys(_STREAMS, 0.0)
        self._stamp_ms = 0
        self._draw = random.Random(robot_id)

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def receive(self) -> None:
        """Take in and obey every datagram; each holds whole frames."""
        while True:
            try:
                data, control, _, self._companion = self._socket.recvmsg(_DATAGRAM_BYTES, 64)
            except (BlockingIOError, ConnectionRefusedError):
                return
            seconds, nanoseconds = _TIMESPEC.unpack(control[0][2])
            arrival_s = to_monotonic(seconds + nanoseconds * 1e-9)
            with contextlib.suppress(common.MAVError):
                self._obey(self._codec.decode(bytearray(data)), arrival_s)

    def report(self, pose: Pose) -> None:
        """Send the streams that are due."""
        now_s = time.monotonic()
        due = [name for name in _STREAMS if now_s >= self._due_s[name]]
        for name in due:
            # On a grid, so that what the loop is late by does not add up.
            self._due_s[name] = max(self._due_s[name] + self._period_s[name], now_s)
        boot_ms = round(1e3 * (now_s - self._born_s))
        if "heartbeat" in due:
            self._send(self._heartbeat())
        if "attitude" in due:
            yaw = swap_heading_yaw(pose.heading_rad)
            self._send(common.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, -pose.yaw_rad_s))
        if "local_position_ned" in due and self.located:
            self._send_position(boot_ms, pose)

    def _send_position(self, boot_ms: int, pose: Pose) -> None:
        self._stamp_ms = self._stamp_ms if self.stale else boot_ms
        north, east = (math.nan, math.nan) if self.not_finite else swap_enu_ned(pose.position_m)
        v_north, v_east = swap_enu_ned(rotate((pose.forward_m_s, 0.0), pose.heading_rad))
        self._send(
            common.MAVLink_local_position_ned_message(self._stamp_ms, north, east, 0.0, v_north, v_east, 0.0)
        )
        self._sent_pose(self._born_s + 1e-3 * self._stamp_ms)

    def _heartbeat(self) -> Message:
        flags = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= common.MAV_MODE_FLAG_SAFETY_ARMED if self._armed else 0
        return common.MAVLink_heartbeat_message(
            common.MAV_TYPE_GROUND_ROVER,
            common.MAV_AUTOPILOT_ARDUPILOTMEGA,
            flags,
            self._mode,
            common.MAV_STATE_ACTIVE,
            3,
        )

    def _obey(self, message: Message, arrival_s: float) -> None:
        match message.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED":
                motion = (float(message.vx), -float(message.yaw_rate))
                self._follow(arrival_s, motion, obeys=self._obeys())
            case "COMMAND_LONG":
                self._command(message)
            case "TIMESYNC" if message.tc1 == 0:
                remote_ns = round(1e9 * (time.monotonic() - self._born_s))
                self._send(common.MAVLink_timesync_message(remote_ns, message.ts1))
            case "PARAM_REQUEST_READ":
                name = _PROFILE.timeout_parameter.encode()
                self._send(common.MAVLink_param_value_message(name, self.timeout_s, 9, 1, 0))

    def _obeys(self) -> bool:
        return self._armed and self._mode == _PROFILE.command_mode.reported

    def _command(self, message: Message) -> None:
        match message.command:
            case common.MAV_CMD_COMPONENT_ARM_DISARM:
                self._armed = message.param1 == 1.0
            case common.MAV_CMD_DO_SET_MODE:
                self._mode = int(message.param2)
            case common.MAV_CMD_SET_MESSAGE_INTERVAL:
                self._set_interval(int(message.param1), 1e-6 * message.param2)
        if not self._obeys():
            self._halt()
        self._send(common.MAVLink_command_ack_message(message.command, common.MAV_RESULT_ACCEPTED))
        self._due_s["heartbeat"] = 0.0  # a change of mode is told at once

    def _set_interval(self, message_id: int, period_s: float) -> None:
        ids = {
            common.MAVLINK_MSG_ID_HEARTBEAT: "heartbeat",
            common.MAVLINK_MSG_ID_ATTITUDE: "attitude",
            common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: "local_position_ned",
        }
        if message_id in ids and period_s > 0.0:
            self._period_s[ids[message_id]] = period_s

    def _send(self, message: Message) -> None:
        """Send to the companion; one that was killed refuses it, and the rover does not mind."""
        if self._companion is None:
            return
        frame = bytearray(message.pack(self._codec))
        if self.corrupt:
            frame[self._draw.randrange(len(frame))] ^= 1 << self._draw.randrange(8)
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            self._socket.sendto(frame, self._companion)
