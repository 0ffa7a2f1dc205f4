"""What the guard asks of a link: codec and transport of one robot, living inside the guard process."""

import enum
from collections.abc import Iterator
from typing import Protocol

import msgspec

from edge_runtime.messages import RobotState, Vector

Steps = Iterator[float]
"""A sequence on the wire: each ``next`` does a step without blocking and gives the seconds until the next."""


class Setpoint(msgspec.Struct, frozen=True, gc=False):
    """One command as it crosses the socket.

    A link is handed only those that the guard has found finite, fresh and within limits.
    """

    sequence: int
    stamp_s: float
    """Monotonic time at which the runtime took the command's decision."""
    action: Vector
    velocity_m_s: Vector
    """Velocity in the team's common frame."""
    yaw_rate_rad_s: float = 0.0


class Condition(enum.IntEnum):
    """What a link knows of its firmware, from feedback and never from its own commands."""

    WAITING = 0
    """Not enabled: setpoints are withheld."""
    READY = 1
    """The firmware reports that it takes our setpoints, and the feedback is fresh."""
    FAULT = 2
    """Stale feedback or a clearable fault: the robot is stopped, then enabled again a few times."""
    OVERRIDE = 3
    """An operator or a failsafe took the robot: the guard sends nothing more, not even a stop."""
    LOST = 4
    """Bus-off, cable or peer gone: the guard tries to stop the robot and latches."""


class Health(msgspec.Struct, frozen=True, gc=False):
    """A condition and, in a few words, its cause."""

    condition: Condition
    detail: str = ""
    warning: str = ""
    """What the firmware complains of and drives on with; the runtime is told each once."""


class SetpointLimits(msgspec.Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """What the guard lets through; anything outside stops the robot."""

    speed_m_s: float
    """Largest length of the velocity."""
    low: Vector
    """Least action, (d,)."""
    high: Vector
    """Greatest action."""
    yaw_rate_rad_s: float = 0.0
    """Largest magnitude of the yaw rate; 0 for a policy that does not turn its robot."""
    dims: int = 2
    """Components of the velocity."""


class Link(Protocol):
    """Codec and transport of one robot.

    The guard is its only caller, from one thread. After ``open`` nothing blocks. ``now_s`` is monotonic.
    Any method may raise BridgeError: the guard then stops the robot for good and reports the message.
    """

    @property
    def firmware_timeout_s(self) -> float | None:
        """Silence after which the firmware stops by itself, known after ``open``; None: unknown, 0: off."""
        ...

    keepalive_period_s: float
    """Period of ``keepalive``; infinite where the protocol has no heartbeat of ours."""
    recoveries: int
    """How many times a FAULT is answered by stopping and enabling again before the stop is final."""

    def open(self) -> None:
        """Open the transport and learn what the firmware tells; may block for some seconds.

        Raises:
            ConfigError: on options that contradict each other or the firmware.
            BridgeError: if the transport cannot be opened or the firmware stays silent.
        """
        ...

    def close(self) -> None:
        """Release the transport; sends nothing that moves the robot or changes its mode."""
        ...

    def filenos(self) -> tuple[int, ...]:
        """File descriptors whose readability calls ``receive``; the same from ``open`` to ``close``."""
        ...

    def receive(self, now_s: float) -> None:
        """Take in everything that has arrived; malformed frames are counted and change nothing."""
        ...

    def health(self, now_s: float) -> Health:
        """Judge the firmware; called after every event, so cheap."""
        ...

    def state(self) -> RobotState | None:
        """Return the newest state of the robot, or None before the first."""
        ...

    def dropped(self) -> int:
        """Count frames that the transport did not take."""
        ...

    def enable_sequence(self) -> Steps:
        """Take command and arm; ends once the firmware confirmed it, raises BridgeError if it did not.

        Started by a fresh command, and only with ``--arm``. Sends nothing that moves the robot.
        """
        ...

    def send(self, setpoint: Setpoint, now_s: float) -> None:
        """Put one setpoint on the wire, once; a full transmit queue drops it and counts it.

        Raises:
            BridgeError: if this base cannot follow it, such as a lateral velocity on wheels that do not slip.
        """
        ...

    def stop_sequence(self) -> Steps:
        """Bring the robot to rest, ramped from the last sent setpoint where the profile says so.

        Ends in any case, and early if an operator takes the robot over meanwhile.
        """
        ...

    def keepalive(self, fresh: bool, now_s: float) -> None:
        """Send the protocol's heartbeat if ``fresh``: commands arrive and the robot is not being stopped."""
        ...
