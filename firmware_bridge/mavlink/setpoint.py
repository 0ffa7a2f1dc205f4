"""From one command to what the autopilot follows: velocity, or speed and yaw rate."""

import math

from msgspec.structs import replace

from edge_runtime.messages import RobotState, Vector
from edge_runtime.motion.models import MotionModel
from firmware_bridge.guard.link import Setpoint, SetpointLimits
from firmware_bridge.kinematics.base import Base, motion_for
from firmware_bridge.kinematics.frames import swap_enu_ned
from firmware_bridge.mavlink.messages import Target
from firmware_bridge.mavlink.profiles import (
    BODY_NED,
    LOCAL_NED,
    VELOCITY_AND_YAW_RATE,
    VELOCITY_ONLY,
    SetpointKind,
)

LEAK_PER_S = 0.5
"""Share of the integrated velocity lost in a second, at least: without drag, errors would pile up."""


class Follower:
    """Keeps the integrated velocity and yaw rate between commands.

    Args:
        follows: what the autopilot follows.
        motion: of the policy, integrated with the control period.
        limits: what the guard lets through.
        wheels: how forward speed and yaw rate follow from a velocity; only for autopilots that follow those.
    """

    def __init__(
        self, follows: SetpointKind, motion: MotionModel, limits: SetpointLimits, wheels: Base
    ) -> None:
        self._follows = follows
        self._limits = limits
        self._wheels = wheels
        self._turns = motion.turns
        self._preview = motion.preview(1)
        rest = (0.0,) * motion.dims
        moving = RobotState(0, 0.0, rest, (1.0, *rest[1:]), 0.0, 1.0)
        drift = self._preview.predict(moving, (0.0,) * motion.action_dim)
        self._keep, self._keep_turn = (_kept(decay, motion.dt_s) for decay in (drift.vx, drift.yaw_rate))
        self._velocity: Vector | None = None
        self._yaw_rate = 0.0

    def hold(self) -> Target:
        """Return the setpoint that brings the robot to rest, and forget the integrated velocity."""
        self._velocity, self._yaw_rate = (0.0,) * self._limits.dims, 0.0
        if self._follows is SetpointKind.FORWARD_AND_YAW_RATE:
            return Target(BODY_NED, VELOCITY_AND_YAW_RATE)
        return Target(LOCAL_NED, VELOCITY_AND_YAW_RATE if self._turns else VELOCITY_ONLY)

    def follow(self, setpoint: Setpoint, state: RobotState) -> Target:
        """Return the setpoint for one command.

        Raises:
            BridgeError: if these wheels cannot move that way.
        """
        if not any(setpoint.action) and not any(setpoint.velocity_m_s) and not setpoint.yaw_rate_rad_s:
            return self.hold()
        velocity, yaw_rate = self._integrate(setpoint.action, state)
        if self._follows is SetpointKind.FORWARD_AND_YAW_RATE:
            motion = motion_for(velocity, state.heading_rad, self._wheels, yaw_rate)
            forward = (motion.forward_m_s, 0.0, 0.0)
            return Target(BODY_NED, VELOCITY_AND_YAW_RATE, forward, -motion.yaw_rad_s)
        x, y, *up = velocity
        target = (*swap_enu_ned((x, y)), -up[0] if up else 0.0)
        if self._turns:
            return Target(LOCAL_NED, VELOCITY_AND_YAW_RATE, target, -yaw_rate)
        return Target(LOCAL_NED, VELOCITY_ONLY, target)

    def _integrate(self, action: Vector, state: RobotState) -> tuple[Vector, float]:
        """Return velocity and yaw rate that the motion model reaches in one period."""
        if self._velocity is not None:
            state = replace(state, velocity_m_s=self._velocity, yaw_rate_rad_s=self._yaw_rate)
        motion, most = self._preview.predict(state, action), self._limits.yaw_rate_rad_s
        reached = motion.velocity_m_s(self._limits.dims)
        self._velocity = clamp(tuple(self._keep * speed for speed in reached), self._limits.speed_m_s)
        self._yaw_rate = min(max(self._keep_turn * motion.yaw_rate, -most), most)
        return self._velocity, self._yaw_rate


def _kept(decay: float, period_s: float) -> float:
    """Share to keep of what a model keeps ``decay`` of, so that in all it leaks."""
    return min(1.0, (1.0 - LEAK_PER_S * period_s) / decay) if decay > 0.0 else 1.0


def clamp(vector: Vector, length: float) -> Vector:
    """Shorten a vector to ``length`` if it is longer, in the same direction."""
    size = math.hypot(*vector)
    if size <= length:
        return vector
    return tuple(component * length / size for component in vector)
