"""From odometry to the robot's state, and whether it is stale, late, jumped, not finite, another's."""

import math
import time
from typing import Any, Final

import msgspec

from edge_runtime.messages import RobotState
from firmware_bridge.kinematics.frames import rotate, wrap
from firmware_bridge.ros.profile import RosProfile

JUMP_M: Final = 0.1
JUMP_RAD: Final = 0.5
"""Beside twice what the robot can travel or turn in the time: no wheel does that."""
FASTEST_TURN_RAD_S: Final = 10.0
APART_S: Final = 1.0
"""Clocks further apart are worth a line."""
DRIFT: Final = 1e-3
"""How much faster than ours another computer's clock may run before its odometry looks late."""
LEAST_NORM: Final = 0.5
"""Of a quaternion that is one; all zeros are what a node leaves that knows no orientation."""


class Origin(msgspec.Struct, frozen=True):
    """Where the odometry's origin lies in the team's frame."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0


class Odometry(msgspec.Struct, frozen=True, gc=False):
    """One message of ``nav_msgs/Odometry``, in the plane."""

    x_m: float
    y_m: float
    heading_rad: float
    forward_m_s: float
    lateral_m_s: float
    yaw_rad_s: float
    stamp_s: float
    """In the robot's own time; 0 where it gives none."""
    arrival_s: float
    """Monotonic."""
    frame: str = ""
    """The base's frame: ``child_frame_id``."""


def odometry_from(message: Any, stamp_s: float, arrival_s: float) -> Odometry:  # noqa: ANN401  # of either ROS
    """Read the message of either ROS; what is not finite, or no rotation, becomes nan."""
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    speed = message.twist.twist
    norm = turn.w**2 + turn.x**2 + turn.y**2 + turn.z**2
    heading = math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), turn.w**2 + turn.x**2 - turn.y**2 - turn.z**2
    )
    return Odometry(
        place.x,
        place.y,
        heading if norm > LEAST_NORM else math.nan,
        speed.linear.x,
        speed.linear.y,
        speed.angular.z,
        stamp_s,
        arrival_s,
        message.child_frame_id,
    )


class Odometer:
    """Follows one robot's odometry.

    Args:
        robot_id: whose.
        profile: the robot's.
        namespace: the robot's, as in ``/a200_0000``; a base frame with another prefix is another robot's.
        origin: of the odometry, in the team's frame.
    """

    def __init__(self, robot_id: int, profile: RosProfile, namespace: str, origin: Origin) -> None:
        self.state: RobotState | None = None
        self._id, self._profile, self._namespace, self._origin = robot_id, profile, namespace, origin
        self._newest: Odometry | None = None
        self._late_s = 0.0
        self._least_offset_s = math.inf
        self._passing = ""
        self._lasting = ""
        self.warning = ""
        """What the robot's clock is worth saying of."""

    def take(self, odometry: Odometry) -> None:
        """Take one message in; what cannot be trusted becomes no state."""
        numbers = (odometry.x_m, odometry.y_m, odometry.heading_rad, odometry.forward_m_s)
        more = (odometry.lateral_m_s, odometry.yaw_rad_s, odometry.stamp_s)
        self._passing = "" if all(map(math.isfinite, (*numbers, *more))) else "odometry is not finite"
        if self._passing:
            return
        self._lasting = self._lasting or self._stranger(odometry) or self._jump(odometry)
        self._delay(odometry)
        self._newest = odometry
        self.state = self._located(odometry)

    def fault(self, now_s: float) -> str:
        """Say why nothing may rest on the odometry now; empty if it may."""
        if self._passing or self._lasting:
            return self._passing or self._lasting
        if self._newest is None:
            return "no odometry yet"
        if (age_s := now_s - self._newest.arrival_s) > self._profile.stale_s:
            return f"odometry is {age_s:.2f} s old"
        return f"odometry comes {self._late_s:.2f} s late" if self._late_s > self._profile.stale_s else ""

    def forgive(self) -> None:
        """Begin anew with a clock that was set; what jumped, or is another robot's, stays wrong."""
        self._least_offset_s, self._late_s = math.inf, 0.0

    def robot_time_s(self, now_s: float) -> float:
        """Return the time on the robot's clock as its odometry tells it; 0 where it tells none."""
        newest = self._newest
        if newest is None or newest.stamp_s == 0.0:
            return 0.0
        return newest.stamp_s + (now_s - newest.arrival_s)

    def _stranger(self, odometry: Odometry) -> str:
        """Whether it is another robot's: by its frame's prefix, or because the frame has changed."""
        first = self._newest.frame if self._newest else odometry.frame
        if odometry.frame != first:
            return f"odometry is of {odometry.frame!r} now, and was of {first!r}"
        prefix = odometry.frame.strip("/").rpartition("/")[0]
        if prefix and self._namespace and not self._namespace.endswith(f"/{prefix}"):
            return f"odometry is of {odometry.frame!r}, not of {self._namespace}"
        return ""

    def _jump(self, odometry: Odometry) -> str:
        before = self._newest
        if before is None:
            return ""
        passed_s = self._passed_s(before, odometry)
        gone_m = math.hypot(odometry.x_m - before.x_m, odometry.y_m - before.y_m)
        if gone_m > 2.0 * self._profile.limits.speed_m_s * passed_s + JUMP_M:
            return f"odometry jumped by {gone_m:.2f} m"
        turned_rad = abs(wrap(odometry.heading_rad - before.heading_rad))
        fastest = min(self._profile.base.max_yaw_rad_s, FASTEST_TURN_RAD_S)
        return (
            f"odometry turned by {turned_rad:.2f} rad at once"
            if turned_rad > 2.0 * fastest * passed_s + JUMP_RAD
            else ""
        )

    def _passed_s(self, before: Odometry, odometry: Odometry) -> float:
        """Time between two messages: that of their arrivals, or of their stamps where the first came late.

        Stamps count for no longer than a message may be late: a clock that leaps hides no jump.
        """
        stamped_s = min(odometry.stamp_s - before.stamp_s, self._profile.stale_s)
        return max(odometry.arrival_s - before.arrival_s, stamped_s)

    def _delay(self, odometry: Odometry) -> None:
        """Compare with the fastest message so far: how late this one is, whatever the robot's clock shows."""
        if odometry.stamp_s == 0.0:
            return
        passed_s = odometry.arrival_s - self._newest.arrival_s if self._newest else 0.0
        offset_s = odometry.arrival_s - odometry.stamp_s
        self._least_offset_s = min(self._least_offset_s + DRIFT * passed_s, offset_s)
        self._late_s = offset_s - self._least_offset_s
        apart_s = time.time() - (time.monotonic() - odometry.arrival_s) - odometry.stamp_s
        if abs(apart_s) > APART_S and not self.warning:
            way = "behind" if apart_s > 0.0 else "ahead of"
            self.warning = f"the robot's clock is {abs(apart_s):.0f} s {way} ours: commands carry its time"

    def _located(self, odometry: Odometry) -> RobotState:
        origin, ahead = self._origin, self._profile.base.reference_m
        off_x, off_y = rotate((ahead, 0.0), odometry.heading_rad)
        x, y = rotate((odometry.x_m + off_x, odometry.y_m + off_y), origin.heading_rad)
        heading = wrap(odometry.heading_rad + origin.heading_rad)
        body = (odometry.forward_m_s, odometry.lateral_m_s + ahead * odometry.yaw_rad_s)
        return RobotState(
            self._id,
            odometry.arrival_s,
            (origin.x_m + x, origin.y_m + y),
            rotate(body, heading),
            heading,
            odometry.yaw_rad_s,
        )
