"""What every training scenario offers: a batch of B teams of N robots, stepped and reset together."""

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import MotionModel
from edge_runtime.observation import ObservationField
from edge_runtime.policy.manifest import ActionField, Spaces


@dataclass(frozen=True)
class Mirror:
    """A reflection that leaves a task as it is, with its robots in reverse order."""

    observation: tuple[float, ...]
    """(O,), each 1 or -1: what becomes of the numbers that a robot observes."""
    action: tuple[float, ...]
    """(d,), likewise."""


@dataclass(frozen=True)
class ScenarioFacts(Spaces):
    """What a policy trained here must be told about its robots; the bundle's manifest repeats it."""

    name: str
    observation: tuple[ObservationField, ...]
    action: tuple[ActionField, ...]
    robots: int
    training_steps: int
    """Length of a training episode, in control steps; the critic bootstraps beyond it."""
    evaluation_steps: int
    """Time limit of an evaluated episode, in control steps."""
    discount: float
    """Of rewards, a control step: how far ahead training looks."""
    motion: MotionModel
    body: Body
    failure: str
    """What a failed episode is called: ``collision``."""
    failure_decides: bool = True
    """A failed episode counts no further; else it goes on, and can no longer succeed."""
    mirror: Mirror | None = None
    """The symmetry by which training learns from reflected experience as well."""

    @property
    def control_rate_hz(self) -> float:
        """Control steps in a second."""
        return 1.0 / self.motion.dt_s


@dataclass(frozen=True)
class Transition:
    """What one control step brought."""

    reward: Tensor
    """(B, N), each robot's own."""
    succeeded: Tensor
    """(B,) bool: the team's task is done in this state."""
    failed: Tensor
    """(B,) bool: this state is one that the task forbids (a collision, a fallen payload)."""
    terminated: Tensor
    """(B,) bool: the episode ends here by itself, with no value beyond."""


@dataclass(frozen=True)
class EpisodeMetrics:
    """Means over finished episodes; each counts until its first success, deciding failure or time limit."""

    episodes: int
    mean_return: float
    """Sum of the rewards of an episode, averaged over the robots."""
    success: float
    """Share of the episodes that succeeded with no failure before."""
    failure: float
    """Share of the episodes that failed with no success before."""
    steps: float


class Scenario(Protocol):
    """A batch of teams; all tensors lie on the scenario's device."""

    facts: ScenarioFacts
    environments: int
    """B."""
    device: torch.device

    def observe(self) -> Tensor:
        """Return the observations (B, N, O)."""
        ...

    def motion(self) -> tuple[Tensor, Tensor]:
        """Return all robots' positions (B, N, 2) in metres and velocities (B, N, 2) in m/s."""
        ...

    def step(self, action: Tensor) -> Transition:
        """Apply the actions (B, N, d), clamped to their limits, for one control period."""
        ...

    def reset(self, finished: Tensor) -> None:
        """Start new episodes where ``finished`` (B,) is true."""
        ...

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return what validation maximises, in [0, 1] where the task knows success."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Return everything that decides the future of the episodes, generators included."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned."""
        ...
