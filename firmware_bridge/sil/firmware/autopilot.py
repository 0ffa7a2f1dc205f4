"""An autopilot, as far as its MAVLink 2 tells.

Source: ArduPilot's "Rover commands in guided mode", PX4's "Offboard mode" and the MAVLink ``common`` message
set. It changes mode, arms, follows forward speed and yaw rate in its command mode, grants or denies streams,
answers TIMESYNC and PARAM_REQUEST_READ, and may leave its command mode where the guard's heartbeats end.
"""

import math
import struct
from collections.abc import Callable, Iterable, Iterator
from time import monotonic
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect  # type: ignore[import-untyped]

from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.mavlink.profiles import Profile
from firmware_bridge.sil.firmware.firmware import Heard
from firmware_bridge.sil.firmware.telemetry import HEARTBEAT, Message, Telemetry
from firmware_bridge.sil.firmware.world import BaseState

LOOP_RATE_HZ: Final = 200.0
"""ArduPilot's SCHED_LOOP_RATE, as the documentation advises; Rover's own is 50."""
STATION_TIMEOUT_S: Final = 5.0
"""ArduPilot's FS_GCS_TIMEOUT."""
_GUARD = 255
"""The system whose heartbeats the failsafe watches (ArduPilot's SYSID_MYGCS)."""


class Autopilot(Telemetry):
    """One vehicle, system 1, component 1.

    Args:
        profile: whose modes and parameters it has.
        clock: monotonic time in seconds.
    """

    def __init__(self, profile: Profile, clock: Callable[[], float] = monotonic) -> None:
        super().__init__(profile, clock)
        self.loop_rate_hz = LOOP_RATE_HZ if profile.loop_rate_parameter else None
        """What is faster than 80 % of it is denied; None: nothing is."""
        self.parameters = {profile.timeout_parameter: self.timeout_s}
        """Those that it tells, beside its loop rate."""
        self.refuses: set[int] = set()
        """Numbers of commands that are acknowledged and then ignored."""
        self.refusal, self.complains = 0, True
        """MAV_RESULT that acknowledges those, and whether a STATUSTEXT says why."""
        self.station_failsafe = False
        """Whether it leaves its command mode once the guard's heartbeats have ended."""
        self._station_s = math.inf

    def _take(self, packet: bytes, arrival_s: float) -> Iterator[bytes]:
        """Obey one datagram, which holds one frame."""
        try:
            message = self.codec.decode(bytearray(packet))
        except dialect.MAVError:
            return
        for answer in self._obey(message, arrival_s):
            yield self.pack(answer)

    def _obey(self, message: Message, arrival_s: float) -> Iterable[Message]:
        match message.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED":
                motion = BaseMotion(float(message.vx), 0.0, -float(message.yaw_rate))
                self._follow(motion, arrival_s)
                self.on_command(Heard(arrival_s, motion, message))
            case "COMMAND_LONG":
                yield from self._command(message)
                self.on_command(Heard(arrival_s, None, message))
            case "TIMESYNC" if message.tc1 == 0:
                remote_ns = round(1e9 * (self.clock() - self._born_s))
                yield dialect.MAVLink_timesync_message(remote_ns, message.ts1)
            case "PARAM_REQUEST_READ":
                yield from self._tell(message.param_id)
            case "REQUEST_DATA_STREAM":
                self.intervals.request_all(message.req_message_rate)
            case "HEARTBEAT" if message.get_srcSystem() == _GUARD:
                self._station_s = arrival_s

    def _tell(self, name: str) -> Iterator[Message]:
        """Answer for a parameter; ArduPilot says nothing of one that it does not have."""
        if name == self.profile.loop_rate_parameter and self.loop_rate_hz is not None:
            kind = dialect.MAV_PARAM_TYPE_INT16
            yield dialect.MAVLink_param_value_message(name.encode(), self.loop_rate_hz, kind, 1, 0)
        elif name in self.parameters:
            kind = dialect.MAV_PARAM_TYPE_REAL32
            yield dialect.MAVLink_param_value_message(name.encode(), self.parameters[name], kind, 1, 0)

    def _command(self, message: Message) -> Iterator[Message]:
        if message.command in self.refuses:
            yield dialect.MAVLink_command_ack_message(message.command, self.refusal)
            if self.complains:
                yield dialect.MAVLink_statustext_message(3, b"Arm: compass not calibrated")
            return
        about = int(message.param1)
        if message.command == dialect.MAV_CMD_GET_MESSAGE_INTERVAL:
            yield dialect.MAVLink_message_interval_message(about, self.intervals.get_us(about))
        yield dialect.MAVLink_command_ack_message(message.command, self._execute(message, about))
        self._mind_mode()
        self.intervals.send_now(HEARTBEAT)  # a change of mode is told at once

    def _execute(self, message: Message, about: int) -> int:
        """Obey, and return the MAV_RESULT."""
        match message.command:
            case dialect.MAV_CMD_COMPONENT_ARM_DISARM:
                self.armed = message.param1 == 1.0
            case dialect.MAV_CMD_DO_SET_MODE:
                self.mode = self._reported(int(message.param2), int(message.param3))
            case dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                return self.intervals.set(about, message.param2, self.loop_rate_hz)
            case dialect.MAV_CMD_REQUEST_MESSAGE:
                self.intervals.send_now(about)
        return int(dialect.MAV_RESULT_ACCEPTED)

    def _reported(self, main: int, sub: int) -> int:
        """PX4 packs main and sub mode into HEARTBEAT.custom_mode, ArduPilot has one number."""
        if self.autopilot_type != dialect.MAV_AUTOPILOT_PX4:
            return main
        return int.from_bytes(struct.pack("<HBB", 0, main, sub), "little")

    def _obeys(self) -> bool:
        return self.armed and self.mode == self.profile.command_mode.reported

    def _telemetry(self, state: BaseState) -> Iterator[bytes]:
        missing_s = self.clock() - self._station_s
        deserted = self.station_failsafe and missing_s > STATION_TIMEOUT_S
        if self._obeys() and (deserted or self.pressed):
            self.mode = self.profile.stop_mode.reported
            self._mind_mode()
        yield from super()._telemetry(state)
