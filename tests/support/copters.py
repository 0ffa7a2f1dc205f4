"""Copters of the harness's autopilot: they fly in space as they are told, and answer MAVLink on ports."""

import contextlib
import threading
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.sil.firmware.autopilot import Autopilot
from firmware_bridge.sil.firmware.firmware import REST, Heard
from firmware_bridge.sil.firmware.node import STEP_S, FirmwareLoop, FirmwareNode
from firmware_bridge.sil.firmware.wires import UdpWire

HARDEST_M_S2 = 3.0
"""As hard as a copter follows a velocity."""


class Flight(NamedTuple):
    """A copter as its firmware measures it, (east, north, up)."""

    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    heading_rad: float = 0.0
    yaw_rad_s: float = 0.0


class Copter(Autopilot):
    """Follows velocities in space."""

    def __init__(self):
        super().__init__(PROFILES["ardupilot_copter"])

    def _obey(self, message, arrival_s):
        if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED":
            yield from super()._obey(message, arrival_s)
            return
        motion = float(message.vy), float(message.vx), -float(message.vz)
        self._follow(motion, arrival_s)
        self.on_command(Heard(arrival_s, motion, message))

    def _position(self, state):
        (east, north, up), (v_east, v_north, v_up) = state.position_m, state.velocity_m_s
        return dialect.MAVLink_local_position_ned_message(
            self._stamp_ms, north, east, -up, v_north, v_east, -v_up
        )


class Sky:
    """Points in space; see `firmware_bridge.sil.firmware.node.Plant`."""

    def __init__(self, starts_m):
        self.place, self.speed = np.array(starts_m, float), np.zeros((len(starts_m), 3))

    def step(self, motions):
        wanted = np.array([(0.0,) * 3 if motion == REST else motion for motion in motions])
        most = HARDEST_M_S2 * STEP_S
        self.speed += np.clip(wanted - self.speed, -most, most)
        self.place += STEP_S * self.speed

    def state(self, robot):
        return Flight(tuple(self.place[robot].tolist()), tuple(self.speed[robot].tolist()))


@contextlib.contextmanager
def flying(starts_m):
    """Copters that hover at these places, served by a thread; gives their ports."""
    nodes = [FirmwareNode(Copter(), UdpWire()) for _ in starts_m]
    over = threading.Event()
    with FirmwareLoop(Sky(starts_m), nodes) as loop:

        def serve():
            while not over.is_set():
                loop.turn()

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield [node.wire.port for node in nodes]
        finally:
            over.set()
            thread.join()
