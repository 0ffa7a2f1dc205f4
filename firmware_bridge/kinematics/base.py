"""From a velocity in the team's frame to what a base can do: omnidirectional, differential, Ackermann."""

import math
from typing import Literal

import msgspec
from msgspec.structs import replace

from edge_runtime.errors import BridgeError
from edge_runtime.messages import Vector
from firmware_bridge.kinematics.frames import rotate

SIDEWAYS_TOLERANCE_M_S = 0.01
"""Sideways velocity that a base with ``sideways = "refuse"`` ignores."""


class BaseMotion(msgspec.Struct, frozen=True, gc=False):
    """A base's motion in its body frame, x forward, y left, counter-clockwise positive."""

    forward_m_s: float = 0.0
    lateral_m_s: float = 0.0
    yaw_rad_s: float = 0.0
    steering_rad: float = 0.0

    def scaled(self, factor: float) -> "BaseMotion":
        """Slow down along the same curve: the steering angle stays."""
        return BaseMotion(
            self.forward_m_s * factor, self.lateral_m_s * factor, self.yaw_rad_s * factor, self.steering_rad
        )


class Base(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the wheels allow."""

    kind: Literal["omnidirectional", "differential", "ackermann"]
    """How it turns: on the spot and sideways, by the difference of its wheels, or by steering."""
    sideways: Literal["refuse", "lookahead", "turn"] = "refuse"
    """For wheels that do not slip: refuse sideways velocities, or steer a point ahead of the axle by them.
    ``turn`` is for policies that command yaw rates alone, and set where one drives; see `turning`."""
    lookahead_m: float = 0.0
    """Distance of that point ahead of the (rear) axle; it is also the point whose position is reported."""
    max_yaw_rad_s: float = math.inf
    """Greatest yaw rate that is commanded."""
    wheelbase_m: float = 0.0
    """Ackermann: from the axle that does not steer to the one that does; half of it where both do."""
    track_m: float = 0.0
    """Ackermann: between the wheels of an axle, where the steering angle is the inner wheel's; else 0."""
    max_steering_rad: float = 0.0
    """Ackermann: greatest steering angle that is commanded."""

    def __post_init__(self) -> None:
        if self.kind != "omnidirectional" and self.sideways == "lookahead" and not self.lookahead_m > 0.0:
            raise ValueError("`lookahead_m` must be positive where sideways = 'lookahead'")
        if self.kind == "ackermann" and not (self.wheelbase_m > 0.0 and self.max_steering_rad > 0.0):
            raise ValueError("`wheelbase_m` and `max_steering_rad` must be positive for an ackermann base")
        if not self.track_m >= 0.0:
            raise ValueError(f"`track_m` must not be negative, got {self.track_m}")
        if not self.max_yaw_rad_s > 0.0:
            raise ValueError(f"`max_yaw_rad_s` must be positive, got {self.max_yaw_rad_s}")

    @property
    def reference_m(self) -> float:
        """Distance ahead of the axle of the point that is steered and reported."""
        ahead = self.kind != "omnidirectional" and self.sideways == "lookahead"
        return self.lookahead_m if ahead else 0.0


def turning(base: Base) -> Base:
    """Return the base under a policy that commands yaw rates: no velocity steers it, its axle is reported."""
    return replace(base, sideways="turn")


def motion_for(
    velocity_m_s: Vector, heading_rad: float, base: Base, yaw_rate_rad_s: float = 0.0
) -> BaseMotion:
    """Return the motion that gives the base's reference point this velocity in the team's frame.

    A yaw rate beyond the base's shortens the whole motion, which keeps its curve. With a commanded yaw rate
    wheels that do not slip roll with the velocity's length: it points where the base will look by then.

    Args:
        velocity_m_s: in the team's frame.
        heading_rad: of the base.
        base: what its wheels allow.
        yaw_rate_rad_s: of policies that turn their robot.

    Raises:
        BridgeError: on a sideways velocity that the base refuses.
    """
    forward, left = rotate(velocity_m_s, -heading_rad)
    if base.kind == "omnidirectional":
        motion = BaseMotion(forward, left, yaw_rate_rad_s)
    elif base.sideways == "turn":
        motion = BaseMotion(math.copysign(math.hypot(forward, left), forward), 0.0, yaw_rate_rad_s)
    elif base.sideways == "lookahead":
        motion = BaseMotion(forward, 0.0, left / base.lookahead_m)
    elif abs(left) <= SIDEWAYS_TOLERANCE_M_S:
        motion = BaseMotion(forward)
    else:
        raise BridgeError(
            f"this {base.kind} base cannot move sideways at {left:.2f} m/s: "
            "set base.sideways = 'lookahead' in the profile"
        )
    if abs(motion.yaw_rad_s) > base.max_yaw_rad_s:
        motion = motion.scaled(base.max_yaw_rad_s / abs(motion.yaw_rad_s))
    return _steered(motion, base) if base.kind == "ackermann" else motion


def yaw_from_steering(forward_m_s: float, steering_rad: float, base: Base) -> float:
    """Return the yaw rate of an Ackermann base in rad/s: v tan(d) / (l + |tan(d)| b / 2)."""
    slope = math.tan(steering_rad)
    return forward_m_s * slope / (base.wheelbase_m + abs(slope) * base.track_m / 2)


def _steered(motion: BaseMotion, base: Base) -> BaseMotion:
    """Replace the yaw rate by the steering angle nearest to it; standing wheels turn, the base does not."""
    forward, limit = motion.forward_m_s, base.max_steering_rad
    if forward == 0.0:
        steering = math.copysign(limit, motion.yaw_rad_s) if motion.yaw_rad_s else 0.0
    else:
        curvature = motion.yaw_rad_s / forward
        beside = 1.0 - abs(curvature) * base.track_m / 2  # 0: the curve's centre lies under the inner wheel
        wanted = math.atan(base.wheelbase_m * abs(curvature) / beside) if beside > 0.0 else limit
        steering = math.copysign(min(wanted, limit), curvature)
    return BaseMotion(forward, 0.0, yaw_from_steering(forward, steering, base), steering)
