"""Messages drawn at random, encoded and decoded here and by cantools."""

import functools
import struct

import cantools
import pytest
from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.can.layout import Layout
from firmware_bridge.can.profile import PROFILES
from firmware_bridge.can.reader import Reader

BYTES = 8


@functools.cache
def database(path):
    return cantools.database.load_file(path)


def signal(
    name, start, length, little, *, signed=False, floating=False, scale=1, offset=0, bounds=(None, None)
):
    return Signal(
        name,
        start,
        length,
        byte_order="little_endian" if little else "big_endian",
        is_signed=signed or floating,
        conversion=BaseConversion.factory(scale, offset, None, floating),
        minimum=bounds[0],
        maximum=bounds[1],
    )


def message(*signals):
    return Message(0x123, "M", BYTES, list(signals), strict=True)


@st.composite
def messages(draw):
    """Signals one after the other, all of one byte order, with gaps."""
    little = draw(st.booleans())
    signals, used = [], 0
    for number in range(draw(st.integers(1, 4))):
        floating = draw(st.integers(0, 3)) == 0
        length = draw(st.sampled_from([32, 16, 64])) if floating else draw(st.integers(1, 32))
        gap = draw(st.integers(0, 5))
        if used + gap + length > 8 * BYTES:
            continue
        index = used + gap
        start = index if little else 8 * (index // 8) + 7 - index % 8
        scale = draw(st.sampled_from([1, 0.001, 0.5, -0.25, 10]))
        offset = draw(st.sampled_from([0, -40, 12.5]))
        signed = draw(st.booleans())
        signals.append(
            signal(
                f"S{number}",
                start,
                length,
                little,
                signed=signed,
                floating=floating,
                scale=scale,
                offset=offset,
            )
        )
        used = index + length
    return message(*signals) if signals else message(signal("S0", 0 if little else 7, 8, little))


@given(messages(), st.data())
def test_writes_what_cantools_writes(drawn, data):
    layout = Layout(drawn)
    values = {}
    for name, (low, high) in layout.ranges.items():
        if data.draw(st.booleans()):
            values[name] = data.draw(st.floats(max(low, -6e4), min(high, 6e4)))
    whole = {name: min(max(values.get(name, 0.0), low), high) for name, (low, high) in layout.ranges.items()}
    assert layout.encode(values) == drawn.encode(whole, strict=False)


def assert_reads_what_cantools_reads(message, data):
    expected = message.decode_simple(data, decode_choices=False)
    read = Reader(message).read(data)
    assert read == pytest.approx(
        {f"{message.name}.{n}": v for n, v in expected.items()}, rel=1e-15, nan_ok=True
    )


@given(messages(), st.binary(min_size=BYTES, max_size=BYTES))
def test_reads_what_cantools_reads(drawn, data):
    assert_reads_what_cantools_reads(drawn, data)


@pytest.mark.parametrize("file", sorted(PROFILES.glob("*.dbc")), ids=lambda path: path.stem)
@given(data=st.binary(min_size=BYTES, max_size=BYTES))
def test_reads_the_packaged_robots_messages_as_cantools_does(file, data):
    for known in database(file).messages:
        if not known.is_multiplexed():
            assert_reads_what_cantools_reads(known, data[: known.length])


def test_both_byte_orders_in_one_message():
    mixed = message(signal("A", 7, 12, False, signed=True), signal("B", 32, 20, True, scale=0.5))
    data = mixed.encode({"A": -3, "B": 1000.5})
    assert Layout(mixed).encode({"A": -3, "B": 1000.5}) == data
    assert Reader(mixed).read(data) == {"M.A": -3, "M.B": 1000.5}


def test_what_is_not_given_is_zero_in_physical_units():
    offset = message(signal("A", 0, 8, True, offset=-40), signal("B", 8, 8, True))
    assert Layout(offset).encode({"B": 1.0}) == bytes([40, 1]) + bytes(6)
    assert Layout(offset).encode({"A": -40.0}) == bytes(8)


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize("length", [1, 7, 16, 33, 64])
@pytest.mark.parametrize("signed", [True, False])
@pytest.mark.parametrize("scale", [1, 0.001, -0.1])
def test_saturates_at_the_integers_bounds(little, length, signed, scale):
    start = 0 if little else 7
    one = message(signal("A", start, length, little, signed=signed, scale=scale))
    least, most = (-(1 << length - 1), (1 << length - 1) - 1) if signed else (0, (1 << length) - 1)
    for value, raw in ((1e300, most), (-1e300, least)):
        expected = one.encode({"A": raw if scale > 0 else least + most - raw}, scaling=False)
        written = one.decode(Layout(one).encode({"A": value}), scaling=False)["A"]
        # A 64-bit integer's bound is no double: the last few may be out of reach.
        assert abs(written - one.decode(expected, scaling=False)["A"]) <= (2**12 if length > 50 else 0)


@pytest.mark.parametrize(
    ("length", "layout", "largest"), [(16, "<e", 65504.0), (32, "<f", 3.4e38), (64, "<d", 1.7e308)]
)
def test_floats(length, layout, largest):
    one = message(signal("A", 0, length, True, floating=True))
    for value, carried in ((1.5, 1.5), (1e400, largest), (-1e400, -largest)):
        assert Layout(one).encode({"A": value})[: length // 8] == struct.pack(layout, carried)


def test_the_dbcs_bounds_are_kept():
    one = message(
        signal("A", 0, 8, True, bounds=(-5, 200)), signal("B", 8, 8, True, signed=True, bounds=(-5, 20))
    )
    assert Layout(one).ranges == {"A": (0.0, 200.0), "B": (-5.0, 20.0)}
    assert Layout(one).encode({"A": 255.0, "B": -100.0})[:2] == bytes([200, 0x100 - 5])


@pytest.mark.parametrize("little", [False, True], ids=["big", "little"])
def test_a_wide_signal_that_rounding_takes_past_its_end_does_not_wrap(little):
    """-2**63 scaled and scaled back is 2048 less: masked, it would be a large positive number."""
    start = 0 if little else 7
    layout = Layout(message(signal("A", start, 64, little, signed=True, scale=0.01, offset=-40)))
    least, most = (layout.encode({"A": value}) for value in (-1e30, 1e30))
    order = "little" if little else "big"
    assert int.from_bytes(least, order, signed=True) == -(2**63)
    assert int.from_bytes(most, order, signed=True) > 2**62
