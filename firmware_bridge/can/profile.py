"""A CAN robot in two files: a DBC for the frames, and this TOML for what they mean.

Every number is in SI units on this side and in the DBC's physical units on the wire. A profile is a
directory-local pair: the TOML names its DBC, relative to itself. Signals are written ``Message.Signal``.
"""

from pathlib import Path
from typing import Literal

import msgspec

from edge_runtime.common.toml_file import read_toml, to_record
from firmware_bridge.can.e2e import Protection
from firmware_bridge.can.odrive import Watchdog
from firmware_bridge.can.vesc import Vescs
from firmware_bridge.guard.profile_file import SpeedLimits, profile_file
from firmware_bridge.kinematics.base import Base

PROFILES = Path(__file__).parents[1] / "profiles"


class Gains(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One signal as a linear function of the base's motion, so that wheels of any arrangement fit.

    For a wheel of radius r at distance b / 2 from the middle, in revolutions per second:
    forward = 1 / (2 pi r), yaw = -b / (4 pi r) on the left, + on the right.
    """

    forward: float = 0.0
    """Physical units per m/s."""
    lateral: float = 0.0
    """As `forward`, to the left."""
    yaw: float = 0.0
    """Physical units per rad/s."""
    steering: float = 0.0
    """Physical units per rad."""


class Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One frame of an enable or stop sequence; signals that are not named are zero."""

    message: str
    """Of the DBC."""
    signals: dict[str, float] = {}
    """Physical values by the names of the signals."""
    pause_s: float = 0.02
    """Time until the next step."""


class Stop(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the robot is brought to rest."""

    deceleration_m_s2: float | None = None
    """Ramp the speed down by this; None: a sudden zero."""
    zeros: int = 3
    """How often the zero command is sent, once a period, before the final steps."""
    then: tuple[Step, ...] = ()


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Holds while the newest value of a signal is one of, or none of, some values."""

    signal: str
    """As ``Message.Signal``."""
    any_of: tuple[float, ...] = ()
    """Values with which it holds."""
    none_of: tuple[float, ...] = ()
    """Values with which it does not hold."""

    def __post_init__(self) -> None:
        if bool(self.any_of) == bool(self.none_of):
            raise ValueError("a rule has either `any_of` or `none_of`")

    def holds(self, value: float) -> bool:
        """Judge one value."""
        return value in self.any_of if self.any_of else value not in self.none_of


class MotionSignals(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The base's motion as weighted sums of feedback signals."""

    forward: dict[str, float]
    """In m/s."""
    lateral: dict[str, float] = {}
    """In m/s, to the left."""
    yaw: dict[str, float] = {}
    """In rad/s, counter-clockwise."""
    steering: dict[str, float] = {}
    """Where given, an Ackermann base's yaw rate is computed from it."""


class Feedback(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the firmware tells, and how old that may be."""

    stale_s: dict[str, float]
    """Messages that must keep coming, and their greatest age."""
    motion: MotionSignals
    ready: tuple[Rule, ...] = ()
    """All hold while the firmware takes commands; without rules it always does, once enabled."""
    fault: tuple[Rule, ...] = ()
    """One holds: a fault that the enable sequence may clear."""
    warn: tuple[Rule, ...] = ()
    """One holds: somebody should know; the robot drives on."""
    override: tuple[Rule, ...] = ()
    """One holds: an operator, or an emergency stop, has the robot."""

    @property
    def rules(self) -> tuple[Rule, ...]:
        """All of them."""
        return (*self.ready, *self.fault, *self.warn, *self.override)

    @property
    def signals(self) -> list[str]:
        """Every signal that a rule or the motion rests on."""
        motion = self.motion
        measured = (*motion.forward, *motion.lateral, *motion.yaw, *motion.steering)
        return list(dict.fromkeys([*(rule.signal for rule in self.rules), *measured]))


class Profile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One kind of CAN robot; the field order is the order of the file."""

    dbc: str
    """File of the frames, relative to this one."""
    transport: Literal["can", "limo_serial"]
    """What carries them: a CAN bus, or the serial frames of a Limo."""
    period_s: float
    """Time between the frames of a ramp or a zero command; the firmware's usual command period."""
    limits: SpeedLimits
    base: Base
    motion: dict[str, dict[str, Gains]]
    """Command messages, in sending order, and their signals."""
    stop: Stop
    feedback: Feedback
    firmware_timeout_s: float | None = None
    """Silence after which the firmware stops by itself; leave it out where unknown, 0 where off."""
    watchdog: Watchdog | None = None
    """ODrive: where to read that timeout, and to set it with ``--arm``."""
    vesc: Vescs | None = None
    """VESC: who is asked for that timeout."""
    confirm: dict[str, bool] = {}
    """What no message tells and no robot drives without: each true once somebody has looked."""
    enable: tuple[Step, ...] = ()
    enable_timeout_s: float = 2.0
    """How long the firmware may take to be ready after the enable sequence."""
    recoveries: int = 3
    """How many times in one run a fault or stale feedback is answered by the enable sequence."""
    frame_ids: dict[str, int] = {}
    """Messages whose identifier differs from the DBC's, such as other node numbers."""
    protection: dict[str, Protection] = {}
    """Messages with counter and CRC."""

    def __post_init__(self) -> None:
        if not 0.0 < self.period_s <= 1.0:
            raise ValueError(f"`period_s` must lie in (0, 1], got {self.period_s}")
        if sum(source is not None for source in (self.firmware_timeout_s, self.watchdog, self.vesc)) > 1:
            raise ValueError("give one of `firmware_timeout_s`, `watchdog` and `vesc`: asked for, or known")
        if self.recoveries < 0:
            raise ValueError(f"`recoveries` must not be negative, got {self.recoveries}")
        if not self.motion or not self.feedback.stale_s:
            raise ValueError("`motion` and `feedback.stale_s` must name at least one message each")


def profile_path(name: str) -> Path:
    """Return the file of a profile given by name or by path; raises as `profile_file`."""
    return profile_file(name, PROFILES, "--profile")


def load_profile(path: Path) -> Profile:
    """Read and validate a profile's TOML; the codec checks it against the DBC.

    Raises:
        ConfigError: names file and key.
    """
    return to_record(read_toml(path), Profile, path)
