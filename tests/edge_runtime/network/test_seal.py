"""Seals: who lacks the key makes no packet, and no kind of packet passes for another."""

import ast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paths import ROOT

from edge_runtime.network.seal import MAGIC_BYTES, FrameError, Magic, Refusal, seal, unseal

KEY = bytes(range(32))
magics = st.sampled_from(Magic)


def refusal(*arguments):
    with pytest.raises(FrameError) as caught:
        unseal(*arguments)
    return caught.value.cause


@settings(deadline=None)
@given(magic=magics, body=st.binary(max_size=100), key=st.binary(min_size=32, max_size=32))
def test_a_body_survives_the_way(magic, body, key):
    assert unseal(seal(magic, body, key), magic, key, 100) == body


@settings(deadline=None)
@given(magic=magics, other=magics, body=st.binary(max_size=20))
def test_no_kind_of_packet_passes_for_another(magic, other, body):
    if magic is not other:
        assert refusal(seal(magic, body, KEY), other, KEY, 100) is Refusal.MALFORMED


@pytest.mark.parametrize("magic", Magic)
def test_every_altered_bit_and_every_other_key_is_noticed(magic):
    packet = seal(magic, b"body", KEY)
    for bit in range(8 * len(packet)):
        altered = bytearray(packet)
        altered[bit // 8] ^= 1 << bit % 8
        expected = Refusal.MALFORMED if bit < 8 * MAGIC_BYTES else Refusal.FOREIGN
        assert refusal(bytes(altered), magic, KEY, 100) is expected
    assert refusal(packet, magic, bytes(32), 100) is Refusal.FOREIGN


@pytest.mark.parametrize("size", [0, 9, 21, 100])
def test_bodies_of_other_lengths_are_refused(size):
    assert refusal(seal(Magic.TEAM, bytes(size), KEY), Magic.TEAM, KEY, 20, 10) is Refusal.MALFORMED


@settings(deadline=None)
@given(junk=st.binary(max_size=200))
def test_junk_is_refused(junk):
    assert refusal(Magic.TEAM + junk, Magic.TEAM, KEY, 100) in (Refusal.MALFORMED, Refusal.FOREIGN)


def test_all_magics_stand_in_one_list():
    """Another one anywhere in the sources could be that of a packet which the same key seals."""
    found = [
        (node.value, path.name)
        for package in ("edge_runtime", "firmware_bridge", "export", "benchmarks")
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_bytes()))
        if isinstance(node, ast.Constant) and isinstance(node.value, bytes) and node.value[:2] == b"CF"
    ]
    assert sorted(found) == sorted((magic.value, "seal.py") for magic in Magic)
    assert len({magic[:3] for magic in Magic}) == len(Magic)
    assert {len(magic) for magic in Magic} == {MAGIC_BYTES}
