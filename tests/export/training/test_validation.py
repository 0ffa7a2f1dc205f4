"""Guided validation: it judges what the averaged policy does when it is asked for several things."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from training_runs import SETTINGS, request, train

from edge_runtime.policy.bundle import packaged_bundle
from export.algorithms.mafpo_chain import MafpoChain
from export.algorithms.mappo import Mappo
from export.common.distributed import Workers
from export.training import guided_validation
from export.training.checkpoint import load, load_policy
from export.training.guided_validation import GuidedValidation
from export.training.validation import Validation

EPISODES = 8


@pytest.fixture(autouse=True)
def two_groups(monkeypatch):
    monkeypatch.setattr(guided_validation, "GROUPS", 2)


def deployed(scenario):
    """The packaged policy of a task, as validation is shown one."""
    bundle = packaged_bundle(scenario)
    flow = SimpleNamespace(to_weights=lambda: bundle.weights)
    actor = SimpleNamespace(as_flow=lambda: flow, start="noise")
    return SimpleNamespace(actor=actor, euler_steps=bundle.manifest.euler_steps)


def test_a_good_policy_succeeds_where_an_untrained_one_does_not():
    validation = GuidedValidation("navigation", EPISODES, Workers())
    good = validation.run(deployed("navigation"))
    assert good >= 0.5
    assert validation.run(MafpoChain(18, 2)) == 0.0
    assert validation.run(deployed("navigation")) == good


def test_workers_deal_the_groups_out_among_them():
    class Rank(Workers):
        def mean(self, value):
            return value / self.count

    alone = GuidedValidation("navigation", EPISODES, Workers()).run(deployed("navigation"))
    shares = [
        GuidedValidation("navigation", EPISODES, Rank(rank=rank, count=2)).run(deployed("navigation"))
        for rank in range(2)
    ]
    assert sum(shares) == pytest.approx(alone)


def test_the_score_is_of_guided_success_first(monkeypatch):
    settings = replace(SETTINGS, guided_episodes=EPISODES)
    monkeypatch.setattr(GuidedValidation, "run", lambda _self, _algorithm: 0.5)
    validation = Validation("navigation", settings, Workers(), preferred=False)
    found = validation.run(Mappo(18, 2), 0.5)
    assert found.guided_success == 0.5
    assert 0.45 <= found.score <= 0.55
    early = validation.run(Mappo(18, 2), 0.49)
    assert early.guided_success is None
    assert early.score <= 0.1
    told = Validation("navigation", settings, Workers(), preferred=True)
    assert told.run(Mappo(21, 2), 1.0).guided_success is None


def test_the_averaged_weights_are_what_is_kept(tmp_path):
    run = train(request(tmp_path), settings=replace(SETTINGS, frames=48, averaging=0.5, validation_every=1))
    trained = run.trainer.algorithm.actor.as_flow().state_dict()
    kept, _ = load_policy(tmp_path)
    saved = load(tmp_path / "checkpoint.pt")["trainer"]["averaged"]
    for name, value in kept.state_dict().items():
        assert torch.equal(value, saved[f"module.flow.{name}"])
    assert any(not torch.equal(value, trained[name]) for name, value in kept.state_dict().items())
