"""How firmware follows the motion that it was told, as hard as the manifest's action limits allow.

It takes the action of the policy's own motion model that comes nearest to that motion in one step.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.messages import RobotState, Vector
from edge_runtime.motion.model import LinearModel
from edge_runtime.motion.models import Unicycle
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.kinematics.frames import rotate


class Wanted(NamedTuple):
    """Velocity in the team's frame in m/s, and yaw rate in rad/s; those of another kind are passed over."""

    x_m_s: float
    y_m_s: float
    yaw_rad_s: float = 0.0


Follower = Callable[[RobotState, Wanted], Vector]


def follower(manifest: Manifest, period_s: float) -> Follower:
    """Return what gives the action for one step from a state, within the manifest's limits.

    Args:
        manifest: of a policy in the plane.
        period_s: of a step.
    """
    low = np.array([field.low for field in manifest.action])
    high = np.array([field.high for field in manifest.action])
    motion = manifest.motion.at_period(period_s)
    solve = _rolling(motion) if isinstance(motion, Unicycle) else _linear(motion)

    def follow(state: RobotState, wanted: Wanted) -> Vector:
        return tuple(np.clip(solve(state, wanted), low, high).tolist())

    return follow


def _linear(motion: LinearModel) -> Callable[[RobotState, Wanted], Floats]:
    """v' = keep v + gain u, solved for u: with the least effort where that leaves a choice."""
    axes = motion.axes()
    keep = np.array([axis.velocity_decay for axis in axes])
    solution = np.linalg.pinv(np.array([axis.velocity_gain for axis in axes]))

    def solve(state: RobotState, wanted: Wanted) -> Floats:
        now = np.array((*state.velocity_m_s, state.yaw_rate_rad_s)[: len(axes)])
        return solution @ (np.array(wanted[: len(axes)]) - keep * now)

    return solve


def _rolling(motion: Unicycle) -> Callable[[RobotState, Wanted], Floats]:
    """Speeds and rates are asked for as they are; accelerations, so that they come to be in one step."""

    def solve(state: RobotState, wanted: Wanted) -> Floats:
        forward, turn = rotate(wanted[:2], -state.heading_rad)[0], wanted.yaw_rad_s
        if motion.forward == "acceleration":
            speed, _ = rotate(state.velocity_m_s, -state.heading_rad)
            forward = (forward - speed) / motion.dt_s
        if motion.turn == "acceleration":
            turn = (turn - state.yaw_rate_rad_s) / motion.dt_s
        return np.array((forward / motion.gain, turn))

    return solve
