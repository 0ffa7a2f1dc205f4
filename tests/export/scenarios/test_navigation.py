"""The training scenario against VMAS itself."""

import pytest
import torch
import vmas

from export.scenarios import make_scenario
from export.scenarios.navigation import FACTS, RADIUS_M, SPAWN_DISTANCE_M, Navigation

CPU = torch.device("cpu")


def navigation(environments=64, seed=0, training=False):
    return make_scenario("navigation", environments, seed, CPU, training=training)


def places(scenario):
    state = scenario.state_dict()
    return torch.cat([state["position"], state["goal"]], 1)


def place(scenario, position, goal):
    state = scenario.state_dict()
    state["position"], state["goal"] = torch.tensor([position]), torch.tensor([goal])
    state["velocity"] = torch.zeros(1, 4, 2)
    scenario.load_state_dict(state)


CORNERS = [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]
STILL = torch.zeros(1, 4, 2)


def test_observation_holds_the_fields_in_the_manifests_order():
    scenario = navigation()
    state, observation = scenario.state_dict(), scenario.observe()
    sizes = [field.size for field in FACTS.observation]
    position, velocity, goal_offset, proximity = observation.split(sizes, -1)
    assert observation.shape == (64, FACTS.robots, FACTS.observation_dim)
    torch.testing.assert_close(position, state["position"])
    torch.testing.assert_close(velocity, state["velocity"])
    torch.testing.assert_close(goal_offset, state["position"] - state["goal"])
    assert 0 <= proximity.min() < proximity.max() <= FACTS.body.lidar_range_m - RADIUS_M


def test_robots_see_each_other_as_vmas_lets_them():
    scenario = navigation(200, training=True)
    env = vmas.make_env("navigation", num_envs=200, continuous_actions=True, seed=0)
    for _ in range(10):
        scenario.step(torch.rand(200, 4, 2) * 2 - 1)
    position, _ = scenario.motion()
    for i, agent in enumerate(env.agents):
        agent.state.pos = position[:, i].contiguous()
    theirs = torch.stack([env.scenario.observation(agent)[:, 6:] for agent in env.agents], 1)
    assert (theirs > 0).sum() > 100
    torch.testing.assert_close(scenario.observe()[..., 6:], theirs, atol=1e-5, rtol=0)


def test_a_team_may_be_larger_and_its_robots_heavier():
    scenario = Navigation(5, 0, CPU, training=False, robots=7, half_width_m=2.0, masses_kg=[1.0] * 6 + [2.0])
    assert scenario.observe().shape == (5, 7, FACTS.observation_dim)
    assert 1.5 < places(scenario).abs().max() <= 2.0
    scenario.step(torch.ones(5, 7, 2))
    _, velocity = scenario.motion()
    torch.testing.assert_close(2 * velocity[:, 6], velocity[:, 0])


def test_motion_is_what_the_policy_observes_of_itself():
    scenario = navigation(training=True)
    position, velocity = scenario.motion()
    assert torch.equal(torch.cat([position, velocity], -1), scenario.observe()[..., :4])


def test_dynamics_of_the_manifest_predict_vmas():
    scenario = navigation(training=True)
    before = scenario.state_dict()
    action = torch.rand(64, 4, 2) * 2 - 1
    for _ in range(3):
        scenario.step(action)
    after, preview = scenario.state_dict(), FACTS.motion.preview(3)
    velocity = preview.velocity_decay * before["velocity"] + preview.velocity_gain * action
    position = (
        before["position"] + preview.position_decay * before["velocity"] + preview.position_gain * action
    )
    distance = (after["position"][:, :, None] - after["position"][:, None]).norm(dim=-1)
    untouched = ((distance + 9 * torch.eye(4)).amin((1, 2)) > 0.3)[:, None, None]
    assert untouched.float().mean() > 0.5
    torch.testing.assert_close(after["velocity"] * untouched, velocity * untouched, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(after["position"] * untouched, position * untouched, atol=1e-5, rtol=1e-5)


def test_starts_are_distributed_as_vmas_own():
    own = places(navigation(3000, training=True))
    env = vmas.make_env("navigation", num_envs=3000, continuous_actions=True, seed=1)
    entities = [*env.agents, *(agent.goal for agent in env.agents)]
    theirs = torch.stack([entity.state.pos for entity in entities], 1)
    for statistic in (torch.abs, lambda p: (p[:, :, None] - p[:, None]).norm(dim=-1)):
        torch.testing.assert_close(statistic(own).mean(0), statistic(theirs).mean(0), atol=0.04, rtol=0)
        torch.testing.assert_close(statistic(own).std(0), statistic(theirs).std(0), atol=0.04, rtol=0)
    assert torch.pdist(own[0]).min() >= SPAWN_DISTANCE_M


def test_masked_reset_leaves_the_other_episodes_alone():
    scenario = navigation()
    scenario.step(torch.rand(64, 4, 2))
    before, finished = scenario.state_dict(), torch.arange(64) % 3 == 0
    scenario.reset(finished)
    after = scenario.state_dict()
    for name in ("position", "velocity", "goal"):
        assert torch.equal(before[name][~finished], after[name][~finished])
    assert (before["goal"][finished] != after["goal"][finished]).all()
    assert (after["velocity"][finished] == 0).all()


def test_reset_does_not_reward_the_way_to_the_new_start():
    scenario = navigation()
    scenario.reset(torch.ones(64, dtype=torch.bool))
    reward = scenario.step(torch.zeros(64, 4, 2)).reward
    assert reward[reward > -0.5].abs().max() < 0.02


def test_only_training_starts_in_motion():
    assert navigation(training=True).observe()[..., 2:4].abs().max() > 0.1
    assert navigation(training=False).observe()[..., 2:4].abs().max() == 0


def test_all_robots_at_their_goals_succeed_together():
    scenario = navigation(1)
    near = [[x + 0.09, y] for x, y in CORNERS]
    place(scenario, near, CORNERS)
    assert scenario.step(STILL).succeeded.all()
    place(scenario, [*near[:3], [0.5, 0.39]], CORNERS)
    assert not scenario.step(STILL).succeeded.any()


@pytest.mark.parametrize(("gap", "touches"), [(0.0, True), (0.02, False)])
def test_touching_discs_fail(gap, touches):
    scenario = navigation(1)
    place(scenario, [[0.0, 0.0], [2 * RADIUS_M + gap, 0.0], [0.8, 0.8], [-0.8, -0.8]], CORNERS)
    towards_each_other = torch.tensor([[[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]])
    assert bool(scenario.step(towards_each_other).failed) == touches


def test_a_saved_scenario_goes_on_the_same_way():
    scenario = navigation(training=True)
    saved = scenario.state_dict()
    action, finished = torch.rand(64, 4, 2), torch.arange(64) < 20

    def continue_():
        reward = scenario.step(action).reward
        scenario.reset(finished)
        return reward, scenario.observe()

    first = continue_()
    scenario.load_state_dict(saved)
    for a, b in zip(first, continue_(), strict=True):
        assert torch.equal(a, b)
