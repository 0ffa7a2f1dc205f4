"""Peers for the MAVLink tests: an autopilot scripted with pymavlink, free of sockets and wall clocks."""

import os
import struct

from pymavlink.dialects.v20 import common

from firmware_bridge.mavlink.profiles import PROFILES


def vehicle_frame(message, system=1, component=1, sequence=0, signing=None):
    """One frame as pymavlink packs it; ``signing`` is (key, timestamp)."""
    packer = common.MAVLink(None, srcSystem=system, srcComponent=component)
    packer.seq = sequence
    if signing is not None:
        packer.signing.secret_key, packer.signing.timestamp = signing
        packer.signing.sign_outgoing = True
    return bytes(message.pack(packer))


def local_position(boot_ms=1000, x=1.0, y=2.0, vx=0.1, vy=0.2):
    return common.MAVLink_local_position_ned_message(boot_ms, x, y, -3.0, vx, vy, 0.0)


def odometry(boot_ms=2500, frame_id=1, child_frame_id=12, x=1.0, yaw_rate=0.5, q=(1.0, 0.0, 0.0, 0.0)):
    covariance = [0.0] * 21
    position, velocity, turn = (x, 2.0, 3.0), (0.25, 0.5, 0.75), (0.0, 0.0, yaw_rate)
    return common.MAVLink_odometry_message(
        boot_ms * 1000, frame_id, child_frame_id, *position, list(q), *velocity, *turn, covariance, covariance
    )


class Ticks:
    """A clock that moves a little whenever it is read."""

    def __init__(self, start_s=100.0, step_s=0.004):
        self.now_s = start_s
        self.step_s = step_s

    def __call__(self):
        self.now_s += self.step_s
        return self.now_s


class ScriptedAutopilot:
    """Answers like the autopilot of a profile, and is the link's transport at once."""

    datagrams = True

    def __init__(self, profile, clock, timeout_s=0.5):
        self.profile, self.clock = PROFILES[profile], clock
        self.mode, self.armed = 0, False
        self.timeout_s = timeout_s
        self.refuses = set()
        """Command numbers that are acknowledged and then ignored."""
        self.silent = False
        self.frozen = False
        """Whether position no longer comes."""
        self.heard = []
        """Messages in the order in which they arrived."""
        self.yaw, self.yaw_rate = 0.0, 0.0
        self.boot_offset_s = 50.0
        self.proofs = []
        self.odometry = False
        """Whether the state comes as ODOMETRY."""
        self.acknowledges = 0
        """Result that refused commands are acknowledged with."""
        self.complains = True
        self._parser = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._answers = []
        self._readable, writer = os.pipe()
        os.write(writer, b"x")
        os.close(writer)

    def fileno(self):
        return self._readable

    def answer_sender(self, proved):
        self.proofs.append(proved)

    def close(self):
        os.close(self._readable)

    def sign(self, key, tick):
        """Sign and demand signatures by pymavlink's own rules."""
        self._parser.signing.secret_key, self._parser.signing.timestamp = key, tick
        self._parser.signing.sign_outgoing = True

    def send(self, frame):
        if not self.proofs:
            return False  # A listening port knows nobody to send to.
        try:
            message = self._parser.decode(bytearray(frame))
        except common.MAVError:
            return True
        self.heard.append(message)
        answer = getattr(self, "on_" + message.get_type().lower(), None)
        if answer is not None:
            answer(message)
        return True

    def receive(self):
        if self.silent:
            return
        boot_ms = int((self.clock.now_s - self.boot_offset_s) * 1e3)
        telemetry = [self.heartbeat()]
        if not self.frozen:
            telemetry.append(
                common.MAVLink_attitude_message(boot_ms, 0.0, 0.0, self.yaw, 0.0, 0.0, self.yaw_rate)
            )
            telemetry.append(odometry(boot_ms) if self.odometry else local_position(boot_ms))
        answers, self._answers = self._answers, []
        for message in (*answers, *telemetry):
            yield bytes(message.pack(self._parser))

    def heartbeat(self):
        base = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= common.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        return common.MAVLink_heartbeat_message(2, 3, base, self.mode, 4, 3)

    def on_timesync(self, request):
        remote_ns = int((self.clock.now_s - self.boot_offset_s) * 1e9)
        self._answers.append(common.MAVLink_timesync_message(remote_ns, request.ts1))

    def on_param_request_read(self, request):
        if self.timeout_s is not None and request.param_id == self.profile.timeout_parameter:
            name = self.profile.timeout_parameter.encode()
            self._answers.append(common.MAVLink_param_value_message(name, self.timeout_s, 9, 1, 0))

    def on_command_long(self, command):
        result = self.acknowledges if command.command in self.refuses else 0
        self._answers.append(common.MAVLink_command_ack_message(command.command, result))
        if command.command in self.refuses:
            if self.complains:
                self._answers.append(common.MAVLink_statustext_message(3, b"Arm: compass not calibrated"))
        elif command.command == common.MAV_CMD_DO_SET_MODE:
            self.mode = self._reported(int(command.param2), int(command.param3))
        elif command.command == common.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = command.param1 == 1.0

    def _reported(self, main, sub):
        """PX4 packs main and sub mode into HEARTBEAT.custom_mode, ArduPilot has one number."""
        if self.profile.name == "px4":
            return struct.unpack("<I", struct.pack("<HBB", 0, main, sub))[0]
        return main

    def setpoints(self):
        return [m for m in self.heard if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]

    def commands(self, number):
        return [m for m in self.heard if m.get_type() == "COMMAND_LONG" and m.command == number]
