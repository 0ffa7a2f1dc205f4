"""The on-policy loop that all algorithms share: collect, estimate advantages, update, count."""

import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from edge_runtime.errors import FailedError
from export.algorithms.base import Algorithm, TrainingSettings
from export.algorithms.gae import advantages
from export.algorithms.moments import RunningMoments
from export.algorithms.networks import Critic, team_views
from export.common.distributed import Workers
from export.scenarios.scenario import EpisodeMetrics, Scenario
from export.training.fitted import fitted, require_finite
from export.training.reflection import Experience, with_reflection
from export.training.rollout import Collector, Rollout

CHUNK = 8192
"""Samples evaluated at once where no gradient is needed: bounds memory, stays in the cache."""
ADAPTED_RATES = (0.01, 3.0)
"""Bounds of the adapted learning rate, relative to its setting."""


@dataclass(frozen=True)
class Batch:
    """R samples of single robots, ready to learn from."""

    observation: Tensor
    """(R, O)"""
    action: Tensor
    """(R, d)"""
    trace: Tensor
    """(R, X)"""
    old_log_likelihood: Tensor
    """(R,)"""
    advantage: Tensor
    """(R,), normalised over all workers."""
    team_observation: Tensor
    """(R, N O): ``team_views`` of the normalised observations."""
    value_target: Tensor
    """(R,)"""

    def rows(self, index: Tensor) -> "Batch":
        """Return the samples at ``index``."""
        return Batch(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class UpdateMetrics:
    """Means over the gradient steps of one update."""

    ratio_change: float
    """|ratio - 1|"""
    value_loss: float


class Trainer:
    """One worker's share of a training run; everything that decides its future is in ``state_dict``."""

    def __init__(
        self,
        scenario: Scenario,
        algorithm: Algorithm,
        settings: TrainingSettings,
        generator: torch.Generator,
        workers: Workers,
    ) -> None:
        facts = scenario.facts
        self.algorithm, self.settings, self.workers = algorithm, settings, workers
        self.frames = 0
        self.critic = Critic(facts.observation_dim, facts.robots).to(workers.device)
        algorithm.actor.to(workers.device)
        self.collector = Collector(scenario, generator)
        self._generator = generator
        self._reward_moments = RunningMoments(1).to(workers.device)
        self._discounted = torch.zeros(scenario.environments, facts.robots, device=workers.device)
        self._discount, self._rate = facts.discount, settings.learning_rate
        self._mirror = facts.mirror
        self._averaged = AveragedModel(
            algorithm.actor, avg_fn=partial(_averaged, settings.averaging), use_buffers=True
        )
        self._averaged.update_parameters(algorithm.actor)
        self._optimizer = torch.optim.Adam(
            [{"params": algorithm.actor.parameters()}, {"params": self.critic.parameters()}], eps=1e-5
        )

    @property
    def learning_rate(self) -> float:
        """The actor's present learning rate."""
        return self._rate * self._decay()

    @property
    def progress(self) -> float:
        """Share of the training that is done."""
        return min(self.frames / self.settings.frames, 1.0)

    @property
    def deployed(self) -> Algorithm:
        """The algorithm with the averaged weights (Polyak and Juditsky 1992): what validation drives."""
        deployed = copy.copy(self.algorithm)
        deployed.actor = self._averaged.module
        return deployed

    def iterate(self) -> tuple[EpisodeMetrics | None, UpdateMetrics]:
        """Collect once and learn from it; returns what ended meanwhile and how the update went."""
        rollout = self.collector.collect(self.algorithm, self.settings.steps, self._value)
        metrics = self.update(self.prepare(rollout))
        if self.settings.moving_moments:
            self.algorithm.actor.moments.update(rollout.observation, self.workers)
        self._averaged.update_parameters(self.algorithm.actor)
        self.frames += self.settings.environments * self.settings.steps
        return self.collector.tally.take(self.workers), metrics

    @torch.no_grad()
    def prepare(self, rollout: Rollout) -> Batch:
        """Estimate advantages and value targets, and record the likelihoods before the update."""
        settings = self.settings
        value = self._value(rollout.observation)
        reward = self._scaled(rollout) + self._discount * rollout.cut_value
        advantage = advantages(
            reward,
            value,
            self._value(rollout.last_observation),
            rollout.done,
            discount=self._discount,
            gae_lambda=settings.gae_lambda,
        )
        samples = (rollout.observation, rollout.action, rollout.trace)
        likelihood = self._log_likelihood(*(values.flatten(0, 2) for values in samples))
        seen = Experience(*samples, likelihood.view_as(advantage), advantage, advantage + value)
        if self._mirror:
            seen = with_reflection(seen, self._mirror, self.algorithm.reflect_trace)
        team = team_views(self.algorithm.actor.moments(seen.observation))
        flat = Experience(*(values.flatten(0, 2) for values in seen))
        return Batch(
            flat.observation,
            flat.action,
            flat.trace,
            flat.log_likelihood,
            advantage=self._normalised(flat.advantage),
            team_observation=team.flatten(0, 2),
            value_target=flat.value_target,
        )

    def update(self, batch: Batch) -> UpdateMetrics:
        """Several epochs of minibatches; gradients are averaged over the workers.

        Raises:
            FailedError: if what was learned is no finite number.
        """
        self._set_learning_rates()
        minibatch = self.settings.minibatch // self.workers.count
        metrics = []
        for _ in range(self.settings.epochs):
            order = torch.randperm(
                len(batch.advantage), generator=self._generator, device=self.workers.device
            )
            if self._mirror:  # no more steps than without: each sample or its reflection, as chance has it
                order = order[: len(order) // 2]
            metrics += [self._gradient_step(batch.rows(index)) for index in order.split(minibatch)]
        ratio_change, value_loss = self.workers.mean(torch.stack(metrics).mean(0)).tolist()
        self._require_sense(ratio_change, value_loss)
        self._adapt_learning_rate(ratio_change)
        return UpdateMetrics(ratio_change, value_loss)

    def state_dict(self) -> dict[str, Any]:
        """Return what all workers share."""
        return {
            "frames": self.frames,
            "actor": self.algorithm.actor.state_dict(),
            "averaged": self._averaged.state_dict(),
            "critic": self.critic.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "reward_moments": self._reward_moments.state_dict(),
            "learning_rate": self._rate,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned.

        Raises:
            ValueError: or what Python makes of it, if it is anything else.
        """
        own = self.state_dict()
        moments, groups = state["optimizer"]["state"], own["optimizer"]["param_groups"]
        own["optimizer"] = self._adams_moments() if moments else {}
        taken = fitted({**state, "optimizer": moments}, own)
        self.frames, self._rate = taken["frames"], taken["learning_rate"]
        low, high = self._rates
        if not low <= self._rate <= high:
            raise ValueError(f"learning_rate {self._rate:g} is never adapted to")
        self.algorithm.actor.load_state_dict(taken["actor"])
        self._averaged.load_state_dict(taken["averaged"])
        self._optimizer.load_state_dict({"state": taken["optimizer"], "param_groups": groups})
        self.adopt_critic(taken)

    def adopt_critic(self, state: dict[str, Any]) -> None:
        """Begin with the critic of another run's ``state_dict``, and with its scale of rewards.

        A policy that is good already would be spoilt by the advantages of a critic that knows nothing.
        """
        self.critic.load_state_dict(state["critic"])
        self._reward_moments.load_state_dict(state["reward_moments"])

    def worker_state_dict(self) -> dict[str, Any]:
        """Return what this worker alone knows: its episodes and its generator."""
        return {
            "collector": self.collector.state_dict(),
            "discounted": self._discounted,
            "generator": self._generator.get_state(),
        }

    def load_worker_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``worker_state_dict`` returned, after `load_state_dict`.

        Raises:
            ValueError: or what Python makes of it, if it is anything else, or nothing to go on from.
        """
        taken = fitted(state, self.worker_state_dict())
        self.collector.load_state_dict(taken["collector"])
        self._discounted.copy_(taken["discounted"])
        self._generator.set_state(taken["generator"])
        observation = self.collector.scenario.observe()
        start = observation.new_zeros(*observation.shape[:-1], self.algorithm.actor.action_dim)
        with torch.no_grad():
            actions = [each.act(observation, start) for each in (self.algorithm, self.deployed)]
            require_finite(self._value(observation), *actions)

    def _value(self, observation: Tensor) -> Tensor:
        """Observations (.., N, O) -> values (.., N)."""
        return self.critic(self.algorithm.actor.moments(observation))

    def _log_likelihood(self, *samples: Tensor) -> Tensor:
        chunks = zip(*(x.split(CHUNK) for x in samples), strict=True)
        return torch.cat([self.algorithm.log_likelihood(*chunk) for chunk in chunks])

    def _scaled(self, rollout: Rollout) -> Tensor:
        """Rewards (K, B, N) over the running deviation of their discounted sums."""
        sums = []
        for reward, done in zip(rollout.reward, rollout.done, strict=True):
            self._discounted = self._discount * self._discounted + reward
            sums.append(self._discounted)
            self._discounted = self._discounted * (~done)[:, None]
        self._reward_moments.update(torch.stack(sums)[..., None], self.workers)
        return rollout.reward / self._reward_moments.deviation.to(rollout.reward.dtype)

    def _normalised(self, advantage: Tensor) -> Tensor:
        mean = self.workers.mean(advantage.mean())
        deviation = self.workers.mean((advantage - mean).square().mean()).sqrt()
        return (advantage - mean) / (deviation + 1e-8)

    def _gradient_step(self, batch: Batch) -> Tensor:
        """Return |ratio - 1| and the critic's loss, both averaged over the samples."""
        new = self.algorithm.log_likelihood(batch.observation, batch.action, batch.trace)
        ratio = self.algorithm.ratio(new, batch.old_log_likelihood)
        surrogate = self.algorithm.objective(ratio, batch.advantage).mean()
        value_loss = (
            0.5 * (self.critic.own_value(batch.team_observation) - batch.value_target).square().mean()
        )
        self._optimizer.zero_grad()
        (value_loss - surrogate).backward()
        self.workers.average_gradients([*self.algorithm.actor.parameters(), *self.critic.parameters()])
        for network in (self.algorithm.actor, self.critic):
            nn.utils.clip_grad_norm_(network.parameters(), self.settings.gradient_limit)
        self._optimizer.step()
        return torch.stack([(ratio.detach() - 1).abs().mean(), value_loss.detach()])

    def _adams_moments(self) -> dict[int, dict[str, Tensor]]:
        """The optimizer's state, once there is one."""
        parameters = [p for group in self._optimizer.param_groups for p in group["params"]]
        return {
            k: {"step": torch.zeros(()), "exp_avg": torch.zeros_like(p), "exp_avg_sq": torch.zeros_like(p)}
            for k, p in enumerate(parameters)
        }

    @property
    def _rates(self) -> tuple[float, float]:
        """Bounds of the learning rate before it decays."""
        low, high = ADAPTED_RATES
        return low * self.settings.learning_rate, high * self.settings.learning_rate

    def _require_sense(self, *metrics: float) -> None:
        weights = (*self.algorithm.actor.parameters(), *self.critic.parameters())
        try:
            require_finite(torch.tensor(metrics), *weights)
        except ValueError as error:
            raise FailedError(
                f"training came apart after {self.frames} frames: what it learned is no finite number; "
                "train again into a new directory with another --seed"
            ) from error

    def _decay(self) -> float:
        return 1.0 - (1.0 - self.settings.final_learning_rate) * self.progress

    def _set_learning_rates(self) -> None:
        actor, critic = self._optimizer.param_groups
        actor["lr"] = self.learning_rate
        critic["lr"] = self.settings.critic_learning_rate * self._decay()

    def _adapt_learning_rate(self, ratio_change: float) -> None:
        wanted = self.settings.ratio_change
        if wanted is None:
            return
        factor = 1 / 1.2 if ratio_change > 1.5 * wanted else 1.1 if ratio_change < 0.7 * wanted else 1.0
        low, high = self._rates
        self._rate = min(max(self._rate * factor, low), high)


def _averaged(share: float, averaged: Tensor, present: Tensor, updates: Tensor | int) -> Tensor:
    """Average weights over the last tenth of the updates so far, until ``share`` reaches no further back."""
    kept = min(share, (1.0 + float(updates)) / (10.0 + float(updates)))
    return averaged.lerp(present, 1.0 - kept)
