"""Ticks that begin with their poses, on a clock that only moves when told, beside sources of every temper."""

import bisect
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.control import start
from edge_runtime.control.rate import SLOWER, STEP
from edge_runtime.control.start import FRESH, KEPT, PATIENCE, StateGrid, lead_for

PERIOD = 0.02
DRIFT = 200e-6
"""Greatest rate at which two machines' clocks part."""
START = 100.0
TINY = 1e-9


class Source:
    """Poses that arrive at given times, and a clock that waits for them."""

    def __init__(self, poses, oversleep=0.0):
        self.poses, self.now, self.taken, self.oversleep = sorted(poses), START, 0, oversleep

    def __call__(self):
        return self.now

    def fileno(self):
        raise AssertionError("nothing here is to be selected")

    def sleep(self, seconds):
        self.now += seconds + self.oversleep

    def listen(self, _source, seconds):
        nothing_new = self.taken == len(self.poses) or self.poses[self.taken] > self.now + seconds
        end = self.now + max(seconds, 1e-12)  # time goes on
        self.now = end if nothing_new else max(self.now, self.poses[self.taken])

    def new_poses(self):
        begin = self.taken
        self.taken = bisect.bisect_right(self.poses, self.now)
        return self.poses[begin : self.taken]


def run(poses, ticks=400, work=0.001, oversleep=0.0, **options):
    """Tick; returns when ticks began, their deadlines, the age of the newest pose at each, and the grid."""
    source = Source(poses, oversleep)
    options = {"clock": source, "sleep": source.sleep, "listen": source.listen, **options}
    grid = StateGrid(PERIOD, source, **options)
    begun, deadlines, ages = [], [], []
    for _ in range(ticks):
        deadlines.append(grid.wait())
        begun.append(source.now)
        arrived = bisect.bisect_right(source.poses, source.now + TINY)
        ages.append(source.now - source.poses[arrived - 1] if arrived else math.inf)
        source.now += work
    return np.array(begun), np.array(deadlines), np.array(ages), grid


def steady(hz, phase=0.3, seconds=12.0):
    return [START + (number + phase) / hz for number in range(int(seconds * hz))]


phases = st.floats(0.0, 1.0)


@pytest.mark.parametrize("hz", [50.0, 100.0, 120.0, 150.0, 240.0, 1000.0])
@given(phase=phases)
@settings(max_examples=15)
def test_ticks_begin_with_their_poses_whatever_the_phase(hz, phase):
    """Once the source's phase is known, and the deadlines were put off by up to a period in small steps."""
    begun, _, ages, grid = run(steady(hz, phase))
    assert ages[30:].max() <= FRESH * PERIOD + TINY
    assert (grid.misses, grid.ticks) == (0, 400)
    assert begun[-1] - START < (399 + 1.0) * PERIOD


@given(phase=phases, seed=st.integers(0, 2**16))
@settings(max_examples=60)
def test_two_poses_a_period_that_jitter_do_not_make_ticks_jump_from_one_to_the_other(phase, seed):
    jitter = np.random.default_rng(seed).uniform(-0.0005, 0.0005, 1200)
    begun, *_ = run(np.array(steady(100.0, phase)) + jitter)
    apart = np.diff(begun[60:])
    assert (np.abs(apart - PERIOD) > 0.15 * PERIOD).mean() < 0.02


@pytest.mark.parametrize("hz", [50.0, 100.0, 120.0, 150.0, 240.0])
@given(phase=phases, seed=st.integers(0, 2**16))
@settings(max_examples=20)
def test_a_pose_that_comes_sooner_than_expected_begins_its_tick(hz, phase, seed):
    """Also while the loop waits for the moment at which it prepares; deadlines may be put off meanwhile."""
    jitter = np.random.default_rng(seed).uniform(-0.001, 0.001, int(12 * hz))
    begun, _, ages, _ = run(np.array(steady(hz, phase)) + jitter, lead_s=0.0005)
    assert (ages[60:] > KEPT * PERIOD + TINY).mean() < 0.02
    assert np.diff(begun).min() >= (1.0 - PATIENCE) * PERIOD - TINY


@given(phase=phases, drift=st.floats(-DRIFT, DRIFT))
@settings(max_examples=5)
def test_a_source_whose_clock_drifts_is_followed(phase, drift):
    """It has to be caught again after each beat, within half a second."""
    _, _, ages, grid = run(steady(50.0 * (1.0 + drift), phase, 210.0), ticks=10_000)
    assert (ages[30:] > FRESH * PERIOD + TINY).mean() < 0.01
    assert grid.rate_hz == pytest.approx(50.0, rel=SLOWER)
    assert grid.misses <= 10


def irregular(kinds, seed):
    """A source that changes its temper every now and then."""
    draw, now, poses = np.random.default_rng(seed), START, []
    for kind, hz in kinds:
        for _ in range(60):
            now += 1.0 / hz
            match kind:
                case "jitter":
                    poses.append(now + draw.uniform(0.0, 1.5) / hz)
                case "double":
                    poses += [now, now + draw.uniform(0.0, 0.3) / hz]
                case "burst":
                    poses += [now + 1e-5 * n for n in range(8)] if draw.random() < 0.2 else []
                case "pause":
                    poses += [now] if draw.random() < 0.5 else []
                case "steady":
                    poses.append(now)
        now += 0.3 if kind == "pause" else 0.0
    return poses


tempers = st.lists(
    st.tuples(
        st.sampled_from(["jitter", "double", "burst", "pause", "steady"]),
        st.sampled_from([3.0, 10.0, 30.0, 49.0, 50.0, 51.0, 60.0, 120.0, 400.0]),
    ),
    max_size=8,
)


@given(kinds=tempers, seed=st.integers(0, 2**16), work=st.floats(0.0, 0.9))
@settings(max_examples=60)
def test_no_source_makes_more_commands_nor_fewer(kinds, seed, work):
    """In any stretch of time there are as many ticks as deadlines, and any two keep their distance."""
    begun, deadlines, _, grid = run(irregular(kinds, seed), work=work * PERIOD)
    late = begun - deadlines
    assert late.min() >= -TINY
    assert late.max() <= PATIENCE * PERIOD + TINY
    assert np.diff(deadlines).min() >= PERIOD - TINY
    apart = np.diff(begun)
    assert apart.min() >= (1.0 - PATIENCE) * PERIOD - TINY
    assert apart.max() <= (1.0 + PATIENCE + STEP) * PERIOD + TINY
    for stretch in (2, 10, 100):
        span = begun[stretch:] - begun[:-stretch]
        assert span.min() >= (stretch - PATIENCE) * PERIOD - TINY
    put_off = (deadlines[-1] - deadlines[0]) / PERIOD - 399
    assert put_off <= 1.0 + 399 * SLOWER + TINY
    assert grid.misses == math.floor(put_off + TINY)


@given(kinds=tempers, seed=st.integers(0, 2**16), late=st.lists(st.floats(0.0, 3.0), max_size=20))
def test_late_ticks_are_counted_as_on_the_grid(kinds, seed, late):
    source = Source(irregular(kinds, seed))
    grid = StateGrid(PERIOD, source, clock=source, sleep=source.sleep, listen=source.listen)
    first = grid.wait()
    for periods in late:
        source.now += periods * PERIOD
        deadline = grid.wait()
        assert deadline - TINY <= source.now <= deadline + PATIENCE * PERIOD + TINY
    assert math.floor((deadline - first) / PERIOD + TINY if late else 0) + 1 == grid.ticks + grid.misses


@pytest.mark.parametrize("hz", [100.0, 120.0])
def test_a_silent_source_is_waited_for_a_few_times_only(hz):
    begun, deadlines, _, _ = run([pose for pose in steady(hz) if not START + 2.0 < pose < START + 4.0])
    late = begun - deadlines
    silent = late[(deadlines > START + 2.1) & (deadlines < START + 4.0)]
    assert silent.max() <= TINY
    assert late[deadlines > START + 4.2].max() > 0.0


def test_a_slow_source_makes_no_tick_late_in_vain():
    begun, deadlines, _, _ = run(steady(10.0))
    waited = begun - deadlines > TINY
    assert waited.mean() <= 0.21  # those ticks within whose reach its poses fall


def test_nothing_waits_longer_than_the_guard_allows():
    begun, _, _, _ = run(steady(120.0), longest_gap_s=1.2 * PERIOD)
    assert np.diff(begun).max() <= 1.2 * PERIOD + TINY


@given(phase=phases)
def test_a_tick_that_takes_long_does_not_wait_into_the_next(phase):
    begun, deadlines, _, grid = run(steady(120.0, phase), work=0.7 * PERIOD)
    assert (begun + 0.7 * PERIOD - deadlines)[10:].max() <= 0.81 * PERIOD
    assert grid.misses <= 1  # the deadlines were put off until they fell on poses


def test_without_a_source_ticks_begin_at_their_deadlines():
    source = Source([])
    grid = StateGrid(0.5, None, clock=source, sleep=source.sleep)
    assert [grid.wait() for _ in range(3)] == [100.0, 100.5, 101.0]
    assert source.now == grid.due_s == 101.0


@pytest.mark.parametrize("hz", [0.0, 50.0, 120.0])
def test_an_early_wake_prepares_before_the_pose_and_delays_nothing(hz):
    source, prepared = Source(steady(hz) if hz else []), []

    def prepare():
        prepared.append(source.now)
        source.now += 0.0003

    lazy = run(source.poses)[0]
    grid = StateGrid(PERIOD, source, prepare, 0.001, math.inf, source, source.sleep, source.listen)
    begun = []
    for _ in range(400):
        grid.wait()
        begun.append(source.now)
        source.now += 0.001
    np.testing.assert_allclose(begun, lazy, atol=TINY)
    assert len(prepared) == 399
    ahead = np.array(begun[1:]) - np.array(prepared)
    np.testing.assert_allclose(ahead, 0.001, atol=TINY)


def test_due_is_the_pose_that_was_waited_for():
    source = Source(steady(120.0))
    grid = StateGrid(PERIOD, source, clock=source, sleep=source.sleep, listen=source.listen)
    for _ in range(50):
        deadline = grid.wait()
        source.now += 0.001
    assert grid.due_s == source.now - 0.001 > deadline + TINY


def test_no_early_wake_where_it_takes_a_share_of_the_period(monkeypatch):
    monkeypatch.setattr(start, "time", SimpleNamespace(perf_counter=lambda: 5.0))
    assert lead_for(lambda: None, 1.0) > 0.0
    assert lead_for(lambda: None, 1e-3) == 0.0
