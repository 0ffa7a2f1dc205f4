"""The sampling scenario against VMAS itself."""

import numpy as np
import pytest
import torch
import vmas

from export.beliefs.sample_belief import WALL_M
from export.scenarios import make_scenario
from export.scenarios.sampling import CLUSTER_M, CLUSTERED_SHARE, FACTS, RADIUS_M, START_SPEED_M_S
from export.scenarios.scenario import EpisodeMetrics

CPU = torch.device("cpu")
STILL = torch.zeros(1, 3, 2)


def sampling(environments=64, seed=0, training=False):
    return make_scenario("sampling", environments, seed, CPU, training=training)


def place(scenario, position, centre=((0.0, 0.0),) * 3):
    """Put one team of robots at rest into a field of its own."""
    state = scenario.state_dict()
    state["position"], state["velocity"] = torch.tensor([position]), torch.zeros(1, 3, 2)
    state["emptied"], state["densest"] = torch.zeros_like(state["emptied"]), torch.full((1,), 3.0)
    state["centre"] = torch.tensor([centre])
    scenario.load_state_dict(state)


@pytest.fixture(scope="module")
def reference():
    """A VMAS environment, and the scenario in the same state."""
    env = vmas.make_env("sampling", num_envs=24, continuous_actions=True, clamp_actions=True, seed=1)
    scenario = sampling(24)
    state = scenario.state_dict()
    state["position"] = torch.stack([agent.state.pos for agent in env.agents], 1)
    state["velocity"] = torch.zeros(24, 3, 2)
    state |= scenario._field.untouched(torch.stack(env.scenario.locs, 1))
    scenario.load_state_dict(state)
    return env, scenario


def test_episodes_are_vmas_own(reference):
    env, scenario = reference
    torch.testing.assert_close(
        scenario.state_dict()["densest"] / (2 * torch.pi * 0.05), env.scenario.max_pdf, rtol=1e-6, atol=0
    )
    torch.manual_seed(0)
    action, seen, walled, total = torch.zeros(24, 3, 2), 0, 0, 0.0
    for t in range(120):
        # Wander, and gather at the middle now and then: walls, contacts and emptied cells all occur.
        home = 2 * scenario.motion()[0] if t % 40 > 20 else 0.0
        action = 0.7 * action + torch.randn(24, 3, 2) - home
        theirs, reward, _, _ = env.step(list(action.unbind(1)))
        transition = scenario.step(action)
        own, theirs = scenario.observe(), torch.stack(theirs, 1)
        assert torch.equal(own[..., :4], theirs[..., :4])
        torch.testing.assert_close(own[..., 4:16], theirs[..., 4:16], atol=1e-5, rtol=0)
        torch.testing.assert_close(own[..., 16:], theirs[..., 16:], atol=1e-6, rtol=0)
        torch.testing.assert_close(transition.reward, torch.stack(reward, 1), atol=1e-6, rtol=0)
        seen += int((theirs[..., 4:16] < 0.2).sum())
        walled += int((theirs[..., :2].abs() == WALL_M).sum())
        total = total + transition.reward[:, 0]
    assert torch.equal(scenario.state_dict()["emptied"], env.scenario.sampled.flatten(1))
    torch.testing.assert_close(scenario.nominal(), total)
    assert seen > 500
    assert walled > 50


def test_a_robot_computes_the_same_ranges():
    scenario = sampling(500)
    position = scenario.motion()[0] * 0.15
    state = scenario.state_dict()
    scenario.load_state_dict({**state, "position": position})
    places = position.double().numpy()
    sensor, radius = FACTS.body.sensor(), FACTS.body.radius_m
    found = [sensor.readings(own, [(*mate, radius) for mate in mates]) for own, *mates in places.tolist()]
    wanted = scenario.observe()[:, 0, 4:16].numpy()
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    assert (wanted < FACTS.body.lidar_range_m).sum() > 500


def test_motion_is_what_the_policy_observes_of_itself():
    scenario = sampling(training=True)
    position, velocity = scenario.motion()
    assert torch.equal(torch.cat([position, velocity], -1), scenario.observe()[..., :4])
    assert scenario.observe().shape == (64, FACTS.robots, FACTS.observation_dim)


def test_dynamics_of_the_manifest_predict_vmas():
    scenario = sampling(training=True)
    (start, speed), preview = scenario.motion(), FACTS.motion.preview(4)
    action = torch.rand(64, 3, 2) * 2 - 1
    free = torch.ones(64, dtype=torch.bool)
    for _ in range(4):
        free &= ~scenario.step(action).failed
        free &= (scenario.motion()[0].abs() < WALL_M).all(-1).all(-1)
    assert free.float().mean() > 0.5
    position, velocity = scenario.motion()
    predicted_velocity = preview.velocity_decay * speed + preview.velocity_gain * action
    predicted = start + preview.position_decay * speed + preview.position_gain * action
    torch.testing.assert_close(velocity[free], predicted_velocity[free], atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(position[free], predicted[free], atol=1e-6, rtol=1e-6)


def test_starts_are_distributed_as_vmas_own():
    state, env = sampling(4000).state_dict(), vmas.make_env("sampling", num_envs=4000, seed=1)
    position = torch.stack([agent.state.pos for agent in env.agents], 1)
    pairs = [
        (state["position"], position),
        (state["centre"], torch.stack(env.scenario.locs, 1)),
        (state["densest"] / (2 * torch.pi * 0.05), env.scenario.max_pdf),
        ((state["position"].abs() == WALL_M).float(), (position.abs() == WALL_M).float()),
    ]
    share = torch.linspace(0.05, 0.95, 19)
    for own, theirs in pairs:
        torch.testing.assert_close(own.mean(0), theirs.mean(0), atol=0.05, rtol=0)
        spread = own.flatten().quantile(share) - theirs.flatten().quantile(share)
        assert spread.abs().max() < 0.1
    assert state["velocity"].abs().max() == 0


def test_masked_reset_leaves_the_other_episodes_alone():
    scenario = sampling()
    scenario.step(torch.rand(64, 3, 2))
    before, finished = scenario.state_dict(), torch.arange(64) % 3 == 0
    scenario.reset(finished)
    after = scenario.state_dict()
    for name in ("position", "velocity", "gathered", "centre", "densest", "emptied"):
        assert torch.equal(before[name][~finished], after[name][~finished])
        assert not torch.equal(before[name][finished], after[name][finished])
    assert not after["emptied"][finished].any()
    assert (after["gathered"][finished] == 0).all()


def test_only_training_starts_in_motion_and_in_clusters():
    def clustered(scenario):
        position, _ = scenario.motion()
        return ((position.amax(1) - position.amin(1)).amax(1) <= 2 * CLUSTER_M).float().mean()

    by_chance = clustered(sampling(2000))
    wanted = CLUSTERED_SHARE + (1 - CLUSTERED_SHARE) * by_chance
    assert float(clustered(sampling(2000, training=True))) == pytest.approx(float(wanted), abs=0.05)
    speed = sampling(training=True).motion()[1].abs().max()
    assert 0.5 * START_SPEED_M_S < speed <= START_SPEED_M_S
    assert sampling(training=False).motion()[1].abs().max() == 0


def test_a_cell_pays_once():
    scenario = sampling(1)
    place(scenario, [[0.01, 0.01], [0.02, 0.08], [0.9, 0.9]])
    assert scenario.step(STILL).reward[0, 0] > 1
    assert scenario.step(STILL).reward.abs().max() == 0


def test_of_two_robots_in_one_cell_the_first_is_paid():
    scenario = sampling(1)
    place(scenario, [[0.001, 0.001], [0.049, 0.049], [0.9, 0.9]])
    both = scenario.step(STILL).reward[0, 0]
    place(scenario, [[0.001, 0.001], [-0.9, 0.9], [0.9, 0.9]])
    torch.testing.assert_close(both, scenario.step(STILL).reward[0, 0], atol=1e-4, rtol=0)


@pytest.mark.parametrize(("gap", "touches"), [(-0.005, True), (0.03, False)])
def test_touching_discs_fail(gap, touches):
    scenario = sampling(1)
    place(scenario, [[0.0, 0.0], [2 * RADIUS_M + gap, 0.0], [0.8, 0.8]])
    towards_each_other = torch.tensor([[[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]]])
    transition = scenario.step(towards_each_other)
    assert bool(transition.failed) == touches
    assert not transition.succeeded.any()
    assert not transition.terminated.any()


def test_score_lies_in_the_unit_interval():
    def score(mean_return):
        return sampling(1).score(EpisodeMetrics(1, mean_return, 0.0, 0.0, 100.0))

    assert 0 == score(0.0) < score(80.0) < score(100.0) < score(500.0) == 1


def test_a_saved_scenario_goes_on_the_same_way():
    scenario = sampling(training=True)
    saved = scenario.state_dict()
    action, finished = torch.rand(64, 3, 2), torch.arange(64) < 20

    def continue_():
        rewards = [scenario.step(action).reward for _ in range(3)]
        scenario.reset(finished)
        return *rewards, scenario.observe(), scenario.nominal()

    first = continue_()
    scenario.load_state_dict(saved)
    for a, b in zip(first, continue_(), strict=True):
        assert torch.equal(a, b)
