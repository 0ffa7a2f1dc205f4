"""Peers for the MAVLink tests: an autopilot scripted with pymavlink, free of sockets and wall clocks."""

import math
import os

from pymavlink.dialects.v20 import ardupilotmega as common

from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.sil.firmware.autopilot import Autopilot
from firmware_bridge.sil.firmware.world import BaseState

HOME = ("10.0.0.2", 14550)
"""Where the scripted autopilot speaks from."""
NORTHBOUND = BaseState((2.0, 1.0), math.pi / 2, 0.1, 0.0)


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


def odometry(
    boot_ms=2500, frame_id=1, child_frame_id=12, x=1.0, yaw_rate=0.5, q=(1.0, 0.0, 0.0, 0.0), resets=7
):
    covariance = [0.0] * 21
    position, velocity, turn = (x, 2.0, 3.0), (0.25, 0.5, 0.75), (0.0, 0.0, yaw_rate)
    return common.MAVLink_odometry_message(
        *(boot_ms * 1000, frame_id, child_frame_id, *position, list(q)),
        *(*velocity, *turn, covariance, covariance, resets),
    )


class Ticks:
    """A clock that moves a little whenever it is read."""

    def __init__(self, start_s=100.0, step_s=0.004):
        self.now_s = start_s
        self.step_s = step_s

    def __call__(self):
        self.now_s += self.step_s
        return self.now_s


class ScriptedAutopilot(Autopilot):
    """The harness's autopilot as a link's transport."""

    datagrams = True
    sender = HOME

    def __init__(self, profile, clock):
        super().__init__(PROFILES[profile], lambda: clock.now_s)
        self.heard = []
        """Messages in the order in which they arrived."""
        self.answered = []
        """The addresses that it was told to send to, in their order."""
        self.others = []
        """Frames of others on the same port, with their senders: they come first."""
        self.dropped = 0
        self.punctual = False
        """Whether messages come at their intervals, and not all of them whenever it is read."""
        self._answers = []
        self._readable, writer = os.pipe()
        os.write(writer, b"x")
        os.close(writer)

    def fileno(self):
        return self._readable

    def answer(self, sender):
        self.answered.append(sender)

    def close(self):
        os.close(self._readable)

    def send(self, frame):
        if not self.answered:
            self.dropped += 1  # A listening port knows nobody to send to.
        elif self.answered[-1] == HOME:
            self._answers += self.hear(frame, self.clock())

    def receive(self):
        others, self.others = self.others, []
        for self.sender, frame in others:
            yield frame
        self.sender = HOME
        answers, self._answers = self._answers, []
        yield from answers
        if not self.punctual:
            for message in self.intervals.period_s:
                self.intervals.send_now(message)
        yield from self.report(NORTHBOUND)

    def setpoints(self):
        return [m for m in self.heard if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]

    def commands(self, number):
        return [m for m in self.heard if m.get_type() == "COMMAND_LONG" and m.command == number]

    def _obey(self, message, arrival_s):
        self.heard.append(message)
        return super()._obey(message, arrival_s)
