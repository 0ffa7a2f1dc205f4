"""Beginning a run with another's Gaussian policy: what it takes over, what it refuses, how it resumes."""

import shutil
from dataclasses import replace
from functools import partial
from math import nan

import pytest
import torch
from training_runs import SETTINGS, request, same, train

from edge_runtime.errors import ConfigError
from export import edge_train as command
from export.algorithms.mafpo_warm import MafpoWarm, match
from export.common.distributed import Workers
from export.scenarios import make_scenario, scenario_facts
from export.training import warm_start
from export.training.checkpoint import load, load_policy
from export.training.request import check_request
from export.training.run import TrainingRun

BRIEF = replace(SETTINGS, frames=3 * 48, validation_every=9)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Finished runs by algorithm, and one of another task."""
    folder = tmp_path_factory.mktemp("runs")
    for name in ("mappo", "mafpo-chain", "pc-mappo"):
        (folder / name).mkdir()
        train(request(folder / name, algorithm=name), settings=BRIEF)
    (folder / "balance").mkdir()
    train(request(folder / "balance", scenario="balance", algorithm="mappo"), settings=BRIEF)
    return folder


@pytest.fixture
def brief(monkeypatch):
    """Match for a moment only, in a few environments."""
    monkeypatch.setattr(warm_start, "ENVIRONMENTS", 4)
    monkeypatch.setattr(warm_start, "match", partial(match, steps=10))


def warm(runs, out, **changes):
    out.mkdir(exist_ok=True)
    return request(out, algorithm=MafpoWarm.name, warm_start=runs / "mappo", **changes)


def new_flow():
    torch.manual_seed(5)
    facts = scenario_facts("navigation")
    return MafpoWarm(facts.observation_dim, facts.action_dim).actor.as_flow()


def test_the_flow_has_the_gaussians_moments_and_nears_its_mean(runs, monkeypatch):
    monkeypatch.setattr(warm_start, "ENVIRONMENTS", 16)
    monkeypatch.setattr(warm_start, "match", partial(match, steps=200))
    flow, (gaussian, _) = new_flow(), load_policy(runs / "mappo")
    torch.nn.init.constant_(gaussian.layers[-1].bias, 0.5)  # hardly trained, it has a mean of nearly zero
    error = warm_start.warm_start(flow, gaussian, "navigation", 0)
    assert same(flow.moments.state_dict(), gaussian.moments.state_dict())
    observation = make_scenario("navigation", 100, 9, torch.device("cpu"), training=True).observe()
    start = torch.zeros(*observation.shape[:2], 2)
    miss, unmatched = (
        (field.sample(observation, start, 10) - gaussian.sample(observation, start, 1)).square().mean().sqrt()
        for field in (flow, new_flow())
    )
    assert error < 0.1
    assert miss < 0.1 < 0.4 < unmatched


@pytest.mark.usefixtures("brief")
def test_workers_that_begin_alike_stay_alike(runs):
    flows, (gaussian, _) = [new_flow() for _ in range(2)], load_policy(runs / "mappo")
    errors = [warm_start.warm_start(flow, gaussian, "navigation", 3) for flow in flows]
    assert errors[0] == errors[1]
    assert same(flows[0].state_dict(), flows[1].state_dict())
    assert not same(flows[0].state_dict(), new_flow().state_dict())


@pytest.mark.usefixtures("brief")
def test_a_new_run_begins_with_the_matched_flow_and_keeps_it_as_its_best(runs, tmp_path):
    run = TrainingRun(warm(runs, tmp_path), Workers(), BRIEF)
    flow, facts = load_policy(tmp_path)
    assert same(flow.state_dict(), run.trainer.algorithm.actor.as_flow().state_dict())
    assert (facts.algorithm, facts.frames, facts.score) == (MafpoWarm.name, 0, run.best_score)
    (gaussian, _), moments = load_policy(runs / "mappo"), flow.moments.state_dict()
    assert same(moments, gaussian.moments.state_dict())
    assert same(run.trainer.critic.state_dict(), load(runs / "mappo" / "checkpoint.pt")["trainer"]["critic"])


@pytest.mark.usefixtures("brief")
def test_what_normalises_observations_stays_as_the_gaussian_policy_had_it(runs, tmp_path):
    settings = replace(BRIEF, moving_moments=MafpoWarm.settings.moving_moments)
    trainer = TrainingRun(warm(runs, tmp_path), Workers(), settings).trainer
    flow = trainer.algorithm.actor.as_flow()
    before = {name: value.clone() for name, value in flow.state_dict().items()}
    trainer.iterate()
    assert not same(flow.state_dict(), before)
    assert same(flow.moments.state_dict(), load_policy(runs / "mappo")[0].moments.state_dict())


@pytest.mark.usefixtures("brief")
def test_a_resumed_warm_run_neither_needs_nor_takes_the_gaussian_policy(runs, tmp_path, monkeypatch):
    begun = warm(runs, tmp_path)
    before = TrainingRun(begun, Workers(), BRIEF)
    monkeypatch.setattr(warm_start, "load_policy", lambda run: pytest.fail(f"{run} was read again"))
    resumed = TrainingRun(replace(begun, resume=True, warm_start=None), Workers(), BRIEF)
    assert same(resumed.trainer.state_dict(), before.trainer.state_dict())
    assert resumed.best_score == before.best_score
    with pytest.raises(ConfigError, match="--warm-start is for new runs"):
        check_request(replace(begun, resume=True), 1)


@pytest.mark.parametrize(
    ("run", "found"),
    [
        ("balance", "holds mappo on balance"),
        ("mafpo-chain", "holds mafpo-chain on navigation"),
        ("pc-mappo", "holds pc-mappo on navigation"),
        ("nothing", "best.pt does not exist: name the --out directory of an edge-train run"),
    ],
)
def test_a_run_without_a_gaussian_policy_of_this_task_is_refused_in_one_line(
    runs, tmp_path, capsys, run, found
):
    flags = ["navigation", "--algorithm", "mafpo-warm", "--warm-start", str(runs / run)]
    assert command.main([*flags, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith(f"edge-train: {runs / run}")
    assert found in error
    assert found.startswith("best.pt") or "edge-train navigation --algorithm mappo" in error
    assert not list(tmp_path.iterdir())


DAMAGES = {
    "no critic": lambda trainer: trainer.pop("critic"),
    "another task's critic": lambda trainer: trainer["critic"].update({"layers.0.weight": torch.ones(2)}),
    "a critic of numbers that are none": lambda trainer: trainer["critic"]["layers.4.bias"].fill_(nan),
    "a critic beyond all measure": lambda trainer: trainer["critic"]["layers.0.weight"].fill_(1e38),
    "a list of rewards": lambda trainer: trainer.update(reward_moments=[0.0]),
    "rewards that vary less than not": lambda trainer: trainer["reward_moments"]["variance"].fill_(-1.0),
}


@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize("damage", [*DAMAGES, "no file"])
def test_a_run_with_a_bad_critic_is_refused_before_anything_is_done(
    runs, tmp_path, capsys, monkeypatch, damage, workers
):
    run = shutil.copytree(runs / "mappo", tmp_path / "mappo")
    told = "checkpoint.pt does not exist: name the --out directory"
    if damage == "no file":
        (run / "checkpoint.pt").unlink()
    else:
        state = load(run / "checkpoint.pt")
        DAMAGES[damage](state["trainer"])
        torch.save(state, run / "checkpoint.pt")
        told = "checkpoint.pt holds no run of this version: train again into a new directory"
    monkeypatch.setattr(command, "_train", lambda *_: pytest.fail("it began to train"))
    flags = ["navigation", "--algorithm", "mafpo-warm", "--warm-start", str(run), "--workers", workers]
    assert command.main([*flags, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"edge-train: {run}/{told}")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--algorithm", "mafpo-warm"], "--algorithm mafpo-warm needs --warm-start RUN"),
        (
            ["--algorithm", "mappo", "--warm-start", "x"],
            "--warm-start is for new runs of --algorithm",
        ),
        (["--warm-start", "x"], "--warm-start is for new runs of --algorithm mafpo-warm: leave it out"),
    ],
)
def test_a_warm_start_that_is_missing_or_not_wanted_is_one_line(tmp_path, capsys, flags, message):
    for workers in ("1", "2"):
        assert command.main(["navigation", "--out", str(tmp_path), "--workers", workers, *flags]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert message in error
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("brief")
def test_a_warm_start_is_not_for_a_run_that_goes_on(runs, tmp_path, capsys):
    TrainingRun(warm(runs, tmp_path), Workers(), BRIEF)
    before = load(tmp_path / "checkpoint.pt")
    flags = ["--algorithm", "mafpo-warm", "--warm-start", str(runs / "mappo"), "--resume"]
    assert command.main(["navigation", "--out", str(tmp_path), *flags]) == 2
    assert "--warm-start is for new runs" in capsys.readouterr().err
    assert same(before, load(tmp_path / "checkpoint.pt"))
