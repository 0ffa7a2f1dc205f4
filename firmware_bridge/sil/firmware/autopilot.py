"""An autopilot, as far as its MAVLink 2 tells.

Source: ArduPilot's "Rover commands in guided mode", PX4's "Offboard mode" and the MAVLink ``common`` message
set. It changes mode, arms, follows forward speed and yaw rate in its command mode, streams at the intervals
that it is asked for, and answers TIMESYNC and PARAM_REQUEST_READ.
"""

import math
import struct
from collections.abc import Callable, Iterable, Iterator
from time import monotonic
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import common  # type: ignore[import-untyped]

from firmware_bridge.kinematics.frames import rotate, swap_enu_ned, swap_heading_yaw
from firmware_bridge.mavlink.profiles import Profile
from firmware_bridge.sil.firmware.firmware import Firmware, Heard
from firmware_bridge.sil.firmware.world import BaseState

TIMEOUT_S: Final = 0.5
STREAM_PERIOD_S: Final = 0.25
"""Until SET_MESSAGE_INTERVAL asks for another."""
UPTIME_S: Final = 100.0
"""The autopilot's clock is not ours."""
STREAMS: Final = {
    common.MAVLINK_MSG_ID_HEARTBEAT: "heartbeat",
    common.MAVLINK_MSG_ID_ATTITUDE: "attitude",
    common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: "local_position_ned",
}
_TYPES: Final = {
    "ardupilot_rover": (common.MAV_TYPE_GROUND_ROVER, common.MAV_AUTOPILOT_ARDUPILOTMEGA),
    "ardupilot_copter": (common.MAV_TYPE_QUADROTOR, common.MAV_AUTOPILOT_ARDUPILOTMEGA),
    "px4": (common.MAV_TYPE_QUADROTOR, common.MAV_AUTOPILOT_PX4),
}

Message: TypeAlias = Any
"""An object of pymavlink, which has no types."""


class Autopilot(Firmware[bytes]):
    """One vehicle, system 1, component 1.

    Args:
        profile: whose modes and parameters it has.
        clock: monotonic time in seconds.
    """

    def __init__(self, profile: Profile, clock: Callable[[], float] = monotonic) -> None:
        super().__init__(TIMEOUT_S, clock)
        self.profile = profile
        self.vehicle_type, self.autopilot_type = _TYPES[profile.name]
        self.mode, self.armed = 0, False
        """As HEARTBEAT tells them; whoever writes them is the operator, or a failsafe."""
        self.parameters = {profile.timeout_parameter: self.timeout_s}
        """Those that it tells."""
        self.refuses: set[int] = set()
        """Numbers of commands that are acknowledged and then ignored."""
        self.refusal, self.complains = 0, True
        """MAV_RESULT that acknowledges those, and whether a STATUSTEXT says why."""
        self.odometry = False
        """Whether the state comes as ODOMETRY."""
        self.period_s = dict.fromkeys(STREAMS.values(), STREAM_PERIOD_S)
        self._due_s = dict.fromkeys(STREAMS.values(), 0.0)
        self.codec = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._born_s = clock() - UPTIME_S
        self._stamp_ms = 0

    def sign(self, key: bytes, tick: int) -> None:
        """Sign and demand signatures, by pymavlink's own rules."""
        signing = self.codec.signing
        signing.secret_key, signing.timestamp, signing.sign_outgoing = key, tick, True

    def pack(self, message: Message) -> bytes:
        """Return a message's frame, signed if there is a key."""
        return bytes(message.pack(self.codec))

    def _take(self, packet: bytes, arrival_s: float) -> Iterator[bytes]:
        """Obey one datagram, which holds one frame."""
        try:
            message = self.codec.decode(bytearray(packet))
        except common.MAVError:
            return
        for answer in self._obey(message, arrival_s):
            yield self.pack(answer)

    def _obey(self, message: Message, arrival_s: float) -> Iterable[Message]:
        match message.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED":
                motion = (float(message.vx), -float(message.yaw_rate))
                self._follow(motion, arrival_s)
                self.on_command(Heard(arrival_s, motion, message))
            case "COMMAND_LONG":
                yield from self._command(message)
                self.on_command(Heard(arrival_s, None, message))
            case "TIMESYNC" if message.tc1 == 0:
                remote_ns = round(1e9 * (self.clock() - self._born_s))
                yield common.MAVLink_timesync_message(remote_ns, message.ts1)
            case "PARAM_REQUEST_READ" if message.param_id in self.parameters:
                value = self.parameters[message.param_id]
                yield common.MAVLink_param_value_message(message.param_id.encode(), value, 9, 1, 0)

    def _command(self, message: Message) -> Iterator[Message]:
        refused = message.command in self.refuses
        result = self.refusal if refused else common.MAV_RESULT_ACCEPTED
        yield common.MAVLink_command_ack_message(message.command, result)
        if not refused:
            self._execute(message)
        elif self.complains:
            yield common.MAVLink_statustext_message(3, b"Arm: compass not calibrated")
        self._mind_mode()
        self._due_s["heartbeat"] = 0.0  # a change of mode is told at once

    def _execute(self, message: Message) -> None:
        match message.command:
            case common.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = message.param1 == 1.0
            case common.MAV_CMD_DO_SET_MODE:
                self.mode = self._reported(int(message.param2), int(message.param3))
            case common.MAV_CMD_SET_MESSAGE_INTERVAL:
                name, period_s = STREAMS.get(int(message.param1)), 1e-6 * message.param2
                if name is not None and period_s > 0.0:
                    self.period_s[name] = period_s

    def _reported(self, main: int, sub: int) -> int:
        """PX4 packs main and sub mode into HEARTBEAT.custom_mode, ArduPilot has one number."""
        if self.autopilot_type != common.MAV_AUTOPILOT_PX4:
            return main
        return int.from_bytes(struct.pack("<HBB", 0, main, sub), "little")

    def _obeys(self) -> bool:
        return self.armed and self.mode == self.profile.command_mode.reported

    def _telemetry(self, state: BaseState) -> Iterator[bytes]:
        now_s = self.clock()
        due = self._due(now_s)
        boot_ms = round(1e3 * (now_s - self._born_s))
        if "heartbeat" in due:
            yield self.pack(self._heartbeat())
        if "attitude" in due:
            yaw = swap_heading_yaw(state.heading_rad)
            yield self.pack(
                common.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, -state.yaw_rad_s)
            )
        if "local_position_ned" in due and self.located:
            self._stamp_ms = self._stamp_ms if self.stale else boot_ms
            yield self.pack(self._position(state))
            self.on_pose(self._born_s + 1e-3 * self._stamp_ms)

    def _due(self, now_s: float) -> list[str]:
        """Return the streams whose time has come, on a grid: what the loop is late by does not add up."""
        due = [name for name, due_s in self._due_s.items() if now_s >= due_s]
        for name in due:
            self._due_s[name] = max(self._due_s[name] + self.period_s[name], now_s)
        return due

    def _heartbeat(self) -> Message:
        flags = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= common.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        status = (flags, self.mode, common.MAV_STATE_ACTIVE, 3)
        return common.MAVLink_heartbeat_message(self.vehicle_type, self.autopilot_type, *status)

    def _position(self, state: BaseState) -> Message:
        north, east = (math.nan, math.nan) if self.not_finite else swap_enu_ned(state.position_m)
        if self.odometry:
            half, zeros = swap_heading_yaw(state.heading_rad) / 2, [0.0] * 21
            attitude = [math.cos(half), 0.0, 0.0, math.sin(half)]
            place = (north, east, 0.0, attitude, state.forward_m_s, 0.0, 0.0, 0.0, 0.0, -state.yaw_rad_s)
            frames = (common.MAV_FRAME_LOCAL_NED, common.MAV_FRAME_BODY_FRD)
            return common.MAVLink_odometry_message(1000 * self._stamp_ms, *frames, *place, zeros, zeros)
        v_north, v_east = swap_enu_ned(rotate((state.forward_m_s, 0.0), state.heading_rad))
        return common.MAVLink_local_position_ned_message(
            self._stamp_ms, north, east, 0.0, v_north, v_east, 0.0
        )

    def _damaged(self, packet: bytes) -> bytes:
        frame = bytearray(packet)
        frame[self._draw.randrange(len(frame))] ^= 1 << self._draw.randrange(8)
        return bytes(frame)
