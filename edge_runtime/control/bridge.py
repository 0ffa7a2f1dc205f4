"""The one object in which simulation and reality differ."""

from typing import Protocol

import msgspec

from edge_runtime.control.start import PoseSource
from edge_runtime.messages import Command, RobotState


class Reaction(msgspec.Struct, frozen=True):
    """How a link answers faults."""

    deadline_s: float
    """Longest time that its guard waits for a fresh command."""
    firmware_timeout_s: float | None
    """Silence after which the firmware stops by itself; None where unknown, 0 where off."""
    deceleration_m_s2: float | None
    """Of its stop; None where the policy's own dynamics are all that is known."""


class Bridge(Protocol):
    """A robot's link to its firmware; leaving the context leaves the robot stopped.

    Raises:
        BridgeError: from any method, if the link cannot be opened or has failed.
    """

    name: str
    """What reports call this link, such as ``sim`` or ``can``."""
    max_speed_m_s: float
    """Greatest speed that the link lets through; may be infinite."""
    max_yaw_rate_rad_s: float
    """Greatest yaw rate, likewise; 0 where the policy turns no robot."""
    complaints: tuple[str, ...]
    """What the firmware has complained of so far and driven on with, in order."""

    @property
    def poses(self) -> PoseSource | None:
        """Tells when a state arrives; None where one is always there."""
        ...

    @property
    def withholds(self) -> str:
        """Why what is written does not drive the robot, such as that nobody armed it; empty while it does."""
        ...

    @property
    def reaction(self) -> Reaction | None:
        """How it answers faults, known once it is open; None where nothing real moves."""
        ...

    def __enter__(self) -> "Bridge":
        """Open the link."""
        ...

    def __exit__(self, *_: object) -> None:
        """Stop the robot, whatever happened, and close the link."""
        ...

    def read(self) -> RobotState | None:
        """Return the newest state, or None before the first one has arrived. Never blocks."""
        ...

    def write(self, command: Command) -> None:
        """Send one setpoint, once. Never blocks."""
        ...

    def stop(self, reason: str) -> None:
        """Bring the robot to rest by the firmware's own stop sequence."""
        ...
