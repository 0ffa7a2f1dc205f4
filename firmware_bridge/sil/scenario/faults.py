"""What may go wrong while a team drives, and the file that says when: ``[[fault]]`` tables, a timeline."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, TypeAlias, cast, get_args

import msgspec

from edge_runtime.common.toml_file import Table, read_toml, refuse, to_record
from edge_runtime.config.objectives import load_objective_set

MOST_HOGS: Final = 64
LARGEST: Final = 1e7
"""Of any number in a timeline: four months, or ten million frames."""
ROUNDING_S: Final = 1e-6
"""Of two decimal numbers' sum."""


class Fault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base of every fault; times count from the moment at which all robots drive."""

    at_s: float
    """When it begins."""

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if isinstance(value, (int, float)) and not 0 <= value <= LARGEST:
                raise ValueError(f"`{field}` must lie in [0, {LARGEST:g}], got {value:g}")

    @property
    def kind(self) -> str:
        """The name under which the file knows it."""
        return str(self.__struct_config__.tag)

    @property
    def end_s(self) -> float:
        """When it is over; infinite where nothing ends it."""
        return math.inf

    @property
    def names(self) -> tuple[int, ...]:
        """Ids of the robots that the file names."""
        robot: int | None = getattr(self, "robot", None)
        return () if robot is None else (robot,)

    @property
    def hits(self) -> tuple[int, ...]:
        """Ids of the robots that it takes out of the run, of which no limit holds."""
        return self.names


class Lasting(Fault, frozen=True, kw_only=True):
    """A fault that ends."""

    for_s: float
    """How long it lasts; it must end within the run."""

    @property
    def end_s(self) -> float:
        """When it is over."""
        return self.at_s + self.for_s


class Kill(Fault, frozen=True, kw_only=True, tag="kill"):
    """SIGKILL of one of a robot's processes."""

    robot: int
    """Whose."""
    part: Literal["runtime", "guard", "logger"] = "runtime"
    """Which of its processes."""

    @property
    def hits(self) -> tuple[int, ...]:
        """The robot; a run goes on without its logger."""
        return () if self.part == "logger" else self.names


class Freeze(Lasting, frozen=True, kw_only=True, tag="freeze"):
    """SIGSTOP of one of a robot's processes, then SIGCONT; its guard has stopped it for good by then."""

    robot: int
    """Whose."""
    part: Literal["runtime", "guard"] = "runtime"
    """Which of its processes."""


class CpuHog(Lasting, frozen=True, kw_only=True, tag="cpu_hog"):
    """Processes that compute without end, of ordinary priority."""

    processes: int = 1
    """How many."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.processes <= MOST_HOGS:
            raise ValueError(f"`processes` must lie in [1, {MOST_HOGS}], got {self.processes}")


class ClockJump(Fault, frozen=True, kw_only=True, tag="clock_jump"):
    """The wall clock jumps ahead, and back when the run is over; needs CAP_SYS_TIME.

    A kernel has one wall clock: all its processes see this. Use a computer or a virtual machine of its own.
    """

    by_s: float = 3600.0
    """How far ahead."""
    whole_machine: bool = False
    """Must be true: that you know that it sets the whole machine's clock."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.whole_machine:
            raise ValueError("clock_jump sets the machine's own clock: allow it by `whole_machine = true`")


class NetworkFault(Lasting, frozen=True, kw_only=True):
    """A fault of the team's network, made by a relay between the robots' sockets."""

    robots: tuple[int, ...] | None = None
    """Frames from and to these; all where None."""

    @property
    def names(self) -> tuple[int, ...]:
        """The robots."""
        return self.robots or ()

    @property
    def hits(self) -> tuple[int, ...]:
        """None: whoever hears nobody stops, and goes on."""
        return ()


class SharedFault(NetworkFault, frozen=True, kw_only=True):
    """A fault of some packets."""

    share: float
    """Probability for each packet."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.share <= 1.0:
            raise ValueError(f"`share` must lie in [0, 1], got {self.share:g}")


class Loss(SharedFault, frozen=True, kw_only=True, tag="loss"):
    """Packets are lost."""


class Duplicate(SharedFault, frozen=True, kw_only=True, tag="duplicate"):
    """Packets arrive twice."""


class Reorder(SharedFault, frozen=True, kw_only=True, tag="reorder"):
    """Packets are held back so long that later ones overtake them."""

    hold_ms: float = 30.0
    """How long a packet is held back."""


class CorruptPackets(SharedFault, frozen=True, kw_only=True, tag="corrupt_packets"):
    """Packets arrive with a bit changed."""


class Delay(NetworkFault, frozen=True, kw_only=True, tag="delay"):
    """Packets arrive late, by up to ``jitter_ms`` more than ``delay_ms``."""

    delay_ms: float
    """Of every packet."""
    jitter_ms: float = 0.0
    """At most this much more, drawn anew for each packet."""


class Blackout(NetworkFault, frozen=True, kw_only=True, tag="blackout"):
    """Nothing arrives."""


class WireFault(Lasting, frozen=True, kw_only=True):
    """A fault of one robot's firmware, and of what it sends."""

    robot: int
    """Whose firmware."""


class StalePose(WireFault, frozen=True, kw_only=True, tag="stale_pose"):
    """The pose stands still in time: CAN's motion state ends, MAVLink's position keeps its stamp."""


class NanPose(WireFault, frozen=True, kw_only=True, tag="nan_pose"):
    """What it tells is not a number (MAVLink, ROS; the integers of CAN carry none)."""


class CorruptFrames(WireFault, frozen=True, kw_only=True, tag="corrupt_frames"):
    """Every frame from the firmware is damaged: cut short on CAN, a bit changed on MAVLink.

    ROS carries nothing damaged: what is not a number stands for it.
    """


class EmergencyStop(WireFault, frozen=True, kw_only=True, tag="emergency_stop"):
    """Somebody presses the robot's emergency stop (MAVLink: takes it into its stop mode), and releases it."""


class LogFull(Lasting, frozen=True, kw_only=True, tag="log_full"):
    """No file that the robots' processes write may grow any more (RLIMIT_FSIZE)."""


class Hostile(Lasting, frozen=True, kw_only=True, tag="hostile"):
    """A peer without the key sends frames to every robot: random, forged, recorded and altered ones."""

    frames: int
    """How many to each robot, spread over its time."""


class Objectives(Fault, frozen=True, kw_only=True, tag="objectives"):
    """No fault, but an operator: ``edge-ctl objectives FILE`` while the team drives."""

    file: str
    """Relative to the timeline."""


AnyFault: TypeAlias = (
    Kill
    | Freeze
    | CpuHog
    | ClockJump
    | Loss
    | Duplicate
    | Reorder
    | CorruptPackets
    | Delay
    | Blackout
    | StalePose
    | NanPose
    | CorruptFrames
    | EmergencyStop
    | LogFull
    | Hostile
    | Objectives
)
KINDS: Final[tuple[type[Fault], ...]] = get_args(AnyFault)


class _Tables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    fault: tuple[Table, ...]


def load_faults(path: Path, robots: Sequence[int], duration_s: float, bridge: str) -> tuple[AnyFault, ...]:
    """Read a timeline for these robots, in the order of its times.

    Raises:
        ConfigError: names the file, the key and what is allowed.
    """
    tables = to_record(read_toml(path), _Tables, path).fault
    faults = []
    for index, table in enumerate(tables):
        key = f"fault[{index}]"
        fault = _fault(table, path, key)
        if fault.at_s >= duration_s:
            refuse(path, f"{key}.at_s", f"{fault.at_s:g} s is not within the run of {duration_s:g} s")
        if isinstance(fault, Lasting) and fault.end_s > duration_s + ROUNDING_S:
            refuse(path, f"{key}.for_s", f"ends at {fault.end_s:g} s, beyond the run of {duration_s:g} s")
        for robot_id in fault.names:
            if robot_id not in robots:
                known = ", ".join(map(str, robots))
                refuse(path, key, f"no robot has id {robot_id}; known: {known}")
        if isinstance(fault, NanPose) and bridge == "can":
            refuse(path, f"{key}.kind", "CAN frames are integers and carry no NaN; use --bridge mavlink")
        if isinstance(fault, Objectives):
            load_objective_set(path.parent / fault.file)
            fault = msgspec.structs.replace(fault, file=str((path.parent / fault.file).resolve()))
        faults.append(fault)
    return tuple(sorted(faults, key=lambda fault: fault.at_s))


def _fault(table: Table, path: Path, key: str) -> AnyFault:
    known = {str(kind.__struct_config__.tag): kind for kind in KINDS}
    name = table.get("kind")
    if not isinstance(name, str) or name not in known:
        said = "missing" if name is None else f"unknown fault {name!r}"
        refuse(path, f"{key}.kind", f"{said}; allowed: {', '.join(known)}")
    return cast(AnyFault, to_record(table, known[name], path, key))
