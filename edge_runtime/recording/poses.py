"""The team's poses as Foxglove's 3D panel draws them."""

import math

from edge_runtime.messages import RobotState, TeamState
from edge_runtime.recording.events import unix_time
from edge_runtime.recording.schema import Pose, PosesInFrame, Quaternion, Vector3

FRAME = "team"
"""The common frame of all positions."""


def team_poses(team: TeamState, time_ns: int) -> PosesInFrame:
    """Return the own pose and the teammates' in one tick."""
    states = (team.own, *(mate.state for mate in team.teammates))
    return PosesInFrame(unix_time(time_ns), FRAME, tuple(map(_pose, states)))


def _pose(state: RobotState) -> Pose:
    x, y, *height = state.position_m
    half = 0.5 * state.heading_rad if math.isfinite(state.heading_rad) else math.nan
    return Pose(
        Vector3(x, y, height[0] if height else 0.0), Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
    )
