"""A node of ROS 2 by rclpy, of whatever distribution and middleware the robot has."""

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

from edge_runtime.common.printable import first_line
from edge_runtime.errors import BridgeError
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.ros.client import Graph, Item, Pressed, Sight, Taken, Topic, Trouble, fill
from firmware_bridge.ros.installed import load
from firmware_bridge.ros.odometry import odometry_from
from firmware_bridge.ros.profile import RosProfile

MODULES: Final = (
    "rclpy",
    "rclpy.executors",
    "rclpy.qos",
    "rclpy.signals",
    "rcl_interfaces.srv",
    "geometry_msgs.msg",
    "nav_msgs.msg",
    "std_msgs.msg",
)
WATCH_S: Final = 0.25
ANSWER_S: Final = 3.0
"""For the controller to tell its timeout."""
TURN_S: Final = 0.1
"""Longest wait of the executor's thread: an executor that is shut down as it begins to wait never wakes."""
ASK_AGAIN_S: Final = 0.01
NAMING_S: Final = 1.0
UNNAMED: Final = "a node without a name"
_WHOLE, _REAL = 2, 3
"""Of rcl_interfaces/ParameterType."""


class Ros2Client:
    """Implements ``Client``."""

    settling_s = 4.0
    """Fast DDS announces a node to everybody every 3 s (`leaseDuration_announcementperiod`): one whose first
    announcements were lost is known after the next."""

    def __init__(
        self,
        profile: RosProfile,
        namespace: str,
        robot_id: int,
        folders: tuple[str, ...],
        put: Callable[[Item], None],
    ) -> None:
        self.name = f"{namespace}/cfpg_edge_{robot_id}"
        self.where = f"domain {os.environ.get('ROS_DOMAIN_ID', '0')}"
        self._profile, self._folders, self._put = profile, folders, put
        self._node: Any = None
        self._commands: Any = None
        self._last_word: Any = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def connect(self) -> None:
        """Load rclpy and become a node.

        Raises:
            BridgeError: if rclpy is not there, or its middleware does not start.
        """
        self._rclpy, executors, self._qos, signals, *interfaces = load(MODULES, self._folders)
        self._services, self._geometry, self._nav, self._std = interfaces
        self._kind = getattr(self._geometry, self._profile.message)
        with self._told():
            self._context = self._rclpy.Context()
            quiet = signals.SignalHandlerOptions.NO
            self._rclpy.init(args=[], context=self._context, signal_handler_options=quiet)
            self.where += f", {self._rclpy.get_rmw_implementation_identifier()}"
            namespace, _, name = self.name.rpartition("/")
            self._node = self._rclpy.create_node(
                name,
                context=self._context,
                namespace=namespace or "/",
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
            )
            self._executor = executors.SingleThreadedExecutor(context=self._context)
            self._executor.add_node(self._node)
        self._thread.start()

    def graph(self) -> Graph:
        """Return what has been discovered so far; a rival is discovered a little before its name."""
        end_s, command = time.monotonic() + NAMING_S, self._profile.command
        while UNNAMED in (graph := self._discovered()).topic(command).publishers and time.monotonic() < end_s:
            time.sleep(ASK_AGAIN_S)
        return graph

    def _discovered(self) -> Graph:
        with self._told():
            topics = {
                name: Topic(
                    tuple(kind.replace("/msg/", "/") for kind in types),
                    self._others(self._node.get_publishers_info_by_topic(name)),
                    self._others(self._node.get_subscriptions_info_by_topic(name)),
                )
                for name, types in self._node.get_topic_names_and_types()
            }
            nodes = [_full(name, space) for name, space in self._node.get_node_names_and_namespaces()]
        return Graph(topics, self._but_ours(nodes))

    def parameter(self, name: str) -> float | None:
        """Ask the controller's node."""
        node, _, parameter = name.rpartition("/")
        end_s = time.monotonic() + ANSWER_S
        with self._told():
            service = self._services.GetParameters
            asking = self._node.create_client(service, f"{node}/get_parameters")
            while not asking.service_is_ready() and time.monotonic() < end_s:
                time.sleep(ASK_AGAIN_S)
            answer = asking.call_async(service.Request(names=[parameter]))
            while not answer.done() and time.monotonic() < end_s:
                time.sleep(ASK_AGAIN_S)
            values = answer.result().values if answer.done() else []
            self._node.destroy_client(asking)
        known = {_REAL: "double_value", _WHOLE: "integer_value"}
        return next(
            (float(getattr(value, known[value.type])) for value in values if value.type in known), None
        )

    def unheard(self) -> tuple[str, ...]:
        """Compare what the robot's nodes ask and offer with what this one does."""
        profile, node = self._profile, self._node
        stop = [profile.emergency_stop] if profile.emergency_stop else []
        with self._told():
            hearers = node.get_subscriptions_info_by_topic(profile.command)
            pairs = [(profile.command, self._quality(True), self._known(hearer)) for hearer in hearers]
            for topic in (profile.odometry, *profile.operators, *stop):
                speakers = node.get_publishers_info_by_topic(topic)
                pairs += [(topic, self._known(speaker), self._quality(False)) for speaker in speakers]
            judged = [(topic, *self._qos.qos_check_compatible(offer, wish)) for topic, offer, wish in pairs]
        error = self._qos.QoSCompatibility.ERROR
        return tuple(f"{topic}: {why.strip(' ;')}" for topic, fits, why in judged if fits == error)

    def advertise(self) -> None:
        """Reliably, the newest message alone."""
        with self._told():
            self._commands = self._node.create_publisher(
                self._kind, self._profile.command, self._quality(True)
            )

    def listen(self) -> None:
        """Subscribe, and watch."""
        profile = self._profile
        with self._told():
            self._subscribe(self._nav.Odometry, profile.odometry, self._hear_odometry)
            if profile.emergency_stop:
                self._subscribe(self._std.Bool, profile.emergency_stop, self._hear_stop)
            for topic in profile.operators:
                self._subscribe(self._kind, topic, partial(self._hear_operator, topic))
            self._node.create_timer(WATCH_S, self._look)

    def compose(self, motion: BaseMotion, stamp_s: float) -> object:
        """Make a Twist or TwistStamped."""
        message = self._kind()
        fill(message, motion)
        if self._profile.message == "TwistStamped":
            whole_s, rest_s = divmod(stamp_s, 1.0)
            message.header.frame_id = "base_link"
            message.header.stamp.sec, message.header.stamp.nanosec = int(whole_s), int(rest_s * 1e9)
        return message

    def publish(self, message: object) -> None:
        """Hand one message to the middleware."""
        with self._told():
            self._commands.publish(message)

    def close(self) -> None:
        """End the executor's thread before its node: rclpy aborts the process otherwise."""
        self._closing.set()
        if self._node is None:
            return
        with self._told():
            self._thread.join()
            self._executor.shutdown()
            self._node.destroy_node()
            self._rclpy.shutdown(context=self._context)

    def _quality(self, reliable: bool) -> Any:  # noqa: ANN401  # rclpy's QoSProfile
        """Of the newest message alone; best effort matches any publisher."""
        policy = self._qos.ReliabilityPolicy
        return self._qos.QoSProfile(depth=1, reliability=policy.RELIABLE if reliable else policy.BEST_EFFORT)

    def _known(self, endpoint: Any) -> Any:  # noqa: ANN401  # rclpy's TopicEndpointInfo and QoSProfile
        """Of another's quality of service, what discovery tells truly: durations it does not."""
        told = endpoint.qos_profile
        return self._qos.QoSProfile(depth=1, reliability=told.reliability, durability=told.durability)

    def _subscribe(self, kind: object, topic: str, hear: Callable[[Any], None]) -> None:
        self._node.create_subscription(kind, topic, hear, self._quality(False))

    def _spin(self) -> None:
        try:
            with self._told():
                while not self._closing.is_set():
                    self._executor.spin_once(timeout_sec=TURN_S)
        except BridgeError as error:
            self._put(Trouble(str(error)))

    def _hear_stop(self, message: Any) -> None:  # noqa: ANN401  # std_msgs/Bool
        self._put(Pressed(bool(message.data)))

    def _hear_operator(self, topic: str, _: object) -> None:
        self._put(Taken(topic))

    def _hear_odometry(self, message: Any) -> None:  # noqa: ANN401  # nav_msgs/Odometry
        stamp = message.header.stamp
        self._put(odometry_from(message, stamp.sec + 1e-9 * stamp.nanosec, time.monotonic()))

    def _look(self) -> None:
        """Tell who is there."""
        command, odometry = self._profile.command, self._profile.odometry
        rivals = self._others(self._node.get_publishers_info_by_topic(command))
        tellers = self._others(self._node.get_publishers_info_by_topic(odometry))
        listeners = self._commands.get_subscription_count() if self._commands else 0
        self._put(Sight(listeners, rivals, len(tellers)))
        self._ask_last_word()

    def _ask_last_word(self) -> None:
        """Subscribe once more where an emergency stop is told when it changes, and its last word kept.

        That word is for those alone who ask for it, and whoever asks hears nobody else.
        """
        topic, kept = self._profile.emergency_stop, self._qos.DurabilityPolicy.TRANSIENT_LOCAL
        if topic is None or self._last_word is not None:
            return
        tellers = self._node.get_publishers_info_by_topic(topic)
        if any(teller.qos_profile.durability == kept for teller in tellers):
            quality = self._quality(True)
            quality.durability = kept
            self._last_word = self._node.create_subscription(self._std.Bool, topic, self._hear_stop, quality)

    def _others(self, endpoints: list[Any]) -> tuple[str, ...]:
        """Whose endpoints these are, ours left out."""
        return self._but_ours([_full(one.node_name, one.node_namespace) for one in endpoints])

    def _but_ours(self, names: list[str]) -> tuple[str, ...]:
        if self.name in names:
            names.remove(self.name)
        return tuple(names)

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what rclpy and its middleware raise into one line."""
        try:
            yield
        except Exception as error:
            raise BridgeError(f"ROS 2 failed ({self.where}): {first_line(error)}") from error


def _full(name: str, namespace: str) -> str:
    return UNNAMED if name == "_NODE_NAME_UNKNOWN_" else f"{namespace.rstrip('/')}/{name}"


def make_client(
    profile: RosProfile, namespace: str, robot_id: int, folders: tuple[str, ...], put: Callable[[Item], None]
) -> Ros2Client:
    """Make the node, not yet connected."""
    return Ros2Client(profile, namespace, robot_id, folders, put)
