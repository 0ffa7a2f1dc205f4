"""The packaged profiles, and what a profile of one's own may say."""

import pytest

from edge_runtime.errors import ConfigError
from firmware_bridge.ros.profile import PROFILES, RosProfile, check_namespace, load_profile, profile_path

COUNTS = "`zeros` must lie in [1, 100] and `recoveries` in [0, 100]"
NAMES = sorted(path.stem for path in PROFILES.glob("*.toml"))


def test_all_robots_of_the_readme_have_one():
    assert NAMES == ["clearpath_humble", "clearpath_jazzy", "generic", "husky_noetic", "limo_ros2"]


@pytest.mark.parametrize("name", NAMES)
def test_a_packaged_profile_is_whole(name):
    profile = load_profile(profile_path(name)).under("/a200_0000")
    names = [profile.command, profile.odometry, profile.emergency_stop, profile.timeout_parameter]
    assert all(topic.startswith("/") for topic in names if topic)
    assert profile.base.reference_m > 0.0


def test_names_are_below_the_namespace_unless_they_are_absolute():
    husky = load_profile(profile_path("clearpath_jazzy")).under("/a200_0000")
    assert husky.command == "/a200_0000/cmd_vel"
    assert husky.timeout_parameter == "/a200_0000/platform_velocity_controller/cmd_vel_timeout"
    assert husky.operators[0] == "/a200_0000/joy_teleop/cmd_vel"
    assert load_profile(profile_path("limo_ros2")).under("/a200_0000").command == "/cmd_vel"


def test_jazzy_stamps_its_commands_and_humble_does_not():
    kinds = {name: load_profile(profile_path(name)).type_name for name in NAMES}
    assert kinds["clearpath_jazzy"] == "geometry_msgs/TwistStamped"
    assert kinds["clearpath_humble"] == kinds["husky_noetic"] == "geometry_msgs/Twist"


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('command = "cmd_vel"', 'command = "cmd vel"', "not a name of ROS: 'cmd vel'"),
        ('command = "cmd_vel"', "", f"command: missing; allowed: {', '.join(RosProfile.__struct_fields__)}"),
        (
            'message = "Twist"',
            'message = "Pose"',
            "message: Invalid enum value 'Pose'; allowed: 'Twist', 'TwistStamped'",
        ),
        (
            '"controller/cmd_vel_timeout"',
            '"/cmd_vel_timeout"',
            "`timeout_parameter` must name a node and its parameter: node/parameter",
        ),
        (
            "[limits]",
            "firmware_timeout_s = 0.5\n[limits]",
            "give one of `timeout_parameter` and `firmware_timeout_s`: asked for, or known",
        ),
        ("[limits]", "stale_s = 0\n[limits]", "`stale_s` must lie in (0, 10], got 0.0"),
        ("[limits]", "period_s = 11\n[limits]", "`period_s` must lie in (0, 10], got 11.0"),
        ("[limits]", "enable_timeout_s = -1\n[limits]", "`enable_timeout_s` must lie in (0, 10], got -1.0"),
        ("[limits]", "zeros = 0\n[limits]", COUNTS),
        ("[limits]", "zeros = 101\n[limits]", COUNTS),
        ("[limits]", "recoveries = -1\n[limits]", COUNTS),
        ("[limits]", "recoveries = 101\n[limits]", COUNTS),
        (
            "# emergency_stop_silent_s",
            "emergency_stop_silent_s",
            "`emergency_stop_silent_s` needs `emergency_stop`: the topic that may fall silent",
        ),
        (
            "[limits]",
            'emergency_stop = "e_stop"\nemergency_stop_silent_s = 0\n[limits]',
            "`emergency_stop_silent_s` must lie in (0, 10], got 0.0",
        ),
        ("speed_m_s = 0.5", "speed_m_s = 0.0", "limits: `speed_m_s` must be positive, got 0.0"),
        (
            "speed_m_s = 0.5",
            "speed_m_s = 0.5\ndeceleration_m_s2 = 0",
            "limits: `deceleration_m_s2` must be positive, got 0.0",
        ),
        (
            "speed_m_s = 0.5",
            "speed_m_s = 0.5\ncolour = 1",
            "limits.colour: unknown key; allowed: speed_m_s, deceleration_m_s2",
        ),
        (
            'kind = "differential"',
            'kind = "ackermann"\nwheelbase_m = 1.0\nmax_steering_rad = 0.5',
            "a Twist has no steering angle: `base.kind` must not be 'ackermann'",
        ),
    ],
)
def test_what_a_profile_may_not_say(tmp_path, old, new, complaint):
    path = tmp_path / "mine.toml"
    text = profile_path("generic").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        load_profile(profile_path(str(path)))
    assert str(caught.value) == f"{path}: {complaint}"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("stale_s", 10.0), ("period_s", 1e-3), ("enable_timeout_s", 10.0)),
        *(("zeros", 1), ("zeros", 100), ("recoveries", 0), ("recoveries", 100)),
    ],
)
def test_what_it_may(tmp_path, name, value):
    path = tmp_path / "mine.toml"
    path.write_text(f"{name} = {value}\n{profile_path('generic').read_text()}")
    assert getattr(load_profile(path), name) == value


def test_a_robot_may_brake_gently(tmp_path):
    path = tmp_path / "mine.toml"
    text = profile_path("generic").read_text()
    path.write_text(text.replace("speed_m_s = 0.5", "speed_m_s = 0.5\ndeceleration_m_s2 = 0.5"))
    assert load_profile(path).limits.deceleration_m_s2 == 0.5


def test_what_it_leaves_out_is_left_out_under_a_namespace_too():
    limo = load_profile(profile_path("limo_ros2")).under("/limo")
    assert (limo.emergency_stop, limo.timeout_parameter, limo.operators) == (None, None, ())


def test_a_profile_that_does_not_exist_is_answered_with_those_that_do():
    with pytest.raises(
        ConfigError, match=f"^--ros-profile husky: no such profile; known: {', '.join(NAMES)}"
    ):
        profile_path("husky")


@pytest.mark.parametrize("namespace", ["", "/a200_0000", "/fleet/a200_0000"])
def test_a_namespace_is_accepted(namespace):
    check_namespace(namespace)


@pytest.mark.parametrize("namespace", ["a200_0000", "/", "/a200 0000", "/0", "/a200_0000/", "/a\n"])
def test_what_is_no_namespace_is_refused(namespace):
    with pytest.raises(ConfigError) as caught:
        check_namespace(namespace)
    assert str(caught.value) == f"--ros-namespace {namespace!r}: must look like /a200_0000, or be left out"
