"""Sessions: whatever the network and an attacker do with recorded frames, only newer ones are taken."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.messages import RobotState
from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.network.session import RESTART_S, WINDOW
from edge_runtime.network.team_wire import Frame
from edge_runtime.team.peer import Peer

BOOT, NEXT_BOOT = 11, 12


def frame(peer, sequence, boot_id=BOOT, answer=None):
    """What the robot of this peer sends after it has heard us."""
    answer = peer.challenge if answer is None else answer
    return Frame(
        0, boot_id, sequence, 5, answer, RobotState(1, 0.02 * sequence, (0.0, 0.0), (0.0, 0.0)), (0.0, 0.0)
    )


def fate(peer, frame, arrival_s=0.0):
    try:
        peer.admit(frame, arrival_s)
    except FrameError as error:
        return error.cause
    return None


@pytest.fixture
def peer():
    peer = Peer(1)
    peer.admit(frame(peer, 100), 0.0)
    return peer


def test_a_session_opens_with_the_right_answer_only():
    peer = Peer(1)
    assert fate(peer, frame(peer, 1, answer=0)) is Refusal.UNANSWERED
    assert fate(peer, frame(peer, 1, answer=peer.challenge ^ 1)) is Refusal.UNANSWERED
    assert peer.newest is None
    assert peer.answer == 5
    assert fate(peer, frame(peer, 1)) is None


def test_a_stranger_cannot_change_what_an_open_session_answers(peer):
    stray = Frame(0, NEXT_BOOT, 1, 99, 0, RobotState(1, 0.0, (0.0, 0.0), (0.0, 0.0)), (0.0, 0.0))
    assert fate(peer, stray) is Refusal.UNANSWERED
    assert peer.answer == 5


def test_a_challenge_opens_one_session():
    peer = Peer(1)
    first = peer.challenge
    held_back = frame(peer, 500, BOOT)
    assert fate(peer, frame(peer, 1, NEXT_BOOT)) is None
    assert peer.challenge != first
    assert fate(peer, held_back) is Refusal.UNANSWERED
    assert fate(peer, frame(peer, 2, NEXT_BOOT, answer=first)) is None


@pytest.mark.parametrize(
    "sequence, cause",
    [
        (100, Refusal.DUPLICATE),
        (99, Refusal.REORDERED),
        (101 - WINDOW, Refusal.REORDERED),
        (100 - WINDOW, Refusal.REPLAYED),
        (0, Refusal.REPLAYED),
        (101, None),
        (100 + WINDOW, None),
        (101 + WINDOW, Refusal.SEQUENCE_LEAPS),
        (2**64 - 1, Refusal.SEQUENCE_LEAPS),
    ],
)
def test_sequences(peer, sequence, cause):
    assert fate(peer, frame(peer, sequence)) is cause
    assert peer.newest.sequence == (sequence if cause is None else 100)


def test_one_frame_that_leaps_costs_the_later_ones_nothing(peer):
    """Whoever made it: a robot whose memory is damaged, or another one with the key."""
    assert fate(peer, frame(peer, 2**64 - 1)) is Refusal.SEQUENCE_LEAPS
    assert fate(peer, frame(peer, 101)) is None
    assert fate(Peer(1), frame(Peer(1), 2**63 + 1)) is Refusal.UNANSWERED
    fresh = Peer(1)
    assert fate(fresh, frame(fresh, 2**63 + 1)) is Refusal.SEQUENCE_LEAPS
    assert fate(fresh, frame(fresh, 1)) is None


def test_a_sequence_counts_on_while_nothing_is_heard(peer):
    assert fate(peer, frame(peer, 100 + WINDOW + 50 * 3600), 3600.0) is None


def test_nobody_starts_anew_with_every_frame(peer):
    fates = [fate(peer, frame(peer, 1, boot), 0.02 * boot) for boot in range(BOOT + 1, BOOT + 101)]
    assert set(fates) == {Refusal.RESTARTS, None}
    assert fates.count(None) <= 0.02 * 111 / RESTART_S


def test_a_frame_that_was_late_is_a_duplicate_the_second_time(peer):
    assert fate(peer, frame(peer, 105)) is None
    assert fate(peer, frame(peer, 103)) is Refusal.REORDERED
    assert fate(peer, frame(peer, 103)) is Refusal.DUPLICATE
    assert fate(peer, frame(peer, 100)) is Refusal.DUPLICATE


@given(order=st.lists(st.integers(0, 200), min_size=1, max_size=100))
def test_what_is_taken_is_ever_newer_and_every_fate_has_its_cause(order):
    """The oracle remembers everything."""
    peer, had, newest, now_s = Peer(1), set(), -1, 0.0
    for sequence in order:
        behind = newest - sequence
        expected = None
        if behind >= WINDOW:
            expected = Refusal.REPLAYED
        elif behind >= 0:
            expected = Refusal.DUPLICATE if sequence in had else Refusal.REORDERED
        assert fate(peer, frame(peer, sequence), now_s) is expected
        newest = max(newest, sequence)
        had.add(sequence)
        now_s += 1.0
        assert peer.newest.sequence == newest


@given(
    delivered=st.lists(st.tuples(st.integers(0, 2), st.integers(0, 9)), max_size=60),
    restarts=st.sets(st.integers(0, 59)),
)
def test_no_recording_outlives_our_restart(delivered, restarts):
    """Three boots of theirs were recorded in full, with the challenges of our boot of then."""
    nonces = itertools.count(1)
    peer = Peer(1, lambda: next(nonces))
    recorded = {}
    for boot in range(3):
        recorded.update({(boot, sequence): frame(peer, sequence, boot) for sequence in range(10)})
        peer.admit(recorded[boot, 0], float(boot))
    peer = Peer(1, lambda: next(nonces))
    for step, which in enumerate(delivered):
        if step in restarts:
            peer = Peer(1, lambda: next(nonces))
        assert fate(peer, recorded[which]) is Refusal.UNANSWERED


def test_a_peer_never_heard_has_no_state():
    assert Peer(1).age_s(0.0) == math.inf
    with pytest.raises(LookupError, match="robot 1 has not been heard"):
        Peer(1).teammate(0.0)
