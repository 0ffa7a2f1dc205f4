"""What holds together, and is still hardly meant: numbers far from anything that the policy has seen."""

import math
from collections.abc import Iterator
from typing import Final

from edge_runtime.control.mission import Mission
from edge_runtime.motion.model import velocity_gains

FASTER: Final = 10.0
"""Times the policy's rate; it still drives at five times (`docs/first-robot-can.md`)."""
SLOWER: Final = 2.0
BEYOND: Final = 10.0
"""Times the speed that the policy can reach at all: such a limit asks for nothing."""
LONGEST_WAY_S: Final = 300.0
"""To a goal, at that speed."""
_STEADY_S: Final = 60.0
"""After so long under its greatest action a robot is about as fast as it gets."""


def doubts(mission: Mission) -> Iterator[str]:
    """Yield, a line each, what about a mission somebody should look at once more."""
    policy_hz = mission.bundle.manifest.control_rate_hz
    if mission.rate_hz > FASTER * policy_hz or mission.rate_hz < policy_hz / SLOWER:
        yield (
            f"the rate of {mission.rate_hz:g} Hz is far from the {policy_hz:g} Hz that the policy was "
            "trained at; is --rate meant?"
        )
    fastest_m_s = _fastest_m_s(mission)
    limit_m_s = mission.objective_set.speed_limit_m_s
    if limit_m_s is not None and limit_m_s > BEYOND * fastest_m_s:
        yield (
            f"the speed limit of {limit_m_s:g} m/s asks for nothing: the policy drives {fastest_m_s:.2g} m/s "
            "at most; is limit_m_s in m/s?"
        )
    robot = mission.fleet.robot(mission.robot_id)
    way_m = math.dist(robot.start_m, robot.goal_m or robot.start_m)
    if way_m > LONGEST_WAY_S * fastest_m_s:
        yield (
            f"the goal of robot {robot.id} is {way_m:g} m from its start, {way_m / fastest_m_s:.0f} s at the "
            f"{fastest_m_s:.2g} m/s that the policy drives at most; is goal_m in m?"
        )


def _fastest_m_s(mission: Mission) -> float:
    manifest = mission.bundle.manifest
    gains = velocity_gains(manifest.motion, max(1, round(_STEADY_S / manifest.motion.dt_s)))
    most = [max(abs(field.low), abs(field.high)) for field in manifest.action]
    return max(gain * limit for gain, limit in zip(gains, most, strict=True))
