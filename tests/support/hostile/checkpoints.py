"""Checkpoints and trained policies that hold what training does not write."""

import contextlib
import copy
import shutil
from dataclasses import replace
from functools import partial

import torch
from training_runs import SETTINGS, request, train

from edge_runtime.errors import EdgeError
from export import edge_export
from export.algorithms.mafpo_warm import MafpoWarm, match
from export.common.distributed import Workers
from export.training import warm_start
from export.training.checkpoint import load
from export.training.request import check_request
from export.training.run import TrainingRun
from hostile.values import change_tree, places

MEMORY_MIB = 1000
"""PyTorch's, and matplotlib's."""
BRIEF = replace(SETTINGS, frames=2 * 48, validation_every=9)
FILES = ("checkpoint.pt", "best.pt")
DTYPES = (torch.float16, torch.float64, torch.int64, torch.bool, torch.complex64, torch.uint8)
NUMBERS = (float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e30, -1e38)


def prepare(folder):
    warm_start.ENVIRONMENTS, warm_start.match = 4, partial(match, steps=10)
    edge_export.roll_out = partial(edge_export.roll_out, teams=2, episodes=1)
    for algorithm in ("mappo", "mafpo-chain"):
        (folder / algorithm).mkdir(exist_ok=True)
        with contextlib.suppress(KeyboardInterrupt):
            train(request(folder / algorithm, algorithm=algorithm), stop, replace(BRIEF, validation_every=1))
    return folder


def stop(row):
    """Leave the last of the updates to do."""
    if row.frames == 48:
        raise KeyboardInterrupt


def attempt(draw, folder):
    algorithm, use = draw.choice([
        ("mappo", resume), ("mafpo-chain", resume), ("mappo", begin_with),
        ("mappo", export), ("mafpo-chain", export),
    ])  # fmt: skip
    case, out = folder / "case", folder / "out"
    for each in (case, out):
        shutil.rmtree(each, ignore_errors=True)
    shutil.copytree(folder / algorithm, case)
    file = draw.choice({resume: FILES[:1], begin_with: FILES, export: FILES[1:]}[use])
    torch.save(change(draw, load(case / file)), case / file)
    before = {path: path.read_bytes() for path in case.iterdir()}
    try:
        use(algorithm, case, out)
    except EdgeError as error:
        assert str(case) in str(error), error
        assert before == {path: path.read_bytes() for path in case.iterdir()}
        assert not out.exists()
        raise


def resume(algorithm, case, _out):
    train(request(case, algorithm=algorithm, resume=True), settings=BRIEF)


def begin_with(_algorithm, case, out):
    chosen = request(out, algorithm=MafpoWarm.name, warm_start=case)
    check_request(chosen, 1, BRIEF)
    out.mkdir()
    TrainingRun(chosen, Workers(), BRIEF)


def export(_algorithm, case, out):
    edge_export.export_run(case, out)


def change(draw, state):
    """Change a state in a place or two: a tensor, or whatever else it holds."""
    for _ in range(draw.choice([1, 1, 2])):
        tensors = [path for path in places(state) if isinstance(at(state, path), torch.Tensor)]
        if draw.random() < 0.4 or not tensors:
            state = change_tree(draw, state)
            continue
        *parents, last = draw.choice(tensors)
        at(state, parents)[last] = another_tensor(draw, at(state, (*parents, last)))
    return state


def at(state, path):
    for key in path:
        state = state[key]
    return state


def another_tensor(draw, held):
    match draw.randrange(12):
        case 0:
            return held.to(draw.choice(DTYPES))
        case 1:
            return held[None] if draw.random() < 0.5 else held.flatten()[:-1]
        case 2:
            return held.expand(10**9, *held.shape)
        case 3:
            return (
                held.reshape(-1)[:1].expand(held.numel()).reshape_as(held) if held.numel() else held.tolist()
            )
        case 4:
            return draw.choice([held.to_sparse(), torch.nested.nested_tensor([held]), held.to("meta")])
        case 5:
            return held.tolist()
        case 6:
            return torch.nn.Parameter(held.float())
        case 7:
            return copy.deepcopy(held).fill_(draw.choice([0, 1, 7, 255]))
        case _ if held.dtype.is_floating_point:
            changed = copy.deepcopy(held)
            changed.view(-1)[draw.randrange(held.numel())] = draw.choice(NUMBERS)
            return changed
        case _:
            changed = copy.deepcopy(held)
            changed.view(-1)[draw.randrange(held.numel())] = draw.choice([0, 1, 127, 255])
            return changed
