"""What the link asks of a client library, ROS 1's or ROS 2's, and the records that its threads hand over."""

from typing import Any, Protocol

import msgspec

from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.ros.odometry import Odometry


class Topic(msgspec.Struct, frozen=True):
    """One topic as ROS's graph shows it."""

    types: tuple[str, ...] = ()
    """Such as ``geometry_msgs/Twist``; more than one where nodes disagree."""
    publishers: tuple[str, ...] = ()
    """Full names of the nodes."""
    subscribers: tuple[str, ...] = ()


class Graph(msgspec.Struct, frozen=True):
    """Who is there, without this node's own endpoints."""

    topics: dict[str, Topic] = {}
    nodes: tuple[str, ...] = ()
    """Full names, this node's left out once; a name that stands here twice belongs to two nodes."""

    def topic(self, name: str) -> Topic:
        """Return what is known of a topic."""
        return self.topics.get(name, Topic())


class Sight(msgspec.Struct, frozen=True):
    """What the watch over the graph sees of the robot, several times a second."""

    listeners: int
    """Subscribers that our commands reach."""
    rivals: tuple[str, ...] = ()
    """Other nodes that publish on the command topic."""
    odometers: int = 1
    """Nodes that publish the odometry."""


class Pressed(msgspec.Struct, frozen=True):
    """What the emergency stop says."""

    pressed: bool


class Taken(msgspec.Struct, frozen=True):
    """An operator's command."""

    topic: str


class Trouble(msgspec.Struct, frozen=True):
    """Why this node is no longer part of ROS."""

    text: str


Item = Odometry | Sight | Pressed | Taken | Trouble


def fill(message: Any, motion: BaseMotion) -> None:  # noqa: ANN401  # of either ROS
    """Put a motion into a Twist, or into a TwistStamped's."""
    twist = getattr(message, "twist", message)
    twist.linear.x, twist.linear.y = motion.forward_m_s, motion.lateral_m_s
    twist.angular.z = motion.yaw_rad_s


class Client(Protocol):
    """One node. The guard's thread calls; the library's own threads only put `Item`s into the inbox.

    Every method but ``close`` turns what its library raises into BridgeError.
    """

    name: str
    """Full name of this node."""
    settling_s: float
    """How long others may still be discovered after the robot was; 0 where somebody knows all of them."""
    where: str
    """Where it looks for others, for whoever reads why it found none."""

    def connect(self) -> None:
        """Load the library and become a node without topics.

        Raises:
            BridgeError: if ROS is not installed or not running, or another node has this name.
        """
        ...

    def graph(self) -> Graph:
        """Ask who is there."""
        ...

    def parameter(self, name: str) -> float | None:
        """Return a number that the robot's controller was configured with; None if nobody tells it."""
        ...

    def unheard(self) -> tuple[str, ...]:
        """Name those whose quality of service keeps messages from passing between them and us, and how."""
        ...

    def advertise(self) -> None:
        """Become a publisher of commands, which a guard that drives this robot would take for a rival."""
        ...

    def listen(self) -> None:
        """Subscribe, and watch the graph from a thread."""
        ...

    def compose(self, motion: BaseMotion, stamp_s: float) -> object:
        """Make the message of a command; the stamp, in the robot's own time, goes where there is a header."""
        ...

    def publish(self, message: object) -> None:
        """Put one message on the wire, once."""
        ...

    def close(self) -> None:
        """Leave ROS; sends nothing that moves the robot."""
        ...
