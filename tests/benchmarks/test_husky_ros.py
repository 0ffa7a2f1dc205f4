"""``python -m benchmarks husky-ros``: teams as the plant's own episodes have them, rows as driven."""

import pytest
import tomli_w
from msgspec.structs import replace
from paths import ROOT
from sil_reports import report, robot

from benchmarks.common.result_file import read_result, write_result

pytest.importorskip("mujoco", reason="--plant mujoco needs it")
from benchmarks.husky import through_ros as command
from benchmarks.husky.cases import ASKED
from benchmarks.husky.ros_rows import BASES, Episode, judged, ros_table
from benchmarks.husky.teams import drawn
from edge_runtime.config.fleet import load_fleet
from edge_runtime.errors import BridgeError
from firmware_bridge.sil.scenario.team_file import write_key

GOOD = Episode(
    bridge="ros2",
    seed=5,
    arrived=True,
    contacts=0,
    nearest_m=0.53,
    fastest_m_s=0.58,
    broken=0.002,
    ticks=0.999,
    ended=(),
    disturbed=(),
)


@pytest.mark.parametrize("base", BASES.values())
def test_a_team_is_asked_what_the_plants_own_episodes_ask(base, tmp_path):
    write_key(tmp_path / "team.key")
    (tmp_path / "team.toml").write_text(tomli_w.dumps(command.fleet_table(base, 7)))
    fleet, asked, places = load_fleet(tmp_path / "team.toml"), ASKED[base], drawn([7], 4)
    speed, margin = fleet.objective_set.objectives
    assert (speed.limit_m_s, speed.buffer_m_s) == (asked.limit_m_s, asked.speed_reserve_m_s)
    assert (margin.distance_m, margin.buffer_m) == (asked.margin_m, asked.margin_reserve_m)
    assert fleet.team.arrival_m == pytest.approx(0.1 * asked.scale_m)
    assert fleet.robots[3].goal_m == pytest.approx(asked.scale_m * places.goals[0, 3])
    assert (fleet.simulation.plant, fleet.simulation.base) == ("mujoco", base)


def test_an_episode_is_satisfied_if_everything_is():
    two = [
        robot(i, least_distance_m=0.51 + i, greatest_speed_m_s=0.59, objective_violations_share=0.004 * i)
        for i in range(2)
    ]
    team = report(*two).team
    whole = report(*two, bridge="ros2", team=replace(team, goals_reached=2))
    episode = judged(whole, 5)
    assert episode.satisfied
    assert (episode.seed, episode.nearest_m, episode.broken) == (5, 0.51, 0.004)
    for change in (
        {"arrived": False}, {"contacts": 1}, {"nearest_m": 0.49}, {"broken": 0.006}
    ):  # fmt: skip
        assert not replace(episode, **change).satisfied
    assert not judged(replace(whole, ended=("robot_1 ended with 1",)), 5).satisfied
    assert not judged(replace(whole, team=team), 5).arrived


def test_only_what_proves_nothing_is_driven_again(tmp_path, monkeypatch, capsys):
    noisy, path, asked = (
        replace(GOOD, seed=6, disturbed=("others took 1.5 cores",)),
        tmp_path / "rows.json",
        [],
    )
    write_result(path, [GOOD, noisy])

    def drive(bridge, seed, ros_path):
        asked.append((bridge, seed, *ros_path))
        if seed == 7:
            raise BridgeError("the team did not start")
        return replace(noisy, disturbed=noisy.disturbed * (len(asked) == 1))

    monkeypatch.setattr(command, "drive", drive)
    line = ["--bridge", "ros2", "--ros-path", "/there", "--first-seed", "5", "--json", str(path)]
    assert command.main([*line, "--episodes", "2"]) == 3
    assert command.main([*line, "--episodes", "2"]) == 0
    assert command.main([*line, "--episodes", "3"]) == 1
    assert asked == [("ros2", 6, "/there"), ("ros2", 6, "/there"), ("ros2", 7, "/there")]
    assert read_result(path, list[Episode]) == [GOOD, replace(GOOD, seed=6)]
    said = capsys.readouterr()
    assert "episode 7: the team did not start" in said.err
    assert "| 4 limo | 2 | 2 | 2 | 2 | 2 | 2 | 0.20 | 0.58 | 0.53 | 99.9 |" in said.out


def test_the_page_states_what_was_measured():
    if rows := read_result(command.RESULTS, list[Episode], default=[]):
        assert ros_table(rows) in (ROOT / "docs" / "wheels.md").read_text()
