"""From one command to what the autopilot follows: velocity, or speed and yaw rate."""

import math

from edge_runtime.messages import RobotState, Vector, Vector2
from edge_runtime.motion.dynamics import Dynamics
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

_AT_REST = (0.0, 0.0)


class Follower:
    """Keeps the integrated velocity between commands.

    Args:
        motion: what the autopilot follows.
        dynamics: of the policy, integrated with the control period.
        limits: what the guard lets through.
        wheels: how forward speed and yaw rate follow from a velocity; only for autopilots that follow those.
    """

    def __init__(
        self, motion: SetpointKind, dynamics: Dynamics, limits: SetpointLimits, wheels: Base
    ) -> None:
        self._motion = motion
        self._dynamics = dynamics
        self._limits = limits
        self._wheels = wheels
        self._preview = dynamics.preview(1)
        self._keep = min(1.0, (1.0 - LEAK_PER_S * dynamics.dt_s) / self._preview.velocity_decay)
        self._velocity: Vector2 | None = None

    def hold(self) -> Target:
        """Return the setpoint that brings the robot to rest, and forget the integrated velocity."""
        self._velocity = _AT_REST
        if self._motion is SetpointKind.FORWARD_AND_YAW_RATE:
            return Target(BODY_NED, VELOCITY_AND_YAW_RATE)
        return Target(LOCAL_NED, VELOCITY_ONLY)

    def follow(self, setpoint: Setpoint, state: RobotState) -> Target:
        """Return the setpoint for one command.

        Raises:
            BridgeError: if these wheels cannot move that way.
        """
        if setpoint.action == _AT_REST and setpoint.velocity_m_s == _AT_REST:
            return self.hold()
        velocity = self._integrate(setpoint.action, state.velocity_m_s)
        if self._motion is SetpointKind.VELOCITY:
            return Target(LOCAL_NED, VELOCITY_ONLY, velocity_m_s=swap_enu_ned(velocity))
        motion = motion_for(velocity, state.heading_rad, self._wheels)
        forward = (motion.forward_m_s, 0.0)
        return Target(BODY_NED, VELOCITY_AND_YAW_RATE, velocity_m_s=forward, yaw_rate_rad_s=-motion.yaw_rad_s)

    def rehearse(self, setpoint: Setpoint, state: RobotState) -> Target:
        """Return what ``follow`` would, and keep the integrated velocity; raises as ``follow``."""
        velocity = self._velocity
        try:
            return self.follow(setpoint, state)
        finally:
            self._velocity = velocity

    def _step(self, action: Vector, velocity: Vector) -> Vector2:
        """Return the velocity that the manifest's dynamics reach in one period."""
        decay, gain = self._preview.velocity_decay, self._preview.velocity_gain
        return decay * velocity[0] + gain * action[0], decay * velocity[1] + gain * action[1]

    def _integrate(self, action: Vector, measured: Vector) -> Vector2:
        x, y = self._step(action, measured if self._velocity is None else self._velocity)
        self._velocity = clamp((self._keep * x, self._keep * y), self._limits.speed_m_s)
        return self._velocity


def clamp(vector: Vector2, length: float) -> Vector2:
    """Shorten a vector to ``length`` if it is longer, in the same direction."""
    size = math.hypot(*vector)
    if size <= length:
        return vector
    return vector[0] * length / size, vector[1] * length / size
