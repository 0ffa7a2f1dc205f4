"""The robot whose firmware a trial serves: it obeys, and every command that arrives is kept with its time."""

import abc
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import can
import msgspec
from pymavlink.dialects.v20 import common

from edge_runtime.common.closing import Closing
from edge_runtime.common.key_file import read_key
from edge_runtime.motion.models import PointForce
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.can.feedback import PlanarPose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.link import CanOptions
from firmware_bridge.can.profile import profile_path
from firmware_bridge.guard.link import SetpointLimits
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.signing import clock_ticks
from firmware_bridge.sil.firmware.agilex import AgilexChassis
from firmware_bridge.sil.firmware.autopilot import Autopilot
from firmware_bridge.sil.firmware.firmware import REST, Firmware, Heard
from firmware_bridge.sil.firmware.node import STEP_S, FirmwareLoop, FirmwareNode
from firmware_bridge.sil.firmware.planar_world import PlanarWorld
from firmware_bridge.sil.firmware.wires import CanWire, UdpWire, Wire
from firmware_bridge.sil.firmware.world import Standing
from firmware_bridge.sil.scenario.ports import HOST, free_ports, multicast_bus
from firmware_bridge.sil.scenario.vehicle import AUTOPILOT, POINT_AHEAD_M, PROFILE, BridgeKind, vehicle

PERIOD_S = 0.02
"""Of the commands."""
DEADLINE_S = 3 * PERIOD_S
SPEED_M_S = 0.5
LIMITS = SetpointLimits(1.5, (-1.0, -1.0), (1.0, 1.0))
CRUISING_SHARE = 0.95
SLOWEST_M_S = 1e-3
"""Slower counts as standing."""
SETPOINT_ID = 0x111
_BUS_OFF = 0x40
_TAKING = (common.MAV_CMD_COMPONENT_ARM_DISARM, common.MAV_CMD_DO_SET_MODE)


class Robot(Closing, abc.ABC):
    """One robot on an empty plane, without drag."""

    name: ClassVar[BridgeKind]
    braking_m_s2: ClassVar[float]
    """With what its plant speeds up and slows down at most."""

    def __init__(self, firmware: Firmware[Any], wire: Wire[Any]) -> None:
        self.firmware = firmware
        self.heard: list[Heard] = []
        self.late_s = 0.0
        """How late the plant's latest step was."""
        firmware.on_command = self.heard.append
        manifest = packaged_bundle("navigation").manifest
        motion = msgspec.structs.replace(manifest.motion, drag=0.0)
        most_n = self.braking_m_s2 * motion.mass_kg
        action = tuple(msgspec.structs.replace(one, low=-most_n, high=most_n) for one in manifest.action)
        manifest = msgspec.structs.replace(manifest, motion=motion, action=action)
        standing = Standing((0.0, 0.0), 0.0, vehicle(self.name).ahead_m)
        self._world = PlanarWorld([manifest], [standing], STEP_S)
        self._node = FirmwareNode(firmware, wire)
        self._loop = FirmwareLoop(self._world, [self._node])
        self._receive: Callable[[], object] = self._node.receive

    def close(self) -> None:
        """Let the wire go."""
        self._node.wire.close()

    @abc.abstractmethod
    def spec(self) -> GuardSpec:
        """Return what a guard of this robot is started with."""

    @abc.abstractmethod
    def drives(self, heard: Heard) -> bool | None:
        """Whether it asks for the runtime's motion, and not for less or for a stop; None for neither."""

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Act for some seconds, or until something holds; returns whether it does."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not until():
            self.late_s = max(self.late_s, self._loop.turn(end_s) or 0.0)
        return until()

    def cut(self) -> None:
        """Cut the wire: nothing arrives any more, neither here nor there."""
        self._loop.forget(self._node.wire.fileno())
        self.firmware.silent = True
        self._receive = _nothing

    def take_commands(self) -> list[tuple[Any, ...]]:
        """Return the content of all commands since the last call."""
        self._receive()
        contents = [content(heard) for heard in self.heard]
        self.heard.clear()
        return contents

    def arrivals(self) -> list[float]:
        """Return when each command to drive arrived, those still unread on the wire included."""
        self._receive()
        return [heard.arrival_s for heard in self.heard if self.drives(heard)]

    def stop_after(self, time_s: float) -> float:
        """Return when the first command to do less than drive arrived since then; infinity if none did."""
        stops = (h.arrival_s for h in self.heard if h.arrival_s >= time_s and self.drives(h) is False)
        return next(stops, math.inf)

    def told_to_drive(self) -> bool:
        """Whether the last command was to drive."""
        told = (self.drives(heard) for heard in reversed(self.heard))
        return next((drives for drives in told if drives is not None), False)

    def cruises(self) -> bool:
        """Whether it drives at about the speed that the runtime asks for."""
        return bool(self._world.speeds_m_s()[0] > CRUISING_SHARE * SPEED_M_S)

    def stands(self) -> bool:
        """Whether it is at rest."""
        return bool(self._world.speeds_m_s()[0] < SLOWEST_M_S)

    def position_m(self) -> tuple[float, float]:
        """Return where it is."""
        x, y = self._world.position_m[0].tolist()
        return x, y


class CanRobot(Robot):
    """An AgileX chassis on a UDP multicast bus."""

    name = "can"
    braking_m_s2 = 2.0
    """As its profile has it."""

    def __init__(self) -> None:
        self._address = multicast_bus(free_ports(1)[0])
        self.wire = CanWire(self._address)
        super().__init__(AgilexChassis(), self.wire)

    def spec(self) -> GuardSpec:
        """Return what a guard of this chassis is started with."""
        options = msgspec.json.encode(CanOptions(self._address, str(profile_path(PROFILE)), PlanarPose()))
        return GuardSpec("can", 0, DEADLINE_S, LIMITS, msgspec.Raw(options), arm=True)

    def drives(self, heard: Heard) -> bool:
        """Whether it is the very speed that the runtime asks for: a ramp begins just below."""
        return heard.motion is not None and math.isclose(heard.motion.forward_m_s, SPEED_M_S)

    def tell_bus_off(self) -> None:
        """Put the error frame on the bus by which a kernel reports that its controller went bus-off."""
        self.wire.send_raw(can.Message(arbitration_id=_BUS_OFF, is_error_frame=True, data=bytes(8)))


class MavlinkRobot(Robot):
    """An ArduPilot Rover at a UDP port."""

    name = "mavlink"
    braking_m_s2 = 1.0
    """As the packaged policy's actions have it."""
    firmware: Autopilot

    def __init__(self, signing_key: Path | None = None) -> None:
        self.wire, self._signing_key = UdpWire(), signing_key
        super().__init__(Autopilot(PROFILES[AUTOPILOT]), self.wire)
        if signing_key is not None:
            self.firmware.sign(read_key(signing_key), clock_ticks())

    def spec(self) -> GuardSpec:
        """Return what a guard of this rover is started with."""
        options = MavlinkOptions(
            AUTOPILOT,
            f"udpout:{HOST}:{self.wire.port}",
            PointForce(1.0, PERIOD_S / SPEED_M_S, PERIOD_S),  # the full action ends at SPEED_M_S
            point_ahead_m=POINT_AHEAD_M,
            signing_key=str(self._signing_key or ""),
        )
        raw = msgspec.Raw(msgspec.json.encode(options))
        return GuardSpec("mavlink", 0, DEADLINE_S, LIMITS, raw, arm=True)

    def drives(self, heard: Heard) -> bool | None:
        """Whether it asks for any motion; requests for streams ask for nothing of the kind."""
        if heard.motion is None:
            return False if heard.packet.command in _TAKING else None
        return heard.motion != REST


def _nothing() -> None:
    pass


def content(heard: Heard) -> tuple[Any, ...]:
    """Return what a command asks for, without counters and stamps."""
    packet = heard.packet
    if isinstance(packet, Frame):
        return packet
    if packet.get_type() == "COMMAND_LONG":
        return packet.command, packet.param1, packet.param2
    return tuple(getattr(packet, name) for name in packet.fieldnames if name != "time_boot_ms")


def driving_frame() -> Frame:
    """Return the frame of SPEED_M_S straight on."""
    return Frame(SETPOINT_ID, round(1e3 * SPEED_M_S).to_bytes(2, "big") + bytes(6))
