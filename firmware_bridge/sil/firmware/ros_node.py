"""``python -m firmware_bridge.sil.firmware.ros_node FD TASK``: a robot's node in genuine ROS.

Its base is elsewhere: commands that arrive leave on the socket with their time, as JSON; poses that come in
there are published as odometry. It ends when the socket closes.
"""

import contextlib
import math
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, Protocol

import msgspec

from firmware_bridge.ros.installed import load
from firmware_bridge.ros.profile import RosProfile, load_profile
from firmware_bridge.sil.firmware.world import BaseState

PACKET_BYTES = 1024
TURN_S = 0.1
"""Longest wait of an executor's thread."""


class NodeTask(msgspec.Struct, frozen=True):
    """Whose node it is."""

    ros: Literal[1, 2]
    profile: str
    """Path of the profile's TOML file."""
    namespace: str
    python_path: tuple[str, ...]
    timeout_s: float
    """What its parameter says of the controller's own timeout."""


class Twisted(msgspec.Struct, frozen=True, array_like=True):
    """One command that arrived."""

    forward_m_s: float
    yaw_rad_s: float
    arrival_s: float
    """Monotonic."""


class Node(Protocol):
    """One node of either ROS."""

    def publish(self, state: BaseState) -> None:
        """Tell where the base is."""
        ...

    def close(self) -> None:
        """Leave ROS."""
        ...


def fill_odometry(message: Any, state: BaseState) -> Any:  # noqa: ANN401  # of either ROS
    """Put a base's state into a ``nav_msgs/Odometry`` and return it."""
    half = 0.5 * state.heading_rad
    message.header.frame_id, message.child_frame_id = "odom", "base_link"
    message.pose.pose.position.x, message.pose.pose.position.y = map(float, state.position_m)
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(half), math.cos(half)
    message.twist.twist.linear.x = float(state.forward_m_s)
    message.twist.twist.angular.z = float(state.yaw_rad_s)
    return message


class Ros1Node:
    """By rospy."""

    def __init__(self, profile: RosProfile, task: NodeTask, hear: Callable[[Any], None]) -> None:
        rospy, geometry, nav = load(("rospy", "geometry_msgs.msg", "nav_msgs.msg"), task.python_path)
        self._rospy, self._odometry = rospy, nav.Odometry
        rospy.init_node("robot", argv=[], disable_signals=True, disable_rosout=True)
        if profile.timeout_parameter:
            rospy.set_param(profile.timeout_parameter, task.timeout_s)
        kind = getattr(geometry, profile.message)
        rospy.Subscriber(profile.command, kind, hear, tcp_nodelay=True)
        self._speaker = rospy.Publisher(profile.odometry, nav.Odometry, queue_size=1, tcp_nodelay=True)

    def publish(self, state: BaseState) -> None:
        """Tell where the base is."""
        message = fill_odometry(self._odometry(), state)
        message.header.stamp = self._rospy.Time.from_sec(time.time())
        self._speaker.publish(message)

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("closed")


class Ros2Node:
    """By rclpy."""

    def __init__(self, profile: RosProfile, task: NodeTask, hear: Callable[[Any], None]) -> None:
        names = ("rclpy", "rclpy.executors", "geometry_msgs.msg", "nav_msgs.msg")
        self._rclpy, executors, geometry, nav = load(names, task.python_path)
        self._odometry = nav.Odometry
        self._rclpy.init(args=[])
        name, _, parameter = (profile.timeout_parameter or "/robot/none").rpartition("/")
        namespace, _, own = name.rpartition("/")
        self._node = self._rclpy.create_node(own, namespace=namespace or "/")
        self._node.declare_parameter(parameter, task.timeout_s)
        self._node.create_subscription(getattr(geometry, profile.message), profile.command, hear, 100)
        self._speaker = self._node.create_publisher(nav.Odometry, profile.odometry, 10)
        self._executor = executors.SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def publish(self, state: BaseState) -> None:
        """Tell where the base is."""
        message = fill_odometry(self._odometry(), state)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._speaker.publish(message)

    def close(self) -> None:
        """Leave ROS; the thread ends first."""
        self._closing.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._rclpy.try_shutdown()

    def _spin(self) -> None:
        while not self._closing.is_set():
            self._executor.spin_once(timeout_sec=TURN_S)


def serve(task: NodeTask, link: socket.socket) -> None:
    """Carry both ways until the socket closes."""
    profile = load_profile(Path(task.profile)).under(task.namespace)

    def hear(message: Any) -> None:  # noqa: ANN401  # of either ROS
        now_s, twist = time.monotonic(), getattr(message, "twist", message)
        heard = Twisted(twist.linear.x, twist.angular.z, now_s)
        with contextlib.suppress(OSError):
            link.send(msgspec.json.encode(heard))

    node: Node = (Ros1Node if task.ros == 1 else Ros2Node)(profile, task, hear)
    try:
        while packet := link.recv(PACKET_BYTES):
            node.publish(msgspec.json.decode(packet, type=BaseState))
    finally:
        node.close()


if __name__ == "__main__":
    serve(msgspec.json.decode(sys.argv[2], type=NodeTask), socket.socket(fileno=int(sys.argv[1])))
