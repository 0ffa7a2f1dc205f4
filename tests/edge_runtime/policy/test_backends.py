"""The same policy under guidance decides the same on every backend, to the end of an episode."""

import numpy as np
import pytest
import torch
from networks import needs_kernel

from benchmarks.paper.tasks import TASKS
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.policy.bundle import packaged_bundle
from export.episodes.judges import motion
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


def decide(policy, guide, observation, views, starts):
    """Every robot's decision, made as on a robot."""
    rows = zip(np.split(observation, len(observation)), views, starts, strict=True)
    return np.array(
        [guided_action(policy, row, view, guide, tuple(start)).action for row, view, start in rows]
    )


def play(task, bundle, policy, mode):
    """What the robots of one episode knew and decided at each step, and its outcome."""
    world = make_scenario(task.name, 1, 4, torch.device("cpu"), training=False)
    robots = world.facts.robots
    guide = make_guide(ObjectiveSet(task.objectives, GuidanceSettings(mode=mode)), bundle.manifest.motion)
    draw, judge, steps = np.random.default_rng(0), task.judge(1), []
    action = np.zeros((robots, 2))
    for _ in range(STEPS):
        position, velocity = (values[0].tolist() for values in motion(world))
        known = (
            world.observe()[0].numpy(),
            teams(position, velocity, action.tolist()),
            draw.standard_normal((robots, 2)).tolist(),
        )
        decided = decide(policy, guide, *known)
        steps.append((known, decided))
        action = np.clip(decided, -1.0, 1.0)
        judge.add(world, world.step(torch.from_numpy(action)[None].float()))
    return steps, guide, judge.outcome()


@needs_kernel
@pytest.mark.parametrize("mode", ["terminal", "hierarchical", "none", "cone"])
@pytest.mark.parametrize("name", sorted(TASKS))
def test_kernel_and_onnxruntime_decide_as_numpy_in_every_step_of_an_episode(name, mode):
    pytest.importorskip("onnxruntime")
    task, bundle = TASKS[name], packaged_bundle(name)
    steps, guide, _ = play(task, bundle, bundle.field("numpy"), mode)
    for policy in (bundle.field("compiled"), bundle.graph_policy()):
        for known, decided in steps:
            np.testing.assert_allclose(decide(policy, guide, *known), decided, rtol=1e-4, atol=1e-4)


@needs_kernel
@pytest.mark.parametrize("name", ["navigation", "sampling"])
def test_the_whole_episode_is_the_same_where_no_contact_magnifies_rounding(name):
    pytest.importorskip("onnxruntime")
    task, bundle = TASKS[name], packaged_bundle(name)
    steps, _, judged = play(task, bundle, bundle.field("numpy"), "terminal")
    for policy in (bundle.field("compiled"), bundle.graph_policy()):
        others, _, outcome = play(task, bundle, policy, "terminal")
        np.testing.assert_allclose(others[-1][1], steps[-1][1], atol=1e-2)
        assert outcome.satisfied == judged.satisfied
        np.testing.assert_allclose(outcome.first, judged.first)
