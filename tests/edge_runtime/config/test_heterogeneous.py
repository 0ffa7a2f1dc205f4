"""One fleet file, robots that differ: each reads its own policy, dynamics and limits."""

import hashlib

import pytest
from bundles import write_straight_bundle

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.run.flags import make_mission, make_parser
from firmware_bridge.can.bridge import CanFlags, make_spec
from firmware_bridge.guard.spec import GuardFlags

FLEET = """
[carrier]
key = "team.key"
[team]
policy = "./straight"
slew_per_s = 5.0
max_action = 100.0
[[robots]]
id = 0
start_m = [0, 0]
goal_m = [1, 0]
address = "127.0.0.1:47001"
[[robots]]
id = 1
start_m = [0, 1]
goal_m = [1, 1]
address = "127.0.0.1:47002"
policy = "navigation"
mass_kg = 2.5
drag = 0.5
slew_per_s = 0.5
max_speed_m_s = 0.4
max_action = 0.25
"""


@pytest.fixture
def mission_of(tmp_path):
    write_straight_bundle(tmp_path / "straight")
    (tmp_path / "team.key").write_bytes(hashlib.sha256(b"a key for tests").digest())
    (tmp_path / "fleet.toml").write_text(FLEET)

    def make(robot_id, *more):
        flags = ["--robot-id", str(robot_id), "--fleet", str(tmp_path / "fleet.toml"), *more]
        return make_mission(make_parser().parse_args(flags))

    return make


def test_each_robot_runs_its_own_policy(mission_of, tmp_path):
    assert mission_of(0).bundle.directory == tmp_path / "straight"
    assert mission_of(1).bundle.manifest.name == "navigation"
    assert mission_of(1, "--policy", str(tmp_path / "straight")).bundle.directory == tmp_path / "straight"


def test_its_own_dynamics_reach_preview_and_guide(mission_of):
    mission, unchanged = mission_of(1), mission_of(0)
    dynamics = mission.bundle.manifest.motion
    assert (dynamics.mass_kg, dynamics.drag) == (2.5, 0.5)
    assert unchanged.bundle.manifest.motion.mass_kg != 2.5
    controller = mission.controller(1)
    expected = mission.bundle.manifest.motion.at_period(mission.period_s).preview(1)
    assert controller.limits.preview == expected
    assert controller.limits.preview.velocity_gain == pytest.approx(mission.period_s / 2.5)


def test_its_own_limits_are_kept(mission_of):
    limits = mission_of(1).controller(1, max_speed_m_s=1.0).limits
    assert limits.max_speed_m_s == 0.4
    assert limits.max_step == pytest.approx(0.5 * mission_of(1).period_s)
    assert mission_of(1).controller(1, max_speed_m_s=0.1).limits.max_speed_m_s == 0.1
    limits = mission_of(0).controller(0, max_speed_m_s=1.0).limits
    assert (limits.max_speed_m_s, limits.max_step) == (1.0, pytest.approx(5.0 * mission_of(0).period_s))


def test_the_fleet_files_limit_bounds_the_policys_and_never_widens_it(mission_of):
    own = packaged_bundle("navigation").manifest.action
    bounded = mission_of(1)
    assert [(field.low, field.high) for field in bounded.bundle.manifest.action] == [(-0.25, 0.25)] * 2
    limits = bounded.controller(1).limits
    assert (limits.low, limits.high) == ((-0.25, -0.25), (0.25, 0.25))
    straight = mission_of(0).bundle.manifest.action
    assert all(field.high < 100.0 for field in straight)
    assert all(field.high > 0.25 for field in own)


def test_the_guard_holds_to_the_same_limit(mission_of):
    flags = CanFlags("can0", "agilex_v2", GuardFlags())
    for robot_id, most in ((1, 0.25), (0, mission_of(0).bundle.manifest.action[0].high)):
        mission = mission_of(robot_id, "--rate", "50")
        spec = make_spec(robot_id, mission.bundle.manifest, flags, mission.rate_hz)
        assert (spec.limits.low, spec.limits.high) == ((-most, -most), (most, most))


def test_an_unknown_robot_lists_the_known_ones(mission_of):
    with pytest.raises(ConfigError, match=r"none has id 7 \(--robot-id\); known ids: 0, 1"):
        mission_of(7)
