import math
import os
import random
import struct
from types import SimpleNamespace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mavlink_peers import local_position, odometry, vehicle_frame
from pymavlink.dialects.v20 import ardupilotmega as common

from edge_runtime.errors import ConfigError
from firmware_bridge.mavlink.decoder import STRETCHES_A_DATAGRAM, Decoder
from firmware_bridge.mavlink.encoder import COMPANION, Encoder
from firmware_bridge.mavlink.messages import (
    Attitude,
    Beat,
    Command,
    CommandResult,
    EstimatorStatus,
    GpsFix,
    Heartbeat,
    Landed,
    LocalPosition,
    MessageInterval,
    Odometry,
    Parameter,
    ParameterRequest,
    StatusText,
    Target,
    TimeSync,
)
from firmware_bridge.mavlink.signing import SignatureCheck, Signing, Timestamps

KEY = bytes(range(32))
FUZZ_CASES = int(os.environ.get("MAVLINK_FUZZ_CASES", "20000"))
"""A million: MAVLINK_FUZZ_CASES=1000000 pytest tests/firmware_bridge/mavlink/test_codec.py -k fuzz."""


def decoded(*messages, decoder=None):
    decoder = decoder or Decoder()
    return list(decoder.feed(b"".join(vehicle_frame(message) for message in messages)))


def content(message):
    (received,) = decoded(message)
    return received.content


@pytest.fixture
def signing(tmp_path):
    return Signing(KEY, Timestamps(tmp_path / "timestamp"))


class TestReading:
    """Bytes packed by pymavlink become records."""

    def test_heartbeat(self):
        armed = common.MAVLink_heartbeat_message(10, 3, 0x80 | 1, 15, 4, 3)
        disarmed = common.MAVLink_heartbeat_message(2, 12, 0x7F, 4, 3, 3)
        assert content(armed) == Heartbeat(custom_mode=15, armed=True, kind=10, autopilot=3, status=4)
        assert content(disarmed) == Heartbeat(custom_mode=4, armed=False, kind=2, autopilot=12, status=3)

    def test_attitude(self):
        message = common.MAVLink_attitude_message(1500, 0.1, 0.2, 0.5, 0.3, 0.4, 0.25)
        assert content(message) == Attitude(boot_s=1.5, yaw_rad=0.5, yaw_rate_rad_s=0.25)

    def test_local_position(self):
        assert content(local_position(1500, 1.0, 2.0, 0.5, 0.25)) == LocalPosition(
            1.5, (1.0, 2.0), (0.5, 0.25), -3.0, 0.0
        )

    def test_odometry(self):
        assert content(odometry()) == Odometry(
            2.5, (1.0, 2.0), (0.25, 0.5), (1.0, 0.0, 0.0, 0.0), 0.5, 7, 3.0, 0.75
        )

    @pytest.mark.parametrize(("frame_id", "child_frame_id"), [(20, 12), (1, 1), (0, 12)])
    def test_odometry_in_axes_that_say_nothing_about_north_is_unusable(self, frame_id, child_frame_id):
        decoder = Decoder()
        assert decoded(odometry(frame_id=frame_id, child_frame_id=child_frame_id), decoder=decoder) == []
        assert decoder.tally.unusable == 1

    def test_time_sync(self):
        assert content(common.MAVLink_timesync_message(5, 7)) == TimeSync(remote_ns=5, asker_ns=7)

    def test_parameter(self):
        message = common.MAVLink_param_value_message(b"COM_OF_LOSS_T", 0.5, 9, 1, 0)
        assert content(message) == Parameter("COM_OF_LOSS_T", 0.5)

    def test_a_parameter_name_may_fill_its_field(self):
        message = common.MAVLink_param_value_message(b"ABCDEFGHIJKLMNOP", 0.5, 9, 1, 0)
        assert content(message) == Parameter("ABCDEFGHIJKLMNOP", 0.5)

    def test_an_integer_parameter_says_that_it_is_one(self):
        """What it means depends on the autopilot: PX4 puts an integer's bytes into the float field."""
        message = common.MAVLink_param_value_message(b"SCHED_LOOP_RATE", 50.0, 4, 1, 0)
        assert content(message) == Parameter("SCHED_LOOP_RATE", 50.0, real=False)

    def test_both_estimator_reports(self):
        ekf = common.MAVLink_ekf_status_report_message(0x33F, 0.25, 0.5, 9.0, 9.0, 9.0, 9.0)
        status = common.MAVLink_estimator_status_message(1, 0x33F, 0.5, 0.25, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0)
        assert content(ekf) == content(status) == EstimatorStatus(flags=0x33F, ratio=0.5)

    def test_gps_fix(self):
        message = common.MAVLink_gps_raw_int_message(123_000, 3, 1, 2, 3, 4, 5, 6, 7, 8)
        assert content(message) == GpsFix(kind=3, stamp_us=123_000)

    def test_landed_state(self):
        assert content(common.MAVLink_extended_sys_state_message(0, 2)) == Landed(2)

    def test_message_interval(self):
        assert content(common.MAVLink_message_interval_message(32, -1)) == MessageInterval(32, -1)

    def test_status_text_that_is_no_text(self):
        assert content(common.MAVLink_statustext_message(2, b"ok\xff\x00rest")) == StatusText(2, "ok\ufffd")

    def test_command_result(self):
        assert content(common.MAVLink_command_ack_message(400, 4)) == CommandResult(400, 4)

    @pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
    @pytest.mark.parametrize(
        "message",
        [
            lambda bad: common.MAVLink_attitude_message(1, 0.0, 0.0, bad, 0.0, 0.0, 0.0),
            lambda bad: common.MAVLink_attitude_message(1, 0.0, 0.0, 0.0, 0.0, 0.0, bad),
            lambda bad: local_position(x=bad),
            lambda bad: local_position(vy=bad),
            lambda bad: odometry(x=bad),
            lambda bad: odometry(yaw_rate=bad),
            lambda bad: odometry(q=(1.0, 0.0, bad, 0.0)),
            lambda bad: common.MAVLink_param_value_message(b"P", bad, 9, 1, 0),
            lambda bad: common.MAVLink_ekf_status_report_message(0, bad, 0.0, 0.0, 0.0, 0.0, 0.0),
            lambda bad: common.MAVLink_estimator_status_message(0, 0, 0, bad, 0, 0, 0, 0, 0, 0),
        ],
    )
    def test_what_is_not_finite_is_unusable(self, message, bad):
        decoder = Decoder()
        assert decoded(message(bad), decoder=decoder) == []
        assert (decoder.tally.unusable, decoder.tally.accepted) == (1, 1)

    def test_the_sender_is_named(self):
        (received,) = Decoder().feed(vehicle_frame(local_position(), system=7, component=9))
        assert (received.system_id, received.component_id) == (7, 9)

    def test_messages_of_no_interest_are_passed_over(self):
        decoder = Decoder()
        assert decoded(common.MAVLink_system_time_message(1, 2), decoder=decoder) == []
        assert decoder.tally.accepted == 1


class TestCutting:
    def test_bytes_may_come_in_any_portions(self):
        data = vehicle_frame(local_position()) + vehicle_frame(common.MAVLink_timesync_message(1, 2))
        decoder = Decoder()
        received = [r for byte in data for r in decoder.feed(bytes([byte]))]
        assert [type(r.content) for r in received] == [LocalPosition, TimeSync]
        assert decoder.tally.damaged == 0

    @given(noise=st.binary(max_size=40))
    @settings(deadline=None)
    def test_frames_survive_noise_in_front_of_them(self, noise):
        decoder = Decoder()
        # The longest frame's worth of filling lets a magic byte within the noise be seen through.
        data = noise + vehicle_frame(local_position()) + bytes(300)
        assert [r.content for r in decoder.feed(data)] == [content(local_position())]

    @given(noise=st.binary(max_size=20))
    @settings(deadline=None)
    def test_within_a_datagram_frames_survive_it_without_any_filling(self, noise):
        data = noise + vehicle_frame(local_position())
        assert [r.content for r in Decoder().feed(data, whole=True)] == [content(local_position())]

    @pytest.mark.parametrize("noise", [b"\xfd\x00\x00", b"\xfd\x05\x00", b"\xfd\x00\x01\x00"])
    def test_noise_that_looks_like_an_unknown_message_swallows_no_frame(self, noise):
        """No checksum tells: what follows it must begin like a frame."""
        data = noise + vehicle_frame(local_position()) + vehicle_frame(local_position(2000))
        decoder = Decoder()
        received = [r.content.boot_s for byte in data for r in decoder.feed(bytes([byte]))]
        assert received == [1.0, 2.0]
        assert (decoder.tally.unknown, decoder.tally.damaged) == (0, 1)

    def test_noise_holds_up_no_stop(self):
        """Each false beginning costs a checksum: a datagram full of them is given up."""
        decoder = Decoder()
        frame, false = vehicle_frame(local_position()), b"\xfd\xff\x00"
        assert len(list(Decoder().feed(false * (STRETCHES_A_DATAGRAM - 1) + frame, whole=True))) == 1
        assert list(decoder.feed(false * STRETCHES_A_DATAGRAM + frame, whole=True)) == []
        assert len(list(decoder.feed(vehicle_frame(local_position()), whole=True))) == 1
        assert decoder.tally.damaged == 1

    def test_a_frame_right_behind_a_false_magic_byte_is_found(self):
        decoder = Decoder()
        data = b"\xfd" + vehicle_frame(local_position()) + bytes(300)
        assert [r.content for r in decoder.feed(data)] == [content(local_position())]

    def test_a_stretch_of_noise_is_one_damage(self):
        decoder = Decoder()
        assert len(list(decoder.feed(bytes(50) + vehicle_frame(local_position())))) == 1
        list(decoder.feed(bytes(7)))
        assert decoder.tally.damaged == 2

    def test_a_wrong_checksum_is_damage(self):
        frame = bytearray(vehicle_frame(local_position()))
        frame[-1] ^= 1
        decoder = Decoder()
        assert list(decoder.feed(bytes(frame))) == []
        assert decoder.tally.damaged == 1

    def test_an_unknown_incompatibility_flag_is_damage(self):
        """The guide: a frame with a flag that is not understood must be refused, checksum or not."""
        frame = bytearray(vehicle_frame(local_position()))
        frame[2] |= 0x02
        crc = common.x25crc(frame[1:-2])
        crc.accumulate(bytes([common.MAVLink_local_position_ned_message.crc_extra]))
        frame[-2:] = struct.pack("<H", crc.crc)
        decoder = Decoder()
        assert list(decoder.feed(bytes(frame))) == []
        assert decoder.tally.damaged >= 1

    def test_a_payload_shorter_than_its_message_is_filled_with_zeros(self):
        message = local_position(vy=0.0)
        assert len(vehicle_frame(message)) < len(vehicle_frame(local_position()))
        assert content(message).velocity_m_s[1] == 0.0

    def test_messages_outside_the_dialect_are_counted(self):
        frame = bytearray(vehicle_frame(local_position()))
        frame[7:10] = b"\xff\xff\xff"
        decoder = Decoder()
        assert list(decoder.feed(bytes(frame) + vehicle_frame(local_position()))) != []
        assert decoder.tally.unknown == 1

    def test_the_rest_of_a_datagram_does_not_hold_back_the_next(self):
        frame = vehicle_frame(local_position())
        decoder = Decoder()
        assert list(decoder.feed(frame[:-1], whole=True)) == []
        assert len(list(decoder.feed(frame, whole=True))) == 1
        assert decoder.tally.damaged == 1

    def test_a_datagram_that_ends_with_its_frame_leaves_nothing(self):
        decoder = Decoder()
        list(decoder.feed(vehicle_frame(local_position()), whole=True))
        assert decoder.tally.damaged == 0

    def test_pymavlinks_switch_for_damaged_frames_is_refused(self, monkeypatch):
        monkeypatch.setattr(common, "MAVLINK_IGNORE_CRC", "1")
        with pytest.raises(ConfigError, match="unset it"):
            Decoder()


class TestFuzz:
    @given(data=st.binary(max_size=600))
    @settings(max_examples=200, deadline=None)
    def test_fuzz_no_bytes_crash_the_decoder(self, data):
        list(Decoder().feed(data))
        list(Decoder().feed(data, whole=True))

    @given(
        identity=st.sampled_from(sorted(common.mavlink_map)),
        payload=st.binary(min_size=1, max_size=255),
        flags=st.integers(0, 255),
    )
    @settings(max_examples=200, deadline=None)
    def test_fuzz_any_payload_with_a_good_checksum_is_harmless(self, identity, payload, flags):
        header = struct.pack("<BBBBBBBHB", 0xFD, len(payload), flags & 2, 0, 0, 1, 1, identity & 0xFFFF, 0)
        crc = common.x25crc(header[1:] + payload)
        crc.accumulate(bytes([common.mavlink_map[identity].crc_extra]))
        for received in Decoder().feed(header + payload + struct.pack("<H", crc.crc)):
            numbers = [n for n in vars_of(received.content) if isinstance(n, float)]
            assert all(map(math.isfinite, numbers))

    @given(data=st.binary(max_size=600))
    @settings(max_examples=200, deadline=None)
    def test_fuzz_with_a_key_nothing_unsigned_gets_through(self, data):
        assert list(Decoder(signing=NeverSigned()).feed(data)) == []

    @pytest.mark.parametrize("signed", [False, True], ids=["unsigned", "signed"])
    def test_fuzz_mutilated_frames_are_harmless(self, signing, signed):
        """Flipped, cut, repeated, spliced; with a key, only the untouched frames got through, once."""
        draw = random.Random(1)
        sources = [
            vehicle_frame(message, signing=(KEY, signing.timestamps.last + 1 + n) if signed else None)
            for n, message in enumerate((local_position(), odometry(), common.MAVLink_timesync_message(1, 2)))
        ]
        decoder = Decoder(signing if signed else None)
        assert len(list(decoder.feed(b"".join(sources)))) == len(sources)
        for _ in range(FUZZ_CASES):
            received = list(decoder.feed(mutilated(draw, sources), whole=True))
            assert not (signed and received)
            assert all(math.isfinite(n) for r in received for n in vars_of(r.content))


def mutilated(draw, sources):
    frame = bytearray(draw.choice(sources))
    for _ in range(draw.randint(1, 3)):
        at = draw.randrange(len(frame) + 1)
        match draw.randrange(5):
            case 0 if at < len(frame):
                frame[at] ^= 1 << draw.randrange(8)
            case 1 if at < len(frame):
                frame[at] = draw.randrange(256)
            case 2:
                del frame[at:]
            case 3:
                frame[at:at] = frame[: draw.randrange(20)]
            case 4:
                frame[at:] = draw.choice(sources)[at:]
    return bytes(frame)


class NeverSigned(Signing):
    """Judges by the true rules, without a file on disk."""

    def __init__(self):
        self.key = KEY
        self._floor, self._newest = 0, {}


def vars_of(record):
    for field in record.__struct_fields__:
        value = getattr(record, field)
        yield from value if isinstance(value, tuple) else (value,)


class TestWriting:
    """Records become bytes that pymavlink understands."""

    @pytest.fixture
    def read(self):
        def read(outgoing, now_s=12.5):
            frame = Encoder(255, (1, 1)).encode(outgoing, now_s)
            return common.MAVLink(None).decode(bytearray(frame))

        return read

    def test_target(self, read):
        message = read(Target(8, 0x5C7, (1.5, -0.5, 0.25), -0.75))
        assert message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
        assert (message.target_system, message.target_component, message.time_boot_ms) == (1, 1, 12_500)
        assert (message.coordinate_frame, message.type_mask) == (8, 0x5C7)
        assert (message.x, message.y, message.z, message.yaw) == (0.0, 0.0, 0.0, 0.0)
        assert (message.vx, message.vy, message.vz) == (1.5, -0.5, 0.25)
        assert (message.afx, message.afy, message.afz) == (0.0, 0.0, 0.0)
        assert message.yaw_rate == -0.75

    @given(
        sequence=st.integers(0, 255),
        now_s=st.floats(0.0, 1e9),
        system=st.integers(1, 255),
        target=st.tuples(st.integers(1, 255), st.integers(1, 255)),
        frame=st.integers(0, 255),
        mask=st.integers(0, 2**16 - 1),
        numbers=st.lists(st.floats(width=32, allow_nan=False), min_size=4, max_size=4),
        tick=st.none() | st.integers(0, 2**48 - 1),
    )
    @example(0, 0.0, 1, (1, 1), ord("X"), 0, [0.0, 0.0, 0.0, 0.0], None)
    def test_setpoints_are_pymavlinks_to_the_bit(
        self, sequence, now_s, system, target, frame, mask, numbers, tick
    ):
        vx, vy, vz, rate = numbers
        message = common.MAVLink_set_position_target_local_ned_message(
            int(now_s * 1e3) % 2**32, *target, frame, mask, 0, 0, 0, vx, vy, vz, 0, 0, 0, 0, rate
        )
        oracle = common.MAVLink(None, srcSystem=system, srcComponent=COMPANION)
        oracle.seq = sequence
        signing = None
        if tick is not None:
            oracle.signing.secret_key, oracle.signing.sign_outgoing = KEY, True
            oracle.signing.timestamp = tick
            signing = Signing(KEY, SimpleNamespace(last=0, next=lambda: tick))
        encoder = Encoder(system, target, signing)
        encoder._packer.seq = sequence
        outgoing = Target(frame, mask, (vx, vy, vz), rate)
        assert encoder.encode(outgoing, now_s) == bytes(message.pack(oracle))

    def test_the_time_wraps_with_its_field(self, read):
        assert read(Target(1, 0), now_s=2**32 / 1e3 + 1.0).time_boot_ms == 1000

    def test_command(self, read):
        message = read(Command(176, (1.0, 15.0)))
        assert message.get_type() == "COMMAND_LONG"
        assert (message.target_system, message.target_component) == (1, 1)
        assert (message.command, message.confirmation) == (176, 0)
        assert [getattr(message, f"param{i}") for i in range(1, 8)] == [1.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0]

    def test_parameter_request(self, read):
        message = read(ParameterRequest("GUID_TIMEOUT"))
        assert (message.get_type(), message.param_id) == ("PARAM_REQUEST_READ", "GUID_TIMEOUT")
        assert (message.target_system, message.target_component, message.param_index) == (1, 1, -1)

    def test_time_sync(self, read):
        message = read(TimeSync(0, 123))
        assert (message.get_type(), message.tc1, message.ts1) == ("TIMESYNC", 0, 123)

    def test_heartbeat_of_a_companion_computer(self, read):
        message = read(Beat())
        assert message.get_type() == "HEARTBEAT"
        assert (message.type, message.autopilot) == (18, 8)
        assert (message.base_mode, message.custom_mode, message.system_status) == (0, 0, 4)
        assert message.mavlink_version == 3
        assert (message.get_srcSystem(), message.get_srcComponent()) == (255, COMPANION)
        assert common.MAV_COMP_ID_ONBOARD_COMPUTER == COMPANION

    def test_sequence_numbers_count_and_wrap(self):
        encoder = Encoder(255, (1, 1))
        assert [encoder.encode(Beat(), 0.0)[4] for _ in range(258)] == [*range(256), 0, 1]

    def test_without_a_key_frames_are_not_signed(self):
        assert Encoder(255, (1, 1)).encode(Beat(), 0.0)[2] == 0


class TestSigned:
    def test_pymavlink_accepts_what_we_sign_and_only_once(self, signing):
        oracle = common.MAVLink(None)
        oracle.signing.secret_key = KEY
        encoder = Encoder(255, (1, 1), signing)
        start = signing.timestamps.last
        frames = [encoder.encode(Beat(), 0.0) for _ in range(3)]
        ticks = [int.from_bytes(frame[-12:-6], "little") for frame in frames]
        assert start < ticks[0] < ticks[1] < ticks[2] == signing.timestamps.last
        assert all(oracle.decode(bytearray(frame)).get_signed() for frame in frames)
        with pytest.raises(common.MAVError, match="signature"):
            oracle.decode(bytearray(frames[0]))

    def test_every_kind_of_refusal_is_counted(self, signing):
        decoder = Decoder(signing)
        tick = signing.timestamps.last + 5
        good = vehicle_frame(local_position(), signing=(KEY, tick))
        forged = vehicle_frame(local_position(), signing=(KEY[::-1], tick + 1))
        received = list(decoder.feed(good + good + forged + vehicle_frame(local_position())))
        assert [r.content for r in received] == [content(local_position())]
        assert decoder.tally.refused == {
            SignatureCheck.UNSIGNED: 1,
            SignatureCheck.ALTERED: 1,
            SignatureCheck.REPLAYED: 1,
        }
        assert decoder.tally.accepted == 1

    def test_signed_frames_are_cut_with_their_signature(self, signing):
        tick = signing.timestamps.last
        data = b"".join(vehicle_frame(local_position(), signing=(KEY, tick + n)) for n in (1, 2, 3))
        assert len(list(Decoder(signing).feed(data))) == 3
