"""What one run is about, put together from the fleet, the bundle and the flags, and checked as a whole."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from edge_runtime.common.toml_file import refuse
from edge_runtime.config.beliefs import make_beliefs
from edge_runtime.config.fleet import Fleet, Team
from edge_runtime.config.network import Robot
from edge_runtime.config.objectives import parse_objective_set
from edge_runtime.control.controller import Controller
from edge_runtime.control.limits import RobotLimits, robot_limits
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import Guide, check_objectives, guide_for
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.objectives import BUILT_IN, Objective
from edge_runtime.observation import GoalOffset, Sensor, Source, Tracked, TrackedGoalOffset
from edge_runtime.observation.border import Border, observes_place
from edge_runtime.observation.familiarity import Familiarity, knows_training
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.adaptation import Adaptation, adapt
from edge_runtime.policy.backend import Backend
from edge_runtime.policy.bundle import MANIFEST_FILE, Bundle
from edge_runtime.policy.velocity_field import VelocityField

NOWHERE: Final = (math.nan, math.nan)
"""Goal of a robot that has none: whoever observes it stops the robot."""


def adaptation_of(robot: Robot, team: Team) -> Adaptation:
    """Return where a robot differs from the policy's, as its fleet file says."""
    most = team.max_action if robot.max_action is None else robot.max_action
    return Adaptation(robot.mass_kg, robot.drag, most, team.scale_m, team.training_arena)


def adapted(bundle: Bundle, robot: Robot, team: Team) -> Bundle:
    """Return a policy's bundle as one of a fleet's robots runs it."""
    return adapt(bundle, adaptation_of(robot, team))


@dataclass(frozen=True)
class Mission:
    """One robot's run in its team.

    Raises:
        ConfigError: if the robot is not in the fleet, two of the policy's discs would overlap at their
            starts or goals, one would start within an obstacle, or an objective needs to see what the
            robot cannot see.
    """

    robot_id: int
    fleet: Fleet
    bundle: Bundle
    objective_set: ObjectiveSet
    """What it starts with."""
    rate_hz: float
    seed: int = 0
    guided: bool = True
    """False leaves the flow alone; reports still say what the objectives would have wanted."""
    backend: Backend = "auto"
    """What computes the policy."""
    own_sources: tuple[type[Source], ...] = ()
    """Code of the user's own that it may observe by."""

    def __post_init__(self) -> None:
        self.fleet.robot(self.robot_id)
        self._check_dims()
        self._check_apart("start_m")
        self._check_apart("goal_m")
        self._check_goals()
        self._check_obstacles()
        self._check_sight(self.objective_set)
        if self.guided:
            check_objectives(self.objective_set, self.bundle.manifest.motion, f"{self.bundle.directory}: ")
        self._check_familiarity()
        self._check_arena()
        self._check_sources()
        self._observer(self.fleet.robot(self.robot_id))  # which own sources may refuse
        make_beliefs(self.fleet.path, self.fleet.beliefs)  # which their code may refuse

    @property
    def objectives(self) -> tuple[Objective, ...]:
        """The objectives that steer."""
        return self.objective_set.objectives if self.guided else ()

    @property
    def period_s(self) -> float:
        """The control period."""
        return 1.0 / self.rate_hz

    def guide(self) -> Guide:
        """Make ready what guides the robot from the start."""
        return self._ready(self.objective_set)

    def guide_of(self, file: str, content: bytes) -> Guide:
        """Make ready an objectives file that came over the network, as if it lay beside the fleet file.

        It may name the own objectives that the robot's files named at its start; no code is loaded for it.

        Raises:
            ConfigError: names what does not hold together, or says that this robot is not guided.
        """
        if not self.guided:
            raise ConfigError("this robot runs with --no-guidance")
        known = {type(one) for one in (*self.fleet.objective_set.objectives, *self.objective_set.objectives)}
        own = known.difference(BUILT_IN)
        asked = parse_objective_set(content, self.fleet.path.parent / Path(file).name, own)
        self._check_sight(asked)
        return self._ready(asked)

    @cached_property
    def policy(self) -> VelocityField:
        """What computes the policy, prepared once: controllers of one mission share it and take turns.

        Raises:
            PolicyError: if the backend cannot run the bundle's policy.
        """
        return self.bundle.field(self.backend)

    def controller(
        self, robot_id: int, max_speed_m_s: float = math.inf, max_yaw_rate_rad_s: float = math.inf
    ) -> Controller:
        """Prepare the decisions of one of the fleet's robots.

        Args:
            robot_id: whose.
            max_speed_m_s: greatest velocity setpoint that the link to the robot takes.
            max_yaw_rate_rad_s: greatest yaw rate that it takes.

        Raises:
            PolicyError: if the policy cannot be computed.
            ConfigError: if it observes by code that may not run here.
        """
        robot, team, observed = self.fleet.robot(robot_id), self.fleet.team, self.bundle.manifest.observation
        return Controller(
            robot.id,
            self._observer(robot),
            self.policy,
            self.guide(),
            self._limits(robot, max_speed_m_s, max_yaw_rate_rad_s),
            Familiarity(observed),
            Border(observed, team.training_arena, team.scale_m),
            make_beliefs(self.fleet.path, self.fleet.beliefs),
            self.seed * 2**16 + robot.id,
        )

    def _observer(self, robot: Robot) -> Observer:
        path, scale_m = str(self.bundle.directory / MANIFEST_FILE), self.fleet.team.scale_m
        return Observer(
            self.bundle.manifest, robot.goal_m or NOWHERE, scale_m, own=self.own_sources, path=path
        )

    def _ready(self, asked: ObjectiveSet) -> Guide:
        return guide_for(self.bundle.manifest, asked, guided=self.guided)

    def _limits(self, robot: Robot, max_speed_m_s: float, max_yaw_rate_rad_s: float) -> RobotLimits:
        team = self.fleet.team
        slew_per_s = math.inf if team.slew_per_s is None else team.slew_per_s
        slew_per_s = slew_per_s if robot.slew_per_s is None else robot.slew_per_s
        return robot_limits(
            self.bundle.manifest,
            self.period_s,
            max_step=slew_per_s * self.period_s,
            max_state_age_s=team.max_state_age_s,
            max_speed_m_s=min(max_speed_m_s, robot.max_speed_m_s or math.inf),
            max_unfamiliar_s=math.inf if team.max_unfamiliar_s is None else team.max_unfamiliar_s,
            max_yaw_rate_rad_s=max_yaw_rate_rad_s,
        )

    def _check_sight(self, asked: ObjectiveSet) -> None:
        """Refuse objectives over obstacles where no sensor sees any, or over what nobody tracks."""
        fleet, body = self.fleet, self.bundle.manifest.body
        if asked.guidance.goal_reach is not None and all(each.goal_m is None for each in fleet.tracked):
            refuse(fleet.path, "tracked", "none has a `goal_m`, which `goal_reach` waits for")
        for objective in asked.objectives:
            self._check_tracked(objective)
            if not objective.sight_m:
                continue
            if objective.sight_m > body.lidar_range_m:
                raise ConfigError(
                    f"{self.bundle.directory}: body.lidar_range_m: {objective.name} needs to see "
                    f"{objective.sight_m:g} m far; allowed with this sensor: {body.lidar_range_m:g} m"
                )
            index = [robot.id for robot in fleet.robots].index(self.robot_id)
            if fleet.carrier is not None and fleet.robots[index].ranges_place is None:
                refuse(
                    fleet.path,
                    f"robots[{index}].ranges",
                    f'"teammates" shows no obstacles, which {objective.name} needs to see; allowed: the '
                    "address of a stream, such as 10.0.0.5:47100",
                )

    def _check_tracked(self, objective: Objective) -> None:
        fleet = self.fleet
        known = [*(each.name for each in fleet.tracked), *(each.name for each in fleet.beliefs)]
        for name in objective.looks_at:
            if name not in known:
                refuse(
                    self.fleet.path,
                    "tracked",
                    f"{objective.name} looks at {name!r}, which is none of them; allowed: "
                    f"{', '.join(known) or 'none'}",
                )

    def _check_goals(self) -> None:
        """Refuse a policy that observes the way to a goal where a robot has none."""
        manifest = self.bundle.manifest
        for index, robot in enumerate(self.fleet.robots):
            if robot.goal_m is None and any(isinstance(field, GoalOffset) for field in manifest.observation):
                key = f"robots[{index}].goal_m"
                refuse(self.fleet.path, key, f"missing: policy {manifest.name!r} observes the way to it")

    def _check_familiarity(self) -> None:
        """Refuse to judge by ranges that nobody knows."""
        asked = self.fleet.team.max_unfamiliar_s is not None
        if asked and not knows_training(self.bundle.manifest.observation):
            refuse(
                self.fleet.path,
                "team.max_unfamiliar_s",
                f"policy {self.bundle.manifest.name!r} does not say what it saw in training; "
                "leave it out, or export the policy again (a graph: with --calibration FILE.npz)",
            )

    def _check_arena(self) -> None:
        """Refuse an arena of other axes than the robot's, or for a policy that knows no place."""
        arena, manifest = self.fleet.team.training_arena, self.bundle.manifest
        if arena is None:
            return
        found, dims, policy = len(arena.low_m), manifest.motion.dims, f"policy {manifest.name!r}"
        if found != dims:
            wrong = f"has {found} components; allowed with {policy}: {dims}"
            refuse(self.fleet.path, "team.training_arena.low_m", wrong)
        if not observes_place(manifest.observation):
            wrong = f"{policy} does not observe where it is; leave it out"
            refuse(self.fleet.path, "team.training_arena", wrong)

    def _check_sources(self) -> None:
        """Refuse a policy that observes what nobody tells this robot."""
        path, fleet = self.bundle.directory / MANIFEST_FILE, self.fleet
        tracked = {each.name: each for each in fleet.tracked}
        sensors = list(fleet.robot(self.robot_id).sensors)
        for index, field in enumerate(self.bundle.manifest.observation):
            key = f"observation[{index}]"
            networked = fleet.carrier is not None  # else the simulation tells, or says that it cannot
            if networked and isinstance(field, Sensor) and field.sensor not in sensors:
                refuse(path, f"{key}.sensor", _not_told(field.sensor, "sensors of the robot", fleet, sensors))
            if isinstance(field, Tracked) and field.object not in tracked:
                refuse(path, f"{key}.object", _not_told(field.object, "[[tracked]]", fleet, list(tracked)))
            if isinstance(field, TrackedGoalOffset) and tracked[field.object].goal_m is None:
                refuse(
                    fleet.path,
                    f"tracked[{list(tracked).index(field.object)}].goal_m",
                    "missing: the policy observes it",
                )

    def _check_obstacles(self) -> None:
        for index, obstacle in enumerate(self.fleet.obstacles):
            least = obstacle.radius_m + self.bundle.manifest.body.radius_m
            for robot in self.fleet.robots:
                distance = math.dist(obstacle.centre_m, robot.start_m[:2])
                if distance < least:
                    raise ConfigError(
                        f"{self.fleet.path}: obstacle[{index}].centre_m: {distance:.3f} m from the start of "
                        f"robot {robot.id}; their discs need at least {least:g} m"
                    )

    def _check_dims(self) -> None:
        """Refuse places of the plane for robots in space, and the other way round."""
        dims = self.bundle.manifest.motion.dims
        for index, robot in enumerate(self.fleet.robots):
            for place in ("start_m", "goal_m"):
                found = len(getattr(robot, place) or (0.0,) * dims)
                if found != dims:
                    refuse(
                        self.fleet.path,
                        f"robots[{index}].{place}",
                        f"has {found} components; allowed with policy {self.bundle.manifest.name!r}: {dims}",
                    )

    def _check_apart(self, place: str) -> None:
        diameter = 2.0 * self.bundle.manifest.body.radius_m
        robots: tuple[Robot, ...] = self.fleet.robots
        for index, robot in enumerate(robots):
            for other in robots[:index]:
                own, others = getattr(robot, place), getattr(other, place)
                if own is not None and others is not None and (distance := math.dist(own, others)) < diameter:
                    raise ConfigError(
                        f"{self.fleet.path}: robots[{index}].{place}: {distance:.3f} m from that of robot "
                        f"{other.id}; their discs need at least {diameter:g} m"
                    )


def _not_told(name: str, table: str, fleet: Fleet, known: Sequence[str]) -> str:
    return f"{name!r} is none of {table} in {fleet.path}; allowed: {', '.join(known) or 'none'}"
