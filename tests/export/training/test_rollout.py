import pytest
import torch

from export.algorithms.mafpo import Mafpo
from export.common.distributed import Workers
from export.scenarios import make_scenario
from export.scenarios.scenario import Transition
from export.training.rollout import Collector, EpisodeTally, evaluate

CPU = torch.device("cpu")


def transition(reward, succeeded=False, failed=False):
    flag = torch.tensor([succeeded, failed])[:, None]
    return Transition(torch.tensor([[reward, reward + 2.0]]), flag[0], flag[1], torch.tensor([False]))


def metrics_of(*transitions, failure_decides=True):
    tally = EpisodeTally(1, CPU, failure_decides=failure_decides)
    for step in transitions:
        tally.add(step)
    tally.close(torch.tensor([True]))
    return tally.take(Workers())


def test_an_episode_counts_until_it_is_decided():
    metrics = metrics_of(transition(1.0), transition(2.0, succeeded=True), transition(50.0, failed=True))
    assert (metrics.success, metrics.failure, metrics.steps) == (1.0, 0.0, 2.0)
    assert metrics.mean_return == pytest.approx(2.0 + 3.0)


def test_success_after_or_with_a_collision_is_none():
    assert metrics_of(transition(0.0, failed=True), transition(0.0, succeeded=True)).success == 0.0
    assert metrics_of(transition(0.0, succeeded=True, failed=True)).success == 0.0


def test_an_episode_goes_on_after_a_failure_that_does_not_decide():
    steps = transition(1.0), transition(2.0, failed=True), transition(3.0), transition(4.0, succeeded=True)
    metrics = metrics_of(*steps, failure_decides=False)
    assert (metrics.success, metrics.failure, metrics.steps) == (0.0, 1.0, 4.0)
    assert metrics.mean_return == pytest.approx(2.0 + 3.0 + 4.0 + 5.0)


def test_tally_starts_anew_after_each_take():
    tally = EpisodeTally(1, CPU)
    assert tally.take(Workers()) is None
    tally.add(transition(1.0, succeeded=True))
    tally.close(torch.tensor([True]))
    assert tally.take(Workers()).episodes == 1
    assert tally.take(Workers()) is None
    assert not tally.decided.any()


def test_episodes_are_cut_at_their_limit_and_bootstrapped_from_the_state_before_the_reset():
    collector = Collector(
        make_scenario("navigation", 40, 0, CPU, training=True), torch.Generator().manual_seed(0)
    )
    collector._clock.fill_(0)
    collector._clock[:3] = 98
    seen = []

    def value(observation):
        seen.append(observation)
        return torch.full(observation.shape[:-1], 7.0)

    with torch.no_grad():
        rollout = collector.collect(Mafpo(18, 2), 4, value)
    expected = torch.zeros(4, 40, dtype=torch.bool)
    expected[1, :3] = True
    assert torch.equal(rollout.done, expected)
    assert torch.equal(rollout.cut_value, 7.0 * expected[..., None].expand(4, 40, 4))
    goals = [
        x[..., :2] - x[..., 4:6] for x in (rollout.observation[1, :3], seen[0], rollout.observation[2, :3])
    ]
    torch.testing.assert_close(goals[0], goals[1])
    assert (goals[1] - goals[2]).abs().amin(-1).max() > 1e-3


def test_first_episodes_are_staggered():
    collector = Collector(
        make_scenario("navigation", 200, 0, CPU, training=True), torch.Generator().manual_seed(0)
    )
    assert collector._clock.unique().numel() > 50


def test_evaluation_starts_the_flow_from_noise_or_zero_as_told():
    starts = []

    def act(observation, start):
        starts.append(start)
        return torch.zeros(*observation.shape[:-1], 2)

    scenario = make_scenario("navigation", 6, 0, CPU, training=False)
    zero_start = torch.tensor([True, False] * 3)
    tally = evaluate(scenario, act, torch.Generator().manual_seed(0), zero_start)
    start = torch.stack(starts)
    assert len(starts) == scenario.facts.evaluation_steps
    assert (start[:, zero_start] == 0).all()
    assert start[:, ~zero_start].std() == pytest.approx(1.0, abs=0.05)
    assert not tally.succeeded.any()
