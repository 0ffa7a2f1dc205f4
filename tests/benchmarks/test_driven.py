"""The tasks as edge-run drives them: fresh episodes, judged as the tables are."""

import math
import re

import numpy as np
import pytest
from msgspec.json import decode

from benchmarks.common.result_file import read_result
from benchmarks.paper.beside_tables import beside_tables
from benchmarks.paper.driven import TABLES, Driven, drawn, drive, main, stands_apart
from benchmarks.paper.rows import Row
from benchmarks.paper.tasks import TASKS
from edge_runtime.config.fleet import FLEETS, load_fleet
from edge_runtime.policy.bundle import packaged_bundle


@pytest.mark.parametrize("task", TASKS)
def test_every_episode_is_one_of_its_own(task):
    fleet = load_fleet(FLEETS / f"{task}.toml")
    one, again, other = (drawn(fleet, task, seed) for seed in (1, 1, 2))
    assert one == again
    assert [robot.start_m for robot in one.robots] != [robot.start_m for robot in other.robots]
    assert one.objective_set == fleet.objective_set


def test_who_would_start_within_another_is_passed_over():
    task, fleet = TASKS["sampling"], load_fleet(FLEETS / "sampling.toml")
    within = [seed for seed in range(710_000, 710_060) if not stands_apart(task, seed)]
    for seed in within:
        starts = [robot.start_m for robot in drawn(fleet, "sampling", seed).robots]
        assert min(map(math.dist, starts, [*starts[1:], starts[0]])) < 0.05
    assert 0 < len(within) < 10


def test_an_episode_is_the_same_every_time():
    assert drive(TASKS["sampling"], 5) == drive(TASKS["sampling"], 5)


def test_the_rows_say_what_was_driven(tmp_path, capsys):
    path = tmp_path / "tasks.json"
    assert main(["navigation", "--episodes", "2", "--json", str(path)]) == 0
    (row,) = decode(path.read_bytes(), type=list[Driven])
    assert (row.task, row.episodes, row.stopped_ticks) == ("navigation", 2, 0)
    assert np.isfinite(row.satisfied_percent)
    said = capsys.readouterr().out
    assert "of 2 episodes satisfied" in said
    assert re.search(r"tables: [\d.]+ ± [\d.]+ % over \d+ policies", said)


def test_a_policy_of_the_tables_is_held_against_its_own_row():
    rows = read_result(TABLES, list[Row])
    said = beside_tables(50.0, 5.0, packaged_bundle("sampling"), rows)
    own, error, apart = map(
        float, re.search(r"this one ([\d.]+) \+- ([\d.]+) %: ([\d.]+) stand", said).groups()
    )
    assert apart == pytest.approx((own - 50.0) / math.hypot(error, 5.0), abs=0.1)
    assert error == pytest.approx(100 * math.sqrt(own / 100 * (1 - own / 100) / 1000), abs=0.1)
