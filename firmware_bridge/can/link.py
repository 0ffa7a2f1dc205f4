"""A CAN robot as the guard's Link: the only place where the codec's frames meet the bus."""

import math
import time
from pathlib import Path

import msgspec
from msgspec.structs import replace

from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState
from firmware_bridge.can.bus import CanBus
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.feedback import DeadReckoning, FeedbackRules, PlanarPose
from firmware_bridge.can.frame import Frame, Transport
from firmware_bridge.can.limo import LimoPort
from firmware_bridge.can.odrive import watchdog_timeout_s
from firmware_bridge.can.profile import Profile, load_profile
from firmware_bridge.can.vesc import command_timeout_s
from firmware_bridge.guard.link import Condition, Health, Setpoint, Steps
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.kinematics.base import BaseMotion, motion_for, turning

STANDSTILL = BaseMotion()
STOP_TRIES = 50
"""How often a frame of the stop sequence is offered to a full transmit queue, once a period."""


class CanOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the guard's specification carries for this link."""

    bus: str
    profile: str
    """Path of the profile's TOML file."""
    pose: PlanarPose
    turns: bool = False
    """Whether the policy commands yaw rates."""


class CanLink:
    """One CAN robot; implements ``Link``."""

    keepalive_period_s = math.inf

    def __init__(
        self,
        profile: Profile,
        codec: CanCodec,
        transport: Transport,
        robot: DeadReckoning,
        arm: bool = False,
    ) -> None:
        self.firmware_timeout_s = profile.firmware_timeout_s
        stated = profile.firmware_timeout_s is not None
        self.firmware_timeout_source = "says the profile" if stated else "nobody has told it"
        """Who told it, and what may be behind it."""
        self.recoveries = profile.recoveries
        self._profile = profile
        self._codec = codec
        self._transport = transport
        self._robot = robot
        self._arm = arm
        self._rules = FeedbackRules(profile.feedback)
        self._motion_signals = _motion_signals(profile)
        self._state: RobotState | None = None
        self._sent = STANDSTILL
        self._enabled = False
        self._dropped = 0

    def open(self) -> None:
        """Open the bus; drives that can tell their timeout are asked, and ``--arm`` turns a watchdog on.

        Raises:
            BridgeError: if the bus cannot be opened, or such a drive does not answer.
        """
        self._transport.open()
        if self._profile.watchdog is not None:
            self.firmware_timeout_s = watchdog_timeout_s(self._transport, self._profile.watchdog, self._arm)
            self.firmware_timeout_source = "as the drives answer"
        if self._profile.vesc is not None:
            self.firmware_timeout_s, self.firmware_timeout_source = command_timeout_s(
                self._transport, self._profile.vesc
            )
        self._transport.hear_only(self._codec.heard)

    def close(self) -> None:
        """Close the bus."""
        self._transport.close()

    def filenos(self) -> tuple[int, ...]:
        """The bus."""
        return (self._transport.fileno(),)

    def receive(self, now_s: float) -> None:
        """Take in the frames that have arrived."""
        for frame in self._transport.receive():
            decoded = self._codec.decode(frame)
            if decoded is None:
                continue
            self._rules.take(decoded, now_s)
            if not self._motion_signals.isdisjoint(decoded.values):
                motion = self._rules.motion(self._profile.feedback.motion, self._profile.base)
                self._state = self._robot.advance(motion, now_s)

    def health(self, now_s: float) -> Health:
        """Judge the newest feedback; firmware that cannot say whether it listens is ready once enabled."""
        health = self._rules.health(now_s)
        if health.condition is Condition.READY and not (self._profile.feedback.ready or self._enabled):
            return Health(Condition.WAITING, "not enabled by this guard: pass --arm", health.warning)
        return health

    def state(self) -> RobotState | None:
        """Return the dead-reckoned state."""
        return self._state

    def dropped(self) -> int:
        """Count frames that the transmit queue did not take."""
        return self._dropped

    @property
    def malformed(self) -> int:
        """Count what has arrived and could not be understood."""
        return self._transport.malformed + self._codec.malformed

    def send(self, setpoint: Setpoint, now_s: float) -> None:  # noqa: ARG002
        """Send the frames of one setpoint, once."""
        self._command(self._motion(setpoint))

    def keepalive(self, fresh: bool, now_s: float) -> None:
        """CAN robots know no heartbeat of ours."""

    def enable_sequence(self) -> Steps:
        """Command standstill, send the profile's enable steps, wait for the feedback to confirm.

        Raises:
            BridgeError: if the firmware is not ready within the profile's time.
        """
        self._command(STANDSTILL)
        for step in self._profile.enable:
            self._offer(self._codec.encode_step(step))
            yield step.pause_s
        end_s = time.monotonic() + self._profile.enable_timeout_s
        while (health := self._rules.health(time.monotonic())).condition is not Condition.READY:
            if time.monotonic() >= end_s:
                raise BridgeError(f"not enabled within {self._profile.enable_timeout_s:g} s: {health.detail}")
            yield self._profile.period_s
        self._enabled = True

    def stop_sequence(self) -> Steps:
        """Ramp down, command standstill several times, then the profile's last steps."""
        self._enabled = False
        for motion in self._ramp():
            if self._rules.health(time.monotonic()).condition is Condition.OVERRIDE:
                return
            self._command(motion)
            yield self._profile.period_s
        for _ in range(self._profile.stop.zeros):
            yield from self._insist(self._codec.encode(STANDSTILL))
            yield self._profile.period_s
        self._sent = STANDSTILL
        for step in self._profile.stop.then:
            yield from self._insist((self._codec.encode_step(step),))
            yield step.pause_s

    def _motion(self, setpoint: Setpoint) -> BaseMotion:
        heading, base = self._robot.pose.heading_rad, self._profile.base
        return motion_for(setpoint.velocity_m_s, heading, base, setpoint.yaw_rate_rad_s)

    def _ramp(self) -> list[BaseMotion]:
        """The motions from the last sent one down to, but without, standstill."""
        deceleration, sent = self._profile.stop.deceleration_m_s2, self._sent
        speed = math.hypot(sent.forward_m_s, sent.lateral_m_s)
        if deceleration is None or speed == 0.0:
            return []
        loss = deceleration * self._profile.period_s / speed
        return [sent.scaled(1.0 - step * loss) for step in range(1, math.ceil(1.0 / loss))]

    def _command(self, motion: BaseMotion) -> None:
        self._sent = motion
        for frame in self._codec.encode(motion):
            self._offer(frame)

    def _insist(self, frames: tuple[Frame, ...]) -> Steps:
        """Offer frames until the queue takes them; a stop must not be the frame that is dropped."""
        for frame in frames:
            for _ in range(STOP_TRIES):
                if self._offer(frame):
                    break
                yield self._profile.period_s

    def _offer(self, frame: Frame) -> bool:
        taken = self._transport.send(frame)
        self._dropped += not taken
        return taken


def make_link(spec: GuardSpec) -> CanLink:
    """Build the link that a guard's specification describes.

    Raises:
        ConfigError: if the profile is wrong.
    """
    options = msgspec.json.decode(spec.options, type=CanOptions)
    path = Path(options.profile)
    profile = load_profile(path)
    if options.turns:
        profile = replace(profile, base=turning(profile.base))
    robot = DeadReckoning(spec.robot_id, options.pose, profile.base)
    return CanLink(profile, CanCodec(profile, path), _transport(profile, options.bus), robot, spec.arm)


def _transport(profile: Profile, bus: str) -> Transport:
    return LimoPort(bus) if profile.transport == "limo_serial" else CanBus(bus)


def _motion_signals(profile: Profile) -> frozenset[str]:
    motion = profile.feedback.motion
    return frozenset((*motion.forward, *motion.lateral, *motion.yaw, *motion.steering))
