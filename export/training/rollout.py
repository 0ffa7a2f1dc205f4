"""Collecting experience and validating: the two ways in which a policy meets a scenario."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from export.algorithms.base import Algorithm
from export.common.distributed import Workers
from export.scenarios.scenario import EpisodeMetrics, Scenario, Transition


@dataclass(frozen=True)
class Rollout:
    """K control steps of B teams of N robots."""

    observation: Tensor
    """(K, B, N, O)"""
    action: Tensor
    """(K, B, N, d)"""
    trace: Tensor
    """(K, B, N, X), see ``Algorithm``."""
    reward: Tensor
    """(K, B, N)"""
    cut_value: Tensor
    """(K, B, N): the critic's value beyond the time limit where it cut an episode, else zero."""
    done: Tensor
    """(K, B) bool"""
    last_observation: Tensor
    """(B, N, O)"""


class EpisodeTally:
    """Follows the episodes of B environments and sums up those that end."""

    def __init__(self, environments: int, device: torch.device, *, failure_decides: bool = True) -> None:
        self._failure_decides = failure_decides
        self.returns = torch.zeros(environments, device=device)
        self.steps = torch.zeros(environments, device=device)
        self.succeeded = torch.zeros(environments, dtype=torch.bool, device=device)
        self.failed = torch.zeros(environments, dtype=torch.bool, device=device)
        self._sums = torch.zeros(5, dtype=torch.float64, device=device)

    @property
    def decided(self) -> Tensor:
        """(B,) bool: succeeded, or failed where that decides."""
        return self.succeeded | self.failed if self._failure_decides else self.succeeded

    def add(self, transition: Transition) -> None:
        """Count one control step of the episodes that are still undecided."""
        open_ = ~self.decided
        self.returns += open_ * transition.reward.mean(1)
        self.steps += open_
        self.failed |= open_ & transition.failed
        self.succeeded |= open_ & transition.succeeded & ~self.failed

    def close(self, finished: Tensor) -> None:
        """Add the episodes where ``finished`` (B,) to the sums, and start them anew."""
        columns = (torch.ones_like(self.returns), self.returns, self.succeeded, self.failed, self.steps)
        self._sums += torch.stack([column[finished].double().sum() for column in columns])
        for column in columns[1:]:
            column[finished] = 0

    def take(self, workers: Workers) -> EpisodeMetrics | None:
        """Return the means over all workers' closed episodes since the last call; None if there were none."""
        sums = (workers.mean(self._sums) * workers.count).tolist()
        self._sums.zero_()
        if not sums[0]:
            return None
        return EpisodeMetrics(int(sums[0]), *(total / sums[0] for total in sums[1:]))

    def state_dict(self) -> dict[str, Tensor]:
        """Return the running episodes' counts."""
        return {name: getattr(self, name) for name in ("returns", "steps", "succeeded", "failed")}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Continue from what ``state_dict`` returned."""
        for name, value in state.items():
            getattr(self, name).copy_(value)


class Collector:
    """Runs the exploring policy, restarting each environment at its own time.

    The first episodes are cut at staggered lengths, so that every roll-out holds all phases of a task.
    """

    def __init__(self, scenario: Scenario, generator: torch.Generator) -> None:
        self.scenario = scenario
        self.tally = _tally(scenario)
        self._generator = generator
        self._limit = scenario.facts.training_steps
        self._clock = torch.randint(
            self._limit, (scenario.environments,), generator=generator, device=scenario.device
        )

    @torch.no_grad()
    def collect(self, algorithm: Algorithm, steps: int, value: Callable[[Tensor], Tensor]) -> Rollout:
        """Take ``steps`` control steps; ``value`` maps observations (.., N, O) to values (.., N)."""
        rows = []
        observation = self.scenario.observe()
        for _ in range(steps):
            action, trace = algorithm.explore(observation, self._generator)
            transition = self.scenario.step(action)
            after = self.scenario.observe()
            self._clock += 1
            self.tally.add(transition)
            done = transition.terminated | (self._clock >= self._limit)
            cut_value = torch.zeros_like(transition.reward)
            cut = done & ~transition.terminated
            if cut.any():
                cut_value[cut] = value(after[cut])
            rows.append((observation, action, trace, transition.reward, cut_value, done))
            observation = self._restart(done, after)
        return Rollout(*(torch.stack(column) for column in zip(*rows, strict=True)), observation)

    def state_dict(self) -> dict[str, Any]:
        """Return the episodes under way and the clock of each."""
        return {
            "scenario": self.scenario.state_dict(),
            "tally": self.tally.state_dict(),
            "clock": self._clock,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned."""
        self.scenario.load_state_dict(state["scenario"])
        self.tally.load_state_dict(state["tally"])
        self._clock.copy_(state["clock"])

    def _restart(self, done: Tensor, observation: Tensor) -> Tensor:
        if not done.any():
            return observation
        self.tally.close(done)
        self.scenario.reset(done)
        self._clock[done] = 0
        return self.scenario.observe()


def _tally(scenario: Scenario) -> EpisodeTally:
    return EpisodeTally(
        scenario.environments, scenario.device, failure_decides=scenario.facts.failure_decides
    )


@torch.no_grad()
def evaluate(
    scenario: Scenario,
    act: Callable[[Tensor, Tensor], Tensor],
    generator: torch.Generator,
    zero_start: Tensor,
) -> EpisodeTally:
    """Run one episode in every environment of a fresh scenario, as deployed.

    Args:
        scenario: B environments at the start of their episodes.
        act: observations (B, N, O) and noise (B, N, d) -> actions (B, N, d).
        generator: of the noise.
        zero_start: (B,) bool: where the flow starts from zero instead of noise.

    Returns:
        The tally of the B episodes, not yet closed.
    """
    tally = _tally(scenario)
    shape = (scenario.environments, scenario.facts.robots, scenario.facts.action_dim)
    for _ in range(scenario.facts.evaluation_steps):
        start = torch.randn(shape, generator=generator, device=scenario.device)
        start[zero_start] = 0
        tally.add(scenario.step(act(scenario.observe(), start)))
        if tally.decided.all():
            break
    return tally
