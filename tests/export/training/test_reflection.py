"""Reflected experience: what the simulator says that a mirrored team sees and earns."""

from dataclasses import replace

import pytest
import torch

from export.algorithms.base import TrainingSettings
from export.algorithms.mafpo import Mafpo
from export.algorithms.mafpo_chain import MafpoChain
from export.algorithms.mappo import Mappo
from export.common.distributed import Workers
from export.scenarios import make_scenario, scenario_facts
from export.training.reflection import Experience, with_reflection
from export.training.trainer import Trainer

FACTS = scenario_facts("balance")
SIGNS = torch.tensor(FACTS.mirror.action)


def experience(algorithm, steps=3, teams=4):
    generator = torch.Generator().manual_seed(0)
    shape = (steps, teams, FACTS.robots)
    observation = torch.randn(*shape, FACTS.observation_dim, generator=generator)
    action, trace = algorithm.explore(observation, generator)
    return Experience(observation, action, trace, *torch.randn(3, *shape, generator=generator))


def mirrored(state):
    """The same teams in the mirror, told by what a state holds, not by what is observed."""
    across = {name: value for name, value in state.items() if name not in ("generator", "hold")}
    for name, value in across.items():
        turned = value * torch.tensor([-1.0, 1.0]) if value.shape[-1] == 2 else -value
        across[name] = turned.flip(1) if name in ("position", "velocity", "slot") else turned
    return {**state, **across}


def test_a_mirrored_team_sees_and_earns_what_is_reflected():
    teams = 64
    own, other = (
        make_scenario("balance", teams, seed, torch.device("cpu"), training=True) for seed in (3, 4)
    )
    other.load_state_dict(mirrored(own.state_dict()))
    reflected = torch.tensor(FACTS.mirror.observation)
    draw = torch.Generator().manual_seed(1)
    for _ in range(30):
        torch.testing.assert_close(other.observe(), own.observe().flip(1) * reflected, atol=2e-4, rtol=1e-3)
        action = torch.rand(teams, FACTS.robots, 2, generator=draw) * 2 - 1
        earned, there = own.step(action).reward, other.step(action.flip(1) * SIGNS).reward
        torch.testing.assert_close(there, earned.flip(1), atol=2e-2, rtol=1e-3)


@pytest.mark.parametrize("algorithm", [Mafpo, MafpoChain, Mappo])
def test_reflected_experience_stands_behind_the_own_and_has_its_likelihood(algorithm):
    learner = algorithm(FACTS.observation_dim, 2)
    seen = experience(learner)
    both = with_reflection(seen, FACTS.mirror, learner.reflect_trace)
    for values, own in zip(both, seen, strict=True):
        assert torch.equal(values[: len(own)], own)
    for name in ("log_likelihood", "advantage", "value_target"):
        assert torch.equal(getattr(both, name)[len(seen.action) :], getattr(seen, name).flip(2))


@pytest.mark.parametrize("algorithm", [Mafpo, MafpoChain])
def test_twice_reflected_traces_are_as_they_were(algorithm):
    learner = algorithm(FACTS.observation_dim, 2)
    trace = experience(learner).trace
    once = learner.reflect_trace(trace, SIGNS)
    assert not torch.equal(once, trace)
    assert torch.equal(learner.reflect_trace(once, SIGNS), trace)


def test_a_chain_reflected_ends_at_the_reflected_action():
    learner = MafpoChain(FACTS.observation_dim, 2)
    seen = experience(learner)
    assert torch.equal(learner.reflect_trace(seen.trace, SIGNS)[..., -2:], seen.action * SIGNS)


def test_flow_times_of_a_trace_are_not_reflected():
    learner = Mafpo(FACTS.observation_dim, 2)
    trace = experience(learner).trace
    assert torch.equal(learner.reflect_trace(trace, SIGNS)[..., 2::3], trace[..., 2::3])


def test_a_mirrored_task_is_learned_from_both_ways_in_as_many_steps():
    def steps(mirror):
        torch.manual_seed(0)
        teams = make_scenario("balance", 8, 0, torch.device("cpu"), training=True)
        teams.facts = replace(FACTS, mirror=mirror)
        settings = TrainingSettings(environments=8, steps=4, minibatch=40, epochs=2)
        learner = Mappo(FACTS.observation_dim, 2)
        trainer = Trainer(teams, learner, settings, torch.Generator().manual_seed(0), Workers())
        rollout = trainer.collector.collect(learner, 4, lambda seen: seen[..., 0] * 0)
        batch, sizes = trainer.prepare(rollout), []
        step = trainer._gradient_step
        trainer._gradient_step = lambda rows: (sizes.append(len(rows.advantage)), step(rows))[1]
        trainer.update(batch)
        return len(batch.advantage), sizes

    samples, plain = steps(None)
    both, mirrored = steps(FACTS.mirror)
    assert both == 2 * samples
    assert mirrored == plain
