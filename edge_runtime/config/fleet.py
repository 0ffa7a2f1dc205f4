"""The fleet file: TOML, validated once, every error names its key."""

import re
from pathlib import Path
from typing import Final, Literal

import msgspec

from edge_runtime.common.bounds import GREATEST, MOST_ROBOTS, RATE_HZ, check_bounds
from edge_runtime.common.toml_file import Table, read_toml, refuse, to_record
from edge_runtime.config.beliefs import BeliefSettings, check_beliefs
from edge_runtime.config.network import CarrierSettings, Robot, WatchSettings, check_network
from edge_runtime.config.objectives import make_objectives
from edge_runtime.config.tracked import Tracked, check_tracked
from edge_runtime.config.zenoh import check_zenoh
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import Vector2
from edge_runtime.observation.border import Arena

PUBLIC_KEY: Final = re.compile(r"[0-9a-f]{64}")
OLDEST_STATE_S: Final = 0.1
"""No action ever rests on an own state that is older."""
FLEETS: Final = Path(__file__).parents[1] / "fleets"
TASKS: Final = ("navigation", "balance", "sampling")
"""Packaged fleet files of a simulated team each, one for each packaged policy."""
DEFAULT_FLEET: Final = FLEETS / "navigation.toml"


class Team(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What all robots share."""

    policy: str = "navigation"
    """A packaged policy's name, the directory of a bundle, relative to the fleet file, or ``hf://owner/name``."""
    trusted_keys: tuple[str, ...] = ()
    """Public keys, 64 hexadecimal digits each: one of them must have signed the policy, as edge-export --sign
    does. Where none are named, nobody asks."""
    rate_hz: float | None = None
    """Control rate; the policy's own where None."""
    scale_m: float = 1.0
    """One of the policy's metres, in metres of the robots' world; all else in the file is in the robots'."""
    goal_tolerance_m: float | None = None
    """How near a robot must be to its goal to have reached it; a tenth of the policy's metre where None."""
    max_state_age_s: float = 0.1
    """An own state older than this stops the robot; may be made stricter, never laxer."""
    slew_per_s: float | None = None
    """Greatest change of each action component in a second; unlimited where None."""
    max_action: float | None = None
    """Greatest magnitude of each action component, in its unit; the policy's own limits where None."""
    max_unfamiliar_s: float | None = None
    """For so long a robot may act on observations that training never had; without end where None."""
    training_arena: Arena | None = None
    """The arena that the policy was trained in: a robot beyond observes its own place on the border, see
    `edge_runtime.observation.border`. Where None it observes where it is."""
    own_sources: tuple[str, ...] = ()
    """Classes of one's own by which a policy may observe here, as ``module:Class``; they lie beside the fleet
    file, or are installed. No bundle makes other code run."""

    def __post_init__(self) -> None:
        for key in self.trusted_keys:
            if not PUBLIC_KEY.fullmatch(key):
                raise ValueError(f"`trusted_keys` must be public keys of 64 hexadecimal digits, got {key!r}")
        positive = (1.0 / GREATEST, GREATEST)
        names = ("goal_tolerance_m", "slew_per_s", "max_action", "scale_m")
        check_bounds(self, dict.fromkeys(names, positive))
        check_bounds(self, {"rate_hz": RATE_HZ, "max_state_age_s": (1e-3, OLDEST_STATE_S)})
        check_bounds(self, {"max_unfamiliar_s": (0.0, GREATEST)})

    @property
    def arrival_m(self) -> float:
        """How near to its goal a robot has arrived."""
        return 0.1 * self.scale_m if self.goal_tolerance_m is None else self.goal_tolerance_m


class Obstacle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A disc in the simulated world that no robot moves: a table ``[[obstacle]]``."""

    centre_m: Vector2
    """Where it is when the simulation begins."""
    radius_m: float
    """Of the disc."""
    velocity_m_s: Vector2 = (0.0, 0.0)
    """At which it walks on, straight ahead, whoever stands in its way."""

    def __post_init__(self) -> None:
        check_bounds(self, dict.fromkeys(("centre_m", "velocity_m_s"), (-GREATEST, GREATEST)))
        check_bounds(self, {"radius_m": (1.0 / GREATEST, GREATEST)})


class Simulation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What moves a simulated team: the table ``[simulation]``."""

    plant: Literal["discs", "vmas", "mujoco"] = "discs"
    """``discs``, which every robot's install has, or a workstation's: VMAS's own, or MuJoCo's wheels."""
    scenario: str | None = None
    """Of VMAS: which of the training's tasks its world is; it counts for that plant alone."""
    seed: int = 0
    """Of what a world draws, such as where its samples lie."""
    base: Literal["husky", "limo", "limo_mecanum"] = "husky"
    """Of MuJoCo, as all below: whose bodies, wheels and wheel controllers the robots have."""
    friction: float = 0.7
    """Between wheels and ground."""
    payload_kg: float = 0.0
    """What each robot carries on its top."""

    def __post_init__(self) -> None:
        check_bounds(self, {"seed": (0, 2**31), "friction": (0.05, 1.0), "payload_kg": (0.0, 100.0)})


class Fleet(msgspec.Struct, frozen=True):
    """A fleet file."""

    path: Path
    team: Team
    robots: tuple[Robot, ...]
    objective_set: ObjectiveSet
    """What it asks of the team."""
    carrier: CarrierSettings | None = None
    """The team's network; None if all its robots are simulated in one process."""
    watch: WatchSettings | None = None
    """Who watches the team; nobody where None."""
    obstacles: tuple[Obstacle, ...] = ()
    """What stands and walks in the simulated world beside the robots."""
    tracked: tuple[Tracked, ...] = ()
    """What is no robot, yet has a pose."""
    simulation: Simulation = Simulation()
    """What moves a simulated team."""
    beliefs: tuple[BeliefSettings, ...] = ()
    """What each robot works out for itself."""

    def robot(self, robot_id: int) -> Robot:
        """Return the robot with this id.

        Raises:
            ConfigError: lists the known ids.
        """
        for robot in self.robots:
            if robot.id == robot_id:
                return robot
        known = ", ".join(str(robot.id) for robot in self.robots)
        raise ConfigError(f"{self.path}: robots: none has id {robot_id} (--robot-id); known ids: {known}")


class _FleetTables(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    robots: tuple[Robot, ...]
    team: Team = Team()
    objectives: tuple[Table, ...] = ()
    """What the team is asked, a table ``[[objectives]]`` each: its ``type``, and that type's own keys."""
    guidance: GuidanceSettings = GuidanceSettings()
    carrier: CarrierSettings | None = None
    watch: WatchSettings | None = None
    obstacle: tuple[Obstacle, ...] = ()
    tracked: tuple[Tracked, ...] = ()
    belief: tuple[BeliefSettings, ...] = ()
    simulation: Simulation = Simulation()


def load_fleet(path: Path) -> Fleet:
    """Read a fleet file: team, robots, objectives, guidance, carrier, watch, obstacles and tracked objects.

    Raises:
        ConfigError: names the file, the key and what is allowed.
    """
    fleet = fleet_from(read_toml(path), path)
    if fleet.obstacles and fleet.carrier is not None:
        refuse(path, "obstacle", "means nothing with [carrier]: only a team simulated in one process has any")
    return fleet


def fleet_from(table: Table, path: Path) -> Fleet:
    """Return the fleet of a file's content; raises as `load_fleet`."""
    tables = to_record(table, _FleetTables, path)
    if not tables.robots:
        refuse(path, "robots", "a fleet needs at least one robot")
    if len(tables.robots) > MOST_ROBOTS:
        refuse(path, "robots", f"a fleet has at most {MOST_ROBOTS} robots, got {len(tables.robots)}")
    ids = [robot.id for robot in tables.robots]
    for index, robot_id in enumerate(ids):
        if robot_id in ids[:index]:
            refuse(path, f"robots[{index}].id", f"{robot_id} is taken by robots[{ids.index(robot_id)}]")
    check_network(path, tables.carrier, tables.watch, tables.robots)
    check_zenoh(path, tables.carrier, tables.robots)
    if len(tables.obstacle) > MOST_ROBOTS:
        refuse(path, "obstacle", f"at most {MOST_ROBOTS} are allowed, got {len(tables.obstacle)}")
    check_tracked(path, tables.carrier, tables.tracked)
    check_beliefs(path, tables.belief, [each.name for each in tables.tracked])
    objective_set = ObjectiveSet(make_objectives(tables.objectives, path), tables.guidance)
    return Fleet(
        path,
        tables.team,
        tables.robots,
        objective_set,
        tables.carrier,
        tables.watch,
        tables.obstacle,
        tables.tracked,
        tables.simulation,
        tables.belief,
    )
