"""Which odometry a robot's state may rest on, on a clock that the test turns."""

import math
import time
from types import SimpleNamespace as Of

import msgspec
import pytest

from firmware_bridge.ros.odometry import Odometer, Odometry, Origin, odometry_from
from firmware_bridge.ros.profile import load_profile, profile_path

PROFILE = load_profile(profile_path("husky_noetic"))
APART_S = 60.0


def odometry(now, x=0.0, **changes):
    values = {"x_m": x, "y_m": 0.0, "heading_rad": 0.0, "forward_m_s": 0.0, "lateral_m_s": 0.0,
              "yaw_rad_s": 0.0, "stamp_s": wall(now), "arrival_s": now, "frame": "base_link"}  # fmt: skip
    return Odometry(**{**values, **changes})


AHEAD_S = time.time() - time.monotonic()


def wall(now):
    """What a well set clock shows at a monotonic time."""
    return AHEAD_S + now


@pytest.fixture
def odometer():
    return Odometer(3, PROFILE, "/a200_0000", Origin())


def test_nothing_is_known_at_first(odometer):
    assert (odometer.state, odometer.robot_time_s(1.0)) == (None, 0.0)
    assert odometer.fault(1.0) == "no odometry yet"


def test_a_point_ahead_of_the_axle_is_located_in_the_teams_frame():
    odometer = Odometer(3, PROFILE, "", Origin(10.0, 20.0, math.pi / 2))
    odometer.take(odometry(5.0, x=1.0, y_m=2.0, heading_rad=math.pi / 2, forward_m_s=0.5, yaw_rad_s=0.25))
    state = odometer.state
    # Turned by a quarter: east is north. The axle is at (1, 2), the point 0.4 m further along y.
    assert state.position_m == pytest.approx((10.0 - 2.4, 20.0 + 1.0))
    assert abs(state.heading_rad) == pytest.approx(math.pi)
    assert state.velocity_m_s == pytest.approx((-0.5, -0.1))
    assert (state.robot_id, state.stamp_s, state.yaw_rate_rad_s) == (3, 5.0, 0.25)
    assert odometer.warning == ""


def test_what_goes_stale_is_a_fault_and_what_comes_again_is_none(odometer):
    odometer.take(odometry(5.0))
    assert odometer.fault(5.19) == ""
    assert odometer.fault(5.3) == "odometry is 0.30 s old"
    odometer.take(odometry(5.4))
    assert odometer.fault(5.4) == ""


@pytest.mark.parametrize(
    "name", ["x_m", "y_m", "heading_rad", "forward_m_s", "lateral_m_s", "yaw_rad_s", "stamp_s"]
)
@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_what_is_not_finite_becomes_no_state(odometer, name, number):
    odometer.take(odometry(5.0))
    odometer.take(msgspec.structs.replace(odometry(5.02), **{name: number}))
    assert odometer.fault(5.02) == "odometry is not finite"
    assert odometer.state.position_m == (0.4, 0.0)
    odometer.take(odometry(5.04))
    assert odometer.fault(5.04) == ""


def test_a_message_that_came_late_is_no_jump_of_the_next(odometer):
    """At 1 m/s; the first waited for 0.15 s, the second for nothing."""
    odometer.take(odometry(5.15, x=0.0, stamp_s=wall(5.0)))
    odometer.take(odometry(5.17, x=0.17, stamp_s=wall(5.17)))
    assert odometer.fault(5.17) == ""


@pytest.mark.parametrize("late_s", [0.0, 3600.0])
def test_a_clock_that_leaps_hides_no_jump(odometer, late_s):
    odometer.take(odometry(5.0, stamp_s=wall(5.0)))
    odometer.take(odometry(5.02, x=0.6, stamp_s=wall(5.02) + late_s))
    assert odometer.fault(5.02) == "odometry jumped by 0.60 m"


@pytest.mark.parametrize("axis", ["x_m", "y_m"])
def test_a_jump_is_what_no_robot_of_the_profile_travels_along_either_axis(axis):
    limits = msgspec.structs.replace(PROFILE.limits, speed_m_s=0.5)
    odometer = Odometer(3, msgspec.structs.replace(PROFILE, limits=limits), "", Origin())
    for now, where, fault in ((5.0, 7.0, ""), (5.1, 7.19, ""), (5.2, 7.40, "odometry jumped by 0.21 m")):
        odometer.take(odometry(now, **{axis: where}))
        assert odometer.fault(now) == fault


def test_so_is_a_turn_that_none_turns():
    base = msgspec.structs.replace(PROFILE.base, max_yaw_rad_s=2.0)
    odometer = Odometer(3, msgspec.structs.replace(PROFILE, base=base), "", Origin())
    for now, heading, fault in (
        (5.0, 1.0, ""),
        (5.1, 1.89, ""),
        (5.2, 2.80, "odometry turned by 0.91 rad at once"),
    ):
        odometer.take(odometry(now, heading_rad=heading))
        assert odometer.fault(now) == fault


def test_a_jump_is_never_forgiven(odometer):
    odometer.take(odometry(5.0))
    odometer.take(odometry(5.02, x=0.13))
    assert odometer.fault(5.02) == ""
    odometer.take(odometry(5.04, x=0.30))
    assert odometer.fault(5.04) == "odometry jumped by 0.17 m"
    odometer.take(odometry(5.06, x=0.30))
    odometer.forgive()
    assert odometer.fault(5.06) == "odometry jumped by 0.17 m"


def test_so_is_a_turn_at_once(odometer):
    odometer.take(odometry(5.0, heading_rad=3.0))
    odometer.take(odometry(5.02, heading_rad=-3.0))
    assert odometer.fault(5.02) == ""
    odometer.take(odometry(5.04, heading_rad=0.0))
    assert odometer.fault(5.04) == "odometry turned by 3.00 rad at once"


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        ("base_link", ""),
        ("a200_0000/base_link", ""),
        ("/a200_0000/base_link", ""),
        ("a200_0001/base_link", "odometry is of 'a200_0001/base_link', not of /a200_0000"),
    ],
)
def test_a_frames_prefix_names_the_robot(odometer, frame, fault):
    odometer.take(odometry(5.0, frame=frame))
    assert odometer.fault(5.0) == fault


def test_a_frame_that_changes_is_another_robots():
    odometer = Odometer(3, PROFILE, "", Origin())
    odometer.take(odometry(5.0, frame="husky/base_link"))
    odometer.take(odometry(5.02, frame="limo/base_link"))
    assert odometer.fault(5.02) == "odometry is of 'limo/base_link' now, and was of 'husky/base_link'"


def test_what_comes_late_is_a_fault_until_a_clock_that_was_set_is_forgiven(odometer):
    odometer.take(odometry(5.0))
    odometer.take(odometry(5.5, stamp_s=wall(5.1)))
    assert odometer.fault(5.5) == "odometry comes 0.40 s late"
    odometer.forgive()
    odometer.take(odometry(5.6, stamp_s=wall(5.2)))
    assert odometer.fault(5.6) == ""


def test_a_clock_that_runs_a_little_faster_than_ours_never_looks_late(odometer):
    for step in range(30_000):  # 0.3 s apart in the end
        now = 5.0 + 0.02 * step
        odometer.take(odometry(now, stamp_s=wall(5.0) + 0.02 * step * (1.0 - 5e-4)))
        assert odometer.fault(now) == ""


@pytest.mark.parametrize(("apart", "way"), [(-APART_S, "behind"), (APART_S, "ahead of")])
def test_commands_carry_the_robots_time_however_its_clock_is_set(odometer, apart, way):
    odometer.take(odometry(5.0, stamp_s=wall(5.0) + apart))
    assert odometer.fault(5.0) == ""
    assert odometer.warning == f"the robot's clock is 60 s {way} ours: commands carry its time"
    assert odometer.robot_time_s(5.01) == pytest.approx(wall(5.01) + apart, abs=1e-3)


def test_without_stamps_nothing_is_said_of_clocks(odometer):
    for now in (5.0, 6.0):
        odometer.take(odometry(now, stamp_s=0.0))
        assert (odometer.fault(now), odometer.warning, odometer.robot_time_s(now + 0.1)) == ("", "", 0.0)


def message(x, y, z, w):
    zero = Of(x=0.0, y=0.0, z=0.0)
    return Of(
        pose=Of(pose=Of(position=Of(x=1.0, y=2.0), orientation=Of(x=x, y=y, z=z, w=w))),
        twist=Of(twist=Of(linear=Of(x=3.0, y=4.0), angular=Of(x=0.0, y=0.0, z=5.0))),
        child_frame_id="base_link",
        unused=zero,
    )


def test_a_message_of_either_ros_is_read():
    half = math.sqrt(0.5)
    read = odometry_from(message(0.0, 0.0, half, half), 7.0, 8.0)
    assert read.heading_rad == pytest.approx(math.pi / 2)
    assert (read.x_m, read.y_m, read.forward_m_s, read.lateral_m_s, read.yaw_rad_s) == (
        1.0,
        2.0,
        3.0,
        4.0,
        5.0,
    )
    assert (read.stamp_s, read.arrival_s, read.frame) == (7.0, 8.0, "base_link")


def test_a_heading_survives_roll_and_pitch_and_a_quaternion_that_is_none_is_told():
    yaw, pitch = 0.7, 0.3
    w, z = math.cos(yaw / 2) * math.cos(pitch / 2), math.sin(yaw / 2) * math.cos(pitch / 2)
    x, y = -math.sin(yaw / 2) * math.sin(pitch / 2), math.cos(yaw / 2) * math.sin(pitch / 2)
    assert odometry_from(message(x, y, z, w), 0.0, 0.0).heading_rad == pytest.approx(yaw)
    for place, heading in enumerate((0.0, math.pi, math.pi, 0.0)):  # half a turn about each axis; none
        turn = [-1.0 if one == place else 0.0 for one in range(4)]
        assert abs(odometry_from(message(*turn), 0.0, 0.0).heading_rad) == heading
    assert math.isnan(odometry_from(message(0.0, 0.0, 0.0, 0.0), 0.0, 0.0).heading_rad)
    assert math.isnan(odometry_from(message(0.0, 0.0, math.nan, 1.0), 0.0, 0.0).heading_rad)
