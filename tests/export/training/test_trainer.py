"""The shared update: what one worker does, two at half the batch do together."""

from dataclasses import replace

import pytest
import torch

from export.algorithms.base import TrainingSettings
from export.algorithms.mafpo import Mafpo
from export.algorithms.mafpo_chain import MafpoChain
from export.algorithms.mappo import Mappo
from export.common.distributed import Workers, join, launch
from export.scenarios import make_scenario
from export.training.rollout import Rollout
from export.training.trainer import Trainer

ENVIRONMENTS, STEPS, ROBOTS = 8, 5, 4
SETTINGS = TrainingSettings(
    environments=ENVIRONMENTS,
    steps=STEPS,
    minibatch=ENVIRONMENTS * STEPS * ROBOTS,
    epochs=3,
    ratio_change=0.02,
)


def make_trainer(algorithm, workers):
    torch.manual_seed(0)
    scenario = make_scenario("navigation", ENVIRONMENTS // workers.count, 0, workers.device, training=True)
    generator = torch.Generator().manual_seed(workers.rank)
    learner = algorithm(18, 2)
    if not isinstance(learner, Mappo):
        learner.half_precision = False
    return Trainer(scenario, learner, SETTINGS, generator, workers)


def make_rollout(algorithm, first, last):
    """The part of one fixed roll-out that belongs to the environments from ``first`` to ``last``."""
    generator = torch.Generator().manual_seed(5)
    shape = (STEPS, ENVIRONMENTS, ROBOTS)
    observation = torch.randn(*shape, 18, generator=generator)
    action, trace = algorithm.explore(observation, generator)
    reward, cut_value = torch.randn(2, *shape, generator=generator)
    done = torch.rand(shape[:2], generator=generator) < 0.2
    columns = (observation, action, trace, reward, cut_value, done)
    part = [column[:, first:last] for column in columns]
    return Rollout(*part, torch.randn((*shape[1:], 18), generator=generator)[first:last])


def train_on_share(directory):
    """Two updates on this worker's share; every worker writes the weights it ends with."""
    torch.set_num_threads(1)
    with join() as workers:
        for algorithm in (Mafpo, MafpoChain, Mappo):
            trainer = make_trainer(algorithm, workers)
            share = ENVIRONMENTS // workers.count
            for _ in range(2):
                with torch.no_grad():
                    rollout = make_rollout(
                        trainer.algorithm, workers.rank * share, (workers.rank + 1) * share
                    )
                trainer.update(trainer.prepare(rollout))
                trainer.algorithm.actor.moments.update(rollout.observation, workers)
            torch.save(
                trainer.state_dict(), directory / f"{algorithm.name}-{workers.count}-{workers.rank}.pt"
            )


def everything_learned(path):
    state = torch.load(path)
    parts = [*state["actor"].values(), *state["critic"].values(), *state["reward_moments"].values()]
    parts.append(torch.tensor(state["learning_rate"]))
    return torch.cat([part.flatten().double() for part in parts])


def test_two_workers_at_half_the_batch_make_one_workers_update(tmp_path):
    train_on_share(tmp_path)
    launch(2, train_on_share, tmp_path)
    for name in (Mafpo.name, MafpoChain.name, Mappo.name):
        alone, first, second = (
            everything_learned(tmp_path / f"{name}-{worker}.pt") for worker in ("1-0", "2-0", "2-1")
        )
        assert torch.equal(first, second)
        torch.testing.assert_close(first, alone, atol=2e-5, rtol=2e-4)


def test_update_raises_the_likelihood_of_what_had_an_advantage():
    trainer = make_trainer(Mafpo, Workers())
    with torch.no_grad():
        batch = trainer.prepare(make_rollout(trainer.algorithm, 0, ENVIRONMENTS))
    trainer.update(batch)
    with torch.no_grad():
        new = trainer.algorithm.log_likelihood(batch.observation, batch.action, batch.trace)
    gain = (new - batch.old_log_likelihood) * batch.advantage
    assert gain.mean() > 0


def test_learning_rate_follows_the_ratio_and_decays_to_its_share():
    trainer = make_trainer(MafpoChain, Workers())
    batch = trainer.prepare(make_rollout(trainer.algorithm, 0, ENVIRONMENTS))
    before = trainer.learning_rate
    trainer.settings = replace(SETTINGS, ratio_change=1e6)
    trainer.update(batch)
    assert trainer.learning_rate > before
    trainer.settings = replace(SETTINGS, ratio_change=1e-9)
    trainer.update(batch)
    assert trainer.learning_rate == pytest.approx(before * 1.1 / 1.2)
    trainer.frames = SETTINGS.frames
    assert trainer.learning_rate == pytest.approx(before * 1.1 / 1.2 * SETTINGS.final_learning_rate)


def test_averaged_weights_reach_back_over_a_tenth_of_the_updates_at_first():
    trainer = make_trainer(MafpoChain, Workers())
    trainer.settings = replace(SETTINGS, steps=2)

    def weights(algorithm):
        return torch.cat([value.flatten().double() for value in algorithm.actor.state_dict().values()])

    expected = weights(trainer.algorithm)
    for update in range(1, 4):
        trainer.iterate()
        kept = min(SETTINGS.averaging, (1 + update) / (10 + update))
        expected = kept * expected + (1 - kept) * weights(trainer.algorithm)
    torch.testing.assert_close(weights(trainer.deployed), expected, atol=1e-6, rtol=1e-5)
    assert not torch.equal(weights(trainer.deployed), weights(trainer.algorithm))
