"""What an autopilot is asked to send: at every control rate as often as that rate needs."""

import pytest

from firmware_bridge.mavlink.pose_rate import longest_pose_s
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.streams import LOCAL_POSITION_NED, SET_INTERVAL, Streams


@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 10.0, 50.0, 200.0])
def test_poses_are_asked_for_often_enough_at_every_rate(rate_hz):
    asked = []
    streams = Streams(PROFILES["px4"], 1.0 / rate_hz, asked.append)
    streams.begin()
    streams.advance(0.0)
    (interval_us,) = [c.parameters[1] for c in asked if (c.command, c.parameters[0]) == (SET_INTERVAL, 32.0)]
    assert LOCAL_POSITION_NED == 32
    assert 0.0 < 1e-6 * interval_us <= longest_pose_s(1.0 / rate_hz) / 2
