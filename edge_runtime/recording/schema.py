"""What a log holds: its channels, and the record on each.

A log is an MCAP file (https://mcap.dev/spec) with JSON messages and JSON Schemas, as Foxglove opens them.
Every tick puts one message on each of `TICK_CHANNELS`, all with the tick's number as their MCAP sequence and
the same log time; `edge_runtime.recording.reader` puts them together again as one `Tick`.

- Log times are Unix nanoseconds that advance with the monotonic clock: the wall clock at the start plus the
  monotonic time since. Stamps inside records are monotonic seconds of the robot, ages are seconds.
- A field that is None is left out of its message.
- JSON numbers are the shortest that read back as the same double. A number that is not finite, for which
  JSON has no form, is one of the strings "NaN", "Infinity" and "-Infinity", as in protobuf's JSON.
- Every file of a run stands by itself: it begins with `Start` and the `LoggedObjectiveSet` in force.

Whoever changes a record, also one of the runtime's own that is used here, raises `LOG_FORMAT`; a new
field has a default that is true of what older formats tell.
"""

from typing import Final

import msgspec

from edge_runtime.common.bounds import GREATEST, MOST_OBJECTIVES, MOST_ROBOTS, RATE_HZ, check_bounds
from edge_runtime.messages import Action, Command, GuidedAction, Integer, Place, TeamState
from edge_runtime.policy.adaptation import Adaptation
from edge_runtime.policy.flow_steps import SamplerName
from edge_runtime.policy.schema import MAX_STEPS
from edge_runtime.recording.foxglove import PosesInFrame, Time

LOG_FORMAT: Final = "cfpg-log/6"
READ_FORMATS: Final = ("cfpg-log/2", "cfpg-log/3", "cfpg-log/4", "cfpg-log/5", LOG_FORMAT)
"""Logs of format 2 lack yaw rates and tracked objects: nobody's turned, and there were none. Those before
format 4 lack the sampler: it was Euler's; and policies saw teammates where they were. Those before format 5
lack the steps of requirements: it was one. Those before format 6 lack the training's arena: policies
observed all places as they were."""
LATEST_S: Final = 1e11
"""No clock of a robot says more: that is 3,000 years."""


class Versions(msgspec.Struct, frozen=True):
    """The software of a run."""

    cfpg_edge: str
    python: str
    numpy: str


class Machine(msgspec.Struct, frozen=True):
    """The computer of a run."""

    host: str
    processor: str
    cores: Integer
    kernel: str


class BundleIdentity(msgspec.Struct, frozen=True):
    """The policy of a run."""

    name: str
    directory: str
    sha256: str
    """Of its manifest.json, which holds the digests of its other files."""
    radius_m: float
    """Of the robots' discs."""
    euler_steps: Integer
    """T: a sample of fewer steps was cut short by its deadline, or refused."""
    sampler: SamplerName = "euler"
    """How the flow was integrated in them."""

    def __post_init__(self) -> None:
        check_bounds(self, {"radius_m": (0.0, GREATEST), "euler_steps": (1, MAX_STEPS)})


class RobotPlace(msgspec.Struct, frozen=True):
    """One robot of the fleet."""

    robot_id: Integer
    start_m: Place
    goal_m: Place | None = None

    def __post_init__(self) -> None:
        check_bounds(self, dict.fromkeys(("start_m", "goal_m"), (-GREATEST, GREATEST)))


class ObjectPlace(msgspec.Struct, frozen=True):
    """One tracked object of the fleet."""

    name: str
    """By which each tick's state tells of it."""
    radius_m: float
    """Of the disc by which it is drawn."""
    goal_m: Place | None = None
    """Where it is to go, if anywhere."""

    def __post_init__(self) -> None:
        check_bounds(self, {"goal_m": (-GREATEST, GREATEST), "radius_m": (0.0, GREATEST)})


class FleetIdentity(msgspec.Struct, frozen=True):
    """The fleet of a run."""

    path: str
    sha256: str
    """Of the fleet file."""
    goal_tolerance_m: float
    robots: tuple[RobotPlace, ...]
    tracked: tuple[ObjectPlace, ...] = ()
    """What is no robot, yet has a pose."""

    def __post_init__(self) -> None:
        check_bounds(self, {"goal_tolerance_m": (0.0, GREATEST)})
        if not 0 < len({robot.robot_id for robot in self.robots}) == len(self.robots) <= MOST_ROBOTS:
            raise ValueError(f"`robots` must be 1 to {MOST_ROBOTS}, each with an id of its own")
        places = [place for robot in self.robots for place in (robot.start_m, robot.goal_m) if place]
        if len(set(map(len, places))) != 1:
            raise ValueError("`robots` must all be in the plane, or all in space")

    @property
    def dims(self) -> int:
        """Components of every robot's position: 2 in the plane, 3 in space."""
        return len(self.robots[0].start_m)


class Settings(msgspec.Struct, frozen=True):
    """How the run was asked to go, and what its commands were limited to."""

    rate_hz: float
    seed: Integer
    backend: str
    """Who computed the policy: ``numpy``, ``compiled`` or ``onnxruntime``."""
    engine: str
    """The instruction set of the compiled kernel; empty for the other backends."""
    bridge: str
    dry_run: bool
    realtime: bool
    max_state_age_s: float
    max_step: float | None = None
    """Greatest change of each action component from one command to the next; unlimited where None."""
    max_speed_m_s: float | None = None
    """Greatest velocity setpoint; unlimited where None."""
    max_unfamiliar_s: float | None = None
    """How long the robot might act on what training never had; without end where None."""
    max_yaw_rate_rad_s: float | None = None
    """Greatest yaw rate setpoint; unlimited where None."""
    adaptation: Adaptation = Adaptation()
    """Where the robot differed from the policy's."""

    def __post_init__(self) -> None:
        check_bounds(self, {"rate_hz": RATE_HZ})


class Start(msgspec.Struct, frozen=True):
    """Channel ``/start``: the first message of every file."""

    format: str
    """`LOG_FORMAT`."""
    run: str
    """The same in all files of a run, and in no other."""
    part: Integer
    """Number of this file within the run, from 0."""
    robot_id: Integer
    started_at: str
    """Wall clock at the run's start: ISO 8601, UTC."""
    started_unix_s: float
    """The same moment in seconds since 1970."""
    started_s: float
    """The same moment on the monotonic clock."""
    versions: Versions
    machine: Machine
    bundle: BundleIdentity
    fleet: FleetIdentity
    settings: Settings

    def __post_init__(self) -> None:
        check_bounds(self, {"started_unix_s": (0.0, LATEST_S), "started_s": (0.0, LATEST_S)})
        if self.robot_id not in {robot.robot_id for robot in self.fleet.robots}:
            raise ValueError(f"`robot_id` {self.robot_id} is none of the fleet's")


class LoggedObjective(msgspec.Struct, frozen=True):
    """One objective of a set."""

    name: str
    kind: str
    """``type`` of an objectives file: a built-in name, or ``module:Class``."""
    folder: str
    """Where an own objective's module was imported from; empty for built-in ones."""
    weight: float
    active: bool
    """Whether it steered: not with weight 0, or where the flow was left alone. The costs and conflicts of a
    tick are those of the active ones, in this order."""
    parameters: str
    """All its fields as JSON."""

    def __post_init__(self) -> None:
        self.fields()

    def fields(self) -> dict[str, object]:
        """Return the parameters as they were.

        Raises:
            ValueError: if they are no JSON object.
        """
        try:
            return msgspec.json.decode(self.parameters, type=dict[str, object])
        except (msgspec.DecodeError, RecursionError) as error:
            raise ValueError(f"`parameters` of {self.name!r} do not read ({error})") from error


class LoggedObjectiveSet(msgspec.Struct, frozen=True):
    """Channel ``/objectives``: the objectives in force from here on; again at the start of each file."""

    version: Integer
    """0 is what the run started with; a set that the team agrees on while it drives has a higher one."""
    mode: str
    scale: float
    reach: float
    start_noise: float
    """Deviation of the flow's start."""
    objectives: tuple[LoggedObjective, ...]
    ease_m: float = 0.0
    """How much farther away than they are the policy saw teammates, as asked for."""
    goal_reach: float | None = None
    """The reach where what is tracked was at its goals; None for the same."""
    goal_within_m: float = 0.1
    """How near that was."""
    requirement_steps: Integer = 1
    """In which requirements moved a finished action at most."""
    bundle: BundleIdentity | None = None
    """The policy from here on, if it was handed over under way; None for the one of the start."""

    def __post_init__(self) -> None:
        if len(self.objectives) > MOST_OBJECTIVES:
            raise ValueError(f"`objectives` must be at most {MOST_OBJECTIVES}, got {len(self.objectives)}")


class Inputs(msgspec.Struct, frozen=True, gc=False):
    """Channel ``/inputs``: what a tick began with, besides what it saw."""

    number: Integer
    """Of the tick, from 0; numbers that are missing were lost."""
    deadline_s: float
    misses: Integer
    """Deadlines missed so far in the run."""
    objectives_version: Integer
    start: Action
    """Start noise: where the flow began."""
    previous_action: Action
    """The action commanded last, from which the slew limit counts."""
    elapsed_s: float = 0.0
    """Since the robot's first tick, as sources see it."""


class Observation(msgspec.Struct, frozen=True, gc=False):
    """Channel ``/observation``: the policy's input, in the order of the manifest's fields."""

    values: tuple[float, ...]
    """(O,) 32-bit floats."""
    unfamiliar: str = ""
    """The field that lies furthest outside of what training had; empty if none does."""
    unfamiliar_s: float = 0.0
    """For how long now, without a tick inside."""


class StageTimes(msgspec.Struct, frozen=True, gc=False):
    """Channel ``/timing``: how long the tick's stages took, in microseconds."""

    wake: float
    """From the deadline to the tick's start."""
    read: float
    observe: float
    act: float
    limit: float
    write: float
    tick: float
    """From the tick's start to the command's departure."""


class Tick(msgspec.Struct, frozen=True, gc=False):
    """One tick; each field is one message, on the channel of its name."""

    inputs: Inputs
    state: TeamState
    """The own state and the teammates' with their ages, and why no action may rest on them."""
    observation: Observation
    action: GuidedAction
    """The sampled action with each objective's cost and conflicts, and what projections took effect."""
    command: Command
    """The action within its limits."""
    timing: StageTimes

    def fault(self, dims: int) -> str:
        """Say which vectors are not of the fleet's dimensions, or not of one policy's; empty if all are."""
        mates = self.state.teammates + self.state.silent
        states = (self.state.own, *(mate.state for mate in mates))
        places = [vector for state in states for vector in (state.position_m, state.velocity_m_s)]
        if {len(place) for place in (*places, self.command.velocity_m_s)} != {dims}:
            return f"a position or velocity that has not {dims} components"
        actions = [self.inputs.start, self.inputs.previous_action, self.action.action, self.command.action]
        if len({len(action) for action in (*actions, *(mate.intended_action for mate in mates))}) != 1:
            return "actions of different lengths"
        return ""


class Event(msgspec.Struct, frozen=True):
    """Channel ``/events``: something that happened, as a ``foxglove.Log`` for Foxglove's Log panel."""

    timestamp: Time
    level: Integer
    """2 info, 3 warning, 4 error."""
    name: str
    """What kind it is, one of `EVENTS`."""
    message: str
    file: str = ""
    line: Integer = 0


class End(msgspec.Struct, frozen=True):
    """Channel ``/end``: the last message of a run that ended in good order."""

    stop_reason: str
    failed: bool
    """The link to the robot failed; ``stop_reason`` says how."""
    ticks: Integer
    deadline_misses: Integer
    lost: Integer
    """Ticks that the loop could not hand over for recording."""


EVENTS: Final = (
    "start",
    "fault",
    "recovered",
    "miss",
    "cut",
    "unfamiliar",
    "lost",
    "found",
    "objectives",
    "firmware",
    "gap",
    "stop",
)
"""Fault begins, fault ends, deadlines missed, samples are cut short, observations leave what
training had, teammate lost, teammate found,
objectives exchanged, the firmware complains, ticks lost to the log, run stopped."""

TICK_CHANNELS: Final = ("inputs", "state", "observation", "action", "command", "timing")
"""Fields of `Tick`, in the order of their messages."""

CHANNELS: Final[dict[str, tuple[str, type[msgspec.Struct]]]] = {
    "start": ("cfpg.Start", Start),
    "objectives": ("cfpg.ObjectiveSet", LoggedObjectiveSet),
    "inputs": ("cfpg.Inputs", Inputs),
    "state": ("cfpg.TeamState", TeamState),
    "observation": ("cfpg.Observation", Observation),
    "action": ("cfpg.GuidedAction", GuidedAction),
    "command": ("cfpg.Command", Command),
    "timing": ("cfpg.StageTimes", StageTimes),
    "events": ("foxglove.Log", Event),
    "poses": ("foxglove.PosesInFrame", PosesInFrame),
    "end": ("cfpg.End", End),
}
"""Channel (its topic without the slash), name of its schema, record."""

Record = Start | LoggedObjectiveSet | Tick | Event | End
"""What `edge_runtime.recording.reader.read_log` yields, in the order of the file."""
