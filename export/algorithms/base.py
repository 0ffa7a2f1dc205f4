"""What the trainer asks of an on-policy algorithm; each lives in a file of its own."""

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from export.algorithms.networks import Actor


@dataclass(frozen=True)
class TrainingSettings:
    """How much is collected and how hard it is learned from; the same for all workers together."""

    frames: int = 700_000
    """Control steps of the team in total."""
    environments: int = 512
    epochs: int = 4
    steps: int = 25
    """Control steps in each environment between two updates."""
    minibatch: int = 3200
    """Samples of single robots in one gradient step."""
    ratio_change: float | None = None
    """Mean |ratio - 1| that the actor's learning rate is adapted to keep; None leaves the rate alone."""
    gae_lambda: float = 0.9
    learning_rate: float = 1e-3
    critic_learning_rate: float = 1e-3
    final_learning_rate: float = 0.05
    """Share of the learning rates that a linear decay leaves at the end."""
    moving_moments: bool = True
    """Whether what normalises observations goes on following them. A policy that changes little cannot
    follow it: where one begins well trained, it stays."""
    gradient_limit: float = 1.0
    averaging: float = 0.8
    """Share of the averaged weights that a late update leaves in place: these are validated and deployed."""
    validation_every: int = 25
    """Updates between two validations; a checkpoint follows every update."""
    validation_episodes: int = 512
    guided_episodes: int = 256
    """Of a validation, besides those: episodes that ask for execution objectives, too; 0: none."""
    guided_from: float = 0.5
    """Share of the frames before which no validation is guided: what is learned by then is not chosen."""

    @property
    def whole_frames(self) -> int:
        """``frames``, rounded up to whole updates: where training ends."""
        return math.ceil(self.frames / (self.environments * self.steps)) * self.environments * self.steps


class Algorithm(Protocol):
    """Explores with a policy, and says by how much other weights would change what it did.

    R stands for any leading shape, d for the action's size and X for that of the trace: whatever the
    algorithm must remember of how an action came about in order to take its ratio later.
    """

    name: str
    actor: Actor
    euler_steps: int
    settings: TrainingSettings

    def explore(self, observation: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Observations (R, O) -> actions (R, d) and traces (R, X)."""
        ...

    def log_likelihood(self, observation: Tensor, action: Tensor, trace: Tensor) -> Tensor:
        """Log-likelihood (R,) of what was explored, or its surrogate, under the present weights."""
        ...

    def ratio(self, new: Tensor, old: Tensor) -> Tensor:
        """Probability ratio (R,) of two log-likelihoods."""
        ...

    def objective(self, ratio: Tensor, advantage: Tensor) -> Tensor:
        """What each sample adds to the surrogate objective to maximise, (R,)."""
        ...

    def reflect_trace(self, trace: Tensor, signs: Tensor) -> Tensor:
        """Traces (R, X) of actions -> those of the actions times ``signs`` (d,), each 1 or -1."""
        ...

    def act(self, observation: Tensor, start: Tensor) -> Tensor:
        """Actions (R, d) as deployed, made from standard normal noise ``start`` (R, d)."""
        ...
