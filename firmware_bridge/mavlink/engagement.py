"""Taking command of an autopilot and giving it back: sequences that end when a heartbeat confirms them."""

from collections.abc import Callable

from edge_runtime.errors import BridgeError
from firmware_bridge.guard.link import Steps
from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.messages import Command, CommandResult, Content, Outgoing, StatusText
from firmware_bridge.mavlink.profiles import Mode, Profile
from firmware_bridge.mavlink.readiness import Readiness
from firmware_bridge.mavlink.setpoint import Follower
from firmware_bridge.mavlink.vehicle import Vehicle

ENABLING_S = 15.0
LISTENING_S = 1.2
"""Longer than a vehicle's heartbeats are apart: whoever else has this system id has spoken by then."""
STOPPING_S = 3.0
STEP_S = 0.1
ASK_AGAIN_S = 1.0

_DO_SET_MODE = 176
_ARM = Command(400, (1.0,))
_CUSTOM_MODE_ENABLED = 1
_ACCEPTED_OR_IN_PROGRESS = (0, 5)
_GRAVEST_WARNING = 4


class Engagement:
    """The enable and the stop sequence of one autopilot.

    Args:
        profile: modes and engage rules.
        channel: where requests go out.
        vehicle: what heartbeats prove.
        follower: knows the setpoint that holds still.
        ready: judges whether it may be driven.
        clock: monotonic time in seconds.
    """

    def __init__(
        self,
        profile: Profile,
        channel: Channel,
        vehicle: Vehicle,
        follower: Follower,
        ready: Readiness,
        clock: Callable[[], float],
    ) -> None:
        self._profile = profile
        self._channel = channel
        self._vehicle = vehicle
        self._follower = follower
        self._now = clock
        self._ready = ready
        self._explanation = ""

    def listen(self, content: Content) -> None:
        """Remember why the autopilot refuses; words count more than result numbers."""
        match content:
            case StatusText(severity=severity, text=text) if severity <= _GRAVEST_WARNING:
                self._explanation = text
            case CommandResult(command=command, result=result) if result not in _ACCEPTED_OR_IN_PROGRESS:
                self._explanation = self._explanation or f"MAV_RESULT {result} to command {command}"

    def enable(self) -> Steps:
        """Wait for a sound position, take command, then arm; a copter on the ground is not taken.

        Raises:
            BridgeError: if a heartbeat does not confirm it in time, somebody takes the robot over, or
                something forbids to drive it.
        """
        begin_s = self._now()
        end_s = begin_s + ENABLING_S
        while (missing := self._ready.missing(self._now())) or self._now() < begin_s + LISTENING_S:
            self._refuse(self._ready.conflict() or (missing if self._now() >= end_s else ""))
            yield STEP_S
        self._refuse(self._ready.conflict() or self._ready.refusal(self._now()))
        self._vehicle.expect(self._profile.command_mode)
        streaming_s = self._now() + self._profile.prestream_s
        while self._now() < streaming_s:
            self._hold()
            yield STEP_S
        yield from self._reach(self._profile.command_mode, end_s)
        yield from self._until(lambda: self._vehicle.armed, end_s, "arm", _ARM)
        self._refuse(self._ready.hindrance(self._now()))

    def stop(self) -> Steps:
        """Command zero at once, then the stop mode; a robot never taken, or taken over, is left alone.

        Raises:
            BridgeError: if a heartbeat does not confirm the stop mode in time.
        """
        if not self._vehicle.taken or self._vehicle.override:
            return
        self._hold()
        self._vehicle.expect(self._profile.stop_mode)
        yield from self._reach(self._profile.stop_mode, self._now() + STOPPING_S)

    def _reach(self, mode: Mode, end_s: float) -> Steps:
        request = Command(_DO_SET_MODE, (_CUSTOM_MODE_ENABLED, mode.main, mode.sub))
        return self._until(lambda: self._vehicle.in_mode(mode), end_s, f"enter {mode.name}", request)

    def _until(
        self, confirmed: Callable[[], bool], end_s: float, what: str, request: Outgoing | None = None
    ) -> Steps:
        """Ask every second until confirmed; where setpoints must stream meanwhile, they hold still."""
        ask_s = self._now()
        self._explanation = ""
        while not confirmed():
            now_s = self._now()
            self._refuse(self._vehicle.override)
            if now_s >= end_s:
                said = f": {self._explanation}" if self._explanation else ""
                raise BridgeError(f"the autopilot did not {what}{said}")
            if request is not None and self._profile.prestream_s > 0.0:
                self._hold()
            if request is not None and now_s >= ask_s:
                self._channel.send(request, now_s)
                ask_s = now_s + ASK_AGAIN_S
            yield STEP_S

    def _refuse(self, reason: str) -> None:
        if reason:
            raise BridgeError(reason)

    def _hold(self) -> None:
        self._channel.send(self._follower.hold(), self._now())
