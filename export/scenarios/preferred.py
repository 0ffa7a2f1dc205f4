"""A scenario whose robots know their execution objectives already in training: what PC-MAPPO learns on.

Each episode has a preference w on the simplex, w_0 for the task and w_1..w_M for its objectives, drawn
uniformly in training and equal in validation. Every robot observes it and is rewarded by

    r = w_0 r_task / r_step - sum_m w_m x_m,

with ``r_step`` the task's ``NOMINAL_STEP`` and x_m the bounded violations of
``export.scenarios.violations``: at equal weights the grossest violation costs what ``r_step`` earns.
"""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from edge_runtime.errors import ConfigError
from edge_runtime.objectives import Objective
from edge_runtime.observation import Constant
from export.scenarios.definitions import DEFINITIONS
from export.scenarios.scenario import EpisodeMetrics, Scenario, ScenarioFacts, Transition
from export.scenarios.violations import violations

NOMINAL_STEP: dict[str, float] = {"balance": 0.5, "navigation": 0.3, "sampling": 0.85}
"""Nominal reward of a robot in one step that weighs like the grossest violation.

On Navigation 0.3 kept to the objectives, where 0.1, the pay of a robot at its goal, sped; elsewhere it is
what a good policy earns in a step, untuned.
"""


def with_preference(facts: ScenarioFacts) -> ScenarioFacts:
    """Append the field ``preference``: the task's weight, then one for each of its M objectives.

    Robots prefer them alike, as in validation. What they prefer may have a direction: nothing is mirrored.

    Raises:
        ConfigError: if the task has no execution objectives.
    """
    weights = 1 + len(_objectives(facts.name))
    field = Constant("preference", weights, "1", values=(1.0 / weights,) * weights)
    return replace(facts, observation=(*facts.observation, field), mirror=None)


def _objectives(name: str) -> tuple[Objective, ...]:
    if name not in DEFINITIONS:
        known = ", ".join(sorted(DEFINITIONS))
        raise ConfigError(f"no execution objectives are known for scenario '{name}': choose one of {known}")
    return DEFINITIONS[name].objectives


class Preferred:
    """B teams of ``scenario``, each with a preference for the length of its episode.

    Args:
        scenario: the task underneath.
        seed: of the preferences.
        training: draw preferences; else all weights are equal.
    """

    def __init__(self, scenario: Scenario, seed: int, *, training: bool) -> None:
        name = scenario.facts.name
        self.scenario, self.facts = scenario, with_preference(scenario.facts)
        self.environments, self.device = scenario.environments, scenario.device
        self._objectives, self._nominal_step, self._training = _objectives(name), NOMINAL_STEP[name], training
        self._generator = torch.Generator(self.device).manual_seed(seed)
        weights = 1 + len(self._objectives)
        self.preference = torch.empty(self.environments, weights, device=self.device)
        """(B, 1 + M), rows that sum to one."""
        self._prefer(torch.ones(self.environments, dtype=torch.bool, device=self.device))

    def observe(self) -> Tensor:
        """Return the observations (B, N, O): the scenario's, then the preference."""
        observation = self.scenario.observe()
        preference = self.preference[:, None].expand(-1, observation.shape[1], -1)
        return torch.cat([observation, preference], -1)

    def motion(self) -> tuple[Tensor, Tensor]:
        """Return all robots' positions (B, N, 2) in metres and velocities (B, N, 2) in m/s."""
        return self.scenario.motion()

    def step(self, action: Tensor) -> Transition:
        """Apply the actions (B, N, d); rewards are weighted by the preference."""
        transition = self.scenario.step(action)
        violated = violations(self._objectives, self.facts.motion, *self.scenario.motion())
        merits = torch.cat([transition.reward[..., None] / self._nominal_step, -violated], -1)
        return replace(transition, reward=(merits * self.preference[:, None]).sum(-1))

    def reset(self, finished: Tensor) -> None:
        """Start new episodes, with new preferences, where ``finished`` (B,) is true."""
        self.scenario.reset(finished)
        self._prefer(finished)

    def score(self, metrics: EpisodeMetrics) -> float:
        """Return (1 + r) / 2 of the weighted reward r per step: 0.5 is earned by doing nothing at all.

        Not of the return: an episode is followed up to its success only, and success ends the earning.
        """
        return min(max(0.5 + 0.5 * metrics.mean_return / metrics.steps, 0.0), 1.0)

    def state_dict(self) -> dict[str, Any]:
        """Return the scenario's state, the preferences and their generator."""
        return {
            "scenario": self.scenario.state_dict(),
            "preference": self.preference.clone(),
            "generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what ``state_dict`` returned."""
        self.scenario.load_state_dict(state["scenario"])
        self.preference.copy_(state["preference"])
        self._generator.set_state(state["generator"])

    def _prefer(self, rows: Tensor) -> None:
        shape = (int(rows.sum()), self.preference.shape[1])
        if self._training:
            # Normalised exponential draws are uniform on the simplex.
            draws = -torch.rand(shape, generator=self._generator, device=self.device).clamp_min(1e-9).log()
            self.preference[rows] = draws / draws.sum(1, keepdim=True)
        else:
            self.preference[rows] = 1.0 / shape[1]
