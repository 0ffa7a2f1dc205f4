"""The guard's decisions, free of processes, sockets and clocks: events come in with their time.

WATCHING -> ENABLING -> DRIVING <-> RECOVERING -> STOPPING -> STOPPED. STOPPED is final.
"""

import math
from collections import deque

from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.guard.link import Condition, Health, Link, Setpoint, SetpointLimits, Steps
from firmware_bridge.guard.spec import LONGEST_FIRMWARE_TIMEOUT_S, GuardSpec
from firmware_bridge.guard.speeding import Speeding
from firmware_bridge.guard.wire import (
    Complaint,
    Counts,
    Event,
    Phase,
    Report,
    StopRequest,
    WireError,
    decode_request,
)

LONGEST_STOP_S = 10.0
"""A stop sequence that takes longer is broken: the firmware's own timeout has long acted."""
CLOCK_TOLERANCE_S = 1e-3
"""A command stamped later than this in the future was not stamped with the monotonic clock."""
MOST_COMPLAINTS = 50
"""Told in one run; whoever has that many to tell flickers."""
_ROUNDING = 1.0 + 1e-9

_TOUCHING = (Phase.ENABLING, Phase.DRIVING, Phase.RECOVERING)


def check_firmware_timeout(link: Link, allow_unsafe: bool) -> None:
    """Refuse firmware that would drive on for long after the guard itself died.

    Raises:
        ConfigError: if the firmware's command timeout is unknown, off, or over 1 s, unless ``allow_unsafe``.
    """
    fault = firmware_timeout_fault(link.firmware_timeout_s)
    if fault and not allow_unsafe:
        raise ConfigError(f"{fault}: set it as edge-doctor says, or pass --allow-unsafe-firmware-timeout")


def firmware_timeout_fault(timeout_s: float | None) -> str:
    """Say what is wrong with a firmware's command timeout; empty if nothing is."""
    if timeout_s is not None and 0.0 < timeout_s <= LONGEST_FIRMWARE_TIMEOUT_S:
        return ""
    known = "unknown" if timeout_s is None else "off" if timeout_s == 0.0 else f"{timeout_s:g} s"
    return f"the firmware's command timeout is {known}, not between 0 and {LONGEST_FIRMWARE_TIMEOUT_S:g} s"


def limit_fault(setpoint: Setpoint, limits: SetpointLimits) -> str:
    """Say what is wrong with a command's numbers; empty if nothing is."""
    for what, found, wanted in (
        ("action", len(setpoint.action), len(limits.low)),
        ("velocity", len(setpoint.velocity_m_s), limits.dims),
    ):
        if found != wanted:
            return f"{what} of {found} components, this robot takes {wanted}"
    speed, turn = math.hypot(*setpoint.velocity_m_s), abs(setpoint.yaw_rate_rad_s)
    if not all(map(math.isfinite, (speed, turn, setpoint.stamp_s, *setpoint.action))):
        return "command is not finite"
    return _excess(setpoint, speed, turn, limits)


def _excess(setpoint: Setpoint, speed: float, turn: float, limits: SetpointLimits) -> str:
    if speed > limits.speed_m_s * _ROUNDING:
        return f"command of {speed:.3f} m/s is over the limit of {limits.speed_m_s:g} m/s"
    if turn > limits.yaw_rate_rad_s * _ROUNDING:
        return f"yaw rate of {turn:.3f} rad/s is over the limit of {limits.yaw_rate_rad_s:g} rad/s"
    for component, low, high in zip(setpoint.action, limits.low, limits.high, strict=True):
        if not low * _ROUNDING <= component <= high * _ROUNDING:
            return f"action of {component:.3f} is outside its limits, {low:g} to {high:g}"
    return ""


class Guard:
    """Forwards each fresh command once and stops the robot when they end; the only user of its link."""

    def __init__(self, link: Link, spec: GuardSpec) -> None:
        self.phase = Phase.WATCHING
        self.events: deque[Event | Complaint] = deque()
        """Changes of phase, and the firmware's complaints, not yet told to the runtime."""
        self.filenos = link.filenos()
        """File descriptors of the link, which is open; none once it has failed."""
        self._link = link
        self._spec = spec
        self._leaving = False
        self._last_sequence = -1
        self._fresh_until_s = -math.inf
        self._speeding = Speeding(spec.limits.speed_m_s)
        self._steps: Steps = iter(())
        self._step_due_s = math.inf
        self._stop_until_s = math.inf
        self._keepalive_due_s = math.inf if math.isinf(link.keepalive_period_s) else -math.inf
        self._complaints: set[str] = set()
        self._forwarded = self._refused = self._withheld = self._recovered = 0

    @property
    def finished(self) -> bool:
        """Whether the robot was stopped and nobody is left to report to."""
        return self._leaving and self.phase is Phase.STOPPED

    @property
    def holds_robot(self) -> bool:
        """Whether the robot may move by our commands, or was moved by them and has not been stopped yet."""
        return self.phase in _TOUCHING or self.phase is Phase.STOPPING

    def report(self) -> Report:
        """Return what the runtime should know now."""
        counts = Counts(self._forwarded, self._refused, self._withheld, self._link.dropped(), self._recovered)
        return Report(self.phase, counts, self._link.state(), self._link.firmware_timeout_s)

    def next_due_s(self) -> float:
        """Return the monotonic time of the next ``on_time`` that has something to do."""
        deadline = self._fresh_until_s if self.phase in _TOUCHING else math.inf
        return min(deadline, self._step_due_s, self._keepalive_due_s)

    def on_packet(self, packet: bytes, now_s: float) -> None:
        """Take one packet from the runtime."""
        try:
            request = decode_request(packet)
        except WireError as error:
            self.stop(f"malformed command ({error})", now_s)
            return
        if isinstance(request, StopRequest):
            self.stop(request.reason, now_s)
        else:
            self._on_setpoint(request, now_s)

    def on_leave(self, reason: str, now_s: float) -> None:
        """Stop and finish: the runtime's socket closed, or a signal asks the guard to end."""
        self._leaving = True
        self.stop(reason, now_s)

    def on_feedback(self, now_s: float) -> None:
        """Take in what the firmware sent, and judge it at once."""
        try:
            self._link.receive(now_s)
        except BridgeError as error:
            self.filenos = ()
            self.stop(str(error), now_s)

    def on_time(self, now_s: float) -> None:
        """Act on deadlines, health and sequences; called after every event and at ``next_due_s``."""
        if self.phase in _TOUCHING:
            self._judge(self._link.health(now_s), now_s)
        if self.phase in _TOUCHING and now_s >= self._fresh_until_s:
            self.stop(f"no fresh command for {self._spec.deadline_s * 1e3:.0f} ms", now_s)
        if now_s >= self._step_due_s:
            self._advance(now_s)
        if now_s >= self._keepalive_due_s:
            self._keep_alive(now_s)

    def stop(self, reason: str, now_s: float) -> None:
        """Start the stop sequence, finally; a robot never touched or taken over is left alone."""
        if self.phase in (Phase.STOPPING, Phase.STOPPED):
            return
        touched = self.phase in _TOUCHING
        if not touched or self._link.health(now_s).condition is Condition.OVERRIDE:
            self._enter(Phase.STOPPED, reason)
            self._step_due_s = math.inf
            return
        self._enter(Phase.STOPPING, reason)
        self._stop_until_s = now_s + LONGEST_STOP_S
        self._begin(self._link.stop_sequence(), now_s)

    def _on_setpoint(self, setpoint: Setpoint, now_s: float) -> None:
        fault = limit_fault(setpoint, self._spec.limits)
        if not fault and setpoint.stamp_s > now_s + CLOCK_TOLERANCE_S:
            fault = f"command is stamped {setpoint.stamp_s - now_s:.3f} s in the future"
        if fault:
            self.stop(fault, now_s)
        elif setpoint.sequence <= self._last_sequence or now_s - setpoint.stamp_s > self._spec.deadline_s:
            self._refused += 1
        else:
            self._last_sequence = setpoint.sequence
            self._fresh_until_s = now_s + self._spec.deadline_s
            self._on_fresh(setpoint, now_s)

    def _on_fresh(self, setpoint: Setpoint, now_s: float) -> None:
        condition = self._link.health(now_s).condition
        if self.phase is Phase.WATCHING:
            self._take_command(condition, now_s)
        if self.phase is not Phase.DRIVING or condition is not Condition.READY:
            self._withheld += 1
            return
        try:
            self._link.send(setpoint, now_s)
        except BridgeError as error:
            self.stop(str(error), now_s)
            return
        self._forwarded += 1

    def _take_command(self, condition: Condition, now_s: float) -> None:
        if condition in (Condition.OVERRIDE, Condition.LOST):
            return
        if self._spec.arm:
            self._enter(Phase.ENABLING, "first command")
            self._begin(self._link.enable_sequence(), now_s)
        elif condition is Condition.READY:
            self._enter(Phase.DRIVING, "already enabled")

    def _judge(self, health: Health, now_s: float) -> None:
        if health.condition in (Condition.OVERRIDE, Condition.LOST):
            self.stop(health.detail, now_s)
        elif self.phase is Phase.DRIVING and (speeding := self._speeding.fault(self._link.state(), now_s)):
            self.stop(speeding, now_s)
        elif self.phase is Phase.DRIVING and health.condition is not Condition.READY:
            self._recover(health.detail, now_s)
        elif health.warning:
            self._complain(health.warning)

    def _complain(self, text: str) -> None:
        if text not in self._complaints and len(self._complaints) < MOST_COMPLAINTS:
            self._complaints.add(text)
            self.events.append(Complaint(text))

    def _recover(self, cause: str, now_s: float) -> None:
        allowed = self._link.recoveries if self._spec.arm else 0
        if self._recovered >= allowed:
            after = f" after {allowed} recoveries" if allowed else ""
            self.stop(f"{cause}{after}", now_s)
            return
        self._recovered += 1
        self._enter(Phase.RECOVERING, cause)
        self._begin(self._stop_and_enable(), now_s)

    def _stop_and_enable(self) -> Steps:
        yield from self._link.stop_sequence()
        yield from self._link.enable_sequence()

    def _begin(self, steps: Steps, now_s: float) -> None:
        self._steps = steps
        self._advance(now_s)

    def _advance(self, now_s: float) -> None:
        """Do the next step of the running sequence; never blocks."""
        try:
            delay_s = next(self._steps, None)
        except BridgeError as error:
            self._on_failed_step(str(error), now_s)
            return
        if delay_s is None or now_s >= self._stop_until_s:
            self._on_last_step()
        else:
            self._step_due_s = now_s + delay_s

    def _on_last_step(self) -> None:
        self._step_due_s = math.inf
        if self.phase is Phase.STOPPING:
            self._enter(Phase.STOPPED, "stop sequence done")
        else:
            self._enter(Phase.DRIVING, "enabled")

    def _on_failed_step(self, cause: str, now_s: float) -> None:
        self._step_due_s = math.inf
        if self.phase is Phase.RECOVERING:
            self._recover(cause, now_s)
        elif self.phase is Phase.ENABLING:
            self.stop(cause, now_s)
        else:
            self._enter(Phase.STOPPED, f"stop sequence failed: {cause}")

    def _keep_alive(self, now_s: float) -> None:
        self._keepalive_due_s = now_s + self._link.keepalive_period_s
        fresh = now_s < self._fresh_until_s and self.phase < Phase.STOPPING
        try:
            self._link.keepalive(fresh, now_s)
        except BridgeError as error:
            self.stop(str(error), now_s)

    def _enter(self, phase: Phase, cause: str) -> None:
        self.phase = phase
        self.events.append(Event(phase, cause))
