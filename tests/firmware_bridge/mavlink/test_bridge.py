import argparse

import bundles
import msgspec
import pytest

from edge_runtime.errors import BridgeError, ConfigError
from edge_runtime.motion.models import PointForce
from edge_runtime.policy.manifest import ActionField
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.link import SetpointLimits
from firmware_bridge.mavlink.bridge import add_arguments, make_spec, options_from
from firmware_bridge.mavlink.link import MavlinkLink, make_link
from firmware_bridge.mavlink.options import MavlinkOptions

MOTION = PointForce(mass_kg=2.0, drag=0.25, dt_s=0.1)
ACTION = tuple(ActionField(f"force_{axis}", "N", -1.25, 1.0) for axis in "xy")
MANIFEST = msgspec.structs.replace(bundles.MANIFEST, motion=MOTION, action=ACTION)


def make_bridge(*flags):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    needed = ("--mavlink", "udpin:127.0.0.1:14550", "--mavlink-autopilot", "ardupilot_rover")
    arguments = parser.parse_args([*needed, *flags])
    return GuardedBridge(make_spec(3, MANIFEST, options_from(arguments), 50.0))


def options_of(bridge):
    return msgspec.json.decode(bridge._spec.options, type=MavlinkOptions)


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "mavlink.key"
    path.write_text(bytes(range(32)).hex())
    path.chmod(0o600)
    return path


def test_flags_reach_the_guard():
    bridge = make_bridge(
        *("--mavlink", "serial:/dev/ttyACM0:921600", "--mavlink-autopilot", "px4", "--mavlink-system", "5"),
        *("--mavlink-source-system", "9", "--mavlink-origin", "1.5", "-2", "--mavlink-point-ahead", "0.3"),
        *("--max-speed", "1.5", "--arm"),
    )
    spec = bridge._spec
    assert (spec.link, spec.robot_id, spec.arm, spec.limits) == (
        "mavlink",
        3,
        True,
        SetpointLimits(1.5, (-1.25, -1.25), (1.0, 1.0)),
    )
    assert options_of(bridge) == MavlinkOptions(
        autopilot="px4",
        address="serial:/dev/ttyACM0:921600",
        motion=MOTION.at_period(0.02),
        point_ahead_m=0.3,
        system_id=5,
        source_system=9,
        origin_m=(1.5, -2.0),
    )


def test_the_guard_builds_its_link_from_the_options():
    link = make_link(make_bridge("--mavlink-autopilot", "px4")._spec)
    assert isinstance(link, MavlinkLink)
    assert link.firmware_timeout_s is None


def test_wheels_may_refuse_sideways_velocities():
    assert options_of(make_bridge("--mavlink-point-ahead", "0")).point_ahead_m == 0.0
    make_link(make_bridge("--mavlink-point-ahead", "0")._spec)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--mavlink-autopilot", "inav"), "--mavlink-autopilot 'inav' is unknown; choose ardupilot_rover"),
        (("--mavlink", "tcp:1.2.3.4:5760"), "is no address; write udpin:HOST:PORT"),
        (("--mavlink-system", "0"), r"--mavlink-system must lie in \[1, 255\], got 0"),
        (("--mavlink-source-system", "256"), r"--mavlink-source-system must lie in \[1, 255\]"),
        (("--max-speed", "0"), "--max-speed must be above 0 and finite"),
        (("--max-speed", "inf"), "--max-speed must be above 0 and finite"),
        (("--mavlink-point-ahead", "-0.1"), "--mavlink-point-ahead must be 0 or more"),
        (("--mavlink-point-ahead", "inf"), "--mavlink-point-ahead must be 0 or more"),
        (("--mavlink-origin", "nan", "0"), "--mavlink-origin must be two finite numbers"),
        (("--mavlink-require-signing",), "--mavlink-require-signing needs --mavlink-signing-key FILE"),
        (("--mavlink-signing-key", "/nowhere/key"), "key /nowhere/key: No such file"),
    ],
)
def test_bad_flags_are_one_line_with_the_remedy(flags, message):
    with pytest.raises(ConfigError, match=message) as caught:
        make_bridge(*flags)
    assert "\n" not in str(caught.value)


def test_a_signing_key_is_checked_at_once_and_used_by_the_link(key):
    bridge = make_bridge("--mavlink-signing-key", str(key), "--mavlink-require-signing")
    link = make_link(bridge._spec)
    link.close()
    assert (key.parent / "mavlink.key.255-191.timestamp").exists()
    key.chmod(0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        make_bridge("--mavlink-signing-key", str(key))


def test_a_port_that_does_not_exist_stops_the_start():
    with (
        pytest.raises(BridgeError, match="--mavlink serial:/dev/nowhere:57600"),
        make_bridge("--mavlink", "serial:/dev/nowhere:57600"),
    ):
        pass


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot_copter"])
def test_what_flies_takes_policies_in_space(autopilot):
    motion = PointForce(1.0, 0.0, 0.1, dims=3)
    action = tuple(ActionField(axis, "N", -1.0, 1.0) for axis in "xyz")
    manifest = msgspec.structs.replace(bundles.MANIFEST, motion=motion, action=action)
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    flags = ["--mavlink", "udpin:127.0.0.1:14550", "--mavlink-autopilot", autopilot]
    spec = make_spec(3, manifest, options_from(parser.parse_args(flags)), 50.0)
    assert (len(spec.limits.low), spec.limits.dims, spec.limits.yaw_rate_rad_s) == (3, 3, 0.0)
    assert msgspec.json.decode(spec.options, type=MavlinkOptions).motion == motion.at_period(0.02)
    rover = options_from(parser.parse_args([*flags[:3], "ardupilot_rover"]))
    with pytest.raises(ConfigError, match="ardupilot_rover moves in the plane alone"):
        make_spec(3, manifest, rover, 50.0)
