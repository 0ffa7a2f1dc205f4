"""The same policy under guidance decides the same on every backend, to the end of an episode."""

import numpy as np
import pytest
import torch
from conftest import needs_kernel

from benchmarks.paper.judges import motion
from benchmarks.paper.tasks import TASKS
from edge_runtime.bundle import packaged_bundle
from edge_runtime.guidance import guided_action
from edge_runtime.guide import GuidanceSettings, Guide
from edge_runtime.messages import RobotState, Teammate, TeamState
from export.scenarios import make_scenario

STEPS = 60


def teams(position, velocity, action):
    """What every robot of one team knows."""
    states = [
        RobotState(robot, 0.0, tuple(position[robot]), tuple(velocity[robot]))
        for robot in range(len(position))
    ]
    return [
        TeamState(
            own, tuple(Teammate(mate, tuple(action[mate.robot_id])) for mate in states if mate is not own)
        )
        for own in states
    ]


def play(task, bundle, policy, mode):
    """One episode's positions (steps, N, 2), every decision made as on a robot, and its outcome."""
    world = make_scenario(task.name, 1, 4, torch.device("cpu"), training=False)
    robots = world.facts.robots
    guide = Guide(GuidanceSettings(mode=mode), task.objectives, bundle.manifest.dynamics)
    draw, judge, track = np.random.default_rng(0), task.judge(1), []
    action = np.zeros((robots, 2))
    for _ in range(STEPS):
        position, velocity = (values[0] for values in motion(world))
        observation, starts = world.observe()[0].numpy(), draw.standard_normal((robots, 2))
        views = teams(position.tolist(), velocity.tolist(), action.tolist())
        decided = [
            guided_action(
                policy, observation[robot : robot + 1], views[robot], guide, tuple(starts[robot])
            ).action
            for robot in range(robots)
        ]
        action = np.clip(np.array(decided), -1.0, 1.0)
        judge.add(world, world.step(torch.from_numpy(action)[None].float()))
        track.append(position)
    return np.stack(track), judge.outcome()


@needs_kernel
@pytest.mark.parametrize("mode", ["terminal", "none"])
@pytest.mark.parametrize("name", sorted(TASKS))
def test_numpy_kernel_and_onnxruntime_play_the_same_episode(name, mode):
    pytest.importorskip("onnxruntime")
    task, bundle = TASKS[name], packaged_bundle(name)
    reference, judged = play(task, bundle, bundle.field("numpy"), mode)
    for policy in (bundle.field("compiled"), bundle.graph_policy()):
        track, outcome = play(task, bundle, policy, mode)
        np.testing.assert_allclose(track, reference, atol=1e-3)
        assert outcome.satisfied == judged.satisfied
        np.testing.assert_allclose(outcome.first, judged.first)
