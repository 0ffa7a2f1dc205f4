"""VMAS Sampling: three discs gather samples from a field with three bumps, each cell counting once.

Motion is simulated by VMAS 1.5.2; reward, observation and the starts of episodes are computed here for
all teams at once, equal to VMAS's.
"""

import torch
from torch import Tensor
from vmas.scenarios.sampling import Scenario as VmasSampling

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import Ranges, Sensor
from export.beliefs.field_guesses import BUMPS, HALF_WIDTH_M
from export.beliefs.sample_belief import WALL_M
from export.scenarios.lidar import disc_ranges
from export.scenarios.sample_field import SampleField
from export.scenarios.scenario import EpisodeMetrics, ScenarioFacts, Transition
from export.scenarios.vmas_teams import FORCES, OWN_MOTION, State, VmasTeams

ROBOTS = 3
RADIUS_M = 0.025
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
        *OWN_MOTION,
        Ranges("ranges", 12, "m"),
        Sensor("nearby_samples", 8, "1", sensor="nearby_samples"),
    ),
    action=FORCES,
    motion=PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1),
    body=Body(radius_m=RADIUS_M, lidar_rays=12, lidar_range_m=0.2, lidar_start_rad=0.05),
    training_steps=100,
    evaluation_steps=100,
    discount=0.97,
    failure="collision",
    failure_decides=False,
)
"""``nearby_samples`` are the values, relative to the densest place of the field, of the samples left one
cell (5 cm) away: east, west, north, south, south-west, south-east, north-west, north-east."""


class Sampling(VmasTeams):
    """B teams of VMAS Sampling.

    The task is to gather as much as one can: no episode succeeds. It counts as failed once the centres of
    two robots were at most two radii apart at the end of a control step, but goes on gathering: VMAS lets
    robots bounce without a penalty.
    """

    facts = FACTS

    def __init__(self, environments: int, seed: int, device: torch.device, *, training: bool) -> None:
        self._start_speed = START_SPEED_M_S if training else 0.0
        self._clustered_share = CLUSTERED_SHARE if training else 0.0
        self._vmas = VmasSampling()
        self._world = self._vmas.env_make_world(environments, device, n_agents=ROBOTS)
        self._field = SampleField(environments, WALL_M, device)
        self._gathered = torch.zeros(environments, device=device)
        super().__init__(environments, seed, device, self._world.agents)

    def observe(self) -> Tensor:
        """Return the observations (B, N, 24), fields in the order of ``FACTS``."""
        position, velocity = self.motion()
        nearby = self._field.around(position).flatten(2)[..., NEIGHBOUR_CELLS]
        return torch.cat([position, velocity, disc_ranges(position, FACTS.body), nearby], -1)

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
            failed=self.closest() <= 2 * RADIUS_M,
            terminated=never,
        )

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return the mean return over 150, at most 1."""
        return min(metrics.mean_return / FULL_SCORE_RETURN, 1.0)

    def _starts(self, count: int) -> State:
        centre = HALF_WIDTH_M * self._draw.uniform(count, BUMPS, 2)
        return {
            **self._field.untouched(centre),
            "position": self._places(count),
            "velocity": self._start_speed * self._draw.uniform(count, ROBOTS, 2),
            "gathered": torch.zeros(count, device=self.device),
        }

    def _places(self, count: int) -> Tensor:
        """Draw places (count, N, 2) as VMAS does: from the whole field, then clamped to the walls' faces."""
        place = HALF_WIDTH_M * self._draw.uniform(count, ROBOTS, 2)
        middle = HALF_WIDTH_M * self._draw.uniform(count, 1, 2)
        clustered = self._draw.uniform(count, 1, 1) < 2 * self._clustered_share - 1
        together = middle + CLUSTER_M / HALF_WIDTH_M * place
        return torch.where(clustered, together, place).clamp(-WALL_M, WALL_M)

    def _state(self) -> State:
        return {**super()._state(), **self._field.state(), "gathered": self._gathered.clone()}

    def _set_state(self, state: State) -> None:
        super()._set_state(state)
        self._field.set_state(state)
        self._gathered = state["gathered"].clone()
