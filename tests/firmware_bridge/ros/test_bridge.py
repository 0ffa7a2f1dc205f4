"""The flags of both bridges, and what is refused before anything of ROS is needed."""

import math

import msgspec
import pytest
from bundles import write_straight_bundle

from edge_runtime.errors import ConfigError
from edge_runtime.motion.models import PointAcceleration, Unicycle
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.run import edge_run
from edge_runtime.run.flags import read_flags
from firmware_bridge.ros.bridge import make_spec, options_from
from firmware_bridge.ros.link import RosOptions
from firmware_bridge.ros.odometry import Origin

MANIFEST = packaged_bundle("navigation").manifest


def options(*flags, bridge="ros2", profile="clearpath_jazzy"):
    arguments = ["--robot-id", "0", "--bridge", bridge, "--ros-profile", profile, *flags]
    parsed, _ = read_flags(arguments)
    return options_from(parsed)


def test_flags_become_the_guards_specification():
    flags = (
        "--ros-namespace",
        "/a200_0000",
        "--ros-origin",
        "1",
        "2",
        "3",
        "--ros-path",
        "/a",
        "--ros-path",
        "/b",
    )
    spec = make_spec(4, MANIFEST, options(*flags, "--max-speed", "0.5", "--arm"), 20.0)
    told = msgspec.json.decode(spec.options, type=RosOptions)
    assert (spec.link, spec.robot_id, spec.limits.speed_m_s, spec.arm) == ("ros2", 4, 0.5, True)
    assert (told.ros, told.namespace, told.origin) == (2, "/a200_0000", Origin(1.0, 2.0, 3.0))
    assert told.python_path == ("/a", "/b")


def test_the_odometrys_origin_is_the_teams_unless_a_flag_says_otherwise():
    told = options()
    assert (told.origin, told.namespace, told.python_path) == (Origin(0.0, 0.0, 0.0), "", ())


def test_a_profile_is_asked_for():
    with pytest.raises(ConfigError, match="required: --ros-profile"):
        read_flags(["--robot-id", "0", "--bridge", "ros1"])


def test_a_profile_gives_speed_and_deceleration():
    spec = make_spec(4, MANIFEST, options(bridge="ros1", profile="husky_noetic"), 20.0)
    assert (spec.link, spec.limits.speed_m_s, spec.deceleration_m_s2) == ("ros1", 1.0, 3.0)


def test_a_policy_that_turns_its_robot_turns_it_as_fast_as_the_profile_allows():
    motion = Unicycle(0.1)
    spec = make_spec(4, msgspec.structs.replace(MANIFEST, motion=motion), options(), 20.0)
    assert msgspec.json.decode(spec.options, type=RosOptions).turns
    assert spec.limits.yaw_rate_rad_s == 1.0


def test_what_a_profiles_base_cannot_follow_is_refused():
    manifest = msgspec.structs.replace(MANIFEST, motion=PointAcceleration(0.1, dims=3))
    with pytest.raises(ConfigError, match=r"base of .*clearpath_jazzy\.toml moves in the plane alone"):
        make_spec(4, manifest, options(), 20.0)


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"profile": "husky_noetic"}, "speaks ROS 1: --bridge ros1"),
        ({"profile": "husky"}, "no such profile"),
        ({"namespace": "a200"}, "must look like"),
        ({"max_speed_m_s": 1.5}, "at most 1 m/s, the limit of profile clearpath_jazzy"),
        ({"max_speed_m_s": math.nan}, "must be positive"),
        ({"origin": Origin(math.inf, 0.0, 0.0)}, "^--ros-origin must be three finite numbers$"),
        ({"origin": Origin(0.0, 0.0, math.nan)}, "^--ros-origin must be three finite numbers$"),
    ],
)
def test_what_does_not_fit_is_refused(wrong, line):
    with pytest.raises(ConfigError, match=line):
        make_spec(0, MANIFEST, msgspec.structs.replace(options(), **wrong), 20.0)


def test_a_robot_without_ros_is_told_so_in_one_line(tmp_path, capsys):
    bundle = write_straight_bundle(tmp_path / "straight")
    fleet = tmp_path / "alone.toml"
    fleet.write_text("[[robots]]\nid = 0\nstart_m = [0.0, 0.0]\ngoal_m = [3.0, 1.0]\n")
    flags = ["--robot-id", "0", "--rate", "50", "--fleet", str(fleet), "--policy", str(bundle)]
    flags += ["--backend", "numpy"]
    ros = ["--bridge", "ros2", "--ros-profile", "generic", "--ros-path", str(tmp_path)]
    assert edge_run.main([*flags, *ros]) == 2
    error = capsys.readouterr().err
    assert "rclpy is not installed" in error
    assert "--ros-path" in error
    assert error.count("\n") == 1
