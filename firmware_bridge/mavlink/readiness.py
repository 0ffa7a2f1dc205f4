"""What forbids to drive an autopilot: before it is taken, and while it drives."""

from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.facts import Facts
from firmware_bridge.mavlink.streams import Streams

STALE_S = 0.5
"""Feedback older than this no longer carries a moving robot."""
GROUNDED = "the copter is on the ground: a pilot takes it off, then --arm takes it over in the air"


def rivalry(channel: Channel) -> str:
    """Say where a second vehicle with the same number is; empty while none has spoken."""
    home, rival = channel.home, channel.rival
    if home is None or rival is None:
        return ""
    return (
        f"two vehicles have one system id, at {home[0]}:{home[1]} and at {rival[0]}:{rival[1]}: "
        "give each its own (SYSID_THISMAV, MAV_SYSID, MAV_SYS_ID)"
    )


class Readiness:
    """Judges what was told; every answer is a reason, empty where there is none."""

    def __init__(self, channel: Channel, facts: Facts, streams: Streams) -> None:
        self._channel = channel
        self._facts = facts
        self._streams = streams

    def conflict(self) -> str:
        """Another vehicle with the same number, or one that the profile is not for."""
        return rivalry(self._channel) or self._facts.vehicle.misfit

    def hindrance(self, now_s: float) -> str:
        """Whatever stops a robot that drives."""
        return self.conflict() or self._unsound(now_s) or self._streams.fault

    def missing(self, now_s: float) -> str:
        """What is not there yet, before the robot is taken."""
        if not self._streams.watched(now_s):
            return "how often the autopilot sends its pose is not known yet"
        return self._unsound(now_s)

    def refusal(self, now_s: float) -> str:
        """What the robot is not taken for once nothing is missing."""
        if self._facts.vehicle.grounded:
            return GROUNDED
        return self._streams.shortfall(now_s)

    def _unsound(self, now_s: float) -> str:
        state = self._facts.estimate.state
        if state is None or now_s - state.stamp_s > STALE_S:
            return f"no position from the autopilot for {STALE_S:g} s"
        return self._facts.soundness.fault(now_s)
