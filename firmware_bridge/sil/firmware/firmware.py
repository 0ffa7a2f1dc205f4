"""A robot's firmware, free of sockets: packets come in with their time, packets go out.

Harness, benchmarks and tests drive the same three: `agilex.AgilexChassis`, `autopilot.Autopilot` and
`ros_base.RosBase`.
"""

import abc
import math
import random
import time
from collections.abc import Callable, Iterable
from typing import Any, Final, Generic, NamedTuple, TypeVar

from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.world import BaseState

REST: Final = BaseMotion()
Packet = TypeVar("Packet")


class Heard(NamedTuple):
    """One command that arrived."""

    arrival_s: float
    """Monotonic time at which it was taken off the wire."""
    motion: BaseMotion | None
    """What it asks for; None: something else than motion."""
    packet: Any
    """As the protocol's own library reads it: a Frame on CAN, a pymavlink message."""


class Firmware(abc.ABC, Generic[Packet]):
    """What all kinds share: the newest motion, how long it holds, and what can be wrong with it.

    Args:
        timeout_s: silence after which it stops by itself.
        clock: monotonic time in seconds.
    """

    def __init__(self, timeout_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.timeout_s = timeout_s
        self.clock = clock
        self.silent = self.stale = self.corrupt = self.not_finite = False
        """Faults: nothing is sent, the pose stands still in time, packets are damaged, the pose is not a
        number."""
        self.pressed = False
        """Whether the robot's emergency stop is pressed."""
        self.located = True
        """Whether it knows its pose yet. Without one its runtime commands nothing, and its guard waits."""
        self.obeyed = self.timeouts = 0
        """How many setpoints it obeyed, and how many times it stopped by itself."""
        self.timed_out_s = math.inf
        """Monotonic time at which it last stopped by itself."""
        self.on_command: Callable[[Heard], object] = _ignore
        """Called with every command that arrives, obeyed or not."""
        self.on_pose: Callable[[float], object] = _ignore
        """Called with the time of measurement of every pose that is sent."""
        self._motion = REST
        self._fresh_until_s = -math.inf
        self._draw = random.Random(0)

    def hear(self, packet: Packet, arrival_s: float) -> list[Packet]:
        """Take in and obey one packet; returns the answers."""
        return self._spoilt(self._take(packet, arrival_s))

    def report(self, state: BaseState) -> list[Packet]:
        """Return the telemetry that is due."""
        return self._spoilt(self._telemetry(state))

    def motion(self, now_s: float) -> BaseMotion:
        """Return what to follow: rest, once the commands have ended or the emergency stop is pressed."""
        if self._motion != REST and now_s > self._fresh_until_s:
            self._motion = REST
            self.timeouts += 1
            self.timed_out_s = now_s
        return REST if self.pressed else self._motion

    @abc.abstractmethod
    def _take(self, packet: Packet, arrival_s: float) -> Iterable[Packet]:
        """Obey one packet; yields the answers."""

    @abc.abstractmethod
    def _telemetry(self, state: BaseState) -> Iterable[Packet]:
        """Yield what is due."""

    @abc.abstractmethod
    def _obeys(self) -> bool:
        """Whether it follows setpoints now."""

    @abc.abstractmethod
    def _damaged(self, packet: Packet) -> Packet:
        """Return a packet that a receiver must refuse."""

    def _follow(self, motion: BaseMotion, arrival_s: float) -> None:
        obeys = self._obeys()
        self._motion, self._fresh_until_s = motion if obeys else REST, arrival_s + self.timeout_s
        self.obeyed += obeys

    def _mind_mode(self) -> None:
        """Rest where setpoints are not followed any more."""
        if not self._obeys():
            self._motion = REST

    def _spoilt(self, packets: Iterable[Packet]) -> list[Packet]:
        sent = list(packets)  # what nobody hears was still measured
        if self.silent:
            return []
        return [self._damaged(packet) for packet in sent] if self.corrupt else sent


def _ignore(_: object) -> None:
    pass
