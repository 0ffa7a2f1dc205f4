"""What a tick says, as ROS's own messages: fields as dictionaries, definitions as ROS has them."""

import math
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from edge_runtime.messages import RobotState
from edge_runtime.recording.poses import FRAME
from edge_runtime.recording.schema import Tick

Fields = dict[str, Any]

_FIELDS: Final = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/PoseArray": "std_msgs/Header header\ngeometry_msgs/Pose[] poses",
    "nav_msgs/Odometry": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist",
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": "byte level\nstring name\nstring message\nstring hardware_id\n"
    "diagnostic_msgs/KeyValue[] values",
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
}
OK, ERROR = 0, 2
"""Levels of a DiagnosticStatus."""
_UNKNOWN: Final = [0.0] * 36


class Message(NamedTuple):
    """One message, and where it goes."""

    topic: str
    kind: str
    """Such as ``nav_msgs/Odometry``."""
    fields: Fields


def definition(kind: str) -> str:
    """Return the definition of a message with those of all that it contains, as ROS writes them together."""
    found = [kind]
    for name in found:
        for line in _FIELDS[name].splitlines():
            part = line.partition(" ")[0].partition("[")[0]
            if part in _FIELDS and part not in found:
                found.append(part)
    parts = [f"MSG: {name}\n{_FIELDS[name]}" for name in found[1:]]
    return f"\n{'=' * 80}\n".join([_FIELDS[kind], *parts])


def messages_of(tick: Tick, time_ns: int, objectives: tuple[str, ...]) -> Iterator[Message]:
    """Yield what a tick says: own odometry, the teammates' poses, the command, and how the objectives fare.

    Args:
        tick: of one robot.
        time_ns: Unix time.
        objectives: names of the active ones, in the order of the tick's costs.
    """
    own, team = tick.state.own, tick.state
    base = f"/robot_{own.robot_id}"
    header = {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": FRAME}
    yield Message(f"{base}/odom", "nav_msgs/Odometry", _odometry(own, header, base))
    poses = {"header": header, "poses": [_pose(mate.state) for mate in team.teammates]}
    yield Message(f"{base}/teammates", "geometry_msgs/PoseArray", poses)
    command = tick.command
    twist = _twist(command.velocity_m_s, command.yaw_rate_rad_s)
    yield Message(f"{base}/command", "geometry_msgs/TwistStamped", {"header": header, "twist": twist})
    status = _status(tick, base, objectives)
    yield Message("/diagnostics", "diagnostic_msgs/DiagnosticArray", {"header": header, "status": [status]})


def _odometry(own: RobotState, header: Fields, base: str) -> Fields:
    """Velocities stand in the base's frame, as this message has them."""
    c, s = math.cos(own.heading_rad), math.sin(own.heading_rad)
    x, y = own.velocity_m_s[:2]
    body = (c * x + s * y, c * y - s * x, *own.velocity_m_s[2:])
    return {
        "header": header,
        "child_frame_id": f"{base[1:]}/base_link",
        "pose": {"pose": _pose(own), "covariance": _UNKNOWN},
        "twist": {"twist": _twist(body, own.yaw_rate_rad_s), "covariance": _UNKNOWN},
    }


def _status(tick: Tick, base: str, objectives: tuple[str, ...]) -> Fields:
    reason = tick.command.stop_reason
    costs = [
        (f"cost of {name}", f"{cost:g}") for name, cost in zip(objectives, tick.action.costs, strict=False)
    ]
    values = [*costs, ("tick", str(tick.inputs.number)), ("tick time", f"{tick.timing.tick:.0f} us")]
    return {
        "level": ERROR if reason else OK,
        "name": f"{base[1:]}: policy",
        "message": reason or "driving",
        "hardware_id": base[1:],
        "values": [{"key": key, "value": value} for key, value in values],
    }


def _pose(state: RobotState) -> Fields:
    half = 0.5 * state.heading_rad
    orientation = {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}
    return {"position": _vector(state.position_m), "orientation": orientation}


def _twist(velocity: tuple[float, ...], yaw_rad_s: float) -> Fields:
    return {"linear": _vector(velocity), "angular": {"x": 0.0, "y": 0.0, "z": yaw_rad_s}}


def _vector(numbers: tuple[float, ...]) -> Fields:
    x, y, *rest = numbers
    return {"x": x, "y": y, "z": rest[0] if rest else 0.0}
