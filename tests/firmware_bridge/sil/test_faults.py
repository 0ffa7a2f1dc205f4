"""The timeline of faults: what a file may say, and what the relay makes of packets."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.errors import ConfigError
from firmware_bridge.sil.network.attacker import bursts
from firmware_bridge.sil.network.disturbance import Disturbance
from firmware_bridge.sil.scenario.faults import (
    Blackout,
    CorruptPackets,
    Delay,
    Duplicate,
    Hostile,
    Kill,
    Loss,
    Reorder,
    load_faults,
)

PACKET = bytes(range(64))


def load(tmp_path, text, bridge="mavlink"):
    path = tmp_path / "faults.toml"
    path.write_text(text)
    return load_faults(path, (0, 1, 2), 10.0, bridge)


def test_a_timeline_is_read_in_the_order_of_its_times(tmp_path):
    faults = load(
        tmp_path,
        """
        [[fault]]
        kind = "kill"
        at_s = 5.0
        robot = 2
        [[fault]]
        kind = "loss"
        at_s = 1.0
        for_s = 2.0
        share = 0.2
        robots = [0, 1]
        """,
    )
    assert faults == (
        Loss(at_s=1.0, for_s=2.0, share=0.2, robots=(0, 1)),
        Kill(at_s=5.0, robot=2),
    )
    assert (faults[0].end_s, faults[0].hits, faults[1].hits) == (3.0, (), (2,))


@pytest.mark.parametrize(
    "table, complaint",
    [
        (
            'kind = "earthquake"\nat_s = 1.0',
            r"fault\[0\].kind: unknown fault 'earthquake'; allowed: kill",
        ),
        ("at_s = 1.0", r"fault\[0\].kind: missing; allowed: kill"),
        ('kind = "kill"\nat_s = 1.0', r"fault\[0\].robot: missing; allowed: "),
        ('kind = "kill"\nat_s = 1.0\nrobot = 1\nhow = "hard"', r"fault\[0\].how: unknown key; allowed: "),
        ('kind = "kill"\nat_s = 1.0\nrobot = 1\npart = "leg"', r"fault\[0\].part: .*'runtime', 'guard'"),
        ('kind = "kill"\nat_s = 1.0\nrobot = 7', r"fault\[0\]: no robot has id 7; known: 0, 1, 2"),
        ('kind = "kill"\nat_s = -1.0\nrobot = 1', r"`at_s` must lie in"),
        (
            'kind = "cpu_hog"\nat_s = 1.0\nfor_s = 1.0\nprocesses = 100000',
            r"`processes` must lie in \[1, 64\]",
        ),
        ('kind = "kill"\nat_s = 10.0\nrobot = 1', r"at_s: 10 s is not within the run of 10 s"),
        (
            'kind = "loss"\nat_s = 4.0\nfor_s = 6.1\nshare = 0.5',
            r"fault\[0\].for_s: ends at 10.1 s, beyond the run of 10 s",
        ),
        ('kind = "kill"\nat_s = nan\nrobot = 1', r"at_s: must be a finite number"),
        ('kind = "loss"\nat_s = 1.0\nfor_s = 1.0\nshare = 1.5', r"`share` must lie in \[0, 1\]"),
        ('kind = "loss"\nat_s = 1.0\nshare = 0.5', r"fault\[0\].for_s: missing"),
        ('kind = "clock_jump"\nat_s = 1.0', r"`whole_machine = true`"),
    ],
)
def test_a_file_that_does_not_hold_together_is_refused_in_one_line(tmp_path, table, complaint):
    with pytest.raises(ConfigError, match=complaint) as caught:
        load(tmp_path, f"[[fault]]\n{table}")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "faults.toml"))


def test_a_fault_may_last_to_the_end(tmp_path):
    (fault,) = load(tmp_path, '[[fault]]\nkind = "blackout"\nat_s = 3.3\nfor_s = 6.7')
    assert fault.end_s == pytest.approx(10.0)


def test_can_carries_no_nan(tmp_path):
    table = '[[fault]]\nkind = "nan_pose"\nat_s = 1.0\nfor_s = 1.0\nrobot = 1'
    assert len(load(tmp_path, table, "mavlink")) == 1
    with pytest.raises(ConfigError, match="use --bridge mavlink"):
        load(tmp_path, table, "can")


def copies(*faults, elapsed_s=1.5, sender=0, receiver=1, packets=4000, seed=0):
    disturbance = Disturbance(faults, seed)
    return [list(disturbance.deliveries(PACKET, sender, receiver, elapsed_s)) for _ in range(packets)]


def lasting(kind, **more):
    return kind(at_s=1.0, for_s=1.0, **more)


def test_without_faults_every_packet_arrives_at_once():
    assert copies(packets=10) == [[(0.0, PACKET)]] * 10


@pytest.mark.parametrize(
    "elapsed_s, sender, receiver, strikes",
    [(0.9, 0, 1, False), (1.0, 0, 1, True), (1.9, 2, 0, True), (2.0, 0, 1, False), (1.5, 1, 2, False)],
)
def test_a_fault_strikes_in_its_time_and_at_its_robots_only(elapsed_s, sender, receiver, strikes):
    fault = lasting(Blackout, robots=(0,))
    arrived = copies(fault, elapsed_s=elapsed_s, sender=sender, receiver=receiver, packets=1)
    assert arrived == ([[]] if strikes else [[(0.0, PACKET)]])


def test_shares_are_those_of_the_file():
    counts = Counter(len(one) for one in copies(lasting(Loss, share=0.2)))
    assert counts[0] / 4000 == pytest.approx(0.2, abs=0.03)
    counts = Counter(len(one) for one in copies(lasting(Duplicate, share=0.2)))
    assert counts[2] / 4000 == pytest.approx(0.2, abs=0.03)


def test_packets_held_back_are_overtaken():
    delays = [one[0][0] for one in copies(lasting(Reorder, share=0.5, hold_ms=70.0))]
    assert set(delays) == {0.0, 0.07}


@given(st.floats(0.0, 500.0), st.floats(0.0, 500.0))
def test_delays_lie_within_their_bounds(delay_ms, jitter_ms):
    fault = lasting(Delay, delay_ms=delay_ms, jitter_ms=jitter_ms)
    for [(delay_s, packet)] in copies(fault, packets=20):
        assert delay_ms * 1e-3 <= delay_s * (1 + 1e-12) and delay_s <= (delay_ms + jitter_ms) * 1.001e-3
        assert packet == PACKET


def test_a_corrupt_packet_differs_in_one_bit():
    for [(_, packet)] in copies(lasting(CorruptPackets, share=1.0), packets=50):
        different = int.from_bytes(packet, "big") ^ int.from_bytes(PACKET, "big")
        assert different.bit_count() == 1


def test_faults_add_up_and_repeat_with_their_seed():
    faults = (lasting(Loss, share=0.3), lasting(Duplicate, share=0.3), lasting(Delay, delay_ms=5.0))
    first = copies(*faults, packets=200, seed=1)
    assert first == copies(*faults, packets=200, seed=1) != copies(*faults, packets=200, seed=2)
    assert {len(one) for one in first} == {0, 1, 2}


@given(st.integers(1, 200_000), st.floats(0.01, 60.0))
def test_a_hostile_peer_sends_all_its_frames_in_its_time(frames, for_s):
    plan = list(bursts(Hostile(at_s=2.0, for_s=for_s, frames=frames)))
    assert plan[-1][1] == frames
    assert all(2.0 <= time_s <= 2.0 + for_s for time_s, _ in plan)
    assert [count for _, count in plan] == sorted(count for _, count in plan)
