"""The oracle: relaxations against search, plans against the judge, and rows that add up by hand."""

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.common.result_file import read_result
from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import decider
from benchmarks.paper.oracle import oracle_command
from benchmarks.paper.oracle.endings import failures
from benchmarks.paper.oracle.oracle_page import endings_table, possible_table
from benchmarks.paper.oracle.planning import changed, followed, improved, sampled, start_of, world_of
from benchmarks.paper.oracle.relaxation import least_radius, never_gathered
from benchmarks.paper.possible import Ended, Planned, Row, Ruled, possible
from benchmarks.paper.settings import UNGUIDED
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import tuned_default
from edge_runtime.policy.bundle import packaged_bundle
from export.episodes.neighbourhood import Setting
from export.scenarios import scenario_facts
from export.scenarios.definitions import SAMPLING

FEW = Setting(episodes=3, episodes_seed=77)


def guided(task):
    return decider(TASKS[task], tuned_default(task), packaged_bundle(task))


def radius(place):
    return np.linalg.norm(place - place.mean(-2, keepdims=True), axis=-1).mean(-1)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 1.5))
def test_no_move_within_the_boxes_has_a_smaller_radius_than_the_bound(seed, moved):
    draw = np.random.default_rng(seed)
    start = draw.uniform(-1.0, 1.0, (2, 3, 2))
    moves = moved * np.concatenate(
        [draw.uniform(-1.0, 1.0, (200, 2, 3, 2)), draw.choice([-1.0, 1.0], (64, 2, 3, 2))]
    )
    assert (least_radius(start, moved) <= radius(start + moves).min(0) + 1e-12).all()


def test_the_bound_is_reached_by_robots_that_close_up_along_a_line():
    start = np.array([[[-0.6, 0.0], [0.0, 0.0], [0.6, 0.0]]])
    assert least_radius(start, 0.0) == pytest.approx([0.4])
    assert least_radius(start, 0.15) == pytest.approx([0.3], abs=1e-3)
    assert least_radius(start, 0.7) == pytest.approx([0.0], abs=1e-3)


def test_only_starts_far_apart_are_ruled_out():
    corners = np.array([[-0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]])
    step = scenario_facts("sampling").motion.preview(1)
    assert never_gathered(np.stack([corners, corners / 4]), SAMPLING, step).tolist() == [True, False]


@pytest.mark.parametrize("task", TASKS)
def test_what_fails_by_some_kind_is_what_the_tables_call_unsatisfied(task):
    missed = failures(TASKS[task], guided(task), FEW)
    satisfied = run_episodes(TASKS[task], guided(task), FEW).satisfied
    assert (
        sorted(number for numbers in missed.values() for number in numbers)
        == np.flatnonzero(~satisfied).tolist()
    )


def test_robots_that_do_nothing_are_short_of_what_they_were_asked():
    def idle(batch):
        return lambda *_: np.zeros((batch, 2))

    assert set(failures(TASKS["navigation"], idle, FEW)) <= {"blocked", "short", "stand-off"}
    assert all(kind.startswith("payload") for kind in failures(TASKS["balance"], idle, FEW))
    assert all(kind.startswith("samples") for kind in failures(TASKS["sampling"], idle, FEW))


@pytest.fixture(scope="module", params=TASKS)
def sample(request):
    task = TASKS[request.param]
    start = start_of(task, FEW, 1)
    return task, start, sampled(task, start, guided(task.name), seed=0)


def test_plans_start_where_their_episode_does(sample):
    task, start, plans = sample
    steps = torch.cat([start["position"][None].expand(1, plans.path.shape[1], -1, -1), plans.path]).diff(
        dim=0
    )
    assert plans.path.shape == plans.action.shape == (task.steps, *steps.shape[1:])
    assert steps.norm(dim=-1).max() < 0.1


def test_an_unchanged_plan_does_again_what_it_did(sample):
    task, start, plans = sample
    few = plans.best(2)
    again = followed(task, world_of(task, start, 2), few, few.path)
    tolerance = 1e-2 if task.name == "balance" else 1e-4  # a rod on discs
    assert torch.allclose(again.path, few.path, atol=tolerance)
    assert again.missing == pytest.approx(few.missing, abs=0.1)


def test_a_round_of_search_makes_no_plan_worse(sample):
    task, start, plans = sample
    worst = plans.take(np.argsort(plans.missing)[-2:])
    better = improved(task, start, worst, torch.Generator().manual_seed(0))
    assert (better.missing <= worst.missing).all()
    assert better.path.shape == worst.path.shape


def test_changes_are_smooth_and_end():
    path = torch.rand(100, 500, 3, 2, generator=torch.Generator().manual_seed(1))
    moved = changed(path, torch.Generator().manual_seed(0)) - path
    assert moved.abs().amax((0, 2, 3)).max() < 3.0
    assert (moved.abs().amax((2, 3)) < 1e-3).float().mean() > 0.3
    alone = (moved.abs().amax((0, 3)) > 0).sum(1) == 1
    assert 0.2 < alone.float().mean() < 0.4


def row(kind, **fields):
    return kind(task="sampling", definition="d", episodes_seed=2, episodes=10, commit="", **fields)


ROWS = [
    row(Ended, seed=0, policy="p", settings=UNGUIDED, failures={"radius": (1, 2), "samples": (3,)}),
    row(Ended, seed=1, policy="q", settings=UNGUIDED, failures={"radius": (1, 2, 3, 4)}),
    row(Ruled, impossible=(2,)),
    row(Planned, episode=1, plans=5, missing=0.0),
    row(Planned, episode=3, plans=5, missing=0.2),
]


def test_shares_by_hand():
    assert possible(ROWS, "sampling") == pytest.approx((70.0, 80.0, 90.0))
    assert possible(ROWS, "balance") is None
    assert possible_table({"sampling": (ROWS, ROWS[:2])}).splitlines()[2] == (
        "| sampling | 65.0 ± 7.1 | 70.0 | 80.0 | 90.0 | 81.2 ± 8.8 |"
    )
    assert endings_table(ROWS[:2]).splitlines()[2:] == [
        "| radius | 30.0 ± 14.1 | 2 | 4 |",
        "| samples | 5.0 ± 7.1 | 1 | 0 |",
    ]
    assert msgspec.json.decode(msgspec.json.encode(ROWS), type=list[Row]) == ROWS


def test_the_command_goes_on_where_it_was(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("benchmarks.paper.oracle.questions.ROUNDS", 1)
    path = tmp_path / "oracle.json"
    asked = ["--tasks", "sampling", "--episodes", "6", "--seeds", "1", "--json", str(path)]
    assert oracle_command.main(asked) == 0
    rows = read_result(path, list[Row])
    assert {type(one) for one in rows} >= {Ended, Ruled}
    other = msgspec.structs.replace(next(one for one in rows if isinstance(one, Ended)), settings=UNGUIDED)
    path.write_bytes(msgspec.json.encode([other, *rows[1:]]))
    assert oracle_command.main(asked) == 0
    assert sorted(map(str, read_result(path, list[Row]))) == sorted(map(str, [other, *rows]))
    assert "possible at least" in capsys.readouterr().out
