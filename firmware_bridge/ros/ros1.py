"""A node of ROS 1 by rospy; messages leave by its own threads."""

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final
from urllib.parse import urlsplit

from edge_runtime.common.printable import first_line
from edge_runtime.errors import BridgeError
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.ros.client import Graph, Item, Pressed, Sight, Taken, Topic, Trouble, fill
from firmware_bridge.ros.installed import load
from firmware_bridge.ros.odometry import odometry_from
from firmware_bridge.ros.profile import RosProfile

MODULES: Final = ("rospy", "rosgraph", "geometry_msgs.msg", "nav_msgs.msg", "std_msgs.msg")
WATCH_S: Final = 0.25
ANSWER_S: Final = 1.0
"""For a node that is asked whether it still lives."""
WAITING: Final = 8
FLUSH_S: Final = 0.05
"""For the last message to leave."""


class Ros1Client:
    """Implements ``Client``; a process has one, as rospy has it."""

    settling_s = 0.0

    def __init__(
        self, profile: RosProfile, robot_id: int, folders: tuple[str, ...], put: Callable[[Item], None]
    ) -> None:
        self.name = f"/cfpg_edge_{robot_id}"
        self.where = f"ROS master {os.environ.get('ROS_MASTER_URI', 'not set: ROS_MASTER_URI')}"
        self._profile, self._folders, self._put = profile, folders, put
        self._closing = threading.Event()
        self._watch = threading.Thread(target=self._look, daemon=True)
        self._rospy: Any = None
        self._commands: Any = None

    def connect(self) -> None:
        """Load rospy, ask the master whether the name is free, and take it.

        Raises:
            BridgeError: if rospy or the master is not there, or another node has this name.
        """
        os.environ["ROS_NAMESPACE"] = "/"  # Names of ours are absolute, whatever a launch file has set.
        rospy, rosgraph, self._geometry, self._nav, self._std = load(MODULES, self._folders)
        with self._told():
            self._master = rosgraph.Master(self.name)
            if self.name in self._nodes() and self._lives(self.name):
                raise BridgeError(f"node {self.name} is there already: another edge-run drives this robot")
            rospy.init_node(self.name[1:], argv=[], disable_signals=True, disable_rosout=True)
        self._rospy, self._kind = rospy, getattr(self._geometry, self._profile.message)

    def graph(self) -> Graph:
        """Ask the master; publishers of commands and odometry that have died do not count."""
        with self._told():
            publishers, subscribers, _ = self._master.getSystemState()
            types = self._master.getTopicTypes()
        topics: dict[str, Topic] = {}
        speaking = {name: self._others(nodes, name) for name, nodes in publishers}
        hearing = {name: self._others(nodes, "") for name, nodes in subscribers}
        for name in speaking.keys() | hearing.keys():
            kinds = tuple(kind for topic, kind in types if topic == name and kind != "*")
            topics[name] = Topic(kinds, speaking.get(name, ()), hearing.get(name, ()))
        return Graph(topics)

    def parameter(self, name: str) -> float | None:
        """Ask the master's parameter server."""
        with self._told():
            value = self._master.getParam(name) if self._master.hasParam(name) else None
        return float(value) if isinstance(value, float | int) and not isinstance(value, bool) else None

    def unheard(self) -> tuple[str, ...]:
        """ROS 1 knows no quality of service."""
        return ()

    def advertise(self) -> None:
        """A few messages may wait for rospy's thread to send them; none makes the guard wait."""
        command = self._profile.command
        with self._told():
            self._commands = self._rospy.Publisher(command, self._kind, queue_size=WAITING, tcp_nodelay=True)

    def listen(self) -> None:
        """Subscribe, and watch."""
        profile = self._profile
        with self._told():
            self._subscribe(profile.odometry, self._nav.Odometry, self._hear_odometry)
            if profile.emergency_stop:
                self._subscribe(profile.emergency_stop, self._std.Bool, self._hear_stop)
            for topic in profile.operators:
                self._subscribe(topic, self._kind, partial(self._hear_operator, topic))
        self._watch.start()

    def compose(self, motion: BaseMotion, stamp_s: float) -> object:
        """Make a Twist or TwistStamped."""
        message = self._kind()
        fill(message, motion)
        if self._profile.message == "TwistStamped":
            message.header.frame_id = "base_link"
            message.header.stamp = self._rospy.Time.from_sec(stamp_s)
        return message

    def publish(self, message: object) -> None:
        """Hand one message to rospy."""
        with self._told():
            self._commands.publish(message)

    def close(self) -> None:
        """Let the last message leave, then take leave of the master."""
        self._closing.set()
        if self._watch.is_alive():
            self._watch.join(ANSWER_S)
            time.sleep(FLUSH_S)
        if self._rospy is not None:
            self._rospy.signal_shutdown("closed")

    def _subscribe(self, topic: str, kind: object, hear: Callable[[Any], None]) -> None:
        self._rospy.Subscriber(topic, kind, hear, queue_size=8, tcp_nodelay=True)

    def _hear_stop(self, message: Any) -> None:  # noqa: ANN401  # std_msgs/Bool
        self._put(Pressed(bool(message.data)))

    def _hear_operator(self, topic: str, _: object) -> None:
        self._put(Taken(topic))

    def _hear_odometry(self, message: Any) -> None:  # noqa: ANN401  # nav_msgs/Odometry
        self._put(odometry_from(message, message.header.stamp.to_sec(), time.monotonic()))

    def _look(self) -> None:
        """Tell several times a second who is there; the first thing that goes wrong is told last."""
        try:
            while not self._closing.wait(WATCH_S):
                graph = self.graph()
                rivals = graph.topic(self._profile.command).publishers
                tellers = graph.topic(self._profile.odometry).publishers
                if self._rospy.is_shutdown():
                    raise BridgeError(f"another node took the name {self.name}")
                with self._told():
                    listeners = self._commands.get_num_connections() if self._commands else 0
                self._put(Sight(listeners, rivals, len(tellers)))
        except BridgeError as error:
            self._put(Trouble(str(error)))

    def _nodes(self) -> set[str]:
        state = self._master.getSystemState()
        return {node for part in state for _, nodes in part for node in nodes}

    def _others(self, nodes: list[str], topic: str) -> tuple[str, ...]:
        """The other nodes, of certain topics only those that live: a master forgets nobody by itself."""
        others = tuple(node for node in nodes if node != self.name)
        judged = topic in (self._profile.command, self._profile.odometry)
        return tuple(filter(self._lives, others)) if judged else others

    def _lives(self, node: str) -> bool:
        """Whether anybody still answers at a node's address."""
        try:
            address = urlsplit(self._master.lookupNode(node))
            with socket.create_connection((address.hostname or "", address.port or 0), ANSWER_S):
                return True
        except Exception:  # noqa: BLE001  # unknown to the master, or whatever its address makes of that
            return False

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what rospy and its XML-RPC raise into one line."""
        try:
            yield
        except BridgeError:
            raise
        except Exception as error:
            raise BridgeError(
                f"no answer from the {self.where} ({first_line(error)}): start roscore, or set ROS_MASTER_URI"
            ) from error


def make_client(
    profile: RosProfile, namespace: str, robot_id: int, folders: tuple[str, ...], put: Callable[[Item], None]
) -> Ros1Client:
    """Make the node, not yet connected; its name tells the robot, and needs no namespace."""
    del namespace
    return Ros1Client(profile, robot_id, folders, put)
