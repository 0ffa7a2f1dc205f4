"""``python -m firmware_bridge.sil.firmware.ros_node FDS TASK``: the robots' nodes in genuine ROS.

Their bases are elsewhere, each behind a socket of FDS: commands that arrive leave there with their time,
poses that come in are published as odometry, what the emergency stop says on its topic. One process has
all of them, as one has all firmware. It ends when a socket closes.
"""

import contextlib
import math
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import msgspec

from edge_runtime.common.realtime import enter_realtime, switch_threads_often
from firmware_bridge.ros.installed import load
from firmware_bridge.ros.profile import RosProfile, load_profile
from firmware_bridge.sil.firmware.world import BaseState

PACKET_BYTES = 1024
TURN_S = 0.1
"""Longest wait of an executor's thread."""
MODULES = ("geometry_msgs.msg", "nav_msgs.msg", "std_msgs.msg")


class NodesTask(msgspec.Struct, frozen=True):
    """Whose nodes they are."""

    ros: Literal[1, 2]
    profile: str
    """Path of the profile's TOML file."""
    namespaces: tuple[str, ...]
    """Of each robot."""
    python_path: tuple[str, ...]
    timeout_s: float
    """What their parameters say of their controllers' own timeouts."""
    realtime: bool = False


class Twisted(msgspec.Struct, frozen=True, array_like=True):
    """One command that arrived."""

    forward_m_s: float
    lateral_m_s: float
    yaw_rad_s: float
    arrival_s: float
    """Monotonic."""


class Told(NamedTuple):
    """Where a base is, and when that was measured, by the wall clock."""

    state: BaseState
    stamp_s: float


class Stop(msgspec.Struct, frozen=True):
    """What a robot's emergency stop says."""

    pressed: bool


class Nodes(Protocol):
    """The robots' nodes, of either ROS."""

    def add(self, profile: RosProfile, hear: Callable[[Any], None]) -> "Speaker":
        """Make a robot's, whose names are absolute."""
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
    message.twist.twist.linear.y = float(state.lateral_m_s)
    message.twist.twist.angular.z = float(state.yaw_rad_s)
    return message


class Speaker:
    """A robot's publishers, of either ROS.

    Args:
        kinds: the messages Odometry and Bool.
        odometry: publishes the one.
        stop: publishes the other, where the robot has an emergency stop.
        stamp: a wall clock's time in s as that ROS writes it into headers.
    """

    def __init__(
        self,
        kinds: tuple[Any, Any],
        odometry: Callable[[object], object],
        stop: Callable[[object], object] | None,
        stamp: Callable[[float], object],
    ) -> None:
        self._kinds, self._odometry, self._stop, self._stamp = kinds, odometry, stop, stamp

    def publish(self, told: Told) -> None:
        """Tell where the base is, and when it was there, however late this is."""
        message = fill_odometry(self._kinds[0](), told.state)
        message.header.stamp = self._stamp(told.stamp_s)
        self._odometry(message)

    def tell_stop(self, pressed: bool) -> None:
        """Tell whether the emergency stop is pressed."""
        if self._stop is not None:
            self._stop(self._kinds[1](data=pressed))


class Ros1Nodes:
    """By rospy, which has one node a process: it speaks for all robots."""

    def __init__(self, task: NodesTask) -> None:
        os.environ["ROS_NAMESPACE"] = "/"
        self._rospy, self._geometry, self._nav, self._std = load(("rospy", *MODULES), task.python_path)
        self._rospy.init_node("robots", argv=[], disable_signals=True, disable_rosout=True)
        self._timeout_s = task.timeout_s

    def add(self, profile: RosProfile, hear: Callable[[Any], None]) -> Speaker:
        """Make a robot's."""
        if profile.timeout_parameter:
            self._rospy.set_param(profile.timeout_parameter, self._timeout_s)
        self._rospy.Subscriber(
            profile.command, getattr(self._geometry, profile.message), hear, tcp_nodelay=True
        )
        kinds = self._nav.Odometry, self._std.Bool
        speak = partial(self._rospy.Publisher, queue_size=1, tcp_nodelay=True)
        stop = speak(profile.emergency_stop, kinds[1]).publish if profile.emergency_stop else None
        odometry = speak(profile.odometry, kinds[0]).publish
        return Speaker(kinds, odometry, stop, self._rospy.Time.from_sec)

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("closed")


class Ros2Nodes:
    """By rclpy: a node each, named by its controller's parameter."""

    def __init__(self, task: NodesTask) -> None:
        names = ("rclpy", "rclpy.executors", "rclpy.qos", "builtin_interfaces.msg", *MODULES)
        self._rclpy, executors, self._qos, self._time, *messages = load(names, task.python_path)
        self._geometry, self._nav, self._std = messages
        self._rclpy.init(args=[])
        self._timeout_s = task.timeout_s
        self._nodes: list[Any] = []
        self._executor = executors.SingleThreadedExecutor()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def add(self, profile: RosProfile, hear: Callable[[Any], None]) -> Speaker:
        """Make a robot's."""
        unnamed = profile.command.rpartition("/")[0] + "/base/timeout"
        name, _, parameter = (profile.timeout_parameter or unnamed).rpartition("/")
        namespace, _, own = name.rpartition("/")
        node = self._rclpy.create_node(own, namespace=namespace or "/")
        self._nodes.append(node)
        node.declare_parameter(parameter, self._timeout_s)
        node.create_subscription(getattr(self._geometry, profile.message), profile.command, hear, 100)
        kinds, quality = (self._nav.Odometry, self._std.Bool), self._qos.qos_profile_sensor_data
        topic = profile.emergency_stop
        stop = node.create_publisher(kinds[1], topic, quality).publish if topic else None
        odometry = node.create_publisher(kinds[0], profile.odometry, 10).publish
        self._executor.add_node(node)

        def stamp(stamp_s: float) -> object:
            whole_s, rest_s = divmod(stamp_s, 1.0)
            return self._time.Time(sec=int(whole_s), nanosec=int(1e9 * rest_s))

        return Speaker(kinds, odometry, stop, stamp)

    def close(self) -> None:
        """Leave ROS; the thread ends first."""
        self._closing.set()
        self._thread.join()
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        self._rclpy.try_shutdown()

    def _spin(self) -> None:
        while not self._closing.is_set():
            self._executor.spin_once(timeout_sec=TURN_S)


def serve(task: NodesTask, links: list[socket.socket]) -> None:
    """Carry both ways until a socket closes."""
    if task.realtime:
        enter_realtime()  # first: threads inherit it
    switch_threads_often()
    nodes: Nodes = (Ros1Nodes if task.ros == 1 else Ros2Nodes)(task)
    profile = load_profile(Path(task.profile))
    poll = select.poll()
    try:
        served = {}
        for link, namespace in zip(links, task.namespaces, strict=True):
            served[link.fileno()] = link, nodes.add(profile.under(namespace), partial(_hear, link))
            poll.register(link, select.POLLIN)
        while all(_pass_on(*served[descriptor]) for descriptor, _ in poll.poll()):
            pass
    finally:
        nodes.close()


def _hear(link: socket.socket, message: Any) -> None:  # noqa: ANN401  # of either ROS
    now_s, twist = time.monotonic(), getattr(message, "twist", message)
    heard = Twisted(twist.linear.x, twist.linear.y, twist.angular.z, now_s)
    with contextlib.suppress(OSError):
        link.send(msgspec.msgpack.encode(heard))


def _pass_on(link: socket.socket, speaker: Speaker) -> bool:
    """Publish one packet; returns whether there was any."""
    packet = link.recv(PACKET_BYTES)
    if packet:
        told = msgspec.msgpack.decode(packet, type=Told | Stop)
        speaker.tell_stop(told.pressed) if isinstance(told, Stop) else speaker.publish(told)
    return bool(packet)


if __name__ == "__main__":
    serve(
        msgspec.json.decode(sys.argv[2], type=NodesTask),
        [socket.socket(fileno=int(descriptor)) for descriptor in sys.argv[1].split(",")],
    )
