"""VMAS Balance: five discs under a loose line lift the package on it to a goal, against gravity.

Simulation and reward are those of VMAS 1.5.2, and in training `GOAL_REWARD` more. Episodes start by this
module's own vectorised reset; the line's inclination is observed as sin(2 angle), since VMAS' own angle
modulo pi jumps where the line is level.
"""

import torch
from torch import Tensor
from vmas.scenarios.balance import Scenario as VmasBalance
from vmas.simulator.core import Agent

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import (
    TrackedGoalOffset,
    TrackedHeading,
    TrackedOffset,
    TrackedVelocity,
    TrackedYawRate,
)
from export.scenarios.balance_starts import (
    LINE_LENGTH_M,
    PACKAGE_RADIUS_M,
    RADIUS_M,
    ROBOTS,
    draw_starts,
)
from export.scenarios.scenario import EpisodeMetrics, Mirror, ScenarioFacts, Transition
from export.scenarios.vmas_teams import FORCES, OWN_MOTION, State, VmasTeams, simulate

FORCE_MULTIPLIER = 0.7
"""Newtons that VMAS makes of one unit of action, on a robot of 1 kg."""
GRAVITY_M_S2 = 0.05
"""On everything. The dynamics below leave it out: it moves all robots alike, so that neither their order
nor their distances feel it."""
DISCOUNT = 0.99
"""At 0.97 the way that a package makes at once by rolling down a tilted line is worth more than what is lost
when it falls off: one episode in ten ended so."""
ON_GOAL_M = 2 * PACKAGE_RADIUS_M
"""Distance at which VMAS' package and goal overlap."""
START_DISTANCE_M = 1.55
"""Mean distance from package to goal when an episode starts."""
FLYING_SHARE = 0.5
"""Share of the training episodes that start in flight, robots anywhere under the line and in motion:
states which guidance leads to and which the policy would not enter by itself."""
FAR_SHARE = 0.35
"""Share of the training episodes whose goal lies on the other side of the middle, half the arena or more away
along x: the ways that take the longest, on a line that tilts the most."""
GOAL_REWARD = 0.5
"""For each step of the training with the package on its goal, about what a step on the way there brings: the
way alone rewards whoever stops a centimetre before it as well."""

HELD_SHARE = 0.5
"""Share of the training episodes in which something holds the robots in a formation: whatever guides them
later pulls all the time, and the policy is to carry on meanwhile. It knows neither formation nor pull."""
HELD_SPACING_M = (0.06, 0.19)
STRONGEST_HOLD = 0.5
"""Of the pull along x, in units of the action."""
HOLD_STIFFNESS_PER_M = 10.0

FACTS = ScenarioFacts(
    name="balance",
    robots=ROBOTS,
    observation=(
        *OWN_MOTION,
        TrackedOffset("package_offset", 2, "m", object="package"),
        TrackedOffset("line_offset", 2, "m", object="line"),
        TrackedGoalOffset("package_goal_offset", 2, "m", object="package"),
        TrackedVelocity("package_velocity", 2, "m/s", object="package"),
        TrackedVelocity("line_velocity", 2, "m/s", object="line"),
        TrackedYawRate("line_angular_velocity", 1, "rad/s", object="line"),
        TrackedHeading("line_sin_2_angle", 1, "1", object="line", symmetry=2, only="sine"),
    ),
    action=FORCES,
    # The multiplier is stated as inertia: one newton moves 1 / 0.7 kg as VMAS' 0.7 N move 1 kg.
    motion=PointForce(mass_kg=1.0 / FORCE_MULTIPLIER, drag=0.25, dt_s=0.1, substeps=1),
    body=Body(radius_m=RADIUS_M, lidar_rays=0, lidar_range_m=0.0),
    training_steps=200,
    evaluation_steps=300,
    discount=DISCOUNT,
    failure="fall",
    mirror=Mirror(observation=(*(-1.0, 1.0) * 7, -1.0, -1.0), action=(-1.0, 1.0)),
)
"""Offsets are position minus package, position minus the line's centre, and package minus goal. In the mirror
x, angle and angular velocity change their signs."""


class _SilentBalance(VmasBalance):
    """VMAS' scenario less its own observations, which ``Balance.observe`` replaces for all robots at once."""

    def observation(self, agent: Agent) -> Tensor:
        return agent.state.pos


class Balance(VmasTeams):
    """B teams of VMAS Balance.

    A team succeeds when package and goal overlap, and goes on to hold it there: the episode does not end.
    It fails, and ends, when the line or the package lies on the floor.
    """

    facts = FACTS

    def __init__(self, environments: int, seed: int, device: torch.device, *, training: bool) -> None:
        self._flying_share = FLYING_SHARE if training else 0.0
        self._far_share = FAR_SHARE if training else 0.0
        self._held_share = HELD_SHARE if training else 0.0
        self._goal_reward = GOAL_REWARD if training else 0.0
        self._slot = torch.zeros(environments, ROBOTS, device=device)
        self._hold = torch.zeros(environments, 1, device=device)
        self._vmas = simulate(_SilentBalance(), environments, seed, device, n_agents=ROBOTS)
        self._world = self._vmas.world
        super().__init__(environments, seed, device, self._vmas.agents)

    def observe(self) -> Tensor:
        """Return the observations (B, N, 16), fields in the order of ``FACTS``."""
        state = self._state()
        own = (
            state["position"],
            state["velocity"],
            state["position"] - state["package"][:, None],
            state["position"] - state["line"][:, None],
        )
        shared = torch.cat(
            [
                state["package"] - state["goal"],
                state["package_velocity"],
                state["line_velocity"],
                state["line_angular_velocity"],
                (2 * state["line_angle"]).sin(),
            ],
            -1,
        )
        return torch.cat([*own, shared[:, None].expand(-1, ROBOTS, -1)], -1)

    def nominal(self) -> Tensor:
        """Return the payload's distance to its goal now, (B,) in metres: Table I's nominal metric."""
        state = self._state()
        return (state["package"] - state["goal"]).norm(dim=-1)

    def step(self, action: Tensor) -> Transition:
        """Apply actions (B, N, 2), the sum with what holds the robots clamped to [-1, 1], for 0.1 s."""
        _, reward, _, _ = self._vmas.step(list((action + self._holding()).unbind(1)))
        fallen, on_goal = self._vmas.scenario.on_the_ground, self.nominal() < ON_GOAL_M
        return Transition(
            reward=torch.stack(reward, 1) + self._goal_reward * on_goal[:, None],
            succeeded=on_goal,
            failed=fallen,
            terminated=fallen,
        )

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return nine tenths of the success rate, plus up to one for the way made towards the goal."""
        # The reward is 100 per metre that the package comes closer.
        progress = metrics.mean_return / (100 * (START_DISTANCE_M - ON_GOAL_M))
        return 0.9 * metrics.success + 0.1 * min(max(progress, 0.0), 1.0)

    def _starts(self, count: int) -> State:
        starts = draw_starts(count, self._flying_share, self._far_share, self._draw)
        slot, hold = self._draw_formations(count)
        return {**starts, "slot": slot, "hold": hold}

    def _draw_formations(self, count: int) -> tuple[Tensor, Tensor]:
        """Draw places along x relative to the line's centre (count, N), and the strongest pull (count, 1)."""
        low, high = HELD_SPACING_M
        middle, spacing, pull, held = self._draw.uniform(count, 4).split(1, 1)
        spacing = low + (high - low) * (0.5 + 0.5 * spacing)
        places = torch.arange(ROBOTS, device=self.device) - (ROBOTS - 1) / 2
        room = LINE_LENGTH_M / 2 - RADIUS_M - spacing * places[-1]
        slot = middle * room.clamp(min=0.0) + spacing * places
        return slot, STRONGEST_HOLD * pull.abs() * (held < 2 * self._held_share - 1)

    def _holding(self) -> Tensor:
        """What pulls the robots to their places, (B, N, 2) in units of the action."""
        state = self._state()
        missing = self._slot - (state["position"] - state["line"][:, None])[..., 0]
        pull = torch.minimum((HOLD_STIFFNESS_PER_M * missing).abs(), self._hold) * missing.sign()
        return torch.stack([pull, torch.zeros_like(pull)], -1)

    def _state(self) -> State:
        scenario = self._vmas.scenario
        package, line = scenario.package.state, scenario.line.state
        return {
            **super()._state(),
            "package": package.pos.clone(),
            "package_velocity": package.vel.clone(),
            "goal": scenario.package.goal.state.pos.clone(),
            "line": line.pos.clone(),
            "line_velocity": line.vel.clone(),
            "line_angle": line.rot.clone(),
            "line_angular_velocity": line.ang_vel.clone(),
            "slot": self._slot.clone(),
            "hold": self._hold.clone(),
        }

    def _set_state(self, state: State) -> None:
        super()._set_state(state)
        scenario = self._vmas.scenario
        package, line = scenario.package.state, scenario.line.state
        package.pos, package.vel = state["package"].clone(), state["package_velocity"].clone()
        scenario.package.goal.state.pos = state["goal"].clone()
        line.pos, line.vel = state["line"].clone(), state["line_velocity"].clone()
        line.rot, line.ang_vel = state["line_angle"].clone(), state["line_angular_velocity"].clone()
        self._slot, self._hold = state["slot"].clone(), state["hold"].clone()
        # What VMAS measures the next step's progress from.
        scenario.global_shaping = self.nominal() * scenario.shaping_factor
