"""Frames against the numbers that the vendors publish, profiles against their DBC, and junk."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.errors import ConfigError
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.profile import PROFILES, load_profile, profile_path
from firmware_bridge.kinematics.base import BaseMotion

NAMES = sorted(path.stem for path in PROFILES.glob("*.toml"))


def codec(name="agilex_v2"):
    path = profile_path(name)
    return CanCodec(load_profile(path), path)


CODECS = {name: codec(name) for name in NAMES}
FEEDBACK = [(0x211, False), (0x221, False), (0x01, False), (0x09, False), (0x901, True), (0x200, False)]
identifiers = st.sampled_from(FEEDBACK) | st.tuples(st.integers(0, 2**29 - 1), st.booleans())


def edited(folder, changes, name="agilex_v2"):
    """The codec of a profile with some texts replaced."""
    for suffix in ("dbc", "toml"):
        text = (PROFILES / f"{name}.{suffix}").read_text()
        for old, new in changes.items():
            text = text.replace(old, new)
        (folder / f"{name}.{suffix}").write_text(text)
    path = folder / f"{name}.toml"
    return CanCodec(load_profile(path), path)


def frame(frame_id, data, extended=False):
    return Frame(frame_id, bytes.fromhex(data), extended)


class TestPublishedFrames:
    """What the manuals print; none of these bytes were computed by this project."""

    def test_agilex_motion(self):
        # Scout user manual 1.3, table 3.6, examples 1 and 2: 0.15 m/s; 0.05 rad/s.
        agilex = codec()
        assert agilex.encode(BaseMotion(0.15)) == (frame(0x111, "00 96 00 00 00 00 00 00"),)
        assert agilex.encode(BaseMotion(0.0, 0.0, 0.05)) == (frame(0x111, "00 00 00 32 00 00 00 00"),)

    def test_hunter_steers(self):
        # Hunter-2.0 CAN v2.1, examples 1 and 2: 0.15 m/s; 0.2 rad.
        hunter = codec("agilex_hunter")
        assert hunter.encode(BaseMotion(0.15)) == (frame(0x111, "00 96 00 00 00 00 00 00"),)
        assert hunter.encode(BaseMotion(steering_rad=0.2)) == (frame(0x111, "00 00 00 00 00 00 00 C8"),)

    def test_agilex_sequences(self):
        profile = load_profile(profile_path("agilex_v2"))
        agilex = codec()
        enable = [agilex.encode_step(step) for step in profile.enable]
        assert [(step.frame_id, step.data[0]) for step in enable] == [(0x441, 0), (0x421, 1), (0x131, 0)]
        stop = [agilex.encode_step(step) for step in profile.stop.then]
        assert [(step.frame_id, step.data[0]) for step in stop] == [(0x131, 1), (0x421, 0)]

    def test_agilex_feedback(self):
        agilex = codec()
        state = agilex.decode(frame(0x211, "00 01 00 F1 00 04 00 2A"))
        assert state.values["SystemState.ControlMode"] == 1
        assert state.values["SystemState.BatteryVoltage"] == pytest.approx(24.1)
        assert state.values["SystemState.RemoteLost"] == 1
        motion = agilex.decode(frame(0x221, "FF 6A 00 32 00 00 00 00"))
        assert motion.values["MotionState.Linear"] == pytest.approx(-0.15)
        assert motion.values["MotionState.Angular"] == pytest.approx(0.05)

    def test_agilex_odometry(self, tmp_path):
        # Both wheels' way in mm, int32, the left one first.
        agilex = edited(tmp_path, {"MotionState = 0.1 }": "MotionState = 0.1, Odometry = 0.1 }"})
        way = agilex.decode(frame(0x311, "FF FF FC 18 00 01 86 A0"))
        assert way.values == {"Odometry.Left": pytest.approx(-1.0), "Odometry.Right": pytest.approx(100.0)}

    def test_limo_takes_command_in_mecanum_mode(self):
        limo = codec("agilex_limo")
        step = load_profile(profile_path("agilex_limo")).enable[0]
        assert limo.encode_step(step) == frame(0x421, "01 00 01 00 00 00 00 00")
        assert limo.encode(BaseMotion(0.1, -0.2))[0] == frame(0x111, "00 64 00 00 FF 38 00 00")

    def test_vesc(self):
        # vesc-project.com/node/3345: status 1 of controller 4; here the profile's controller 1.
        vesc = codec("vesc")
        status = vesc.decode(frame(0x901, "00 00 0B B8 00 FD 00 29", extended=True))
        assert status.values == {
            "LeftStatus.Erpm": 3000,
            "LeftStatus.Current": pytest.approx(25.3),
            "LeftStatus.Duty": pytest.approx(0.041),
        }
        left, right = vesc.encode(BaseMotion(-1000 / 668.4508))
        assert left == frame(0x301, "FF FF FC 18", extended=True)
        assert right.frame_id == 0x302

    def test_odrive(self):
        # CANSimple: Set_Input_Vel is command 0x0D, two little-endian floats; Set_Axis_State 0x07.
        odrive = codec("odrive_cansimple")
        left, right = odrive.encode(BaseMotion(-2.5 / 1.87241))
        assert (left.frame_id, right.frame_id) == (0x0D, 0x2D)
        assert left.data[:4] == bytes.fromhex("00 00 20 C0")
        profile = load_profile(profile_path("odrive_cansimple"))
        assert odrive.encode_step(profile.enable[-1]) == frame(0x27, "08 00 00 00 00 00 00 00")
        heartbeat = odrive.decode(frame(0x21, "01 00 00 80 08 00 01 00"))
        assert heartbeat.values["RightHeartbeat.AxisError"] == 0x80000001
        assert heartbeat.values["RightHeartbeat.AxisState"] == 8


class TestSaturation:
    @pytest.mark.parametrize(("speed", "raw"), [(40.0, 32767), (-40.0, -32768), (1e300, 32767)])
    def test_before_scaling(self, speed, raw):
        assert struct.unpack(">h", codec().encode(BaseMotion(speed))[0].data[:2]) == (raw,)

    @given(st.sampled_from(NAMES), st.builds(BaseMotion, *[st.floats(-1e300, 1e300)] * 4))
    def test_no_motion_is_a_crash(self, name, motion):
        for sent in CODECS[name].encode(motion):
            assert len(sent.data) in (4, 8)

    def test_unsigned_and_inverted_signals(self, tmp_path):
        changes = {"Linear : 7|16@0- (0.001,0) [-32.768|32.767]": "Linear : 7|16@0+ (-0.001,10) [0|0]"}
        inverted = edited(tmp_path, changes)
        assert inverted.encode(BaseMotion(40.0))[0].data[:2] == b"\0\0"
        assert inverted.encode(BaseMotion(-1000.0))[0].data[:2] == b"\xff\xff"
        assert inverted.encode(BaseMotion(1.0))[0].data[:2] == (9000).to_bytes(2, "big")


class TestProtection:
    def test_commands_count(self):
        generic = codec("generic")
        counters = [generic.encode(BaseMotion())[0].data[1] & 0x0F for _ in range(17)]
        assert counters == [*range(15), 0, 1]

    def test_feedback_with_wrong_crc_or_old_counter_is_refused(self, tmp_path):
        ids = list(range(1, 17))
        table = f'[protection.Status]\nprofile = "e2e_p02"\ndata_id_list = {ids}\n'
        generic = edited(tmp_path, {"[protection.Velocity]": table + "[protection.Velocity]"}, "generic")
        p02 = pytest.importorskip("e2e.p02")
        data = bytearray(8)
        p02.e2e_p02_protect(data, bytes(range(1, 17)))
        assert generic.decode(Frame(0x200, bytes(data))) is not None
        assert generic.decode(Frame(0x200, bytes(data))) is None
        assert generic.malformed == 1
        p02.e2e_p02_protect(data, bytes(range(1, 17)))
        wrong = bytes(data[:7]) + bytes([data[7] ^ 1])
        assert generic.decode(Frame(0x200, wrong)) is None
        assert generic.malformed == 2
        assert generic.decode(Frame(0x200, bytes(data))) is not None


class TestMalformed:
    def test_short_frames(self):
        agilex = codec()
        assert agilex.decode(Frame(0x221, bytes(7))) is None
        assert agilex.malformed == 1

    def test_excess_bytes_do_not_matter(self):
        assert codec().decode(Frame(0x221, bytes(9))).values["MotionState.Linear"] == 0

    @pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
    def test_non_finite_feedback(self, number):
        odrive = codec("odrive_cansimple")
        assert odrive.decode(Frame(0x09, struct.pack("<ff", 0.0, number))) is None
        assert odrive.malformed == 1

    def test_undefined_multiplexers(self, tmp_path):
        changes = {
            "VehicleState : 7|8": "VehicleState M : 7|8",
            "ControlMode : 15|8": "ControlMode m1 : 15|8",
        }
        muxed = edited(tmp_path, changes)
        assert muxed.decode(frame(0x211, "01 01 00 00 00 00 00 00")) is not None
        assert muxed.decode(frame(0x211, "07 01 00 00 00 00 00 00")) is None

    def test_commands_are_not_feedback(self):
        agilex = codec()
        assert agilex.decode(agilex.encode(BaseMotion(0.5))[0]) is None
        assert agilex.decode(Frame(0x211, bytes(8), extended=True)) is None
        assert agilex.malformed == 0

    @given(st.sampled_from(NAMES), identifiers, st.binary(max_size=64))
    def test_junk(self, name, identifier, data):
        frame_id, extended = identifier
        decoded = CODECS[name].decode(Frame(frame_id, data, extended))
        assert decoded is None or all(map(math.isfinite, decoded.values.values()))


class TestProfiles:
    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({'dbc = "agilex_v2.dbc"': 'dbc = "other.dbc"'}, r"dbc: .*other.dbc cannot be read"),
            ({"BO_ 273": "BO 273"}, "cannot be read as a DBC"),
            ({"[motion.MotionCommand]": "[motion.Go]"}, r"motion.Go: no message 'Go'.*it has: MotionCommand"),
            (
                {"Linear = { forward": "Speed = { forward"},
                r"MotionCommand.Speed: no such signal.*Linear, Angular",
            ),
            (
                {"signals = { ControlMode = 1 }": "signals = { Mode = 1 }"},
                r"enable\[1\].signals.Mode: no such",
            ),
            (
                {"signals = { Brake = 1 }": "signals = { Brake = 2 }"},
                r"stop.then\[0\].signals.Brake: .* carry 2",
            ),
            (
                {"speed_m_s = 1.5": "speed_m_s = 40.0"},
                r"limits.speed_m_s: MotionCommand.Linear cannot carry 40",
            ),
            ({"period_s = 0.02": "period_s = 0.02\nframe_ids = { X = 1 }"}, "frame_ids.X: no message"),
            (
                {"Linear : 7|16": "Linear M : 7|16", "Angular : 23|16": "Angular m0 : 23|16"},
                "motion.MotionCommand: MotionCommand is multiplexed",
            ),
            (
                {"ControlMode : 7|8": "ControlMode M : 7|8", "LimoMotionMode :": "LimoMotionMode m1 :"},
                r"enable\[1\].signals: ControlModeCommand is multiplexed",
            ),
            ({"SystemState = 0.5, ": ""}, "stale_s: must give the greatest age of SystemState"),
            ({"MotionState.Linear": "MotionState.Sideways"}, "feedback.Sideways: no such signal"),
            ({"period_s = 0.02": "period_s = 2"}, "`period_s` must lie in"),
            ({"recoveries = 3": "recoveries = -1"}, "`recoveries` must not be negative"),
            ({"speed_m_s = 1.5": "speed_m_s = 0"}, "`speed_m_s` must be positive"),
            ({"any_of = [1] }": "any_of = [] }"}, "either `any_of` or `none_of`"),
            ({"[stop]": "[stops]"}, "stops"),
            (
                {"yaw = 1.0 }": "laterl = 1.0 }"},
                "MotionCommand.Angular.laterl: unknown key; allowed: f",
            ),
            (
                {"{ forward = 1.0 }": '{ forward = "1" }'},
                "Linear.forward: Expected `float`, got",
            ),
            (
                {"[stop]": '[protection.MotionCommand]\nprofile = "e2e_p01"\ndata_idd = 1\n[stop]'},
                "protection.MotionCommand.data_idd: unknown key; allowed: profile, data_id,",
            ),
        ],
    )
    def test_each_mistake_is_one_line_with_its_key(self, tmp_path, changes, said):
        with pytest.raises(ConfigError, match=said) as caught:
            edited(tmp_path, changes)
        assert "\n" not in str(caught.value)
        assert "agilex_v2.toml" in str(caught.value)

    def test_protected_messages_need_room(self, tmp_path):
        with pytest.raises(ConfigError, match=r"protection.Enable: the message is too short"):
            edited(tmp_path, {"[protection.Velocity]": "[protection.Enable]"}, "generic")

    def test_empty_motion_is_refused(self, tmp_path):
        changes = {"speed_m_s": "# speed_m_s", "[limits]": "[motion]\n[limits]\nspeed_m_s = 1.0"}
        for name in ("Velocity", "Forward", "Left", "Yaw"):
            changes |= {f"[motion.{name}]": "", f"{name} = {{": f"# {name} = {{"}
        with pytest.raises(ConfigError, match=r"`motion` and `feedback.stale_s` must name"):
            edited(tmp_path, changes, "generic")

    def test_other_node_numbers(self, tmp_path):
        changes = {"[limits]": "[frame_ids]\nRightSetInputVelocity = 0x6D\nRightHeartbeat = 0x61\n\n[limits]"}
        moved = edited(tmp_path, changes, "odrive_cansimple")
        assert [sent.frame_id for sent in moved.encode(BaseMotion())] == [0x0D, 0x6D]
        assert moved.decode(frame(0x61, "00 00 00 00 08 00 00 00")).message == "RightHeartbeat"
        assert moved.decode(frame(0x21, "00 00 00 00 08 00 00 00")) is None

    def test_unknown_names_list_the_known_ones(self):
        with pytest.raises(
            ConfigError, match="agilex_hunter, agilex_limo, agilex_omni, agilex_ranger, agilex_v2, "
        ):
            profile_path("scout")

    @pytest.mark.parametrize("name", ["odrive_cansimple", "vesc"])
    def test_shipped_wheel_gains_fit_their_feedback(self, name):
        """What feedback computes from the commanded signals is the commanded motion."""
        shipped = load_profile(profile_path(name))
        sent = [next(iter(signals.values())) for signals in shipped.motion.values()]
        forward, yaw = shipped.feedback.motion.forward, shipped.feedback.motion.yaw
        assert sum(w * g.forward for w, g in zip(forward.values(), sent, strict=True)) == pytest.approx(
            1, 1e-4
        )
        assert sum(w * g.yaw for w, g in zip(yaw.values(), sent, strict=True)) == pytest.approx(1, 1e-4)
        assert sum(w * g.yaw for w, g in zip(forward.values(), sent, strict=True)) == pytest.approx(
            0, abs=1e-9
        )
