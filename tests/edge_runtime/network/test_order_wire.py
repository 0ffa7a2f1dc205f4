"""Orders and answers survive the way; nothing else passes for one."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from edge_runtime.network.order_wire import (
    FILE_BYTES,
    Abort,
    Ask,
    Chunk,
    Commit,
    Halt,
    Offer,
    Propose,
    Standing,
    Stop,
    decode_answer,
    decode_order,
    encode_answer,
    encode_order,
)
from edge_runtime.network.seal import FrameError, Magic, Refusal
from edge_runtime.network.team_wire import LAST_TICK

KEY = bytes(range(32))
longs = st.integers(0, 2**64 - 1)
common = (longs, longs, st.integers(0, 65535), longs, st.floats(-1e12, 1e12))
orders = st.one_of(
    *(st.builds(kind, *common) for kind in (Ask, Abort, Halt, Stop)),
    st.builds(Commit, *common, tick=st.integers(1, LAST_TICK)),
    st.builds(
        Offer,
        *common,
        version=st.integers(1, 2**32 - 1),
        files=st.lists(st.tuples(st.text(max_size=64), st.integers(0, 2**32 - 1)), max_size=8).map(tuple),
    ),
    st.builds(Chunk, *common, offset=st.integers(0, 2**32 - 1), content=st.binary()),
    st.builds(
        Propose, *common, version=st.integers(1, 2**32 - 1), file=st.text(max_size=20), content=st.binary()
    ),
)
STANDING = Standing(1, 2, 3, 4, 5.0, 6, 49.9, 50.0, 7, 8, "refused", "because", "", False)
STOP = Stop(1, 2, 3, 4, 5.0)


def refusal(decode, packet):
    with pytest.raises(FrameError) as caught:
        decode(packet, KEY)
    return caught.value.cause


@settings(deadline=None)
@given(order=orders)
def test_orders_survive_the_way(order):
    found = decode_order(encode_order(order, KEY), KEY)
    assert found == order and type(found) is type(order)


def test_answers_survive_the_way():
    assert decode_answer(encode_answer(STANDING, KEY), KEY) == STANDING


@pytest.mark.parametrize(
    "decode, packet", [(decode_order, encode_order(STOP, KEY)), (decode_answer, encode_answer(STANDING, KEY))]
)
def test_every_altered_bit_is_noticed(decode, packet):
    for bit in range(8 * len(packet)):
        altered = bytearray(packet)
        altered[bit // 8] ^= 1 << bit % 8
        assert refusal(decode, bytes(altered)) is (Refusal.MALFORMED if bit < 32 else Refusal.FOREIGN)


def test_an_answer_is_no_order_and_an_order_no_answer():
    assert refusal(decode_order, encode_answer(STANDING, KEY)) is Refusal.MALFORMED
    assert refusal(decode_answer, encode_order(STOP, KEY)) is Refusal.MALFORMED


@pytest.mark.parametrize(
    "order",
    [
        Commit(1, 2, 3, 4, 5.0, tick=-1),
        Commit(1, 2, 3, 4, 5.0, tick=LAST_TICK + 1),
        Propose(1, 2, 3, 4, 5.0, version=2**32, file="f", content=b""),
        Propose(1, 2, 3, 4, 5.0, version=1, file="f", content=bytes(FILE_BYTES + 1)),
        Propose(1, 2, 3, 4, 5.0, version=1, file="f" * 256, content=b""),
        *(Stop(1, 2, 3, 4, expiry) for expiry in (math.nan, math.inf, -math.inf, 1e300)),
    ],
)
def test_what_holds_the_key_but_fits_no_frame_is_refused(order):
    assert refusal(decode_order, encode_order(order, KEY)) is Refusal.MALFORMED


def test_the_longest_file_fits():
    most = 2**64 - 1
    order = Propose(
        most, most, 65535, most, 1e12, version=2**32 - 1, file="ä" * 255, content=bytes(FILE_BYTES)
    )
    assert decode_order(encode_order(order, KEY), KEY) == order


@pytest.mark.parametrize("field", ["stamp_s", "rate_hz", "nominal_rate_hz"])
@pytest.mark.parametrize("number", [math.nan, math.inf, -1e300])
def test_an_answer_with_a_number_that_no_robot_has_is_refused(field, number):
    assert (
        refusal(decode_answer, encode_answer(replace(STANDING, **{field: number}), KEY)) is Refusal.MALFORMED
    )


@settings(deadline=None)
@given(junk=st.binary(max_size=200), magic=st.sampled_from([b"", Magic.ORDER, Magic.ANSWER]))
def test_junk_is_refused(junk, magic):
    for decode in (decode_order, decode_answer):
        assert refusal(decode, magic + junk) in (Refusal.MALFORMED, Refusal.FOREIGN)
