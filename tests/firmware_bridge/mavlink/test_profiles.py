"""The profiles against numbers that others publish: pymavlink's dialects, the autopilots' documentation."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as published

from edge_runtime.errors import ConfigError
from firmware_bridge.mavlink.profiles import (
    ACCELERATION_ONLY,
    BODY_NED,
    LOCAL_NED,
    PROFILES,
    VELOCITY_AND_YAW_RATE,
    VELOCITY_ONLY,
    SetpointKind,
    find_profile,
)

POSITION = (
    published.POSITION_TARGET_TYPEMASK_X_IGNORE
    | published.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | published.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
VELOCITY = (
    published.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | published.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | published.POSITION_TARGET_TYPEMASK_VZ_IGNORE
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
    assert ACCELERATION_ONLY == POSITION | VELOCITY | YAW | YAW_RATE


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


def test_only_the_copter_is_sent_accelerations_and_only_px4_needs_a_stream_first():
    assert [p.name for p in PROFILES.values() if p.motion is SetpointKind.ACCELERATION] == [
        "ardupilot_copter"
    ]
    assert [p.name for p in PROFILES.values() if p.prestream_s > 1.0] == ["px4"]


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ConfigError, match="'apm' is unknown; choose ardupilot_rover, ardupilot_copter, px4"):
        find_profile("apm")
