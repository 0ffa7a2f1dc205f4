"""The guard's link to an autopilot: setpoints go out once, and only heartbeats prove mode and arming."""

import math
import time
from collections.abc import Callable

import msgspec

from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState
from firmware_bridge.guard.link import Condition, Health, Link, Setpoint, SetpointLimits, Steps
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.kinematics.base import Base, turning
from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.decoder import Tally
from firmware_bridge.mavlink.engagement import Engagement
from firmware_bridge.mavlink.facts import Facts
from firmware_bridge.mavlink.messages import Beat
from firmware_bridge.mavlink.opening import Opening
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import SetpointKind, find_profile
from firmware_bridge.mavlink.readiness import Readiness
from firmware_bridge.mavlink.setpoint import Follower
from firmware_bridge.mavlink.streams import Streams

SILENT_S = 3.5
"""Heartbeats come every second: three lost ones are a lost autopilot."""
BEAT_S = 0.5


def make_link(spec: GuardSpec) -> Link:
    """Build the link; nothing is opened yet.

    Raises:
        ConfigError: if profile or key do not exist.
    """
    options = msgspec.json.decode(spec.options, type=MavlinkOptions)
    return MavlinkLink(options, spec.robot_id, spec.limits)


class MavlinkLink:
    """One autopilot; implements ``Link``."""

    recoveries = 0
    """A mode that this guard did not command is the operator's: it takes no robot a second time."""
    keepalive_period_s: float = 0.1

    def __init__(
        self,
        options: MavlinkOptions,
        robot_id: int,
        limits: SetpointLimits,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._options = options
        self._now = clock
        self._beat_due_s = -math.inf
        self._profile = find_profile(options.autopilot)
        self._channel = Channel(options)
        wheels = _wheels(options.point_ahead_m)
        if options.motion.turns:
            wheels = turning(wheels)
        ahead_m = wheels.reference_m if self._profile.motion is SetpointKind.FORWARD_AND_YAW_RATE else 0.0
        self._facts = Facts(self._profile, options, robot_id, ahead_m)
        self._streams = Streams(
            self._profile, options.motion.dt_s, lambda command: self._channel.send(command, self._now())
        )
        self._follower = Follower(self._profile.motion, options.motion, limits, wheels)
        self._ready = Readiness(self._channel, self._facts, self._streams)
        vehicle = self._facts.vehicle
        self._engagement = Engagement(
            self._profile, self._channel, vehicle, self._follower, self._ready, clock
        )

    @property
    def firmware_timeout_s(self) -> float | None:
        """Seconds without setpoints after which the autopilot stops by itself."""
        return self._facts.timeout_s

    @property
    def tally(self) -> Tally:
        """What came in, and why some of it was not taken."""
        return self._channel.tally

    def open(self) -> None:
        """Find the autopilot, its clock, its own command timeout and what it grants.

        Raises:
            BridgeError: if the port cannot be opened, or no autopilot of this kind answers.
        """
        self._channel.open()
        opening = Opening(self._channel, self._facts, self._streams, self._options, self._now)
        opening.complete(self.receive)
        self._channel.forget_dropped()

    def close(self) -> None:
        """Give back the intervals of before, close the port, keep the signing timestamp."""
        if self._channel.home is not None:
            self._streams.restore()
        self._channel.close()

    def filenos(self) -> tuple[int, ...]:
        """Return the port's descriptor."""
        return self._channel.filenos()

    def receive(self, now_s: float) -> None:
        """Take in everything that has arrived.

        Raises:
            BridgeError: if the port is gone.
        """
        for content in self._channel.receive():
            self._facts.take(content, now_s)
            self._streams.listen(content, now_s)
            self._engagement.listen(content)
        self._streams.watch(now_s)

    def health(self, now_s: float) -> Health:
        """Judge the autopilot by its heartbeats, its address, its position and how often it comes."""
        vehicle = self._facts.vehicle
        if vehicle.override:
            return Health(Condition.OVERRIDE, vehicle.override)
        if vehicle.heartbeat is None or now_s - vehicle.heartbeat_s > SILENT_S:
            return Health(Condition.LOST, f"no heartbeat from the autopilot for {SILENT_S:g} s")
        if not vehicle.ready:
            return Health(Condition.WAITING, f"not armed in {self._profile.command_mode.name}")
        if not vehicle.taken and (missing := self._ready.missing(now_s) or self._ready.refusal(now_s)):
            return Health(Condition.WAITING, missing)
        hindrance = self._ready.hindrance(now_s)
        return Health(Condition.FAULT, hindrance) if hindrance else Health(Condition.READY)

    def state(self) -> RobotState | None:
        """Return the newest state."""
        return self._facts.estimate.state

    def dropped(self) -> int:
        """Count frames that the port did not take."""
        return self._channel.dropped

    def enable_sequence(self) -> Steps:
        """Take command, then arm; both count once a heartbeat shows them."""
        return self._engagement.enable()

    def send(self, setpoint: Setpoint, now_s: float) -> None:
        """Put one setpoint on the wire, once.

        Raises:
            BridgeError: if this base cannot follow it.
        """
        if not self._facts.vehicle.taken:
            self._facts.vehicle.expect(self._profile.command_mode)
        self._channel.send(self._follower.follow(setpoint, self._known_state()), now_s)

    def stop_sequence(self) -> Steps:
        """Command zero at once, then the stop mode until a heartbeat confirms it."""
        return self._engagement.stop()

    def keepalive(self, fresh: bool, now_s: float) -> None:
        """Send our heartbeat if ``fresh``; keep clock and streams alive in any case."""
        self._streams.watch(now_s)
        if now_s < self._beat_due_s:
            return
        self._beat_due_s = now_s + BEAT_S
        if fresh:
            self._channel.send(Beat(), now_s)
        self._channel.send(self._facts.clock.request(now_s), now_s)
        self._channel.renew_signing()

    def _known_state(self) -> RobotState:
        state = self._facts.estimate.state
        if state is None:
            raise BridgeError("no position from the autopilot")
        return state


def _wheels(point_ahead_m: float) -> Base:
    if point_ahead_m == 0.0:
        return Base("differential")
    return Base("differential", sideways="lookahead", lookahead_m=point_ahead_m)
