"""VMAS Sampling: three discs gather samples from a field with three bumps, each cell counting once.

Motion is simulated by VMAS 1.5.2; reward, observation and the starts of episodes are computed here for
all teams at once, equal to VMAS's.
"""

import contextlib
import io
from typing import Any

import torch
from torch import Tensor

from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.policy.manifest import ActionField, Body, ObservationField
from export.scenarios.lidar import disc_ranges
from export.scenarios.sample_field import BUMPS, HALF_WIDTH_M, SampleField
from export.scenarios.scenario import EpisodeMetrics, ScenarioFacts, Transition

with contextlib.redirect_stderr(io.StringIO()):  # gym prints an advertisement for its successor
    from vmas.scenarios.sampling import Scenario as VmasSampling

ROBOTS = 3
RADIUS_M = 0.025
WALL_M = HALF_WIDTH_M - RADIUS_M
"""Robots' centres stay within a square of this half-width."""
NEIGHBOUR_CELLS = (7, 1, 5, 3, 0, 6, 2, 8)
"""VMAS's order of the neighbouring samples: of a 3 x 3 window by x, then y, without the robot's own."""
START_SPEED_M_S = 0.3
"""Training episodes start moving, up to this speed along each axis, so that the policy also knows
states that guidance leads to and that it would not enter by itself."""
CLUSTERED_SHARE = 0.3
"""Share of the training episodes whose robots start close together, as an objective may ask of a team
that would rather spread: within a square of half-width ``CLUSTER_M`` somewhere in the field."""
CLUSTER_M = 0.4
FULL_SCORE_RETURN = 150.0
"""Return of an episode that scores 1, out of reach in 100 steps: good policies gather 80 to 90."""

FACTS = ScenarioFacts(
    name="sampling",
    robots=ROBOTS,
    observation=(
        ObservationField("position", 2, "m"),
        ObservationField("velocity", 2, "m/s"),
        ObservationField("ranges", 12, "m"),
        ObservationField("nearby_samples", 8, "1"),
    ),
    action=(ActionField("force_x", "N", -1.0, 1.0), ActionField("force_y", "N", -1.0, 1.0)),
    dynamics=Dynamics(mass_kg=1.0, drag=0.25, dt_s=0.1),
    body=Body(radius_m=RADIUS_M, lidar_rays=12, lidar_range_m=0.2, lidar_start_rad=0.05),
    training_steps=100,
    evaluation_steps=100,
    failure="collision",
    failure_decides=False,
)
"""``nearby_samples`` are the values, relative to the densest place of the field, of the samples left one
cell (5 cm) away: east, west, north, south, south-west, south-east, north-west, north-east."""


class Sampling:
    """B teams of VMAS Sampling.

    The task is to gather as much as one can: no episode succeeds. It counts as failed once the centres of
    two robots were at most two radii apart at the end of a control step, but goes on gathering: VMAS lets
    robots bounce without a penalty.
    """

    facts = FACTS

    def __init__(self, environments: int, seed: int, device: torch.device, *, training: bool) -> None:
        self.environments = environments
        self.device = device
        self._start_speed = START_SPEED_M_S if training else 0.0
        self._clustered_share = CLUSTERED_SHARE if training else 0.0
        self._generator = torch.Generator(device).manual_seed(seed)
        self._vmas = VmasSampling()
        self._world = self._vmas.env_make_world(environments, device, n_agents=ROBOTS)
        self._field = SampleField(environments, WALL_M, device)
        self._gathered = torch.zeros(environments, device=device)
        self.reset()

    def observe(self) -> Tensor:
        """Return the observations (B, N, 24), fields in the order of ``FACTS``."""
        position, velocity = self.motion()
        nearby = self._field.around(position).flatten(2)[..., NEIGHBOUR_CELLS]
        return torch.cat([position, velocity, disc_ranges(position, FACTS.body), nearby], -1)

    def motion(self) -> tuple[Tensor, Tensor]:
        """Return the robots' positions (B, N, 2) in metres and velocities (B, N, 2) in m/s."""
        states = [agent.state for agent in self._world.agents]
        return torch.stack([state.pos for state in states], 1), torch.stack(
            [state.vel for state in states], 1
        )

    def nominal(self) -> Tensor:
        """Return the samples (B,) gathered so far in the episodes, in units of VMAS's reward."""
        return self._gathered.clone()

    def step(self, action: Tensor) -> Transition:
        """Apply forces (B, N, 2) in newtons, clamped to [-1, 1], for 0.1 s."""
        for agent, force in zip(self._world.agents, action.clamp(-1.0, 1.0).unbind(1), strict=True):
            agent.action.u = force
            self._vmas.env_process_action(agent)
        self._world.step()
        position, _ = self.motion()
        reward = self._field.collect(position).sum(1)
        self._gathered += reward
        never = torch.zeros(self.environments, dtype=torch.bool, device=self.device)
        return Transition(
            reward=reward[:, None].expand(-1, ROBOTS),
            succeeded=never,
            failed=_closest(position) <= 2 * RADIUS_M,
            terminated=never,
        )

    def reset(self, finished: Tensor | None = None) -> None:
        """Start new episodes where ``finished`` (B,) is true; everywhere if it is None."""
        if finished is None:
            finished = torch.ones(self.environments, dtype=torch.bool, device=self.device)
        rows = finished.nonzero()[:, 0]
        self._field.renew(rows, HALF_WIDTH_M * self._symmetric(len(rows), BUMPS, 2))
        position, velocity = self.motion()
        position[rows] = self._starts(len(rows))
        velocity[rows] = self._start_speed * self._symmetric(len(rows), ROBOTS, 2)
        self._set_motion(position, velocity)
        self._gathered[rows] = 0.0

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return the mean return over 150, at most 1."""
        return min(metrics.mean_return / FULL_SCORE_RETURN, 1.0)

    def state_dict(self) -> dict[str, Any]:
        """Return motion, fields, what was gathered, and the generator."""
        position, velocity = self.motion()
        return {
            "position": position,
            "velocity": velocity,
            "gathered": self._gathered.clone(),
            "centre": self._field.centre.clone(),
            "densest": self._field.densest.clone(),
            "emptied": self._field.emptied.clone(),
            "generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned."""
        self._set_motion(state["position"].to(self.device), state["velocity"].to(self.device))
        self._gathered.copy_(state["gathered"])
        for name in ("centre", "densest", "emptied"):
            getattr(self._field, name).copy_(state[name])
        self._generator.set_state(state["generator"])

    def _starts(self, count: int) -> Tensor:
        """Draw places (count, N, 2) as VMAS does: from the whole field, then clamped to the walls' faces."""
        place = HALF_WIDTH_M * self._symmetric(count, ROBOTS, 2)
        middle = HALF_WIDTH_M * self._symmetric(count, 1, 2)
        clustered = self._symmetric(count, 1, 1) < 2 * self._clustered_share - 1
        together = middle + CLUSTER_M / HALF_WIDTH_M * place
        return torch.where(clustered, together, place).clamp(-WALL_M, WALL_M)

    def _symmetric(self, *shape: int) -> Tensor:
        """Draw from [-1, 1]."""
        return 2 * torch.rand(shape, generator=self._generator, device=self.device) - 1

    def _set_motion(self, position: Tensor, velocity: Tensor) -> None:
        for i, agent in enumerate(self._world.agents):
            agent.state.pos = position[:, i].contiguous()
            agent.state.vel = velocity[:, i].contiguous()


def _closest(position: Tensor) -> Tensor:
    """Return the least distance between two robots' centres, (B,) in metres."""
    first, second = torch.triu_indices(ROBOTS, ROBOTS, 1, device=position.device)
    return (position[:, first] - position[:, second]).norm(dim=-1).amin(1)
