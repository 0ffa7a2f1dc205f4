"""Counters and CRCs against the autosar-e2e package, and against published check values."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.can.e2e import CRC_H2F, CRC_SAE_J1850, Protection, counter_of, crc8, protect

p01 = pytest.importorskip("e2e.p01")
p02 = pytest.importorskip("e2e.p02")

MODES = {
    "both": p01.E2E_P01_DATAID_BOTH,
    "alternating": p01.E2E_P01_DATAID_ALT,
    "low": p01.E2E_P01_DATAID_LOW,
    "nibble": p01.E2E_P01_DATAID_NIBBLE,
}
frames = st.binary(min_size=3, max_size=8)


def test_published_check_values():
    assert crc8(b"123456789", CRC_SAE_J1850, 0xFF, 0xFF) == 0x4B
    assert crc8(b"123456789", CRC_H2F, 0xFF, 0xFF) == 0xDF


@given(frames, st.integers(0, 0xFFFF), st.sampled_from(sorted(MODES)), st.integers(0, 1), st.integers(0, 13))
def test_profile_1_is_autosars(data, data_id, mode, place, counter):
    theirs = bytearray(data)
    theirs[place + 1] = theirs[place + 1] & 0xF0 | counter
    p01.e2e_p01_protect(theirs, data_id, data_id_mode=MODES[mode], offset=place)
    protection = Protection("e2e_p01", data_id, mode, crc_byte=place)
    assert protect(data, counter + 1, protection) == theirs
    assert counter_of(bytes(theirs), protection) == counter + 1


@given(frames, st.binary(min_size=16, max_size=16))
def test_profile_2_is_autosars(data, ids):
    theirs = bytearray(data)
    p02.e2e_p02_protect(theirs, ids)
    protection = Protection("e2e_p02", data_id_list=tuple(ids))
    counter = theirs[1] & 0x0F
    assert counter == ((data[1] & 0x0F) + 1) % protection.counters
    assert protect(data, counter, protection) == theirs
    assert counter_of(bytes(theirs), protection) == counter


def test_profile_1_counts_to_14_and_profile_2_to_15():
    theirs = bytearray(b"\x00\x0e\x00")
    p01.e2e_p01_protect(theirs, 7)
    assert theirs[1] == 0
    assert Protection("e2e_p01").counters == 15
    assert Protection("e2e_p02", data_id_list=(0,) * 16).counters == 16
    assert counter_of(protect(bytes(8), 15, Protection("e2e_p01")), Protection("e2e_p01")) is None


@given(frames, st.integers(0, 63), st.sampled_from(sorted(MODES)))
def test_every_flipped_bit_is_noticed(data, bit, mode):
    protection = Protection("e2e_p01", 0x1234, mode)
    protected = bytearray(protect(data, 3, protection))
    protected[bit // 8 % len(data)] ^= 1 << bit % 8
    assert counter_of(bytes(protected), protection) is None


def test_every_16_bits_are_a_data_id():
    assert [Protection("e2e_p01", data_id).data_id for data_id in (0, 0xFFFF)] == [0, 0xFFFF]


def test_short_frames_are_refused():
    assert counter_of(b"\0", Protection("e2e_p01")) is None


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"profile": "e2e_p01", "data_id": 0x10000}, "data_id"),
        ({"profile": "e2e_p01", "crc_byte": 7}, "crc_byte"),
        ({"profile": "e2e_p02", "data_id_list": [1]}, "data_id_list"),
        ({"profile": "e2e_p02", "data_id_list": [256] * 16}, "data_id_list"),
        ({"profile": "e2e_p02", "data_id_list": [1] * 16, "crc_byte": 1}, "crc_byte"),
    ],
)
def test_wrong_protections_are_refused(values, key):
    with pytest.raises(msgspec.ValidationError, match=key):
        msgspec.convert(values, Protection)
