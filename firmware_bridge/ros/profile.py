"""A ROS robot in one TOML file: its topics, what they carry, its base, and where its own timeout stands."""

import re
from pathlib import Path
from typing import Final, Literal

import msgspec

from edge_runtime.common.toml_file import read_toml, to_record
from edge_runtime.errors import ConfigError
from firmware_bridge.guard.profile_file import SpeedLimits, profile_file
from firmware_bridge.kinematics.base import Base

PROFILES: Final = Path(__file__).parent / "profiles"
_NAME: Final = re.compile(r"/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
_NAMESPACE: Final = re.compile(r"(/[A-Za-z][A-Za-z0-9_]*)*")


class RosLimits(SpeedLimits, frozen=True, forbid_unknown_fields=True):
    """The most that the robot may be asked for, and how it brakes."""

    deceleration_m_s2: float | None = None
    """Of its own controller, told to stand; None where nobody says."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.deceleration_m_s2 is not None and not self.deceleration_m_s2 > 0.0:
            raise ValueError(f"`deceleration_m_s2` must be positive, got {self.deceleration_m_s2}")


class RosProfile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One kind of ROS robot. Names are ROS's: below the robot's namespace, unless they begin with a slash."""

    command: str
    """Topic of the velocity commands."""
    message: Literal["Twist", "TwistStamped"]
    """Of `geometry_msgs`: what the command topic carries, and the operators' topics."""
    odometry: str
    """Topic of `nav_msgs/Odometry`."""
    base: Base
    limits: RosLimits
    ros: Literal[1, 2] | None = None
    """Which ROS the robot speaks; None: either."""
    python_path: tuple[str, ...] = ()
    """Folders in which this robot's ROS keeps its Python packages; --ros-path says otherwise."""
    emergency_stop: str | None = None
    """Topic of `std_msgs/Bool`, true while pressed."""
    emergency_stop_silent_s: float | None = None
    """Its longest silence, where it is told again and again: three periods. The robot stands while it is
    silent for longer; None: it is told when it changes."""
    operators: tuple[str, ...] = ()
    """Topics of commands that go before ours: whoever speaks there has the robot."""
    timeout_parameter: str | None = None
    """The controller's own command timeout in seconds; the last part is the parameter, the rest its node."""
    firmware_timeout_s: float | None = None
    """That timeout, where no parameter tells it; leave it out where unknown."""
    stale_s: float = 0.2
    """Greatest age of the newest odometry, and greatest delay of any."""
    period_s: float = 0.02
    """Between the zero commands of a stop."""
    zeros: int = 3
    """How many of them."""
    recoveries: int = 3
    """How many times in one run stale odometry is answered by stopping and enabling again."""
    enable_timeout_s: float = 2.0
    """How long fresh odometry and somebody who listens may take to come."""

    def __post_init__(self) -> None:
        names = (self.command, self.odometry, self.emergency_stop, self.timeout_parameter, *self.operators)
        for name in filter(None, names):
            if not _NAME.fullmatch(name):
                raise ValueError(f"not a name of ROS: {name!r}")
        if self.timeout_parameter and "/" not in self.timeout_parameter.lstrip("/"):
            raise ValueError("`timeout_parameter` must name a node and its parameter: node/parameter")
        if self.timeout_parameter and self.firmware_timeout_s is not None:
            raise ValueError("give one of `timeout_parameter` and `firmware_timeout_s`: asked for, or known")
        for name in ("stale_s", "period_s", "enable_timeout_s", "emergency_stop_silent_s"):
            if (value := getattr(self, name)) is not None and not 0.0 < value <= 10.0:
                raise ValueError(f"`{name}` must lie in (0, 10], got {value}")
        if self.emergency_stop_silent_s is not None and self.emergency_stop is None:
            raise ValueError(
                "`emergency_stop_silent_s` needs `emergency_stop`: the topic that may fall silent"
            )
        if not (1 <= self.zeros <= 100 and 0 <= self.recoveries <= 100):
            raise ValueError("`zeros` must lie in [1, 100] and `recoveries` in [0, 100]")
        if self.base.kind == "ackermann":
            raise ValueError("a Twist has no steering angle: `base.kind` must not be 'ackermann'")

    @property
    def type_name(self) -> str:
        """What the command topic carries, as ROS writes it."""
        return f"geometry_msgs/{self.message}"

    def under(self, namespace: str) -> "RosProfile":
        """Return the profile of a robot in a namespace: all names absolute."""

        def absolute(name: str) -> str:
            return name if name.startswith("/") else f"{namespace}/{name}"

        return msgspec.structs.replace(
            self,
            command=absolute(self.command),
            odometry=absolute(self.odometry),
            emergency_stop=self.emergency_stop and absolute(self.emergency_stop),
            operators=tuple(map(absolute, self.operators)),
            timeout_parameter=self.timeout_parameter and absolute(self.timeout_parameter),
        )


def check_namespace(namespace: str) -> None:
    """Refuse what is no namespace.

    Raises:
        ConfigError: says what one looks like.
    """
    if not _NAMESPACE.fullmatch(namespace):
        raise ConfigError(f"--ros-namespace {namespace!r}: must look like /a200_0000, or be left out")


def profile_path(name: str) -> Path:
    """Return the file of a profile given by name or by path; raises as `profile_file`."""
    return profile_file(name, PROFILES, "--ros-profile")


def load_profile(path: Path) -> RosProfile:
    """Read and validate a profile's TOML.

    Raises:
        ConfigError: names file and key.
    """
    return to_record(read_toml(path), RosProfile, path)
