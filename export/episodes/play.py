"""Playing episodes: each robot decides as it would on its own computer, only the loop over robots is batched.

A robot has its observation, and knows its neighbours' states and the actions that they commanded last.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import torch

from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.guide import Guide
from edge_runtime.policy.velocity_field import VelocityField
from export.episodes.judges import Flags, Follower, motion
from export.episodes.neighbourhood import Neighbourhood, Setting
from export.evaluation.guidance import Worth, guided_actions
from export.evaluation.outlook import TeamBatch
from export.evaluation.projection import BatchCombine
from export.scenarios.scenario import Scenario

Observations = npt.NDArray[np.float32]
Decide = Callable[[Observations, TeamBatch, np.random.Generator], Floats]
"""Observations (B, O) and views of B robots, and a generator of noise -> actions (B, 2)."""
MakeDecide = Callable[[int], Decide]
"""Prepares the decisions of B robots."""
Watch = Callable[[Scenario, Flags], None]
"""Sees the scenario before every control step, and which of its episodes (E,) are not over."""


def nobody(_world: Scenario, _running: Flags) -> None:
    """Look away."""


def sampled(
    prepare: Callable[[int], VelocityField],
    guide: Guide,
    combine: BatchCombine | None = None,
    worth: Callable[[Observations], Worth] | None = None,
) -> MakeDecide:
    """Decide by a flow's samples under guidance.

    Args:
        prepare: the flow, for B observations at once.
        guide: what steers.
        combine: what resolves conflicts along the flow; the guide's own projection where None.
        worth: what counts beside objectives, by what robots observe.
    """

    def prepared(batch: int) -> Decide:
        policy = prepare(batch)

        def decide(observation: Observations, views: TeamBatch, draw: np.random.Generator) -> Floats:
            start = guide.start_noise * draw.standard_normal((batch, policy.action_dim))
            also = worth(observation) if worth else None
            return guided_actions(policy, observation, views, guide, start, combine, also)

        return decide

    return prepared


def play(
    world: Scenario,
    make_decide: MakeDecide,
    judge: Follower,
    setting: Setting,
    steps: int,
    seed: int,
    watch: Watch = nobody,
) -> None:
    """Run the episodes of a world until their judge has seen enough, for ``steps`` at most.

    Args:
        world: E teams of N robots at the start of their episodes.
        make_decide: who plays.
        judge: follows.
        setting: what robots hear of each other.
        steps: time limit.
        seed: of noise and lost messages.
        watch: looks on.
    """
    count, robots, draw = world.environments, world.facts.robots, np.random.default_rng(seed)
    neighbourhood, decide = Neighbourhood(setting, draw), make_decide(count * robots)
    low, high = ([getattr(field, end) for field in world.facts.action] for end in ("low", "high"))
    action = np.zeros((count, robots, 2))
    for _ in range(steps):
        watch(world, judge.running)
        views = neighbourhood.views(*motion(world), action)
        observation = world.observe().flatten(0, 1).numpy()
        action = np.clip(decide(observation, views, draw), low, high).reshape(count, robots, 2)
        judge.add(world, world.step(torch.from_numpy(action).float()))
        if not judge.running.any():
            break
