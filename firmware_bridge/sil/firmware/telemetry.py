"""What an autopilot tells of itself, as MAVLink 2 frames.

Source: MAVLink's ``common`` and ``ardupilotmega`` message sets; ArduPilot 4.7's AP_GPS.cpp (the time stamp of
GPS_RAW_INT is that of the last fix) and ArduCopter's heartbeat (standby while it is landed).
"""

import math
from collections.abc import Callable, Iterator
from time import monotonic
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect  # type: ignore[import-untyped]

from firmware_bridge.kinematics.frames import rotate, swap_enu_ned, swap_heading_yaw
from firmware_bridge.mavlink.profiles import Profile
from firmware_bridge.sil.firmware.firmware import Firmware
from firmware_bridge.sil.firmware.intervals import Intervals
from firmware_bridge.sil.firmware.world import BaseState

TIMEOUT_S: Final = 0.5
UPTIME_S: Final = 100.0
"""The autopilot's clock is not ours."""
SOUND: Final = 0x033F
"""Estimator flags while all is well."""
HEARTBEAT: Final = dialect.MAVLINK_MSG_ID_HEARTBEAT
ATTITUDE: Final = dialect.MAVLINK_MSG_ID_ATTITUDE
POSITION: Final = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
GPS: Final = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
LANDED: Final = dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
_TYPES: Final = {
    "ardupilot_rover": (dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA),
    "ardupilot_copter": (dialect.MAV_TYPE_QUADROTOR, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA),
    "px4": (dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_AUTOPILOT_PX4),
}

Message: TypeAlias = Any
"""An object of pymavlink, which has no types."""


class Telemetry(Firmware[bytes]):
    """One vehicle, system 1, component 1, as it describes itself; a copter begins in the air.

    Args:
        profile: whose modes and parameters it has.
        clock: monotonic time in seconds.
    """

    def __init__(self, profile: Profile, clock: Callable[[], float] = monotonic) -> None:
        super().__init__(TIMEOUT_S, clock)
        self.profile = profile
        self.vehicle_type, self.autopilot_type = _TYPES[profile.name]
        self.landed = self.vehicle_type != dialect.MAV_TYPE_QUADROTOR
        """As EXTENDED_SYS_STATE tells it, and a copter's heartbeat."""
        self.mode, self.armed = 0, not self.landed
        """As HEARTBEAT tells them; whoever writes them is the operator, or a failsafe."""
        self.odometry = False
        """Whether the state comes as ODOMETRY."""
        self.resets = 0
        """How often its estimator set the position anew."""
        self.estimator_flags, self.test_ratio = SOUND, 0.1
        self.fix, self.gps_lost = dialect.GPS_FIX_TYPE_3D_FIX, False
        """What GPS_RAW_INT tells, and whether fixes no longer come, which the flags tell only much later."""
        self.intervals = Intervals((HEARTBEAT, ATTITUDE, POSITION, profile.estimator_message, GPS, LANDED))
        self.codec = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self._born_s = clock() - UPTIME_S
        self._stamp_ms = self._fix_us = 0

    def sign(self, key: bytes, tick: int) -> None:
        """Sign and demand signatures, by pymavlink's own rules."""
        signing = self.codec.signing
        signing.secret_key, signing.timestamp, signing.sign_outgoing = key, tick, True

    def pack(self, message: Message) -> bytes:
        """Return a message's frame, signed if there is a key."""
        return bytes(message.pack(self.codec))

    def _telemetry(self, state: BaseState) -> Iterator[bytes]:
        now_s = self.clock()
        boot_ms = round(1e3 * (now_s - self._born_s))
        self._stamp_ms = self._stamp_ms if self.stale else boot_ms
        self._fix_us = self._fix_us if self.gps_lost else 1000 * boot_ms
        for message in self.intervals.due(now_s):
            if message != POSITION or self.located:
                yield self.pack(self._message(message, state, boot_ms))
            if message == POSITION and self.located:
                self.on_pose(self._born_s + 1e-3 * self._stamp_ms)

    def _message(self, message: int, state: BaseState, boot_ms: int) -> Message:
        match message:
            case dialect.MAVLINK_MSG_ID_HEARTBEAT:
                return self._heartbeat()
            case dialect.MAVLINK_MSG_ID_ATTITUDE:
                yaw = swap_heading_yaw(state.heading_rad)
                return dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, -state.yaw_rad_s)
            case dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
                return self._position(state)
            case dialect.MAVLINK_MSG_ID_GPS_RAW_INT:
                return dialect.MAVLink_gps_raw_int_message(
                    self._fix_us, self.fix, 0, 0, 0, 100, 100, 0, 0, 10
                )
            case dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
                air, ground = dialect.MAV_LANDED_STATE_IN_AIR, dialect.MAV_LANDED_STATE_ON_GROUND
                return dialect.MAVLink_extended_sys_state_message(0, ground if self.landed else air)
        return self._estimator()

    def _estimator(self) -> Message:
        ratios = (self.test_ratio, self.test_ratio, 0.1, 0.1, 0.1)
        if self.autopilot_type == dialect.MAV_AUTOPILOT_PX4:
            return dialect.MAVLink_estimator_status_message(0, self.estimator_flags, *ratios, 0.1, 0.1, 0.1)
        return dialect.MAVLink_ekf_status_report_message(self.estimator_flags, *ratios)

    def _heartbeat(self) -> Message:
        flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= dialect.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        state = dialect.MAV_STATE_STANDBY if self.landed else dialect.MAV_STATE_ACTIVE
        status = (flags, self.mode, state, 3)
        return dialect.MAVLink_heartbeat_message(self.vehicle_type, self.autopilot_type, *status)

    def _position(self, state: BaseState) -> Message:
        north, east = (math.nan, math.nan) if self.not_finite else swap_enu_ned(state.position_m)
        if self.odometry:
            half, zeros = swap_heading_yaw(state.heading_rad) / 2, [0.0] * 21
            attitude = [math.cos(half), 0.0, 0.0, math.sin(half)]
            place = (north, east, 0.0, attitude, state.forward_m_s, 0.0, 0.0, 0.0, 0.0, -state.yaw_rad_s)
            frames = (dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD)
            stamp_us, resets = 1000 * self._stamp_ms, self.resets
            return dialect.MAVLink_odometry_message(stamp_us, *frames, *place, zeros, zeros, resets)
        v_north, v_east = swap_enu_ned(rotate((state.forward_m_s, 0.0), state.heading_rad))
        return dialect.MAVLink_local_position_ned_message(
            self._stamp_ms, north, east, 0.0, v_north, v_east, 0.0
        )

    def _damaged(self, packet: bytes) -> bytes:
        frame = bytearray(packet)
        frame[self._draw.randrange(len(frame))] ^= 1 << self._draw.randrange(8)
        return bytes(frame)
