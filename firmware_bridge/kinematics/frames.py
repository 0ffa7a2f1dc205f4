"""The one place where axes change: ENU and FLU inside this project, NED and FRD on MAVLink's wire.

ENU is x east, y north; headings turn counter-clockwise from east. NED is x north, y east; yaw turns clockwise
from north. FLU is a body's x forward, y left; FRD has y right.
"""

import math

from edge_runtime.messages import Vector, Vector2

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z: rotates FRD body axes into NED."""


def swap_enu_ned(vector: Vector2) -> Vector2:
    """Turn (east, north) into (north, east), or back: the change is its own inverse."""
    return vector[1], vector[0]


def swap_flu_frd(vector: Vector2) -> Vector2:
    """Turn (forward, left) into (forward, right), or back."""
    return vector[0], -vector[1]


def swap_heading_yaw(angle_rad: float) -> float:
    """Turn an ENU heading into a NED yaw, or back, in (-pi, pi]."""
    return wrap(math.pi / 2 - angle_rad)


def wrap(angle_rad: float) -> float:
    """Return the same angle in (-pi, pi]."""
    turned = math.remainder(angle_rad, math.tau)
    return math.pi if turned == -math.pi else turned


def rotate(vector: Vector, angle_rad: float) -> Vector2:
    """Turn a vector counter-clockwise: body FLU to ENU with the heading, ENU to body with its negative."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]


def turned_by(quaternion: Quaternion, vector: Vector3) -> Vector3:
    """Rotate a vector of FRD body axes into NED."""
    w, q, v = quaternion[0], quaternion[1:], vector
    twice = tuple(2.0 * component for component in _cross(q, v))
    further = _cross(q, twice)
    x, y, z = (v[i] + w * twice[i] + further[i] for i in range(3))
    return x, y, z


def _cross(a: Vector, b: Vector) -> Vector3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def yaw_of(quaternion: Quaternion) -> float:
    """Return the yaw in radians of a rotation from FRD to NED (Z-Y-X Euler angles)."""
    w, x, y, z = quaternion
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
