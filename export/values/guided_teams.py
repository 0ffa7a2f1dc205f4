"""Teams whose actions are corrected before they act, each as other objectives ask: where guidance leads."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.guide import Guide, make_guide
from export.episodes.carried import distance_left
from export.episodes.judges import motion
from export.episodes.neighbourhood import Neighbourhood, Setting
from export.episodes.varied import varied
from export.evaluation.guidance import corrected_actions
from export.scenarios.scenario import Scenario, Transition

WAYS = 8
"""Of asking; teams are dealt out to them."""
SHARE = 0.75
"""Of the teams that are guided; the others do as they like."""


class GuidedTeams:
    """B teams of ``scenario``, most of them guided.

    Args:
        scenario: the task underneath.
        seed: of what is asked.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self.scenario, self.facts = scenario, scenario.facts
        self.environments = scenario.environments
        asked = (varied(self.facts.name, seed + way).asked for way in range(WAYS))
        guided = np.arange(int(SHARE * self.environments))
        self._guides: list[tuple[np.ndarray, Guide]] = [
            (teams, make_guide(each, self.facts.motion))
            for teams, each in zip(np.array_split(guided, WAYS), asked, strict=True)
        ]
        self._left_m = distance_left(self.facts)
        self.commanded: Floats = np.zeros((self.environments, self.facts.robots, self.facts.action_dim))
        """(B, N, d): what the robots did last, as corrected."""
        self._heard = Neighbourhood(Setting(episodes=1, episodes_seed=0), np.random.default_rng(0))

    def observe(self) -> Tensor:
        """Return the observations (B, N, O)."""
        return self.scenario.observe()

    def step(self, action: Tensor) -> Transition:
        """Apply the actions (B, N, d), corrected."""
        self.commanded = self._corrected(action.double().numpy())
        return self.scenario.step(torch.from_numpy(self.commanded).to(action.dtype))

    def reset(self, finished: Tensor) -> None:
        """Start new episodes where ``finished`` (B,) is true."""
        self.scenario.reset(finished)
        self.commanded[finished.numpy()] = 0.0

    def _corrected(self, action: Floats) -> Floats:
        low, high = ([getattr(field, end) for field in self.facts.action] for end in ("low", "high"))
        views = self._heard.views(*motion(self.scenario), self.commanded)
        if self._left_m:
            views = replace(views, left_m=self._left_m(self.observe().flatten(0, 1).numpy()))
        robots, corrected = self.facts.robots, action.copy()
        for teams, guide in self._guides:
            rows = (teams[:, None] * robots + np.arange(robots)).ravel()
            own = action[teams].reshape(len(rows), self.facts.action_dim)
            corrected[teams] = corrected_actions(own, views.take(rows), guide).reshape(action[teams].shape)
        return np.clip(corrected, low, high)
