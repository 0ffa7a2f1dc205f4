"""What a DBC can carry and say, at its edges: ranges, limits, sums, counters, named values, complaints."""

import os

import pytest

from edge_runtime.errors import ConfigError
from firmware_bridge.can import vocabulary
from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.e2e import Protection, counter_of
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.profile import Step, load_profile
from firmware_bridge.kinematics.base import BaseMotion

DBC = """VERSION ""
NS_ :
BS_:
BU_: Computer Robot
BO_ 16 Drive: 8 Computer
 SG_ Speed : 0|16@1- (0.01,0) [0|0] "m/s" Robot
 SG_ Side : 16|16@1- (0.01,0) [0|0] "m/s" Robot
 SG_ Turn : 32|16@1- (0.01,0) [0|0] "" Robot
BO_ 17 Arm: 2 Computer
 SG_ On : 12|1@1+ (1,0) [0|1] "" Robot
BO_ 18 Beep: 1 Computer
 SG_ Loud : 0|8@1+ (1,0) [0|0] "" Robot
BO_ 32 Status: 8 Robot
 SG_ State : 0|8@1+ (1,0) [0|0] "" Computer
VAL_ 32 State 1 "Ready" 2 "Fault" ;
"""
PROFILE = """
dbc = "robot.dbc"
transport = "can"
period_s = 0.02
[limits]
speed_m_s = 1.5
[base]
kind = "omnidirectional"
[motion.Drive]
Speed = { forward = 1.0 }
[stop]
zeros = 1
[feedback]
stale_s = { Status = 0.1 }
ready = [{ signal = "Status.State", any_of = [1] }]
[feedback.motion]
forward = { "Status.State" = 0.0 }
"""
PROTECTION = '[protection.{}]\nprofile = "e2e_p01"\ndata_id = {}\n'


@pytest.fixture
def codec(tmp_path):
    def make(dbc=("", ""), toml=("", ""), tables=""):
        (tmp_path / "robot.dbc").write_text(DBC.replace(*dbc))
        path = tmp_path / "robot.toml"
        path.write_text(PROFILE.replace(*toml) + tables)
        return CanCodec(load_profile(path), path)

    return make


def complaint(codec, **changes):
    with pytest.raises(ConfigError) as caught:
        codec(**changes)
    return str(caught.value).split("robot.toml: ")[1]


@pytest.mark.parametrize(("speed", "raw"), [(1e6, 32767), (-1e6, -32768), (327.67, 32767), (-327.68, -32768)])
def test_a_signal_without_a_range_saturates_at_its_bits(codec, speed, raw):
    (frame,) = codec().encode(BaseMotion(speed))
    assert int.from_bytes(frame.data[:2], "little", signed=True) == raw


def test_limits_may_fill_a_signal_exactly(codec):
    codec(dbc=("Speed : 0|16@1- (0.01,0) [0|0]", "Speed : 0|16@1- (0.01,0) [-1.5|1.5]"))


@pytest.mark.parametrize("bounds", ["[-1.49|1.5]", "[-1.5|1.49]", "[0|10]"])
def test_a_signal_that_carries_one_direction_less_is_refused(codec, bounds):
    dbc = ("Speed : 0|16@1- (0.01,0) [0|0]", f"Speed : 0|16@1- (0.01,0) {bounds}")
    assert complaint(codec, dbc=dbc) == "limits.speed_m_s: Drive.Speed cannot carry 1.5 m/s"


def test_lateral_speed_counts_against_the_limits(codec):
    dbc = ("Side : 16|16@1- (0.01,0) [0|0]", "Side : 16|16@1- (0.01,0) [-1|1]")
    toml = ("Speed =", "Side = { lateral = 1.0 }\nSpeed =")
    assert complaint(codec, dbc=dbc, toml=toml) == "limits.speed_m_s: Drive.Side cannot carry 1.5 m/s"


def test_every_part_of_the_motion_adds_to_a_signal(codec):
    turn = "Turn = { forward = 1.0, lateral = 10.0, yaw = 100.0, steering = 0.1 }"
    (frame,) = codec(toml=("Speed =", f"{turn}\nSpeed =")).encode(BaseMotion(0.1, 0.2, 0.3, 0.4))
    assert int.from_bytes(frame.data[4:6], "little", signed=True) == round((0.1 + 2.0 + 30.0 + 0.04) * 100)


def test_protected_messages_count_apart(codec):
    made = codec(
        toml=("[limits]", '[[enable]]\nmessage = "Arm"\nsignals = { On = 1 }\n[limits]'),
        tables=PROTECTION.format("Drive", 1) + PROTECTION.format("Arm", 2),
    )
    drives = [made.encode(BaseMotion(0.5))[0].data for _ in range(3)]
    assert [counter_of(data, Protection("e2e_p01", data_id=1)) for data in drives] == [0, 1, 2]
    arm = made.encode_step(Step("Arm", {"On": 1}))
    assert counter_of(arm.data, Protection("e2e_p01", data_id=2)) == 0


def test_named_values_are_read_as_numbers(codec):
    decoded = codec().decode(Frame(32, bytes([2, 0, 0, 0, 0, 0, 0, 0])))
    assert decoded.values == {"Status.State": 2.0}


def test_two_bytes_are_room_enough_for_protection_and_one_is_not(codec):
    codec(tables=PROTECTION.format("Arm", 2))
    said = "protection.Beep: the message is too short for a counter and a CRC"
    assert complaint(codec, tables=PROTECTION.format("Beep", 2)) == said


def test_unknown_messages_are_named_with_their_key_and_the_known_ones(codec):
    known = "no message 'Horn' in robot.dbc; it has: Drive, Arm, Beep, Status"
    assert complaint(codec, tables=PROTECTION.format("Horn", 2)) == f"protection.Horn: {known}"
    assert complaint(codec, toml=("Status = 0.1", "Status = 0.1, Horn = 0.1")) == f"feedback.stale_s: {known}"


def test_a_dbc_is_a_regular_file_of_a_stated_size(codec, tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.dbc")
    said = complaint(codec, toml=('dbc = "robot.dbc"', 'dbc = "pipe.dbc"'))
    assert "pipe.dbc cannot be read as a DBC" in said
    said = complaint(codec, toml=('dbc = "robot.dbc"', 'dbc = "/dev/zero"'))
    assert "/dev/zero cannot be read as a DBC" in said
    monkeypatch.setattr(vocabulary, "LARGEST_DBC", 10)
    assert "robot.dbc cannot be read as a DBC" in complaint(codec)


def test_an_unreadable_dbc_is_one_line_with_the_parsers_words(codec):
    said = complaint(codec, dbc=("BO_ 16", "MESSAGE 16"))
    assert said.startswith("dbc: ")
    assert "Invalid syntax at line 5" in said
    assert "\n" not in said


UNUSED = "BO_ 18 Beep: 1 Computer"


@pytest.mark.parametrize(
    "beep",
    ["BO_ 18 Beep: 16 Computer", "BO_ 16 Beep: 1 Computer"],
    ids=["of CAN FD", "with a used identifier"],
)
def test_what_nobody_uses_does_not_matter(codec, beep):
    codec(dbc=(UNUSED, beep))
    codec(dbc=("Loud : 0|8@1+ (1,0)", "Loud : 0|8@1+ (0,0)"))


@pytest.mark.parametrize("factor", ["0", "1e400"])
def test_a_factor_that_computes_nothing_is_refused_where_it_is_used(codec, factor):
    dbc = ("Turn : 32|16@1- (0.01,0)", f"Turn : 32|16@1- ({factor},0)")
    said = complaint(codec, dbc=dbc)
    assert said == f"motion.Drive: Drive.Turn has the factor {float(factor):g} in the DBC"
    dbc = ("State : 0|8@1+ (1,0)", f"State : 0|8@1+ ({factor},0)")
    said = complaint(codec, dbc=dbc)
    assert said == f"feedback: Status.State has the factor {float(factor):g} in the DBC"


@pytest.mark.parametrize(
    ("dbc", "said"),
    [
        (("Drive: 8", "Drive: 16"), "motion.Drive: Drive has 16 bytes, frames of CAN FD are not spoken"),
        (("Status: 8", "Status: 9"), "feedback: Status has 9 bytes, frames of CAN FD are not spoken"),
    ],
)
def test_messages_longer_than_a_classic_frame_are_refused(codec, dbc, said):
    assert complaint(codec, dbc=dbc) == said


EXTENDED = ("BO_ 16 Drive", f"BO_ {2**31 + 16} Drive")


@pytest.mark.parametrize(
    ("dbc", "ids", "said"),
    [
        (("", ""), "Drive = 0x8CD", "frame_ids.Drive: 0x8cd does not fit the 11 bits of its kind"),
        (("", ""), "Drive = -1", "frame_ids.Drive: -0x1 does not fit the 11 bits of its kind"),
        (EXTENDED, "Drive = 0x80000010", "frame_ids.Drive: 0x80000010 does not fit the 29 bits of its kind"),
        (("", ""), "Drive = 32", "frame_ids.Drive: Status and Drive have the same identifier 0x20"),
        (("", ""), "Beep = 0x800", "frame_ids.Beep: 0x800 does not fit the 11 bits of its kind"),
    ],
)
def test_identifiers_that_are_another_frames_are_refused_with_their_key(codec, dbc, ids, said):
    assert complaint(codec, dbc=dbc, toml=("[limits]", f"[frame_ids]\n{ids}\n[limits]")).startswith(said)


def test_two_messages_of_one_identifier_in_the_dbc_are_refused(codec):
    said = complaint(
        codec,
        dbc=("BO_ 17 Arm", "BO_ 16 Arm"),
        toml=("[limits]", '[[enable]]\nmessage = "Arm"\n[limits]'),
    )
    assert said == "dbc: Arm and Drive have the same identifier 0x10"


def test_identifiers_of_both_kinds_do_not_meet(codec):
    made = codec(dbc=EXTENDED, toml=("[limits]", "[frame_ids]\nDrive = 32\n[limits]"))
    assert made.encode(BaseMotion())[0][::2] == (32, True)


def test_an_extended_identifier_does_not_fit_a_serial_frame(codec):
    said = complaint(codec, dbc=EXTENDED, toml=('transport = "can"', 'transport = "limo_serial"'))
    assert said == "dbc: Drive has an extended identifier, a limo_serial frame carries none"


def test_a_crc_beyond_the_message_is_refused(codec):
    table = '[protection.Arm]\nprofile = "e2e_p01"\ncrc_byte = 1\n'
    said = "protection.Arm: the message is too short for a counter and a CRC"
    assert complaint(codec, tables=table) == said


def test_the_crc_may_stand_in_the_last_byte_but_one():
    assert Protection("e2e_p01", crc_byte=6).crc_byte == 6
    with pytest.raises(ValueError, match=r"^`crc_byte` must lie in \[0, 6\], got 7$"):
        Protection("e2e_p01", crc_byte=7)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"data_id_list": (1,) * 15}, "`data_id_list` must have 16 bytes for e2e_p02"),
        ({"data_id_list": (1,) * 16, "crc_byte": 1}, "`crc_byte` must be 0 for e2e_p02"),
    ],
)
def test_profile_2_says_what_it_needs(settings, said):
    with pytest.raises(ValueError, match=f"^{said}$"):
        Protection("e2e_p02", **settings)
