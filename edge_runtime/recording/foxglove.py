"""Records of Foxglove's own schemas, which its panels know."""

import msgspec

from edge_runtime.messages import Integer


class Time(msgspec.Struct, frozen=True):
    """Unix time as all of them write it."""

    sec: Integer
    nsec: Integer


class Vector3(msgspec.Struct, frozen=True):
    """A point as all of them write it."""

    x: float
    y: float
    z: float


class Quaternion(msgspec.Struct, frozen=True):
    """A rotation as all of them write it."""

    x: float
    y: float
    z: float
    w: float


class Pose(msgspec.Struct, frozen=True):
    """``foxglove.Pose``."""

    position: Vector3
    orientation: Quaternion


class PosesInFrame(msgspec.Struct, frozen=True):
    """Channel ``/poses``: ``foxglove.PosesInFrame`` for the 3D panel, own pose first; from ``/state``."""

    timestamp: Time
    frame_id: str
    poses: tuple[Pose, ...]
