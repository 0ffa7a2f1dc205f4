"""The one object in which simulation and reality differ."""

from types import TracebackType
from typing import Protocol

from edge_runtime.messages import Command, RobotState


class Bridge(Protocol):
    """A robot's link to its firmware; leaving the context leaves the robot stopped.

    Raises:
        BridgeError: from any method, if the link cannot be opened or has failed.
    """

    name: str
    """What reports call this link, such as ``sim`` or ``can``."""
    max_speed_m_s: float
    """Greatest speed that the link lets through; may be infinite."""
    complaints: tuple[str, ...]
    """What the firmware has complained of so far and driven on with, in order."""

    def __enter__(self) -> "Bridge":
        """Open the link."""
        ...

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
