"""What a run ends with: the records that ``--json`` writes and the table shows."""

from typing import Literal

import msgspec

from edge_runtime.control.rate import Percentiles

RunVerdict = Literal["passed", "failed", "invalid"]


class Quality(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's run, or the team's: the sum of counts, the least rate, the distribution over all."""

    achieved_rate_hz: float
    """Commands at the firmware, per second."""
    achieved_rate_share: float
    """Of the control rate."""
    period_jitter_ms: Percentiles | None
    """How far the intervals between commands are from the period."""
    deadline_misses: int
    """Ticks whose command did not reach the firmware in their own period."""
    longest_burst: int
    """Most of them in a row."""
    pose_to_command_age_ms: Percentiles | None
    """From the measurement of the pose that a command rests on to its arrival at the firmware."""
    fleet_message_age_ms: Percentiles | None
    """Of teammates' messages when the policy first used them; the team's is the worst robot's."""
    fleet_used_age_ms: Percentiles | None
    """Of the teammates' states that the policy was given, tick by tick; the team's is the worst robot's."""
    objective_violations_share: float
    """Of the time, any objective with a limit; the team's is the mean."""
    collisions: int
    """Contacts begun with other robots; the team's counts each once, and those with obstacles."""
    goals_reached: int
    """Robots at their goals at the end."""
    cpu_cores: float
    """Processor time over time, of the robot's processes; the team's of all."""
    memory_mib: float
    """Resident at the end, of the robot's processes; the team's of all."""


class RobotQuality(Quality, frozen=True, kw_only=True):
    """One robot."""

    robot_id: int
    exempt: bool
    """A fault took it out: no limit holds of it."""
    stop_reason: str
    """The runtime's own words; empty if it could not say any."""
    undecided_ticks: int
    """Ticks without a decision, by the stamps of the runtime's log; what else is missed at the firmware its
    guard withheld or the wire lost."""
    runtime_misses: int | None
    """Deadlines that the runtime itself counted as missed, from its start to its end."""
    lacking_commands: int | None = None
    """Ticks that brought the firmware no command, neither in time nor late, between two punctual commands;
    None where its log does not tell enough to compare."""
    counted_misses: int | None = None
    """Deadlines that the loop counted as missed between the decisions behind these two commands."""
    late_commands: int | None = None
    """Commands between these two that came, but so late that their own ticks brought none."""
    stopped_ticks: dict[str, int]
    """Ticks in which the runtime commanded rest, by reason, from its start to its end."""
    refused_messages: dict[str, int]
    """Fleet messages that the runtime dropped, by reason."""
    accepted_messages: int
    sent_messages: int
    driven_s: float
    """From the runtime's first tick to its last; messages count that long."""
    halts_s: tuple[tuple[float, float], ...]
    """(from, to) of each time that the firmware was told to rest or told nothing, in the run's time."""
    log_gaps_s: tuple[tuple[float, float], ...]
    """(from, to) of each time of over three periods that its log does not tell of, in the run's time."""
    objective_changes_s: tuple[tuple[float, int], ...]
    """(time, version) of each first decision under other objectives, in the run's time."""
    tick_us: Percentiles | None = None
    """From the runtime's waking to its command's departure, as it reports at its end."""
    stage_us: dict[str, Percentiles] = {}
    """Of the parts of a tick; ``wake`` is from when it was due."""
    goal_distance_m: float | None
    least_distance_m: float | None
    greatest_speed_m_s: float
    firmware_timeouts: int
    obstacle_contacts: int = 0
    """Begun, with obstacles."""


class ProcessCost(msgspec.Struct, frozen=True, kw_only=True):
    """One process, from the beginning of the measurement to its end."""

    name: str
    cpu_cores: float
    memory_mib: float
    """Resident at the end."""
    memory_growth_mib: float
    """Since the end of the first quarter of the run, when everything has been touched once."""


class MachineQuality(msgspec.Struct, frozen=True, kw_only=True):
    """How quiet the machine was."""

    cores: int
    realtime: bool
    wake_ms: Percentiles | None
    """Lateness of a process that only sleeps, beside the run and scheduled like it."""
    plant_late_ms: Percentiles | None
    """Lateness of the plant's own steps."""
    others_cpu_cores: float
    """Taken by processes other than the run's, and stolen."""


class FaultStop(msgspec.Struct, frozen=True):
    """How one robot came to rest after a fault."""

    robot_id: int
    seconds: float | None
    """From the fault to rest; None if it never rested."""
    metres: float
    """Way travelled meanwhile."""


def describe_stop(stop: FaultStop) -> str:
    """Say it in a few words."""
    if stop.seconds is None:
        return f"robot {stop.robot_id} never rested"
    return f"robot {stop.robot_id} at rest after {stop.seconds:.2f} s and {stop.metres:.2f} m"


class FaultDone(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the timeline, as it was done."""

    kind: str
    at_s: float
    for_s: float | None
    details: str
    """The line of the file, as JSON."""
    done_s: float | None
    """When the harness did it; None where a process of its own followed the timeline by itself."""
    stops: tuple[FaultStop, ...] = ()
    """Of the robots that it was to stop."""


class Evidence(msgspec.Struct, frozen=True, kw_only=True):
    """When, by what and of what a run was made: whoever signs off can tell it from others, and repeat it."""

    started_at: str
    """UTC, by the machine's clock."""
    command: tuple[str, ...]
    """The command line."""
    version: str
    """Of this software."""
    commit: str
    """It was made of; see `edge_runtime.common.commit`."""
    python: str
    numpy: str
    machine: str
    sha256: dict[str, str]
    """Of the policy's manifest, which holds the digests of its other files, and of the files named."""
    limits: dict[str, float]
    """What was judged, by its key in the limits file."""


class ObjectQuality(msgspec.Struct, frozen=True):
    """A tracked object that has a goal."""

    name: str
    goal_distance_m: float
    """At the end."""
    least_goal_distance_m: float
    goal_reached: bool
    """Whether it ever was there: where it is carried on to is nobody's task."""


class SilReport(msgspec.Struct, frozen=True, kw_only=True):
    """A finished run."""

    bridge: str
    robots_count: int
    rate_hz: float
    duration_s: float
    """As measured; shorter than asked for if the run was cut short."""
    policy: str
    robots: tuple[RobotQuality, ...]
    team: Quality
    processes: tuple[ProcessCost, ...]
    machine: MachineQuality
    faults: tuple[FaultDone, ...]
    ended: tuple[str, ...]
    """Processes that ended though nobody asked them to, with the last line that each wrote."""
    broken: tuple[str, ...]
    """Limits that were not kept."""
    disturbed: tuple[str, ...]
    """Why the machine was not quiet enough for the run to prove anything."""
    verdict: RunVerdict
    objects: tuple[ObjectQuality, ...] = ()
    evidence: Evidence | None = None
    """None where a benchmark made the run for itself."""
