"""The deadline grid on a clock that only moves when told."""

import numpy as np
import pytest
from clocks import Clock
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.control.rate import DeadlineGrid, TimingRecord


def make_grid(clock, period=0.5):
    return DeadlineGrid(period, clock, clock.sleep)


def test_quick_ticks_meet_every_deadline():
    clock = Clock()
    grid = make_grid(clock)
    deadlines = []
    for _ in range(5):
        deadlines.append(grid.wait())
        clock.now += 0.125
    assert deadlines == [100.0, 100.5, 101.0, 101.5, 102.0]
    assert (grid.ticks, grid.misses, grid.longest_burst) == (5, 0, 0)
    assert grid.rate_hz == 2.0
    assert grid.next_s == 2.5


def test_a_slow_tick_skips_and_counts_but_never_bursts():
    clock = Clock()
    grid = make_grid(clock)
    grid.wait()
    clock.now += 1.75  # over the deadlines at 100.5, 101.0 and 101.5
    assert grid.wait() == 102.0
    assert (clock.now, grid.misses, grid.longest_burst) == (102.0, 3, 3)
    clock.now += 0.75
    assert grid.wait() == 103.0
    assert (grid.ticks, grid.misses, grid.longest_burst) == (3, 4, 3)


def test_small_lateness_does_not_move_the_grid():
    clock = Clock(oversleep=0.0625)
    grid = make_grid(clock)
    assert [grid.wait() for _ in range(4)] == [100.0, 100.5, 101.0, 101.5]
    assert grid.misses == 0


def test_a_sleep_beyond_the_whole_period_is_a_miss():
    clock = Clock()
    grid = make_grid(clock)
    grid.wait()
    clock.oversleep = 0.75

    def sleep_well(seconds):
        clock.sleep(seconds)
        clock.oversleep = 0.0

    grid._sleep = sleep_well
    assert grid.wait() == 101.0
    assert (grid.misses, grid.longest_burst) == (1, 1)


@given(st.lists(st.floats(0.0, 3.0), max_size=30))
def test_deadlines_lie_on_the_grid_and_add_up(work):
    clock = Clock()
    grid = make_grid(clock)
    deadlines = [grid.wait()]
    for seconds in work:
        clock.now += seconds
        deadlines.append(grid.wait())
        assert clock.now == pytest.approx(deadlines[-1])
    index = (np.array(deadlines) - 100.0) / 0.5
    np.testing.assert_allclose(index, np.round(index), atol=1e-9)
    assert (np.diff(index) > 0.5).all()
    assert round(index[-1]) + 1 == grid.ticks + grid.misses


def test_percentiles_of_known_laps():
    clock = Clock()
    timing = TimingRecord(["read", "act"], capacity=2000, clock=clock)
    for tick in range(1, 1001):
        timing.begin(clock.now - 0.25)
        clock.now += tick
        timing.lap()
        clock.now += 2.0
        timing.lap()
        assert timing.end() == pytest.approx((tick + 2) * 1e6)
    stages = timing.stage_us()
    assert list(stages) == ["wake", "read", "act"]
    assert stages["wake"].p50 == pytest.approx(0.25e6)
    assert stages["act"].max == pytest.approx(2e6)
    expected = np.percentile(np.arange(1, 1001) * 1e6, [50, 99, 99.9])
    read = stages["read"]
    np.testing.assert_allclose([read.p50, read.p99, read.p99_9], expected, rtol=1e-6)
    assert read.max == pytest.approx(1000e6)


def test_maxima_outlive_the_ring():
    clock = Clock()
    timing = TimingRecord(["work"], capacity=4, clock=clock)
    for duration in [64.0, *[1.0] * 8]:
        timing.begin(clock.now)
        clock.now += duration
        timing.lap()
        timing.end()
    assert timing.tick_us().max == 64e6
    assert timing.tick_us().p99_9 == 1e6


def test_an_empty_record_has_no_distribution():
    assert TimingRecord(["work"]).tick_us().max == 0.0


@pytest.mark.parametrize("ticks", [1, 2, 5, 64, 200])
def test_recent_durations_are_numpys_percentiles(ticks):
    """Over the newest ticks alone, also where they lie across the ring's end."""
    random, now = np.random.default_rng(ticks), 0.0
    timing = TimingRecord(["read", "act"], capacity=64, clock=lambda: now)
    rows = random.lognormal(5.0, 2.0, (100, 2))
    for read, act in rows:
        timing.begin(now)
        now += 1e-6 * read
        timing.lap()
        now += 1e-6 * act
        timing.lap()
        timing.end()
    newest = rows[-min(ticks, 64) :]
    wanted = np.percentile(np.column_stack([0.0 * newest[:, 0], newest, newest.sum(1)]), [50, 99], axis=0)
    np.testing.assert_allclose(timing.recent_us(ticks), wanted.T, rtol=1e-4)


def test_no_ticks_have_no_recent_durations():
    assert TimingRecord(["work"]).recent_us(5) == [(0.0, 0.0)] * 3
