"""The obstacle benchmark: worlds that hold together, rows as the pages state them."""

import math
import re

import pytest
from paths import ROOT

from benchmarks.common.result_file import read_result
from benchmarks.obstacles import obstacles_command as command
from benchmarks.obstacles.worlds import PILLARS, WALKERS, world
from edge_runtime.guidance.settings import ObjectiveSet


@pytest.mark.parametrize("seed", range(5))
def test_a_world_leaves_room_and_its_walkers_cross_it(seed):
    fleet = world(seed, ObjectiveSet())
    pillars, walkers = fleet.obstacles[:PILLARS], fleet.obstacles[PILLARS:]
    assert len(walkers) == WALKERS
    for walker in walkers:
        (x, y), (vx, vy) = walker.centre_m, walker.velocity_m_s
        assert x * vx + y * vy < 0.0  # towards the middle
        for pillar in pillars:
            px, py = pillar.centre_m
            aside = abs((px - x) * vy - (py - y) * vx) / math.hypot(vx, vy)
            assert aside > pillar.radius_m + walker.radius_m
    assert world(seed, ObjectiveSet()) == fleet


def test_a_short_run_writes_its_rows(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "EPISODE_S", 2.0)
    assert command.main(["--episodes", "2", "--json", str(tmp_path / "rows.json")]) == 0
    rows = read_result(tmp_path / "rows.json", list[command.Row])
    assert [(row.way, row.episodes, row.arrived) for row in rows] == [(way, 2, 0) for way in command.WAYS]
    assert "without: 0 of 2 arrived without contact (0 arrived, 2 had no contact)" in capsys.readouterr().out


@pytest.mark.parametrize("page", ["README.md", "docs/objective.md"])
def test_the_pages_state_what_was_measured(page):
    guided, alone = read_result(command.RESULTS, list[command.Row])
    text = " ".join((ROOT / page).read_text().split())
    assert re.search(
        rf"{guided.succeeded} of {guided.episodes} worlds.* without it in {alone.succeeded}\b", text
    )
    assert guided.succeeded >= 95
