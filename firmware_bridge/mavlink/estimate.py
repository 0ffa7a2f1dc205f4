"""From the autopilot's messages to the robot's state in the team's frame."""

import math

from edge_runtime.messages import RobotState, Vector2
from firmware_bridge.kinematics.frames import (
    Vector3,
    rotate,
    swap_enu_ned,
    swap_flu_frd,
    swap_heading_yaw,
    turned_by,
    yaw_of,
)
from firmware_bridge.mavlink.clock import Clock
from firmware_bridge.mavlink.messages import Attitude, LocalPosition, Odometry

LONGEST_ATTITUDE_AGE_S = 0.5
"""A position is only believed together with an attitude that is not older."""


class Estimate:
    """Keeps the newest state. With a point ahead of the axle, that point is the robot."""

    def __init__(
        self, robot_id: int, clock: Clock, origin_m: Vector2, point_ahead_m: float, dims: int = 2
    ) -> None:
        self.state: RobotState | None = None
        self._robot_id = robot_id
        self._clock = clock
        self._origin_m = origin_m
        self._point_ahead_m, self._dims = point_ahead_m, dims
        self._attitude: Attitude | None = None

    def on_attitude(self, attitude: Attitude) -> None:
        """Take in a heading for the positions that follow."""
        self._attitude = attitude

    def on_local_position(self, position: LocalPosition, now_s: float) -> None:
        """Take in position and velocity, if the heading is known."""
        attitude = self._attitude
        if attitude is None or abs(position.boot_s - attitude.boot_s) > LONGEST_ATTITUDE_AGE_S:
            return
        heading = swap_heading_yaw(attitude.yaw_rad)
        place = (*swap_enu_ned(position.position_m), -position.down_m)
        velocity = (*swap_enu_ned(position.velocity_m_s), -position.down_m_s)
        self._update(position.boot_s, now_s, place, velocity, heading, -attitude.yaw_rate_rad_s)

    def on_odometry(self, odometry: Odometry, now_s: float) -> None:
        """Take in a complete state."""
        heading = swap_heading_yaw(yaw_of(odometry.attitude))
        velocity: Vector3 = (*rotate(swap_flu_frd(odometry.body_velocity_m_s), heading), 0.0)
        if self._dims == 3:
            body = (*odometry.body_velocity_m_s, odometry.body_down_m_s)
            north, east, down = turned_by(odometry.attitude, body)
            velocity = (*swap_enu_ned((north, east)), -down)
        place = (*swap_enu_ned(odometry.position_m), -odometry.down_m)
        self._update(odometry.boot_s, now_s, place, velocity, heading, -odometry.yaw_rate_rad_s)

    def _update(
        self, boot_s: float, now_s: float, position: Vector3, velocity: Vector3, heading: float, turn: float
    ) -> None:
        """Take a state in, (east, north, up); heights that are not finite are none."""
        (x, y, z), (v_x, v_y, v_z), dims = position, velocity, self._dims
        if dims == 3 and not math.isfinite(z + v_z):
            return
        stamp_s = self._clock.local_s(boot_s)
        if stamp_s is None or (self.state is not None and stamp_s < self.state.stamp_s):
            return
        c, s = math.cos(heading), math.sin(heading)
        ahead = self._point_ahead_m
        self.state = RobotState(
            self._robot_id,
            min(stamp_s, now_s),
            (self._origin_m[0] + x + ahead * c, self._origin_m[1] + y + ahead * s, z)[:dims],
            (v_x - ahead * turn * s, v_y + ahead * turn * c, v_z)[:dims],
            heading,
            turn,
        )
