"""The tasks as edge-run drives them: fresh episodes, judged as the tables are."""

import numpy as np
import pytest
from msgspec.json import decode

from benchmarks.paper.driven import Driven, drawn, drive, main
from benchmarks.paper.tasks import TASKS
from edge_runtime.config.fleet import FLEETS, load_fleet


@pytest.mark.parametrize("task", TASKS)
def test_every_episode_is_one_of_its_own(task):
    fleet = load_fleet(FLEETS / f"{task}.toml")
    one, again, other = (drawn(fleet, task, seed) for seed in (1, 1, 2))
    assert one == again
    assert [robot.start_m for robot in one.robots] != [robot.start_m for robot in other.robots]
    assert one.objective_set == fleet.objective_set


def test_an_episode_is_the_same_every_time():
    assert drive(TASKS["sampling"], 5) == drive(TASKS["sampling"], 5)


def test_the_rows_say_what_was_driven(tmp_path, capsys):
    path = tmp_path / "tasks.json"
    assert main(["navigation", "--episodes", "2", "--json", str(path)]) == 0
    (row,) = decode(path.read_bytes(), type=list[Driven])
    assert (row.task, row.episodes, row.stopped_ticks) == ("navigation", 2, 0)
    assert np.isfinite(row.satisfied_percent)
    assert "of 2 episodes satisfied" in capsys.readouterr().out
