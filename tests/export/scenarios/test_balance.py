"""The training scenario against VMAS itself."""

from itertools import product

import numpy as np
import pytest
import torch
import vmas
from msgspec.structs import replace

from edge_runtime.messages import RobotState, TeamState, TrackedObject
from edge_runtime.observation.observer import Observer
from export.scenarios import make_scenario
from export.scenarios.balance import (
    FACTS,
    FAR_SHARE,
    GOAL_REWARD,
    GRAVITY_M_S2,
    HELD_SPACING_M,
    HOLD_STIFFNESS_PER_M,
    ON_GOAL_M,
    START_DISTANCE_M,
    STRONGEST_HOLD,
)
from export.scenarios.balance_starts import LINE_LENGTH_M, RADIUS_M, draw_starts
from export.scenarios.scenario import EpisodeMetrics
from export.scenarios.vmas_teams import Draw

CPU = torch.device("cpu")
ROBOTS = FACTS.robots


def balance(environments=64, seed=0, training=False):
    return make_scenario("balance", environments, seed, CPU, training=training)


def state_of(scenario):
    """What VMAS knows: no generator, and nothing that holds the robots."""
    state = scenario.state_dict()
    return {name: value for name, value in state.items() if name not in {"generator", "slot", "hold"}}


def vmas_in(state):
    """VMAS' own environment, put into a scenario's state."""
    environments = len(state["line"])
    env = vmas.make_env(
        "balance",
        num_envs=environments,
        continuous_actions=True,
        clamp_actions=True,
        n_agents=ROBOTS,
    )
    package, line = env.scenario.package, env.scenario.line
    for i, agent in enumerate(env.agents):
        agent.state.pos, agent.state.vel = state["position"][:, i], state["velocity"][:, i]
    package.state.pos, package.state.vel = state["package"], state["package_velocity"]
    package.goal.state.pos = state["goal"]
    line.state.pos, line.state.vel = state["line"], state["line_velocity"]
    line.state.rot, line.state.ang_vel = state["line_angle"], state["line_angular_velocity"]
    env.scenario.global_shaping = 100 * (package.state.pos - state["goal"]).norm(dim=-1)
    return env


def test_observation_is_that_of_vmas_with_a_continuous_inclination():
    scenario = balance(training=True)
    scenario.step(torch.rand(64, ROBOTS, 2) * 2 - 1)
    env = vmas_in(state_of(scenario))
    theirs = torch.stack([env.scenario.observation(agent) for agent in env.agents], 1)
    ours = scenario.observe()
    assert ours.shape == (64, ROBOTS, FACTS.observation_dim)
    assert torch.equal(ours[..., :-1], theirs[..., :-1])
    torch.testing.assert_close(ours[..., -1], (2 * theirs[..., -1]).sin(), atol=1e-5, rtol=0)


def pull_of(state):
    """What holds each robot, written out: a spring to its slot along x, never stronger than the hold."""
    pull = torch.zeros_like(state["position"])
    for episode, robot in product(range(len(pull)), range(ROBOTS)):
        hold = state["hold"][episode, 0].item()
        x = state["position"][episode, robot, 0] - state["line"][episode, 0]
        spring = HOLD_STIFFNESS_PER_M * (state["slot"][episode, robot] - x)
        pull[episode, robot, 0] = spring.clamp(-hold, hold)
    return pull


@pytest.mark.parametrize("training", [True, False])
def test_steps_and_rewards_are_those_of_vmas(training):
    scenario = balance(training=training)
    env = vmas_in(state_of(scenario))
    for _ in range(10):
        action = torch.randn(64, ROBOTS, 2)
        told = action + pull_of(scenario.state_dict()) if training else action
        transition = scenario.step(action)
        _, reward, done, _ = env.step(list(told.unbind(1)))
        on_goal = GOAL_REWARD * transition.succeeded[:, None] * training
        assert torch.equal(transition.reward, torch.stack(reward, 1) + on_goal)
        assert torch.equal(transition.succeeded | transition.failed, done)


def test_a_package_on_its_goal_is_rewarded_in_training_alone():
    rewards = []
    for training in (True, False):
        scenario = balance()
        scenario._goal_reward = balance(1, training=training)._goal_reward
        moved_to_goal(scenario, ON_GOAL_M - 0.01)
        rewards.append(scenario.step(torch.zeros(64, ROBOTS, 2)).reward)
    torch.testing.assert_close(rewards[0] - rewards[1], torch.full((64, ROBOTS), GOAL_REWARD))


def tracked(name, state, goal_m=None):
    """One of the scene's things as a robot is told of it."""
    angle, turning = state.get(f"{name}_angle"), state.get(f"{name}_angular_velocity")
    motion = (tuple(state[key][0].tolist()) for key in (name, f"{name}_velocity"))
    heading = () if angle is None else (angle.item(), turning.item())
    return replace(TrackedObject(name, 0.0, *motion, *heading), goal_m=goal_m)


def test_robots_observe_tracked_objects_as_training_observed_the_scene():
    scenario = balance(1, training=True)
    for _ in range(5):
        scenario.step(torch.rand(1, ROBOTS, 2) * 2 - 1)
    state, expected = scenario.state_dict(), scenario.observe()[0].numpy()
    objects = tracked("package", state, tuple(state["goal"][0].tolist())), tracked("line", state)
    for robot in range(ROBOTS):
        motion = (tuple(state[key][0, robot].tolist()) for key in ("position", "velocity"))
        view = TeamState(RobotState(robot, 0.0, *motion), tracked=objects)
        found = Observer(FACTS, (0.0, 0.0)).observe(view)[0]
        np.testing.assert_allclose(found, expected[robot], atol=1e-6)


def test_motion_is_what_the_policy_observes_of_itself():
    scenario = balance(training=True)
    position, velocity = scenario.motion()
    assert torch.equal(torch.cat([position, velocity], -1), scenario.observe()[..., :4])


def test_dynamics_of_the_manifest_predict_vmas():
    scenario = balance(1)
    state = scenario.state_dict()
    state["position"] = torch.tensor([[[-0.8, 0.5], [-0.4, 0.3], [0.0, 0.5], [0.4, 0.3], [0.8, 0.5]]])
    state["velocity"] = torch.rand(1, ROBOTS, 2) * 0.4 - 0.2
    scenario.load_state_dict(state)
    action = torch.rand(1, ROBOTS, 2) * 2 - 1
    for _ in range(4):
        scenario.step(action)
    preview = FACTS.motion.preview(4)
    # Gravity, which the manifest leaves out, acts as one more force on each robot.
    force = action - FACTS.motion.mass_kg * torch.tensor([0.0, GRAVITY_M_S2])
    velocity = preview.velocity_decay * state["velocity"] + preview.velocity_gain * force
    position = state["position"] + preview.position_decay * state["velocity"] + preview.position_gain * force
    for predicted, reached in zip((position, velocity), scenario.motion(), strict=True):
        torch.testing.assert_close(reached, predicted, atol=1e-6, rtol=1e-6)


def test_starts_are_distributed_as_vmas_own():
    own = state_of(balance(4000))
    env = vmas.make_env("balance", num_envs=4000, continuous_actions=True, seed=1, n_agents=ROBOTS)
    package, line = env.scenario.package.state.pos, env.scenario.line.state.pos
    theirs = {
        "position": torch.stack([agent.state.pos for agent in env.agents], 1),
        "package": package,
        "goal": env.scenario.package.goal.state.pos,
        "line": line,
    }
    for name, value in theirs.items():
        ours, theirs_line = own[name].view(4000, -1, 2), line[:, None]
        value = value.view(4000, -1, 2)
        assert_alike(ours, value)
        assert_alike(ours - own["line"][:, None], value - theirs_line)
    for name in own.keys() - theirs.keys():
        assert not own[name].any()


def held(environments=2000):
    return balance(environments, training=True).state_dict()


def test_half_of_the_training_episodes_are_held_and_no_others():
    hold = held()["hold"]
    assert 0.46 < (hold > 0).float().mean() < 0.54
    assert hold.min() == 0.0
    assert hold[hold > 0].mean() == pytest.approx(STRONGEST_HOLD / 2, abs=0.02)


def test_formations_stand_on_the_line_apart_by_what_they_may():
    slot = held()["slot"]
    spacing, (low, high) = slot.diff(dim=1), HELD_SPACING_M
    torch.testing.assert_close(spacing, spacing[:, :1].expand_as(spacing), atol=1e-6, rtol=0)
    assert low - 1e-6 <= spacing.min() < low + 0.01
    assert high - 0.01 < spacing.max() <= high + 1e-6
    assert slot.abs().max() < LINE_LENGTH_M / 2
    under = slot.abs().amax(1) <= LINE_LENGTH_M / 2 - RADIUS_M + 1e-6
    amid = slot.mean(1).abs() < 1e-6  # the widest ones have no other place
    assert (under | amid).all()


def test_no_robot_is_pulled_harder_than_it_may_nor_away_from_its_slot():
    scenario = balance(500, training=True)
    for _ in range(20):
        scenario.step(2 * torch.rand(500, ROBOTS, 2) - 1)
        state, pull = scenario.state_dict(), scenario._holding()
        assert (pull[..., 0].abs() <= state["hold"]).all()
        assert state["hold"].max() <= STRONGEST_HOLD
        assert not pull[..., 1].any()
        missing = state["slot"] - (state["position"] - state["line"][:, None])[..., 0]
        assert (pull[..., 0] * missing >= 0).all()
        torch.testing.assert_close(pull, pull_of(state), atol=1e-5, rtol=0)


def test_an_evaluation_is_held_by_nothing_wherever_its_slots_are():
    free, elsewhere, action = balance(), balance(), 2 * torch.rand(64, ROBOTS, 2) - 1
    assert not free.state_dict()["hold"].any()
    elsewhere.load_state_dict(elsewhere.state_dict() | {"slot": torch.full((64, ROBOTS), 7.0)})
    for scenario in (free, elsewhere):
        scenario.reset(torch.arange(64) % 2 == 0)
        assert not scenario.state_dict()["hold"].any()
    for _ in range(20):
        assert torch.equal(free.step(action).reward, elsewhere.step(action).reward)
    assert torch.equal(free.observe(), elsewhere.observe())


def test_what_holds_the_robots_is_saved_and_restored():
    scenario, other = balance(training=True), balance(seed=7, training=True)
    saved = scenario.state_dict()
    scenario.reset(torch.ones(64, dtype=torch.bool))
    assert not torch.equal(scenario.state_dict()["slot"], saved["slot"])
    other.load_state_dict(saved)
    for name in ("slot", "hold"):
        assert torch.equal(other.state_dict()[name], saved[name])
    torch.testing.assert_close(other._holding(), pull_of(saved), atol=1e-5, rtol=0)


def assert_alike(a, b):
    torch.testing.assert_close(a.mean(0), b.mean(0), atol=0.04, rtol=0)
    torch.testing.assert_close(a.std(0), b.std(0), atol=0.02, rtol=0)
    shares = torch.tensor([0.01, 0.25, 0.5, 0.75, 0.99])
    torch.testing.assert_close(a.quantile(shares, 0), b.quantile(shares, 0), atol=0.1, rtol=0)


def test_half_of_the_training_starts_fly_and_no_others():
    flying = [state_of(balance(2000, training=t))["line_angle"][:, 0] != 0 for t in (True, False)]
    assert 0.46 < flying[0].float().mean() < 0.54
    assert not flying[1].any()


def test_goals_are_far_more_often_in_training_and_never_elsewhere():
    state = draw_starts(4000, 0.5, 1.0, Draw(torch.Generator().manual_seed(3)))
    way = state["goal"][:, 0] - state["package"][:, 0]
    assert (way.sign() == -state["package"][:, 0].sign()).all()
    assert way.abs().min() >= 0.5
    training, usual = (state_of(balance(4000, training=t)) for t in (True, False))
    ways = [(each["goal"] - each["package"])[:, 0].abs().mean().item() for each in (state, usual, training)]
    mixed = FAR_SHARE * ways[0] + (1.0 - FAR_SHARE) * ways[1]
    assert ways[2] == pytest.approx(mixed, abs=0.05)


def test_robots_in_flight_are_apart_and_below_the_line():
    state = draw_starts(2000, 1.0, 0.0, Draw(torch.Generator().manual_seed(3)))
    offset = state["position"] - state["line"][:, None]
    angle = state["line_angle"]
    along = offset[..., 0] * angle.cos() + offset[..., 1] * angle.sin()
    below = offset[..., 0] * angle.sin() - offset[..., 1] * angle.cos()
    assert along.abs().max() <= LINE_LENGTH_M / 2 + 1e-6
    assert below.min() >= RADIUS_M
    assert below.max() > 4 * RADIUS_M
    assert along.diff(dim=1).min() >= 2 * RADIUS_M - 1e-6
    assert state["position"][..., 1].min() >= -1


def test_flights_go_on_without_falling_at_once():
    scenario = balance(500, training=True)
    failed = [scenario.step(torch.zeros(500, ROBOTS, 2)).failed for _ in range(10)]
    assert not torch.stack(failed).any()


def test_masked_reset_leaves_the_other_episodes_alone():
    scenario = balance(training=True)
    scenario.step(torch.rand(64, ROBOTS, 2))
    before, finished = scenario.state_dict(), torch.arange(64) % 3 == 0
    scenario.reset(finished)
    after = scenario.state_dict()
    for name in before.keys() - {"generator"}:
        assert torch.equal(before[name][~finished], after[name][~finished])
    assert (before["goal"][finished] != after["goal"][finished]).all()


def test_reset_does_not_reward_the_way_to_the_new_start():
    scenario = balance()
    scenario.reset(torch.ones(64, dtype=torch.bool))
    assert scenario.step(torch.zeros(64, ROBOTS, 2)).reward.abs().max() < 0.3


def moved_to_goal(scenario, distance):
    state = scenario.state_dict()
    state["goal"] = state["package"] + torch.tensor([0.0, distance])
    scenario.load_state_dict(state)


@pytest.mark.parametrize(("distance", "arrived"), [(ON_GOAL_M - 0.01, True), (ON_GOAL_M + 0.01, False)])
def test_a_package_on_its_goal_succeeds_and_may_stay(distance, arrived):
    scenario = balance()
    moved_to_goal(scenario, distance)
    transition = scenario.step(torch.zeros(64, ROBOTS, 2))
    torch.testing.assert_close(scenario.nominal(), torch.full((64,), distance), atol=2e-3, rtol=0)
    assert (transition.succeeded == arrived).all()
    assert not transition.terminated.any()


def test_a_line_without_support_falls_and_ends_the_episode():
    scenario = balance()
    state = scenario.state_dict()
    state["position"] = state["position"] + torch.tensor([0.0, 1.5])
    state["line_angle"] = state["line_angle"] + 0.1  # VMAS holds a level line just above its floor
    scenario.load_state_dict(state)
    transitions = [scenario.step(torch.zeros(64, ROBOTS, 2)) for _ in range(100)]
    failed = torch.stack([transition.failed for transition in transitions])
    assert failed.any(0).all()
    assert torch.equal(failed, torch.stack([transition.terminated for transition in transitions]))


def test_score_is_worth_progress_before_the_first_success():
    def score(success, mean_return):
        return balance(1).score(EpisodeMetrics(100, mean_return, success, 0.0, 300.0))

    assert score(0.0, -50.0) == 0.0 < score(0.0, 50.0) < score(0.0, 100.0) < 0.1
    assert score(0.5, 100.0) > score(0.4, 140.0)
    assert score(1.0, 1000.0) == 1.0
    starts = balance(4000).nominal().mean().item()
    assert starts == pytest.approx(START_DISTANCE_M, abs=0.02)


def test_a_saved_scenario_goes_on_the_same_way():
    scenario = balance(training=True)
    saved = scenario.state_dict()
    action, finished = torch.rand(64, ROBOTS, 2), torch.arange(64) < 20

    def continue_():
        reward = scenario.step(action).reward
        scenario.reset(finished)
        return reward, scenario.observe(), scenario.step(action).reward, scenario.observe()

    first = continue_()
    for resumed in (scenario, balance(seed=7, training=True)):
        resumed.load_state_dict(saved)
        scenario = resumed
        for a, b in zip(first, continue_(), strict=True):
            assert torch.equal(a, b)
