"""The case study on wheels: episodes that hold together, a judge that sees, rows as the pages state them."""

from types import SimpleNamespace

import numpy as np
import pytest
from paths import ROOT

from benchmarks.common.result_file import read_result

pytest.importorskip("mujoco", reason="--plant mujoco needs it")
from benchmarks.husky import husky_command as command
from benchmarks.husky import play
from benchmarks.husky.cases import ASKED, METHODS, TASK, Case, cases, task_of
from benchmarks.husky.teams import APART_M, Teams, drawn
from edge_runtime.config.fleet import FLEETS, load_fleet
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.simulation.wheels.bases import BASES

GUIDED = Case("husky", 4, 0.7, "CFPG")


@pytest.mark.parametrize(("base", "robots"), [(base, 4) for base in BASES] + [("husky", 16)])
def test_nobody_overlaps_at_the_start_or_at_the_goals(base, robots):
    places = drawn(range(5), robots)
    for spots in (places.starts, places.goals):
        apart = np.linalg.norm(spots[:, :, None] - spots[:, None], axis=-1) + np.eye(robots)
        assert apart.min() >= APART_M
    teams = Teams(BASES[base], ASKED[base].scale_m, places, 0.7)
    assert not teams.touched().any()
    np.testing.assert_allclose(teams.position, places.starts, atol=1e-3)
    np.testing.assert_allclose(teams.velocity, 0.0, atol=1e-3)
    assert all(np.array_equal(*pair) for pair in zip(drawn(range(5), robots), places, strict=True))


def test_teams_side_by_side_drive_as_each_would_alone():
    seeds, bundle = [3, 4], packaged_bundle(TASK)
    observed, told = [], []
    for chosen in (seeds, seeds[:1], seeds[1:]):
        places = drawn(chosen, 4)
        teams = Teams(BASES["husky"], 6.0, places, 0.7)
        for _ in range(5):
            teams.world.step(teams.told(np.full_like(teams.velocity, 0.1)), 0.1)
            teams.look()
        observed.append(play.Observing(places, bundle)(teams))
        told.append(teams.position)
    np.testing.assert_allclose(told[0], np.concatenate(told[1:]), atol=1e-6)
    np.testing.assert_allclose(observed[0], np.concatenate(observed[1:]), atol=1e-5)


def test_the_judge_counts_time_until_all_have_held_their_goals():
    goals = np.array([[[0.0, 0.0], [1.0, 0.0]]])
    judge = play.Judge(GUIDED, goals)
    limit, margin = ASKED["husky"].limit_m_s / 6.0, ASKED["husky"].margin_m / 6.0
    away = SimpleNamespace(
        robots=2,
        position=np.array([[[0.0, 0.3], [0.1 + margin, 0.3]]]),
        velocity=np.array([[[0.0, 1.01 * limit], [0.0, 0.0]]]),
        touched=lambda: np.array([False]),
    )
    there = SimpleNamespace(robots=2, position=goals + 0.05, velocity=0.0 * goals, touched=away.touched)
    near = SimpleNamespace(**{**vars(away), "position": away.position - [[[0.0, 0.0], [0.2, 0.0]]]})
    for teams, seconds in ((away, 1.0), (near, 1.0), (there, 0.5), (away, 1.0), (there, 1.5)):
        for _ in range(round(seconds / play.SAMPLE_S)):
            judge.add(teams)
    ends = judge.ends(there)
    assert not judge.running.any()
    assert ends.arrival_s == pytest.approx([3.5], abs=2 * play.SAMPLE_S)
    assert ends.speeding == pytest.approx([3.0 / 4.5], abs=0.02)
    assert ends.near == pytest.approx([1.0 / 4.5], abs=0.02)
    assert ends.fastest_m_s == pytest.approx([1.01 * ASKED["husky"].limit_m_s])
    assert ends.nearest_m == pytest.approx([6.0 * (margin - 0.1)])


@pytest.mark.parametrize("method", ["CFPG", "MAPPO+PGD", "MAPPO+SHLD", "PC-MAPPO", "unguided MAPPO"])
def test_every_method_drives(monkeypatch, method):
    monkeypatch.setattr(play, "EPISODE_S", {4: 1.0})
    row = command.measure(Case("limo_mecanum", 4, 0.7, method), 2, 0)
    assert (row.case.method, row.episodes, row.satisfied, row.arrival_s) == (method, 2, 0.0, None)
    assert 0.1 < row.fastest_m_s < 1.1
    assert row.without_contact == 100.0


def test_rows_that_are_there_are_not_computed_again(tmp_path, monkeypatch, capsys):
    row = command.Row("husky", 4, 0.7, "CFPG", 100, 7, 0.12, *[100.0] * 5, 0.0, 0.0, 0.8, 1.6, 12.0)
    command.write_result(tmp_path / "rows.json", [row])
    monkeypatch.setattr(command, "measure", None)
    line = ["--cases", "1", "--first-seed", "7", "--json", str(tmp_path / "rows.json")]
    assert command.main(line) == 0
    assert "| 4 husky | 0.7 | CFPG | 0.12 | 100 |" in capsys.readouterr().out
    assert read_result(tmp_path / "rows.json", list[command.Row]) == [row]


def test_every_method_of_the_papers_tables_is_asked():
    asked = {(case.base, case.friction, case.method) for case in cases()}
    assert {("husky", 0.3, method) for method in METHODS} <= asked
    assert len(set(cases())) == len(cases())


def test_the_packaged_fleet_is_asked_what_was_measured():
    fleet, asked = load_fleet(FLEETS / "husky.toml"), ASKED["husky"]
    assert fleet.team.scale_m == asked.scale_m
    speed, margin = fleet.objective_set.objectives
    assert speed == SpeedLimit(limit_m_s=asked.limit_m_s, buffer_m_s=asked.speed_reserve_m_s)
    assert margin == SafetyMargin(distance_m=asked.margin_m, buffer_m=asked.margin_reserve_m)
    task = task_of("husky")
    assert task.objectives[0].limit_m_s * asked.scale_m == pytest.approx(asked.limit_m_s)


def test_the_page_states_what_was_measured():
    rows, order = read_result(command.RESULTS, list[command.Row]), cases()
    told = command.husky_table(sorted(rows, key=lambda row: order.index(row.case)))
    assert told in (ROOT / "docs" / "wheels.md").read_text()


def test_the_readme_states_the_worst_of_the_grounds():
    rows = [row for row in read_result(command.RESULTS, list[command.Row]) if row.method == "CFPG"]
    found = [row for row in rows if (row.base, row.robots) == ("husky", 4)]
    text = " ".join((ROOT / "README.md").read_text().split())
    least, worst = min(min(row.arrived, row.margin_kept) for row in found), max(row.speeding for row in found)
    told = f"of three grounds {least:.0f} of {found[0].episodes} episodes arrive without contact"
    assert len(found) == 3
    assert told in text
    assert f"too fast for {worst:.2f} % of the time at most" in text


@pytest.mark.parametrize("robots", [4, 16])
def test_guided_huskies_arrive_inside_their_limits(robots):
    """Without contact; what the limit is broken for is no more than half a percent of the time."""
    least = {4: 95.0, 16: 90.0}[robots]
    for row in read_result(command.RESULTS, list[command.Row]):
        if (row.base, row.robots, row.method) == ("husky", robots, "CFPG"):
            assert min(row.arrived, row.margin_kept) >= least, row
            assert row.speeding <= 0.5, row
