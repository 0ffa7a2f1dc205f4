"""Preferences between a task and its execution objectives: drawn, observed, and rewarded by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import load_bundle
from export.algorithms.pc_mappo import PcMappo
from export.edge_export import export_run
from export.scenarios import SCENARIOS, make_scenario, scenario_facts
from export.scenarios.definitions import DEFINITIONS, NAVIGATION
from export.scenarios.navigation import FACTS
from export.scenarios.preferred import NOMINAL_STEP
from export.scenarios.scenario import EpisodeMetrics
from export.scenarios.violations import violations
from export.training.checkpoint import PolicyFacts, save_policy

CPU = torch.device("cpu")
SPEED, MARGIN = NAVIGATION.objectives


def preferred(environments=1, seed=0, training=True):
    return make_scenario("navigation", environments, seed, CPU, training=training, preferred=True)


def place(scenario, position, velocity):
    """Put the robots of one team somewhere, all goals where they stand."""
    state = scenario.state_dict()
    task = state["scenario"]
    task["position"], task["velocity"] = torch.tensor([position]), torch.tensor([velocity])
    task["goal"] = task["position"].clone()
    scenario.load_state_dict(state)


def bounded(cure):
    return cure / (1 + cure)


def test_violations_by_hand():
    """Robot 0 speeds, 1 and 2 stand too close together, 3 does nothing wrong."""
    position = torch.tensor([[[-0.8, 0.0], [0.0, 0.0], [0.22, 0.0], [0.9, 0.9]]])
    velocity = torch.tensor([[[0.3, 0.4], [0.0, 0.0], [0.0, 0.0], [0.2, 0.0]]])
    found = violations((SPEED, MARGIN), FACTS.motion, position, velocity)
    # One step of 0.1 s takes 1 N to 0.1 m/s; both objectives begin a buffer before their limits.
    speeding = bounded((0.5 - SPEED.limit_m_s + SPEED.buffer_m_s) / 0.1)
    reach = FACTS.motion.preview(MARGIN.look_ahead).position_gain
    close = bounded((MARGIN.distance_m + MARGIN.buffer_m - 0.22) / reach)
    torch.testing.assert_close(
        found, torch.tensor([[[speeding, 0.0], [0.0, close], [0.0, close], [0.0, 0.0]]])
    )


def test_reward_weighs_the_task_and_the_violations():
    """Robots that drive off alone pay for leaving their goals and for speeding, as the preference says."""
    scenario = preferred()
    place(scenario, [[-0.8, -0.8], [0.8, -0.8], [-0.8, 0.8], [0.8, 0.8]], [[0.8, 0.0]] + 3 * [[0.0, 0.0]])
    scenario.preference[:] = torch.tensor([0.5, 0.3, 0.2])
    reward = scenario.step(torch.zeros(1, 4, 2)).reward
    speed = 0.75 * 0.8  # drag
    task = -speed * 0.1 / NOMINAL_STEP["navigation"]  # VMAS pays the way made towards the goal
    speeding = bounded((speed - SPEED.limit_m_s + SPEED.buffer_m_s) / 0.1)
    expected = 0.5 * task - 0.3 * speeding
    torch.testing.assert_close(reward, torch.tensor([[expected, 0.0, 0.0, 0.0]]), atol=1e-5, rtol=1e-5)


def test_every_robot_observes_its_teams_preference():
    scenario = preferred(5)
    observation = scenario.observe()
    assert observation.shape == (5, 4, scenario.facts.observation_dim) == (5, 4, 21)
    assert torch.equal(observation[..., 18:], scenario.preference[:, None].expand(5, 4, 3))
    assert torch.equal(observation[..., :18], scenario.scenario.observe())


def test_training_draws_preferences_uniformly_on_the_simplex_anew_for_each_episode():
    scenario = preferred(4000)
    before = scenario.preference.clone()
    torch.testing.assert_close(before.sum(1), torch.ones(4000))
    # Dirichlet(1, 1, 1): each weight has the distribution function 1 - (1 - w)^2.
    for quantile in (0.1, 0.5, 0.9):
        below = (before < 1 - math.sqrt(1 - quantile)).float().mean(0)
        torch.testing.assert_close(below, torch.full((3,), quantile), atol=0.03, rtol=0)
    finished = torch.arange(4000) < 100
    scenario.reset(finished)
    assert torch.equal((scenario.preference != before).any(1), finished)


def test_validation_weighs_everything_equally():
    scenario = preferred(3, training=False)
    scenario.reset(torch.ones(3, dtype=torch.bool))
    torch.testing.assert_close(scenario.preference, torch.full((3, 3), 1 / 3))


def test_score_prefers_the_faster_way_and_stays_within_its_bounds():
    def score(mean_return, steps):
        return preferred().score(EpisodeMetrics(10, mean_return, success=0.5, failure=0.0, steps=steps))

    assert score(3.0, 40.0) > score(3.0, 80.0) > score(0.0, 80.0) == 0.5 > score(-3.0, 80.0)
    assert (score(-300.0, 80.0), score(300.0, 80.0)) == (0.0, 1.0)


def test_preferences_say_nothing_of_the_starts():
    """Both are drawn from the same seed, but not from the same numbers."""
    scenario = preferred(2000)
    position, _ = scenario.motion()
    columns = torch.cat([scenario.preference, position.flatten(1)], 1).T
    assert torch.corrcoef(columns)[:3, 3:].abs().max() < 0.1


def test_state_continues_the_same_episodes_and_draws():
    first, second = preferred(4), preferred(4, seed=9)
    second.load_state_dict(first.state_dict())
    for scenario in (first, second):
        scenario.step(torch.ones(4, 4, 2))
        scenario.reset(torch.tensor([True, False, True, False]))
    assert torch.equal(first.observe(), second.observe())


def test_tasks_without_objectives_are_refused(monkeypatch):
    other = replace(scenario_facts("navigation"), name="other")
    monkeypatch.setitem(SCENARIOS, "other", type("Other", (), {"facts": other}))
    with pytest.raises(
        ConfigError, match=r"no execution objectives are known for scenario 'other'.*navigation"
    ):
        scenario_facts("other", preferred=True)


@pytest.mark.parametrize("name", sorted(DEFINITIONS))
def test_every_task_with_objectives_pays_by_the_preference(name):
    """The same motion is paid for the task alone, then for one objective alone."""
    scenario = make_scenario(name, 256, 0, CPU, training=True, preferred=True)
    assert scenario.facts.observation[-1].size == 3
    before, weights = scenario.state_dict(), torch.eye(3)
    rewards = []
    for weight in weights:
        scenario.load_state_dict(before)
        scenario.preference[:] = weight
        robots = scenario.facts.robots
        rewards.append(scenario.step(torch.ones(256, robots, 2)).reward)
    task, *objectives = rewards
    scenario.load_state_dict(before)
    expected = scenario.scenario.step(torch.ones(256, robots, 2)).reward / NOMINAL_STEP[name]
    torch.testing.assert_close(task, expected)
    for paid in objectives:
        assert paid.min() < 0
        assert -1 < paid.min() <= paid.max() <= 0


def test_bundle_takes_the_preference_as_an_observation(tmp_path):
    torch.manual_seed(0)
    facts = scenario_facts("navigation", preferred=True)
    algorithm = PcMappo(facts.observation_dim, facts.action_dim)
    for parameter in algorithm.actor.parameters():
        parameter.data.add_(0.3 * torch.randn_like(parameter))
    origin = PolicyFacts("navigation", "pc-mappo", 0, 1, "abc", 0.5, 1, algorithm.actor.start, preferred=True)
    save_policy(tmp_path, algorithm.actor, origin)
    assert export_run(tmp_path, tmp_path / "bundle") < 1e-5
    bundle = load_bundle(tmp_path / "bundle")
    field = bundle.manifest.observation[-1]
    assert (field.name, field.size, field.unit) == ("preference", 3, "1")
    observation = preferred(6).observe().flatten(0, 1)
    policy = bundle.policy(24)
    policy.observe(observation.numpy())
    with torch.no_grad():
        mean = algorithm.actor.mean(observation)
    np.testing.assert_allclose(policy.step(0, np.zeros((24, 2)))[0], mean, rtol=1e-5, atol=1e-5)
