import copy
import csv
import errno
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from math import inf, nan

import pytest
import torch
from training_runs import SETTINGS, request, same, train

from edge_runtime.errors import ConfigError, FailedError
from export.algorithms.mafpo_warm import MafpoWarm, match
from export.common.distributed import Workers
from export.scenarios import SCENARIOS, make_scenario
from export.training import warm_start
from export.training.checkpoint import load, load_policy
from export.training.fitted import fitted
from export.training.request import ALGORITHMS, check_request
from export.training.run import TrainingRun


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("finished")
    train(request(out))
    return out


TRAIN_HALF = """
import sys, time
from pathlib import Path
sys.path.insert(0, "tests/support")
from training_runs import request, train
def show(row):
    print(row.frames, flush=True)
    time.sleep(3600 * (row.frames == 3 * 48))
train(request(Path(sys.argv[1])), show)
"""


def test_resumed_after_sigkill_it_ends_as_if_never_interrupted(finished, tmp_path):
    command = [sys.executable, "-c", TRAIN_HALF, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert [process.stdout.readline() for _ in range(3)] == ["48\n", "96\n", "144\n"]
        process.kill()
    assert 0 < load(tmp_path / "checkpoint.pt")["trainer"]["frames"] < SETTINGS.frames
    train(request(tmp_path, resume=True))
    for name in ("checkpoint.pt", "best.pt"):
        assert same(load(finished / name), load(tmp_path / name))


def interrupt_at(frames):
    """Stop as Ctrl-C does, after the update that reaches ``frames``."""

    def show(row):
        if row.frames == frames:
            raise KeyboardInterrupt

    return show


@pytest.mark.parametrize("algorithm", sorted(ALGORITHMS))
def test_every_algorithm_resumes_between_two_validations(algorithm, tmp_path, monkeypatch):
    settings, start = replace(SETTINGS, frames=3 * 48, validation_every=9), None
    if algorithm == MafpoWarm.name:
        monkeypatch.setattr(warm_start, "ENVIRONMENTS", 4)
        monkeypatch.setattr(warm_start, "match", partial(match, steps=10))
        start = tmp_path / "mappo"
        start.mkdir()
        train(request(start, algorithm="mappo"), settings=settings)
    whole, parts = (
        request(tmp_path / part, algorithm=algorithm, warm_start=start) for part in ("whole", "parts")
    )
    for part in (whole, parts):
        part.out.mkdir()
    train(whole, settings=settings)
    with pytest.raises(KeyboardInterrupt):
        train(parts, interrupt_at(2 * 48), settings)
    assert load(parts.out / "checkpoint.pt")["trainer"]["frames"] == 2 * 48
    train(replace(parts, resume=True, warm_start=None), settings=settings)
    for name in ("checkpoint.pt", "best.pt"):
        assert same(load(whole.out / name), load(parts.out / name))


def test_full_disk_ends_in_one_line_and_what_was_done_is_kept(tmp_path, monkeypatch):
    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def fill_disk(row):
        if row.frames == 48:
            monkeypatch.setattr(os, "fsync", no_space)

    with pytest.raises(ConfigError, match=r"checkpoint\.pt: No space left on device; .* --resume$"):
        train(request(tmp_path), fill_disk)
    monkeypatch.undo()
    assert TrainingRun(request(tmp_path, resume=True), Workers(), SETTINGS).trainer.frames == 48


def test_leaves_a_table_a_picture_and_the_best_policy(finished):
    with (finished / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["frames"]) for row in rows] == list(range(48, SETTINGS.frames + 1, 48))
    scores = [float(row["score"]) for row in rows if row["score"]]
    assert len(scores) == 2
    assert (finished / "curve.png").read_bytes().startswith(b"\x89PNG")
    network, facts = load_policy(finished)
    assert facts.score == max(scores)
    assert facts.frames == max(int(row["frames"]) for row in rows if row["score"] == str(facts.score))
    assert (facts.scenario, facts.algorithm, network.observation_dim) == ("navigation", "mafpo-chain", 18)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algorithm": "mafpo"}, "algorithm mafpo-chain, not mafpo"),
        ({"seed": 7}, "seed 0, not 7"),
        ({"frames": 96}, "frames 288, not 96"),
    ],
)
def test_checkpoint_of_another_run_is_refused(finished, changes, message):
    with pytest.raises(ConfigError, match=message):
        TrainingRun(request(finished, resume=True, **changes), Workers(), SETTINGS)


def test_checkpoint_of_another_shape_is_refused(finished, tmp_path):
    state = load(finished / "checkpoint.pt")
    state["identity"]["observation_dim"] = 24
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(ConfigError, match="observation_dim 24, not 18"):
        TrainingRun(request(tmp_path, resume=True), Workers(), SETTINGS)


def test_checkpoint_of_a_version_without_averaged_weights_is_refused(finished, tmp_path):
    state = load(finished / "checkpoint.pt")
    del state["identity"]["averaging"], state["trainer"]["averaged"]
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(ConfigError, match=r"averaging None, not 0\.8"):
        TrainingRun(request(tmp_path, resume=True), Workers(), SETTINGS)


DAMAGES = {
    "nothing": lambda state: state.clear(),
    "no identity": lambda state: state.pop("identity"),
    "another kind of identity": lambda state: state.update(identity=3),
    "no frames": lambda state: state["identity"].pop("frames"),
    "no trainer": lambda state: state.pop("trainer"),
    "no critic": lambda state: state["trainer"].pop("critic"),
    "an optimizer of something else": lambda state: state["trainer"].update(optimizer={}),
    "weights of another shape": lambda state: state["trainer"]["actor"].popitem(),
    "no workers": lambda state: state.update(workers=[]),
    "another scenario's episodes": lambda state: state["workers"][0]["collector"].update(scenario={}),
    "rows of another version": lambda state: state["rows"][0].update(loss=1.0),
    "rows that are none": lambda state: state.update(rows=[3.0]),
    "a row of texts": lambda state: state["rows"][0].update(seconds="1"),
    "frames counted backwards": lambda state: state["rows"][0].update(frames=-48),
    "frames that no rows tell of": lambda state: state["trainer"].update(frames=10**30),
    "a text for the best score": lambda state: state.update(best_score="0.5"),
    "a best score that nothing exceeds": lambda state: state.update(best_score=nan),
    "frames without end": lambda state: state["identity"].update(frames=inf),
    "seeds without end": lambda state: state["identity"].update(seed=2**64),
    "no frames to train": lambda state: state["identity"].update(frames=0),
    "averages of averages of none": lambda state: state["trainer"]["averaged"]["n_averaged"].fill_(-10),
    "averages that are no numbers": lambda state: state["trainer"]["averaged"]["module.flow.phase"].fill_(
        nan
    ),
    "a critic beyond all measure": lambda state: state["trainer"]["critic"]["layers.2.weight"].fill_(1e38),
    "weights that overflow together": lambda state: [
        value.fill_(1e12) for name, value in state["trainer"]["actor"].items() if name.endswith("weight")
    ],
    "a learning rate of another world": lambda state: state["trainer"].update(learning_rate=1e9),
    "an optimizer before its first step": lambda state: moments(state)["step"].fill_(-1),
    "an optimizer of doubles": lambda state: moments(state).update(
        exp_avg=moments(state)["exp_avg"].double()
    ),
    "a generator of another length": lambda state: state["workers"][0].update(
        generator=torch.zeros(7, dtype=torch.uint8)
    ),
    "a generator of noise": lambda state: state["workers"][0]["generator"].fill_(255),
    "robots of complex places": lambda state: episodes(state).update(
        position=episodes(state)["position"].cfloat()
    ),
    "robots that share a place in memory": lambda state: episodes(state).update(
        goal=episodes(state)["goal"][:1, :, :1].expand_as(episodes(state)["goal"])[None]
    ),
    "robots nowhere": lambda state: episodes(state)["position"].fill_(inf),
    "a list of clocks": lambda state: state["workers"][0]["collector"].update(clock=[0] * 16),
    "another worker": lambda state: state["workers"].append(state["workers"][0]),
}


def moments(state):
    return state["trainer"]["optimizer"]["state"][0]


def episodes(state):
    return state["workers"][0]["collector"]["scenario"]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_checkpoint_of_another_version_is_refused_and_stays(finished, tmp_path, damage):
    state, path = load(finished / "checkpoint.pt"), tmp_path / "checkpoint.pt"
    DAMAGES[damage](state)
    torch.save(state, path)
    content = path.read_bytes()
    with pytest.raises(ConfigError, match=r"checkpoint\.pt holds no run of this version"):
        TrainingRun(request(tmp_path, resume=True), Workers(), SETTINGS)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == content


@pytest.mark.parametrize("rank", [0, 1])
def test_what_one_worker_cannot_go_on_from_every_worker_refuses(tmp_path, monkeypatch, rank):
    monkeypatch.setattr(Workers, "gather", lambda self, value: [value] * self.count)
    TrainingRun(request(tmp_path), Workers(0, 2), SETTINGS)
    assert TrainingRun(request(tmp_path, resume=True), Workers(rank, 2), SETTINGS).trainer.frames == 0
    state = load(tmp_path / "checkpoint.pt")
    state["workers"][1] = copy.deepcopy(state["workers"][1])
    state["workers"][1]["generator"].fill_(255)
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(ConfigError, match=r"checkpoint\.pt holds no run of this version"):
        TrainingRun(request(tmp_path, resume=True), Workers(rank, 2), SETTINGS)


def test_what_an_optimizer_is_told_comes_from_the_algorithm_alone(finished, tmp_path):
    state = load(finished / "checkpoint.pt")
    for group in state["trainer"]["optimizer"]["param_groups"]:
        group.update(fused="yes", betas=(2.0, nan), params=[])
    torch.save(state, tmp_path / "checkpoint.pt")
    run = TrainingRun(request(tmp_path, resume=True), Workers(), SETTINGS)
    taken, written = run.trainer.state_dict(), load(finished / "checkpoint.pt")["trainer"]
    for group in (*taken["optimizer"]["param_groups"], *written["optimizer"]["param_groups"]):
        del group["lr"]  # set before every step
    assert same(taken, written)


@pytest.mark.parametrize("algorithm", ["mappo", "mafpo-chain"])
def test_training_that_comes_apart_ends_in_one_line_and_no_checkpoint_holds_it(tmp_path, algorithm):
    settings = replace(SETTINGS, learning_rate=1e10, gradient_limit=inf)
    with pytest.raises(FailedError, match=r"training came apart after 0 frames: .* another --seed$"):
        train(request(tmp_path, algorithm=algorithm), settings=settings)
    resumed = TrainingRun(request(tmp_path, algorithm=algorithm, resume=True), Workers(), settings)
    assert resumed.trainer.frames == 0


@pytest.mark.parametrize("scenario", sorted(SCENARIOS))
def test_episodes_under_way_are_told_as_those_that_begin(scenario):
    world = make_scenario(scenario, 3, 0, torch.device("cpu"), training=True)
    began = world.state_dict()
    for _ in range(3):
        world.step(torch.ones(3, world.facts.robots, world.facts.action_dim))
    world.reset(torch.tensor([True, False, False]))
    assert not same(fitted(world.state_dict(), began), began)


def test_directories_are_neither_overwritten_nor_resumed_from_nothing(finished, tmp_path):
    with pytest.raises(ConfigError, match="already holds a run: continue it with --resume"):
        check_request(request(finished), 1)
    with pytest.raises(ConfigError, match="start it without --resume"):
        check_request(request(tmp_path, resume=True), 1)
    assert check_request(request(tmp_path), 1).saved is None


def test_work_that_cannot_be_shared_equally_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="--workers 3 does not divide 16 environments"):
        TrainingRun(request(tmp_path), Workers(count=3), SETTINGS)


def test_the_seed_decides_everything(finished, tmp_path):
    train(request(tmp_path))
    assert same(load(finished / "checkpoint.pt"), load(tmp_path / "checkpoint.pt"))
