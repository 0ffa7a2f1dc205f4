"""Stopping, as a number: how far a robot travels after each fault.

Until somebody tells it to stop it goes on at its speed v for a time t, then it brakes with a:

    x = v t + v^2 / (2 a)

Who tells it, and when, is the link's business (`Reaction`): a guard hears at once that its runtime died, and
waits for its deadline where the runtime is frozen. Where the guard itself is gone, or the wire, there is only
the firmware's own command timeout.
"""

import math

import msgspec

from edge_runtime.control.bridge import Reaction
from edge_runtime.control.mission import Mission
from edge_runtime.motion.model import velocity_gains
from edge_runtime.objectives import SpeedLimit
from edge_runtime.policy.manifest import Manifest

NOTICING_S = 0.025
"""From what a guard notices to its stop on the wire, at most: what ``python -m benchmarks faults`` asks."""


class Travel(msgspec.Struct, frozen=True):
    """What one fault costs."""

    fault: str
    seconds: float | None
    """Until the robot brakes; None where nothing bounds it."""
    metres: float | None
    """Until it rests; None as well."""


class Stopping(msgspec.Struct, frozen=True):
    """Every fault's cost for one robot, at its speed limit."""

    speed_m_s: float
    deceleration_m_s2: float
    travels: tuple[Travel, ...]
    room_m: float | None
    """Between the hulls of two robots at the safety margin; None if no margin was asked for."""

    @property
    def too_long(self) -> tuple[Travel, ...]:
        """Those after which the robot may travel farther than the margin leaves room for."""
        room_m = self.room_m
        if room_m is None:
            return ()
        return tuple(one for one in self.travels if one.metres is None or one.metres > room_m)


def stopping(mission: Mission, max_speed_m_s: float, reaction: Reaction) -> Stopping:
    """Work out what each fault costs a mission's robot.

    Args:
        mission: asks for speed limit and safety margin.
        max_speed_m_s: greatest speed that the link lets through.
        reaction: of the link.
    """
    margin_m, manifest = mission.objective_set.margin_m, mission.bundle.manifest
    own = mission.fleet.robot(mission.robot_id).max_speed_m_s or math.inf
    limits = [one.limit_m_s for one in mission.objectives if isinstance(one, SpeedLimit)]
    speed_m_s = min(max_speed_m_s, own, *limits)
    deceleration = reaction.deceleration_m_s2 or _braking_m_s2(manifest)
    room_m = None if margin_m is None else margin_m - 2.0 * manifest.body.radius_m
    return Stopping(speed_m_s, deceleration, travels(speed_m_s, deceleration, reaction), room_m)


def travels(speed_m_s: float, deceleration_m_s2: float, reaction: Reaction) -> tuple[Travel, ...]:
    """Return what each fault costs at this speed."""
    alone_s = reaction.firmware_timeout_s or None
    times_s = {
        "runtime dead": NOTICING_S,
        "runtime frozen": reaction.deadline_s + NOTICING_S,
        "guard dead": alone_s,
        "link cut": alone_s,
    }
    braking_m = speed_m_s**2 / (2.0 * deceleration_m_s2)
    return tuple(
        Travel(fault, time_s, None if time_s is None else speed_m_s * time_s + braking_m)
        for fault, time_s in times_s.items()
    )


def describe(stopping: Stopping) -> str:
    """Say in a line what each fault costs, and where that is more than there is room for."""
    costs = ", ".join(f"{one.fault} {_metres(one)}" for one in stopping.travels)
    text = f"at {stopping.speed_m_s:g} m/s, braking with {stopping.deceleration_m_s2:g} m/s^2: {costs}"
    return f"{text}; {_shortage(stopping)}" if stopping.too_long else text


def _shortage(stopping: Stopping) -> str:
    names = ", ".join(one.fault for one in stopping.too_long)
    return f"the safety margin leaves {stopping.room_m:.2f} m between two robots, less than after: {names}"


def _metres(travel: Travel) -> str:
    return "without end" if travel.metres is None else f"{travel.metres:.2f} m"


def _braking_m_s2(manifest: Manifest) -> float:
    """Return what the policy's greatest action brakes with, along its weakest axis and without drag.

    A robot whose action changes no velocity keeps none.
    """
    limits = [max(-field.low, field.high) for field in manifest.action]
    gains = velocity_gains(manifest.motion, 1)
    pushes = [gain * limit for gain, limit in zip(gains, limits, strict=True)]
    return min((push / manifest.motion.dt_s for push in pushes if push), default=math.inf)
