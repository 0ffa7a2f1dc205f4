"""Short training runs."""

from dataclasses import replace

import torch

from export.algorithms.base import TrainingSettings
from export.common.distributed import Workers
from export.training.request import Request
from export.training.run import TrainingRun

SETTINGS = TrainingSettings(
    frames=6 * 48,
    environments=16,
    steps=3,
    epochs=2,
    minibatch=96,
    validation_every=3,
    validation_episodes=4,
    guided_episodes=0,
)


def request(out, **changes):
    return replace(Request("navigation", "mafpo-chain", 0, out), **changes)


def train(request, show=lambda _row: None, settings=SETTINGS):
    torch.set_num_threads(1)
    run = TrainingRun(request, Workers(), settings)
    run.train(show)
    return run


def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(
            same(a[key], b[key]) for key in a if key not in {"seconds", "commit"}
        )
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b
