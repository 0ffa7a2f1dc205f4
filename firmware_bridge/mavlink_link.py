"""The guard's link to an autopilot: setpoints go out once, and only heartbeats prove mode and arming."""

import select
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from edge_runtime.dynamics import Dynamics
from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState, Vector2
from firmware_bridge.base_kinematics import Base
from firmware_bridge.guard_link import Condition, Health, Limits, Link, Setpoint, Steps
from firmware_bridge.guard_spec import GuardSpec
from firmware_bridge.mavlink_clock import Clock
from firmware_bridge.mavlink_codec import COMPANION, Decoder, Encoder, Tally
from firmware_bridge.mavlink_estimate import Estimate
from firmware_bridge.mavlink_messages import (
    Attitude,
    Beat,
    Command,
    CommandResult,
    Heartbeat,
    LocalPosition,
    Odometry,
    Outgoing,
    Parameter,
    ParameterRequest,
    Received,
    StatusText,
    TimeSync,
)
from firmware_bridge.mavlink_profiles import Mode, Motion, find_profile
from firmware_bridge.mavlink_setpoint import Follower
from firmware_bridge.mavlink_signing import Signing, Timestamps, read_key
from firmware_bridge.mavlink_transport import Transport, open_transport
from firmware_bridge.mavlink_vehicle import Vehicle

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
STALE_S = 0.5
"""Feedback older than this no longer carries a moving robot."""
SILENT_S = 3.5
"""Heartbeats come every second: three lost ones are a lost autopilot."""
OPENING_S = 10.0
ENABLING_S = 15.0
STOPPING_S = 3.0
STEP_S = 0.1
ASK_AGAIN_S = 1.0

_DO_SET_MODE = 176
_ARM_DISARM = 400
_SET_MESSAGE_INTERVAL = 511
_CUSTOM_MODE_ENABLED = 1
_ACCEPTED_OR_IN_PROGRESS = (0, 5)
_GRAVEST_WARNING = 4
_HEARTBEAT, _ATTITUDE, _LOCAL_POSITION_NED = 0, 30, 32


class MavlinkOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the link needs beyond the guard's own specification."""

    autopilot: str
    address: str
    dynamics: Dynamics
    """The policy's, integrated with the control period."""
    point_ahead_m: float = 0.0
    """Of a rover's axle: the point that is steered and reported; 0 refuses sideways velocities."""
    system_id: int = 1
    """The autopilot's MAVLink system."""
    source_system: int = 255
    """Ours; 255 is what ArduPilot's ground station failsafe watches by default."""
    origin_m: Vector2 = (0.0, 0.0)
    """East and north of the autopilot's local origin in the team's frame."""
    signing_key: str = ""
    """Key file; empty: neither sign nor ask for signatures."""


def make_link(spec: GuardSpec) -> Link:
    """Build the link; nothing is opened yet.

    Raises:
        ConfigError: if profile, address or key do not exist.
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
        limits: Limits,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.firmware_timeout_s: float | None = None
        self._options = options
        self._profile = find_profile(options.autopilot)
        wheels = _wheels(options.point_ahead_m)
        self._follower = Follower(self._profile.motion, options.dynamics, limits, wheels)
        self._vehicle = Vehicle(self._profile)
        self._clock = Clock()
        ahead_m = wheels.reference_m if self._profile.motion is Motion.FORWARD_AND_YAW_RATE else 0.0
        self._estimate = Estimate(robot_id, self._clock, options.origin_m, ahead_m)
        self._now = clock
        self._signing = _open_signing(options)
        self._decoder = Decoder(self._signing)
        self._encoder = Encoder(options.source_system, (options.system_id, AUTOPILOT), self._signing)
        self._transport: Transport | None = None
        self._dropped = 0
        self._explanation = ""

    @property
    def tally(self) -> Tally:
        """What came in, and why some of it was not taken."""
        return self._decoder.tally

    def open(self) -> None:
        """Find the autopilot, its clock and its own command timeout.

        Raises:
            BridgeError: if the port cannot be opened or no autopilot answers.
        """
        self._transport = open_transport(self._options.address)
        self._await(lambda: self._vehicle.heartbeat is not None, OPENING_S, self._greet)
        if self._vehicle.heartbeat is None:
            raise BridgeError(self._silence())
        self._await(lambda: self.firmware_timeout_s is not None, ASK_AGAIN_S * 3, self._inquire)
        self._await(lambda: self._estimate.state is not None, ASK_AGAIN_S * 3, self._inquire)
        self._dropped = 0  # What was said before anybody was known to listen does not count.

    def close(self) -> None:
        """Close the port, keep the signing timestamp."""
        if self._transport is not None:
            self._transport.close()
        if self._signing is not None:
            self._signing.timestamps.close()

    def filenos(self) -> tuple[int, ...]:
        """Return the port's descriptor."""
        return () if self._transport is None else (self._transport.fileno(),)

    def receive(self, now_s: float) -> None:
        """Take in everything that has arrived.

        Raises:
            BridgeError: if the port is gone.
        """
        transport = self._opened()
        for portion in transport.receive():
            proved = False
            for received in self._decoder.feed(portion):
                if (received.system_id, received.component_id) == (self._options.system_id, AUTOPILOT):
                    proved = True
                    self._take(received, now_s)
            # An autopilot may speak MAVLink 1, or sign with a clock that lags, until it has heard from us.
            transport.answer_sender(proved)
            if transport.datagrams:
                self._decoder.end_of_datagram()

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
        return self._dropped

    def enable_sequence(self) -> Steps:
        """Take command, then arm; both count once a heartbeat shows them."""
        end_s = self._now() + ENABLING_S
        yield from self._until(lambda: self._fresh(self._now()), end_s, "answer TIMESYNC and send a position")
        self._vehicle.expect_taking()
        streaming_s = self._now() + self._profile.prestream_s
        while self._now() < streaming_s:
            self._transmit(self._follower.hold(), self._now())
            yield STEP_S
        mode = self._profile.command_mode
        yield from self._until(lambda: self._vehicle.in_mode(mode), end_s, mode.name, _set_mode(mode))
        yield from self._until(lambda: self._vehicle.armed, end_s, "arm", Command(_ARM_DISARM, (1.0,)))
        self._vehicle.expect_driving()

    def send(self, setpoint: Setpoint, now_s: float) -> None:
        """Put one setpoint on the wire, once.

        Raises:
            BridgeError: if this base cannot follow it.
        """
        if not self._vehicle.taken:
            self._vehicle.expect_driving()
        state = self._estimate.state
        if state is None:
            raise BridgeError("no position from the autopilot")
        self._transmit(self._follower.follow(setpoint, state), now_s)

    def stop_sequence(self) -> Steps:
        """Command zero at once, then the stop mode until a heartbeat confirms it."""
        if not self._vehicle.taken or self._vehicle.override:
            return
        self._transmit(self._follower.hold(), self._now())
        self._vehicle.expect_stopping()
        mode = self._profile.stop_mode
        end_s = self._now() + STOPPING_S
        yield from self._until(lambda: self._vehicle.in_mode(mode), end_s, mode.name, _set_mode(mode))

    def keepalive(self, fresh: bool, now_s: float) -> None:
        """Send our heartbeat if ``fresh``; keep clock and streams alive in any case."""
        if fresh:
            self._transmit(Beat(), now_s)
        self._transmit(self._clock.request(now_s), now_s)
        if not self._fresh(now_s):
            self._request_streams(now_s)
        if self._signing is not None:
            self._signing.timestamps.renew()

    def _fresh(self, now_s: float) -> bool:
        state = self._estimate.state
        return state is not None and now_s - state.stamp_s <= STALE_S

    def _take(self, received: Received, now_s: float) -> None:
        match received.content:
            case Heartbeat() as heartbeat:
                self._vehicle.on_heartbeat(heartbeat, now_s)
            case Attitude() as attitude:
                self._estimate.on_attitude(attitude)
            case LocalPosition() as position:
                self._estimate.on_local_position(position, now_s)
            case Odometry() as odometry:
                self._estimate.on_odometry(odometry, now_s)
            case TimeSync() as answer:
                self._clock.on_answer(answer, now_s)
            case Parameter(name=self._profile.timeout_parameter, value=value):
                self.firmware_timeout_s = max(value, 0.0)
            case StatusText(severity=severity, text=text) if severity <= _GRAVEST_WARNING:
                self._explanation = text
            case CommandResult(command=command, result=result) if result not in _ACCEPTED_OR_IN_PROGRESS:
                self._explanation = self._explanation or f"MAV_RESULT {result} to command {command}"

    def _transmit(self, content: Outgoing, now_s: float) -> None:
        if not self._opened().send(self._encoder.encode(content, now_s)):
            self._dropped += 1

    def _until(
        self, confirmed: Callable[[], bool], end_s: float, what: str, request: Outgoing | None = None
    ) -> Steps:
        """Ask every second until heartbeats confirm; where setpoints must stream meanwhile, they are zero.

        Raises:
            BridgeError: if somebody takes the robot over meanwhile, or time is up.
        """
        ask_s = self._now()
        self._explanation = ""
        while not confirmed():
            now_s = self._now()
            if self._vehicle.override:
                raise BridgeError(self._vehicle.override)
            if now_s >= end_s:
                said = f": {self._explanation}" if self._explanation else ""
                raise BridgeError(f"the autopilot did not {what}{said}")
            if request is not None and self._profile.prestream_s > 0.0:
                self._transmit(self._follower.hold(), now_s)
            if request is not None and now_s >= ask_s:
                self._transmit(request, now_s)
                ask_s = now_s + ASK_AGAIN_S
            yield STEP_S

    def _greet(self) -> None:
        now_s = self._now()
        self._transmit(self._clock.request(now_s), now_s)

    def _inquire(self) -> None:
        self._greet()
        self._request_streams(self._now())
        self._transmit(ParameterRequest(self._profile.timeout_parameter), self._now())

    def _request_streams(self, now_s: float) -> None:
        interval_us = self._options.dynamics.dt_s * 1e6
        intervals = ((_ATTITUDE, interval_us), (_LOCAL_POSITION_NED, interval_us), (_HEARTBEAT, 200e3))
        for interval in intervals:
            self._transmit(Command(_SET_MESSAGE_INTERVAL, interval), now_s)

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
        refused = ", ".join(f"{count} {why.value}" for why, count in tally.refused.items() if count)
        heard = f"{tally.accepted} frames of others, {tally.damaged} damaged"
        heard += f", {refused} refused by signing" if refused else ""
        return (
            f"no heartbeat of system {self._options.system_id} on {self._options.address} within "
            f"{OPENING_S:g} s ({heard}): check wiring, port, MAVLink 2 and the signing key"
        )

    def _opened(self) -> Transport:
        if self._transport is None:
            raise BridgeError("the MAVLink link is not open")
        return self._transport


def _set_mode(mode: Mode) -> Command:
    return Command(_DO_SET_MODE, (_CUSTOM_MODE_ENABLED, mode.main, mode.sub))


def _wheels(point_ahead_m: float) -> Base:
    if point_ahead_m == 0.0:
        return Base("differential")
    return Base("differential", sideways="lookahead", lookahead_m=point_ahead_m)


def _open_signing(options: MavlinkOptions) -> Signing | None:
    if not options.signing_key:
        return None
    path = Path(options.signing_key)
    key = read_key(path)
    sender = f"{options.source_system}-{COMPANION}"
    return Signing(key, Timestamps(path.with_name(f"{path.name}.{sender}.timestamp")))
