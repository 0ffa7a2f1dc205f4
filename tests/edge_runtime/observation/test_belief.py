"""What robots believe: worked out by the user's own code, tick by tick, and known to objectives by name."""

import sys

import pytest
from bundles import write_straight_bundle
from logs import record, ticks

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.tools.replay.edge_replay import main as edge_replay

WALK = """
from edge_runtime import Belief

class Walk(Belief):
    def __init__(self, step_m=0.1):
        self.step_m, self.ticks = step_m, 0

    def follow(self, team):
        self.ticks += 1
        BODY
        return (self.step_m * self.ticks, team.own.position_m[1])
"""
TABLE = """
[[belief]]
name = "prey"
code = "walk:Walk"
parameters = { step_m = 0.5 }

[[objectives]]
type = "attraction"
object = "prey"
"""
HERE = TeamState(RobotState(0, 1.0, (0.0, 0.25), (0.0, 0.0)))


@pytest.fixture
def fleet(tmp_path):
    """Write a fleet file with a belief, and the module that it names; returns its path."""

    def write(table=TABLE, body="pass"):
        (tmp_path / "walk.py").write_text(WALK.replace("BODY", body))
        (tmp_path / "team.toml").write_text(DEFAULT_FLEET.read_text() + table)
        return tmp_path / "team.toml"

    yield write
    sys.modules.pop("walk", None)


def mission(path, tmp_path):
    file = load_fleet(path)
    bundle = load_bundle(write_straight_bundle(tmp_path / "own"))
    return Mission(0, file, bundle, file.objective_set, 10.0)


def test_each_robot_has_a_belief_of_its_own_and_it_remembers(fleet, tmp_path):
    team = mission(fleet(), tmp_path)
    one, other = team.controller(0), team.controller(1)
    told = [one.believe(HERE).tracked[-1] for _ in range(3)]
    assert [each.position_m for each in told] == [(0.5, 0.25), (1.0, 0.25), (1.5, 0.25)]
    assert {each.name for each in told} == {"prey"}
    assert other.believe(HERE).tracked[-1].position_m == (0.5, 0.25)
    fresh = team.controller(0)
    fresh.succeed(one)
    assert fresh.believe(HERE).tracked[-1].position_m == (2.0, 0.25)


def test_the_robot_is_drawn_by_what_it_believes_while_it_believes_it(fleet, tmp_path):
    behind = TABLE.replace("0.5", "-0.5")
    team = mission(fleet(behind, body="if self.ticks > 1: return None"), tmp_path)
    drawn, sceptic = team.controller(0), team.controller(0)
    sceptic.believe(HERE)
    assert drawn.decide(HERE, 1.0).action[0] < sceptic.decide(HERE, 1.0).action[0]


FAULTS = [
    ("raise SystemExit(0)", "it raised SystemExit: 0"),
    ("return (1.0,)", "it raised ValueError: (1.0,) is no place of 2 components"),
    ("return (1.0, float('nan'))", "it raised ValueError: (1.0, nan) is no place of 2 components"),
    ("return 7", "it raised TypeError: 'int' object is not iterable"),
]


@pytest.mark.parametrize(("body", "fault"), FAULTS)
def test_a_belief_that_fails_stops_the_robot_in_the_same_tick(fleet, tmp_path, body, fault):
    controller = mission(fleet(body=f"if self.ticks > 1: {body}"), tmp_path).controller(0)
    assert controller.decide(HERE, 1.0).stop_reason == ""
    stopped = controller.decide(HERE, 1.0)
    assert stopped.stop_reason == f"belief prey: {fault}"
    assert stopped.action == (0.0, 0.0)


REFUSED = [
    (TABLE.replace("walk:Walk", "walk:Run"), "belief[0].code: cannot import 'walk:Run'"),
    (TABLE.replace("walk:Walk", "math:floor"), "belief[0].code: 'math:floor' is not a subclass"),
    (TABLE.replace("step_m", "pace_m"), "belief[0].code: 'walk:Walk' cannot be made"),
    (TABLE.replace('object = "prey"', 'object = "pray"'), "attraction looks at 'pray'"),
    (TABLE + TABLE, "belief[1].name: 'prey' is taken already"),
    (TABLE + '[[tracked]]\nname = "prey"\n', "belief[0].name: 'prey' is taken already"),
]


@pytest.mark.parametrize(("table", "complaint"), REFUSED)
def test_what_cannot_be_believed_is_one_line(fleet, tmp_path, table, complaint):
    with pytest.raises(ConfigError) as caught:
        mission(fleet(table), tmp_path)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_run_is_repeated_from_its_log_without_the_belief(fleet, tmp_path, capsys):
    path = fleet()
    (log,) = record(tmp_path / "logs", "--fleet", str(path), "--backend", "numpy")
    sys.modules.pop("walk")
    path.with_name("walk.py").unlink()
    assert {each.name for tick in ticks(log) for each in tick.state.tracked} == {"prey"}
    assert edge_replay([str(log)]) == 0
    assert "bit for bit" in capsys.readouterr().out
