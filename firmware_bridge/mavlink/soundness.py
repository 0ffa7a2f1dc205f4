"""Whether the position that an autopilot reports may be driven by: its estimator, its GPS, jumps, its clock.

Sources: MAVLink's ``common`` and ``ardupilotmega`` message sets (ESTIMATOR_STATUS_FLAGS, EKF_STATUS_FLAGS:
the lowest ten bits are the same; GPS_FIX_TYPE); ArduPilot 4.7's AP_NavEKF3_Control.cpp, updateFilterStatus,
and AP_GPS.cpp: the time stamp of GPS_RAW_INT is that of the last fix.
"""

import math
from typing import Final

from edge_runtime.messages import Vector
from firmware_bridge.mavlink.messages import EstimatorStatus, GpsFix, LocalPosition, Odometry

LONGEST_STATUS_S: Final = 2.0
"""An estimator that has told its status and no longer does is not trusted."""
LONGEST_FIX_S: Final = 1.5
"""A GPS that had a fix has lost it after so long without another."""
LONGEST_REJECTION_S: Final = 1.0
"""For a while an estimator may reject measurements."""
NOTICED_S: Final = 1.0
"""How long a jump counts: longer than a guard needs to see it."""
LARGEST_JUMP_M: Final = 0.5
LARGEST_CLOCK_JUMP_S: Final = 1.0

_ATTITUDE, _VELOCITY, _POSITION = 0x001, 0x002, 0x018
_CONSTANT_POSITION, _GLITCH = 0x080, 0x8400
"""Bit 10 is a GPS glitch to PX4 and an estimator not yet started to ArduPilot, bit 15 ArduPilot's glitch."""
_FIX_3D = 3


class Soundness:
    """Follows what an autopilot says of its own estimate; silent about what it never told.

    Args:
        dims: components of a position that count: 2 in the plane, 3 in space.
    """

    def __init__(self, dims: int = 2) -> None:
        self._dims = dims
        self._status: EstimatorStatus | None = None
        self._status_s = self._accepted_s = 0.0
        self._fix: GpsFix | None = None
        self._fix_s = 0.0
        self._had_fix = False
        self._pose: LocalPosition | Odometry | None = None
        self._pose_s = 0.0
        self._jump, self._jump_s = "", -math.inf

    @property
    def told(self) -> bool:
        """Whether the estimator has told its status."""
        return self._status is not None

    def on_status(self, status: EstimatorStatus, now_s: float) -> None:
        """Take in the estimator's own judgement."""
        if self._status is None or status.ratio <= 1.0:
            self._accepted_s = now_s
        self._status, self._status_s = status, now_s

    def on_fix(self, fix: GpsFix, now_s: float) -> None:
        """Take in what the GPS has."""
        if fix.kind >= _FIX_3D and (self._fix is None or fix.stamp_us != self._fix.stamp_us):
            self._had_fix, self._fix_s = True, now_s
        self._fix = fix

    def on_pose(self, pose: LocalPosition | Odometry, now_s: float) -> None:
        """Take in a pose: notice what did not come about by driving."""
        if self._pose is not None:
            self._compare(self._pose, pose, now_s - self._pose_s, now_s)
        self._pose, self._pose_s = pose, now_s

    def fault(self, now_s: float) -> str:
        """Say why the position is not to be trusted; empty where nothing speaks against it."""
        if now_s - self._jump_s <= NOTICED_S:
            return self._jump
        if self._had_fix and now_s - self._fix_s > LONGEST_FIX_S:
            return f"the GPS has lost its fix for {LONGEST_FIX_S:g} s"
        return self._estimator_fault(now_s)

    def _estimator_fault(self, now_s: float) -> str:
        if self._status is None:
            return ""
        flags = self._status.flags
        if now_s - self._status_s > LONGEST_STATUS_S:
            return f"the estimator has not told its status for {LONGEST_STATUS_S:g} s"
        if flags & (_CONSTANT_POSITION | _GLITCH) or not all(
            flags & needed for needed in (_ATTITUDE, _VELOCITY, _POSITION)
        ):
            return f"the estimator does not vouch for its position (flags {flags:#06x})"
        if self._status_s - self._accepted_s > LONGEST_REJECTION_S:
            return f"the estimator rejects its measurements (test ratio {self._status.ratio:.1f})"
        return ""

    def _compare(
        self, before: LocalPosition | Odometry, now: LocalPosition | Odometry, arrived_s: float, now_s: float
    ) -> None:
        apart_m = math.dist(self._place(before), self._place(now))
        clock_s = now.boot_s - before.boot_s
        if abs(clock_s - arrived_s) > LARGEST_CLOCK_JUMP_S:
            self._notice(
                f"the autopilot's clock jumped by {clock_s - arrived_s:.1f} s: it started again, or two "
                "vehicles share this link",
                now_s,
            )
        elif isinstance(before, Odometry) and isinstance(now, Odometry) and before.resets != now.resets:
            self._notice("the estimator set its position anew", now_s)
        elif apart_m > LARGEST_JUMP_M + self._speed(now) * max(clock_s, 0.0):
            self._notice(f"the position jumped by {apart_m:.1f} m", now_s)

    def _notice(self, jump: str, now_s: float) -> None:
        self._jump, self._jump_s = jump, now_s

    def _place(self, pose: LocalPosition | Odometry) -> Vector:
        return (*pose.position_m, pose.down_m)[: self._dims]

    def _speed(self, pose: LocalPosition | Odometry) -> float:
        if isinstance(pose, LocalPosition):
            return math.hypot(*(*pose.velocity_m_s, pose.down_m_s)[: self._dims])
        return math.hypot(*(*pose.body_velocity_m_s, pose.body_down_m_s)[: self._dims])
