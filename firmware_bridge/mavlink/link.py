"""The guard's link to an autopilot: setpoints go out once, and only heartbeats prove mode and arming."""

import select
import time
from collections.abc import Callable

import msgspec

from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState
from firmware_bridge.guard.link import Condition, Health, Link, Setpoint, SetpointLimits, Steps
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.kinematics.base import Base
from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.clock import Clock
from firmware_bridge.mavlink.codec import Tally
from firmware_bridge.mavlink.engagement import ASK_AGAIN_S, STEP_S, Engagement
from firmware_bridge.mavlink.estimate import Estimate
from firmware_bridge.mavlink.messages import (
    Attitude,
    Beat,
    Command,
    Content,
    Heartbeat,
    LocalPosition,
    Odometry,
    Parameter,
    ParameterRequest,
    TimeSync,
)
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import SetpointKind, find_profile
from firmware_bridge.mavlink.setpoint import Follower
from firmware_bridge.mavlink.vehicle import Vehicle

STALE_S = 0.5
"""Feedback older than this no longer carries a moving robot."""
SILENT_S = 3.5
"""Heartbeats come every second: three lost ones are a lost autopilot."""
OPENING_S = 10.0

_SET_MESSAGE_INTERVAL = 511
_HEARTBEAT, _ATTITUDE, _LOCAL_POSITION_NED = 0, 30, 32
_HEARTBEAT_US = 200e3


def make_link(spec: GuardSpec) -> Link:
    """Build the link; nothing is opened yet.

    Raises:
        ConfigError: if profile or key do not exist.
    """
    options = msgspec.json.decode(spec.options, type=MavlinkOptions)
    return MavlinkLink(options, spec.robot_id, spec.limits)


class MavlinkLink:
    """One autopilot; implements ``Link``."""

    recoveries = 3
    keepalive_period_s: float = 0.5

    def __init__(
        self,
        options: MavlinkOptions,
        robot_id: int,
        limits: SetpointLimits,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.firmware_timeout_s: float | None = None
        self._options = options
        self._now = clock
        self._profile = find_profile(options.autopilot)
        self._channel = Channel(options)
        self._vehicle = Vehicle(self._profile)
        self._clock = Clock()
        wheels = _wheels(options.point_ahead_m)
        ahead_m = wheels.reference_m if self._profile.motion is SetpointKind.FORWARD_AND_YAW_RATE else 0.0
        self._estimate = Estimate(robot_id, self._clock, options.origin_m, ahead_m)
        self._follower = Follower(self._profile.motion, options.dynamics, limits, wheels)
        self._engagement = Engagement(self._profile, self._channel, self._vehicle, self._follower, clock)

    @property
    def tally(self) -> Tally:
        """What came in, and why some of it was not taken."""
        return self._channel.tally

    def open(self) -> None:
        """Find the autopilot, its clock and its own command timeout.

        Raises:
            BridgeError: if the port cannot be opened or no autopilot answers.
        """
        self._channel.open()
        self._await(lambda: self._vehicle.heartbeat is not None, OPENING_S, self._greet)
        if self._vehicle.heartbeat is None:
            raise BridgeError(self._silence())
        self._await(lambda: self.firmware_timeout_s is not None, ASK_AGAIN_S * 3, self._inquire)
        self._await(lambda: self._estimate.state is not None, ASK_AGAIN_S * 3, self._inquire)
        self._channel.dropped = 0  # What was said before anybody was known to listen does not count.

    def close(self) -> None:
        """Close the port, keep the signing timestamp."""
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
            self._take(content, now_s)

    def health(self, now_s: float) -> Health:
        """Judge the autopilot by its heartbeats and the age of its state."""
        vehicle = self._vehicle
        if vehicle.override:
            return Health(Condition.OVERRIDE, vehicle.override)
        if vehicle.heartbeat is None or now_s - vehicle.heartbeat_s > SILENT_S:
            return Health(Condition.LOST, f"no heartbeat from the autopilot for {SILENT_S:g} s")
        if not vehicle.ready:
            return Health(Condition.WAITING, f"not armed in {self._profile.command_mode.name}")
        if not self._fresh(now_s):
            return Health(Condition.FAULT, f"no position from the autopilot for {STALE_S:g} s")
        return Health(Condition.READY)

    def state(self) -> RobotState | None:
        """Return the newest state."""
        return self._estimate.state

    def dropped(self) -> int:
        """Count frames that the port did not take."""
        return self._channel.dropped

    def enable_sequence(self) -> Steps:
        """Take command, then arm; both count once a heartbeat shows them."""
        return self._engagement.enable(lambda: self._fresh(self._now()))

    def send(self, setpoint: Setpoint, now_s: float) -> None:
        """Put one setpoint on the wire, once.

        Raises:
            BridgeError: if this base cannot follow it.
        """
        if not self._vehicle.taken:
            self._vehicle.expect_driving()
        self._channel.send(self._follower.follow(setpoint, self._known_state()), now_s)

    def rehearse(self, setpoint: Setpoint, now_s: float) -> None:
        """Encode one setpoint, and forget it."""
        self._channel.rehearse(self._follower.rehearse(setpoint, self._known_state()), now_s)

    def stop_sequence(self) -> Steps:
        """Command zero at once, then the stop mode until a heartbeat confirms it."""
        return self._engagement.stop()

    def keepalive(self, fresh: bool, now_s: float) -> None:
        """Send our heartbeat if ``fresh``; keep clock and streams alive in any case."""
        if fresh:
            self._channel.send(Beat(), now_s)
        self._channel.send(self._clock.request(now_s), now_s)
        if not self._fresh(now_s):
            self._request_streams(now_s)
        self._channel.renew_signing()

    def _known_state(self) -> RobotState:
        state = self._estimate.state
        if state is None:
            raise BridgeError("no position from the autopilot")
        return state

    def _fresh(self, now_s: float) -> bool:
        state = self._estimate.state
        return state is not None and now_s - state.stamp_s <= STALE_S

    def _take(self, content: Content, now_s: float) -> None:
        match content:
            case Heartbeat():
                self._vehicle.on_heartbeat(content, now_s)
            case Attitude():
                self._estimate.on_attitude(content)
            case LocalPosition():
                self._estimate.on_local_position(content, now_s)
            case Odometry():
                self._estimate.on_odometry(content, now_s)
            case TimeSync():
                self._clock.on_answer(content, now_s)
            case Parameter(name=self._profile.timeout_parameter, value=value):
                self.firmware_timeout_s = max(value, 0.0)
            case _:
                self._engagement.listen(content)

    def _greet(self) -> None:
        now_s = self._now()
        self._channel.send(self._clock.request(now_s), now_s)

    def _inquire(self) -> None:
        self._greet()
        self._request_streams(self._now())
        self._channel.send(ParameterRequest(self._profile.timeout_parameter), self._now())

    def _request_streams(self, now_s: float) -> None:
        # Twice as often as commands go out: a pose then never waits a whole period for its tick.
        period_us = self._options.dynamics.dt_s * 1e6 / 2
        for interval in (
            (_ATTITUDE, period_us),
            (_LOCAL_POSITION_NED, period_us),
            (_HEARTBEAT, _HEARTBEAT_US),
        ):
            self._channel.send(Command(_SET_MESSAGE_INTERVAL, interval), now_s)

    def _await(self, settled: Callable[[], bool], longest_s: float, ask: Callable[[], None]) -> None:
        """Block until something is known or time is up; asks every 0.2 s. Only for ``open``."""
        ask_s = self._now()
        end_s = ask_s + longest_s
        while not settled() and (now_s := self._now()) < end_s:
            if now_s >= ask_s:
                ask()
                ask_s = now_s + 2 * STEP_S
            select.select(self.filenos(), (), (), max(ask_s - self._now(), 0.0))
            self.receive(self._now())

    def _silence(self) -> str:
        tally = self.tally
        refused = ", ".join(f"{count} {why.name.lower()}" for why, count in tally.refused.items() if count)
        heard = f"{tally.accepted} frames of others, {tally.damaged} damaged"
        heard += f", {refused} refused by signing" if refused else ""
        return (
            f"no heartbeat of system {self._options.system_id} on {self._options.address} within "
            f"{OPENING_S:g} s ({heard}): check wiring, port, MAVLink 2 and the signing key"
        )


def _wheels(point_ahead_m: float) -> Base:
    if point_ahead_m == 0.0:
        return Base("differential")
    return Base("differential", sideways="lookahead", lookahead_m=point_ahead_m)
