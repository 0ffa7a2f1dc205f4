"""When poses come, as their source's newest ones tell."""

import math

import pytest

from edge_runtime.control.rhythm import Rhythm


def test_a_rhythm_is_known_after_some_poses_and_forgets_a_source_that_is_gone():
    rhythm = Rhythm(0.001)
    for pose in (1.0, 1.01, 1.0105, 1.02, 1.03, 1.04):
        assert rhythm.next_s(pose, pose) == math.inf
        rhythm.heard(pose)
    rhythm.heard(1.05)
    assert rhythm.interval_s == pytest.approx(0.01)
    assert rhythm.next_s(1.051, 1.051) == pytest.approx(1.06)
    assert rhythm.next_s(1.102, 1.0801) == pytest.approx(1.11)
    assert rhythm.next_s(1.1, 1.1) == math.inf
    rhythm.heard(0.5)  # overtaken
    assert (rhythm.newest_s, rhythm.interval_s) == (1.05, pytest.approx(0.01))


def test_a_lost_pose_changes_no_rhythm_and_jitter_averages_out():
    rhythm = Rhythm(0.001)
    for pose in (0.0, 0.011, 0.019, 0.041, 0.05, 0.06):
        rhythm.heard(pose)
    assert rhythm.interval_s == pytest.approx((0.011 + 0.008 + 0.009 + 0.01) / 4)


def test_a_pose_that_is_a_little_late_is_still_expected():
    rhythm = Rhythm(0.001)
    for number in range(6):
        rhythm.heard(0.01 * number)
    assert rhythm.next_s(0.061, 0.055) == pytest.approx(0.06)
    assert rhythm.next_s(0.062, 0.055) == pytest.approx(0.07)
