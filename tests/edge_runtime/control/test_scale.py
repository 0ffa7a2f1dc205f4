"""`scale_m`: a team of robots s times as large, in a world s times as large, acts as the policy's own."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import force_setattr, replace

from edge_runtime.config.fleet import Team, load_fleet
from edge_runtime.control.mission import Mission, adapted
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import TeamState
from edge_runtime.objectives import ObstacleMargin, SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.simulation.bridge import open_bridge

LENGTHS = ("start_m", "goal_m", "centre_m", "velocity_m_s", "radius_m")
FLEET = """\
[team]

[[robots]]
id = 0
start_m = [-0.8, -0.6]
goal_m = [0.7, 0.8]

[[robots]]
id = 1
start_m = [0.8, 0.7]
goal_m = [-0.8, -0.7]

[[robots]]
id = 2
start_m = [0.7, -0.6]
goal_m = [-0.7, 0.8]

[[obstacle]]
centre_m = [0.1, 0.1]
radius_m = 0.15
velocity_m_s = [0.02, -0.01]
"""


def larger(record, scale, names=LENGTHS):
    """A copy of a record whose lengths are those of a world ``scale`` times as large."""
    lengths = [name for name in record.__struct_fields__ if name in names]
    copy = replace(record)
    for name in lengths:
        value = getattr(record, name)
        times = tuple(scale * v for v in value) if isinstance(value, tuple) else scale * value
        force_setattr(copy, name, times)
    return copy


def objectives(scale):
    return ObjectiveSet(
        (
            SpeedLimit(limit_m_s=0.3 * scale, buffer_m_s=0.01 * scale),
            SafetyMargin(distance_m=0.25 * scale, buffer_m=0.02 * scale),
            ObstacleMargin(distance_m=0.12 * scale, buffer_m=0.02 * scale),
        )
    )


def drive(folder, scale, count):
    """Observations, actions, positions and velocities of a simulated team, in the policy's metres."""
    path = folder / "team.toml"
    path.write_text(FLEET)
    small = load_fleet(path)
    team = replace(larger(small.team, scale), scale_m=scale)
    robots = tuple(larger(robot, scale) for robot in small.robots)
    obstacles = tuple(larger(obstacle, scale) for obstacle in small.obstacles)
    fleet = replace(small, team=team, robots=robots, obstacles=obstacles)
    bundle = adapted(packaged_bundle("navigation"), fleet.robots[0], team)
    mission = Mission(0, fleet, bundle, objectives(scale), 10.0, backend="numpy")
    rows = []
    controller = mission.controller(0)
    with open_bridge(mission) as bridge:
        for _ in range(count):
            own = bridge.read()
            view = TeamState(own, bridge.teammates(), ranges_m=bridge.ranges_m())
            seen = controller.observe(view)[0].tolist()
            command = controller.limit(controller.act(controller.observe(view), view), view, own.stamp_s)
            assert not command.stop_reason
            bridge.write(command)
            metres = [*own.position_m, *own.velocity_m_s, *command.velocity_m_s]
            rows.append([*seen, *command.action, *(length / scale for length in metres)])
    return np.array(rows)


@settings(max_examples=8, deadline=None)
@given(scale=st.sampled_from([0.05, 0.25, 0.5, 2.0, 3.7, 10.0, 40.0]))
def test_a_team_of_another_size_in_a_world_of_that_size_acts_the_same(scale, tmp_path_factory):
    # The obstacles' readings are told from teammates' by a fixed 5 cm of error: near nobody in this run.
    folder = tmp_path_factory.mktemp("fleet")
    np.testing.assert_allclose(drive(folder, scale, 40), drive(folder, 1.0, 40), atol=2e-4)


def test_objectives_and_commands_stay_in_the_robots_own_metres(tmp_path):
    fast = drive(tmp_path, 4.0, 60)
    speeds = np.hypot(*fast[:, -2:].T) * 4.0
    assert 0.3 < speeds.max() <= 1.2 + 1e-6


def test_a_larger_robot_has_arrived_from_further_away():
    assert Team().arrival_m == 0.1
    assert Team(scale_m=6.0).arrival_m == pytest.approx(0.6)
    assert Team(scale_m=6.0, goal_tolerance_m=0.2).arrival_m == 0.2


@pytest.mark.parametrize("scale", ["0.0", "-1.0", "nan", '"2 m"', "1e9"])
def test_a_scale_that_is_none_is_refused(tmp_path, scale):
    path = Path(tmp_path / "team.toml")
    path.write_text(FLEET.replace("[team]", f"[team]\nscale_m = {scale}"))
    with pytest.raises(ConfigError, match=r"team\.toml.*scale_m"):
        load_fleet(path)
