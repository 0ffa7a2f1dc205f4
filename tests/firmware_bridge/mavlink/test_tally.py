"""Every frame is counted each time, under its own reason, and under no other."""

import math

import pytest
from mavlink_peers import local_position, vehicle_frame
from pymavlink.dialects.v20 import ardupilotmega as common

from edge_runtime.errors import ConfigError
from firmware_bridge.mavlink.decoder import Decoder
from firmware_bridge.mavlink.signing import SignatureCheck, Signing, Timestamps

KEY = bytes(range(32))
NOW = 10_000_000


@pytest.fixture
def signing(tmp_path):
    return Signing(KEY, Timestamps(tmp_path / "timestamp", clock=lambda: NOW))


def counts(tally):
    return {**vars(tally), **tally.refused}


def counted(decoder, *frames):
    """What the tally holds after the frames, without the zeros."""
    for frame in frames:
        list(decoder.feed(frame, whole=True))
    found = counts(decoder.tally)
    del found["refused"]
    return {name: count for name, count in found.items() if count}


def with_unknown_message(frame):
    """The same frame with a message number that the dialect lacks."""
    return frame[:7] + b"\xff\xff\xff" + frame[10:]


def test_accepted_frames():
    assert counted(Decoder(), *[vehicle_frame(local_position())] * 3) == {"accepted": 3}


def test_damaged_frames():
    frame = bytearray(vehicle_frame(local_position()))
    frame[12] ^= 1
    assert counted(Decoder(), *[bytes(frame)] * 3)["damaged"] >= 3
    assert "accepted" not in counted(Decoder(), bytes(frame))


def test_cut_off_frames():
    assert counted(Decoder(), *[vehicle_frame(local_position())[:20]] * 3) == {"damaged": 3}


def test_unknown_messages():
    frame = with_unknown_message(vehicle_frame(local_position()))
    assert counted(Decoder(), *[frame] * 3) == {"unknown": 3}


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_positions_that_are_no_numbers(number):
    frame = vehicle_frame(local_position(vx=number))
    assert counted(Decoder(), *[frame] * 3) == {"accepted": 3, "unusable": 3}


@pytest.mark.parametrize("field", ["x", "y", "vx", "vy", "yawspeed"])
def test_odometry_that_is_no_number(field):
    values = {"x": 1.0, "y": 2.0, "vx": 3.0, "vy": 4.0, "yawspeed": 5.0, field: math.nan}
    message = common.MAVLink_odometry_message(
        *(1, common.MAV_FRAME_LOCAL_NED, common.MAV_FRAME_BODY_FRD),
        *(values["x"], values["y"], 0.0),
        [1.0, 0.0, 0.0, 0.0],
        *(values["vx"], values["vy"], 0.0),
        *(0.0, 0.0, values["yawspeed"]),
        *([0.0] * 21, [0.0] * 21),
    )
    assert counted(Decoder(), vehicle_frame(message)) == {"accepted": 1, "unusable": 1}


def test_refused_frames(signing):
    unsigned = vehicle_frame(local_position())
    altered = vehicle_frame(local_position(), signing=(bytes(32), NOW + 1))
    genuine = vehicle_frame(local_position(), signing=(KEY, NOW + 1))
    found = counted(Decoder(signing), *[unsigned] * 2, *[altered] * 3, *[genuine] * 5)
    assert found == {
        "accepted": 1,
        SignatureCheck.UNSIGNED: 2,
        SignatureCheck.ALTERED: 3,
        SignatureCheck.REPLAYED: 4,
    }


def test_pymavlinks_own_negligence_is_refused(monkeypatch):
    monkeypatch.setattr(common, "MAVLINK_IGNORE_CRC", True)
    with pytest.raises(ConfigError) as caught:
        Decoder()
    assert str(caught.value) == "MAV_IGNORE_CRC is set: pymavlink would take damaged frames; unset it"
