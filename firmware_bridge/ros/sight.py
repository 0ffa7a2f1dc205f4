"""``python -m firmware_bridge.ros.sight``: the team as ROS shows it, from what robots tell edge-watch.

A process of its own beside the robots' loops, which never read an answer. Topics: ``/diagnostics``
(diagnostic_msgs/DiagnosticArray), ``/cfpg/robot_K/path`` (nav_msgs/Path), ``/cfpg/robots``
(visualization_msgs/MarkerArray). It commands nothing.
"""

import sys
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from edge_runtime.common.command_line import CommandParser, command
from edge_runtime.common.signals import StopSignals
from edge_runtime.config.fleet import load_fleet
from edge_runtime.recording.poses import FRAME
from edge_runtime.telemetry.status import Status
from edge_runtime.tools.watch.edge_watch import open_watch
from edge_runtime.tools.watch.team import WatchedTeam
from firmware_bridge.ros.installed import load

DESCRIPTION: Final = """\
Show a team to ROS: how each robot and its objectives fare on /diagnostics, its way on /cfpg/robot_K/path,
all of them as markers on /cfpg/robots. It hears what robots tell [watch] of the fleet file, beside any
edge-watch, and publishes nothing else."""
EPILOG: Final = """\
exit codes:
  0  ended by Ctrl-C or SIGTERM
  2  a flag or file does not hold together, or ROS is not there; one line says what

examples:
  python -m firmware_bridge.ros.sight --fleet team.toml --key-file team.key --ros 2
  python -m firmware_bridge.ros.sight --fleet team.toml --ros 1 \\
      --ros-path /usr/lib/python3/dist-packages"""
PERIOD_S: Final = 0.2
"""As often as robots talk."""
LONGEST_WAY: Final = 600
"""Positions of a path: two minutes."""
MODULES: Final = ("diagnostic_msgs.msg", "nav_msgs.msg", "geometry_msgs.msg", "visualization_msgs.msg")
OK, ERROR, STALE = 0, 2, 3
"""Levels of a DiagnosticStatus."""
CYLINDER: Final = 3
RADIUS_M: Final = 0.1
COLOURS: Final = {OK: (0.2, 0.7, 0.3), ERROR: (0.9, 0.2, 0.1), STALE: (0.5, 0.5, 0.5)}


class Fare(NamedTuple):
    """What one robot's DiagnosticStatus says."""

    level: int
    message: str
    values: tuple[tuple[str, str], ...] = ()


def fare(status: Status | None, silent: bool) -> Fare:
    """Say how a robot fares by its newest status."""
    if status is None:
        return Fare(STALE, "never heard")
    values = (
        *((f"cost of {one.name}", f"{one.cost:g}") for one in status.objectives),
        *((f"limit of {one.name}", one.limit) for one in status.objectives if one.limit),
        ("rate", f"{status.rate_hz:.1f} of {status.nominal_rate_hz:g} Hz"),
        ("missed deadlines", str(status.missed)),
    )
    if silent:
        return Fare(STALE, status.ended or "silent", values)
    return Fare(ERROR if status.stop_reason else OK, status.stop_reason or "driving", values)


class Shower:
    """Turns what was heard into messages of either ROS.

    Args:
        team: what robots told.
        modules: those of `MODULES`, as loaded.
        plain: whether levels are numbers (ROS 1) and not bytes (ROS 2).
    """

    def __init__(self, team: WatchedTeam, modules: Sequence[Any], plain: bool) -> None:
        self._team, self._plain = team, plain
        self._diagnostic, self._nav, self._geometry, self._visualization = modules
        self._ways: dict[int, deque[Any]] = {robot: deque(maxlen=LONGEST_WAY) for robot in team.heard}

    def diagnostics(self, stamp: object) -> object:
        """Make the DiagnosticArray: one status a robot."""
        array = self._diagnostic.DiagnosticArray()
        array.header.stamp, array.header.frame_id = stamp, FRAME
        for robot, heard in self._team.heard.items():
            said = fare(heard.status if heard else None, self._team.silent(robot))
            one = self._diagnostic.DiagnosticStatus()
            one.level = said.level if self._plain else bytes([said.level])
            one.name, one.hardware_id, one.message = f"robot_{robot}: policy", f"robot_{robot}", said.message
            one.values = [self._diagnostic.KeyValue(key=key, value=value) for key, value in said.values]
            array.status.append(one)
        return array

    def path(self, robot: int, stamp: object) -> object:
        """Make a robot's Path, its newest position the last."""
        heard, way = self._team.heard[robot], self._ways[robot]
        if heard and heard.status.position_m and not self._team.silent(robot):
            pose = self._geometry.PoseStamped()
            pose.header.stamp, pose.header.frame_id = stamp, FRAME
            _place(pose.pose, heard.status.position_m)
            way.append(pose)
        path = self._nav.Path()
        path.header.stamp, path.header.frame_id, path.poses = stamp, FRAME, list(way)
        return path

    def markers(self, stamp: object) -> object:
        """Make the MarkerArray: a disc a robot, its colour how it fares."""
        array = self._visualization.MarkerArray()
        for robot, heard in self._team.heard.items():
            if not (heard and heard.status.position_m):
                continue
            marker = self._visualization.Marker()
            marker.header.stamp, marker.header.frame_id = stamp, FRAME
            marker.ns, marker.id, marker.type = "cfpg", robot, CYLINDER
            _place(marker.pose, heard.status.position_m)
            marker.scale.x, marker.scale.y, marker.scale.z = 2.0 * RADIUS_M, 2.0 * RADIUS_M, RADIUS_M
            red, green, blue = COLOURS[fare(heard.status, self._team.silent(robot)).level]
            marker.color.r, marker.color.g, marker.color.b, marker.color.a = red, green, blue, 1.0
            array.markers.append(marker)
        return array


class Ros1:
    """A node of ROS 1 that only publishes."""

    plain = True

    def __init__(self, folders: Sequence[str]) -> None:
        self._rospy, *self.modules = load(("rospy", *MODULES), folders)
        self._rospy.init_node("cfpg_sight", argv=[], disable_signals=True, disable_rosout=True)

    def publisher(self, topic: str, kind: object) -> Any:  # noqa: ANN401  # of rospy
        """Return what publishes on a topic."""
        return self._rospy.Publisher(topic, kind, queue_size=1)

    def now(self) -> object:
        """Return ROS's time."""
        return self._rospy.Time.from_sec(time.time())


class Ros2:
    """A node of ROS 2 that only publishes."""

    plain = False

    def __init__(self, folders: Sequence[str]) -> None:
        rclpy, signals, *self.modules = load(("rclpy", "rclpy.signals", *MODULES), folders)
        rclpy.init(args=[], signal_handler_options=signals.SignalHandlerOptions.NO)
        self._node = rclpy.create_node("cfpg_sight", enable_rosout=False, start_parameter_services=False)

    def publisher(self, topic: str, kind: object) -> Any:  # noqa: ANN401  # of rclpy
        """Return what publishes on a topic."""
        return self._node.create_publisher(kind, topic, 1)

    def now(self) -> object:
        """Return ROS's time."""
        return self._node.get_clock().now().to_msg()


@command("cfpg sight")
def main(arguments: Sequence[str] | None = None) -> int:
    """Show the team until a signal comes; returns the exit code."""
    parser = CommandParser("python -m firmware_bridge.ros.sight", DESCRIPTION, EPILOG)
    add = parser.add_argument
    add("--fleet", type=Path, required=True, metavar="FILE", help="TOML: the team, with [watch] address")
    add("--key-file", type=Path, metavar="FILE", help="the team's key; default: the one the fleet file names")
    add("--ros", type=int, choices=(1, 2), required=True, help="which ROS")
    add(
        "--ros-path", action="append", default=[], metavar="DIR", help="where rospy or rclpy lies; repeatable"
    )
    flags = parser.parse_args(arguments)
    team, feed = open_watch(load_fleet(flags.fleet), flags.key_file)
    with feed, StopSignals() as signals:
        node = (Ros1 if flags.ros == 1 else Ros2)(flags.ros_path)
        shower = Shower(team, node.modules, node.plain)
        diagnostic, nav, _, visualization = node.modules
        diagnostics = node.publisher("/diagnostics", diagnostic.DiagnosticArray)
        markers = node.publisher("/cfpg/robots", visualization.MarkerArray)
        ways = {robot: node.publisher(f"/cfpg/robot_{robot}/path", nav.Path) for robot in team.heard}
        due_s = time.monotonic()
        while not signals.reason:
            feed.wait(max(due_s - time.monotonic(), 0.0))
            team.receive(feed)
            if time.monotonic() < due_s:
                continue
            due_s, stamp = max(due_s + PERIOD_S, time.monotonic()), node.now()
            diagnostics.publish(shower.diagnostics(stamp))
            markers.publish(shower.markers(stamp))
            for robot, way in ways.items():
                way.publish(shower.path(robot, stamp))
    return 0


def _place(pose: Any, position_m: tuple[float, ...]) -> None:  # noqa: ANN401  # of either ROS
    x, y, *z = position_m
    pose.position.x, pose.position.y, pose.position.z = x, y, z[0] if z else 0.0
    pose.orientation.w = 1.0


if __name__ == "__main__":
    sys.exit(main())
