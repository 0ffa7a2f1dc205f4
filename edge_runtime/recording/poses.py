"""The team's poses as Foxglove's 3D panel draws them."""

import math

from edge_runtime.messages import RobotState, TeamState, TrackedObject
from edge_runtime.recording.events import unix_time
from edge_runtime.recording.foxglove import Pose, PosesInFrame, Quaternion, Vector3

FRAME = "team"
"""The common frame of all positions."""


def team_poses(team: TeamState, time_ns: int) -> PosesInFrame:
    """Return the own pose, the teammates' and the tracked objects' in one tick."""
    mates = [mate.state for mate in team.teammates]
    states: list[RobotState | TrackedObject] = [team.own, *mates, *team.tracked]
    return PosesInFrame(unix_time(time_ns), FRAME, tuple(map(_pose, states)))


def _pose(state: RobotState | TrackedObject) -> Pose:
    x, y, *height = state.position_m
    half = 0.5 * state.heading_rad if math.isfinite(state.heading_rad) else math.nan
    return Pose(
        Vector3(x, y, height[0] if height else 0.0), Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
    )
