"""Every motion model that a manifest can name, by its ``type``."""

from edge_runtime.motion.point import PointAcceleration, PointForce
from edge_runtime.motion.table import LinearTable
from edge_runtime.motion.unicycle import Unicycle
from edge_runtime.motion.velocity import VelocityLag

MotionModel = PointForce | PointAcceleration | VelocityLag | Unicycle | LinearTable
"""Told apart by the key ``type``: point_force, point_acceleration, velocity, unicycle or table."""

__all__ = ["LinearTable", "MotionModel", "PointAcceleration", "PointForce", "Unicycle", "VelocityLag"]
