"""The profiles against numbers that others publish: pymavlink's dialects, the autopilots' documentation."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as published

from edge_runtime.errors import ConfigError
from firmware_bridge.mavlink.profiles import (
    BODY_NED,
    LOCAL_NED,
    PROFILES,
    VELOCITY_AND_YAW_RATE,
    VELOCITY_ONLY,
    SetpointKind,
    find_profile,
    misfit,
)

POSITION = (
    published.POSITION_TARGET_TYPEMASK_X_IGNORE
    | published.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | published.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
ACCELERATION = (
    published.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | published.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | published.POSITION_TARGET_TYPEMASK_AZ_IGNORE
)
YAW = published.POSITION_TARGET_TYPEMASK_YAW_IGNORE
YAW_RATE = published.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE


def test_masks_ignore_what_they_say():
    assert VELOCITY_ONLY == POSITION | ACCELERATION | YAW | YAW_RATE
    assert VELOCITY_AND_YAW_RATE == POSITION | ACCELERATION | YAW


def test_frames():
    assert (LOCAL_NED, BODY_NED) == (published.MAV_FRAME_LOCAL_NED, published.MAV_FRAME_BODY_NED)


@pytest.mark.parametrize(
    ("profile", "command", "stop"),
    [
        ("ardupilot_rover", published.ROVER_MODE_GUIDED, published.ROVER_MODE_HOLD),
        ("ardupilot_copter", published.COPTER_MODE_GUIDED, published.COPTER_MODE_BRAKE),
    ],
)
def test_ardupilot_modes(profile, command, stop):
    modes = (PROFILES[profile].command_mode, PROFILES[profile].stop_mode)
    assert [(mode.main, mode.sub, mode.reported) for mode in modes] == [
        (command, 0, command),
        (stop, 0, stop),
    ]


def test_px4_modes_are_packed_main_in_the_third_and_sub_in_the_fourth_byte():
    offboard, hold = PROFILES["px4"].command_mode, PROFILES["px4"].stop_mode
    assert (offboard.main, offboard.sub) == (6, 0)
    assert (hold.main, hold.sub) == (4, 3)
    for mode in (offboard, hold):
        assert mode.reported.to_bytes(4, "little") == bytes([0, 0, mode.main, mode.sub])


def test_only_the_rover_turns_before_it_moves_sideways_and_only_px4_needs_a_stream_first():
    assert [p.name for p in PROFILES.values() if p.motion is not SetpointKind.VELOCITY] == ["ardupilot_rover"]
    assert [p.name for p in PROFILES.values() if p.prestream_s > 1.0] == ["px4"]


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ConfigError, match="'apm' is unknown; choose ardupilot_rover, ardupilot_copter, px4"):
        find_profile("apm")


@pytest.mark.parametrize(
    ("profile", "autopilot", "kind", "said"),
    [
        ("ardupilot_copter", published.MAV_AUTOPILOT_ARDUPILOTMEGA, published.MAV_TYPE_GROUND_ROVER, "rover"),
        ("ardupilot_rover", published.MAV_AUTOPILOT_ARDUPILOTMEGA, published.MAV_TYPE_QUADROTOR, "copter"),
        ("ardupilot_rover", published.MAV_AUTOPILOT_PX4, published.MAV_TYPE_GROUND_ROVER, "px4"),
        ("px4", published.MAV_AUTOPILOT_ARDUPILOTMEGA, published.MAV_TYPE_HEXAROTOR, "copter"),
        ("px4", published.MAV_AUTOPILOT_PX4, published.MAV_TYPE_FIXED_WING, "choose among ardupilot_rover"),
        ("px4", published.MAV_AUTOPILOT_GENERIC, published.MAV_TYPE_GROUND_ROVER, "choose among"),
    ],
)
def test_a_vehicle_of_another_kind_is_told_with_the_profile_that_fits(profile, autopilot, kind, said):
    """Mode 4 is HOLD on a rover and GUIDED on a copter."""
    text = misfit(PROFILES[profile], autopilot, kind)
    assert said in text
    assert f"not what --mavlink-autopilot {profile} is for" in text


@pytest.mark.parametrize(
    ("profile", "autopilot", "kinds"),
    [
        ("ardupilot_rover", published.MAV_AUTOPILOT_ARDUPILOTMEGA, ("GROUND_ROVER", "SURFACE_BOAT")),
        ("ardupilot_copter", published.MAV_AUTOPILOT_ARDUPILOTMEGA, ("QUADROTOR", "TRICOPTER", "HELICOPTER")),
        ("px4", published.MAV_AUTOPILOT_PX4, ("QUADROTOR", "DODECAROTOR", "GROUND_ROVER")),
    ],
)
def test_vehicles_that_fit(profile, autopilot, kinds):
    for kind in kinds:
        assert misfit(PROFILES[profile], autopilot, getattr(published, f"MAV_TYPE_{kind}")) == ""


def test_the_estimators_messages_are_the_dialects():
    numbers = {published.MAVLINK_MSG_ID_EKF_STATUS_REPORT, published.MAVLINK_MSG_ID_ESTIMATOR_STATUS}
    assert {profile.estimator_message for profile in PROFILES.values()} == numbers


def test_a_rovers_own_timeout_is_not_a_parameter():
    """ArduPilot's Rover/mode_guided.cpp: 3000 ms, in every release."""
    fixed = {name: profile.fixed_timeout_s for name, profile in PROFILES.items()}
    assert fixed == {"ardupilot_rover": 3.0, "ardupilot_copter": None, "px4": None}
