"""What speaks against a position, on a clock of the tests'; the link's tests show that it stops the robot."""

import pytest

from firmware_bridge.mavlink.messages import EstimatorStatus, GpsFix, LocalPosition, Odometry
from firmware_bridge.mavlink.soundness import Soundness

GOOD = EstimatorStatus(0x033F, 0.2)


@pytest.fixture
def sound():
    return Soundness()


def position(boot_s, x=0.0, speed=0.5):
    return LocalPosition(boot_s, (x, 0.0), (speed, 0.0))


def odometry(boot_s, resets=0):
    return Odometry(boot_s, (0.0, 0.0), (0.5, 0.0), (1.0, 0.0, 0.0, 0.0), 0.0, resets)


def test_what_was_never_told_speaks_against_nothing(sound):
    assert sound.fault(1e6) == ""
    assert not sound.told


class TestEstimator:
    @pytest.mark.parametrize(
        ("flags", "fits"),
        [
            (0x033F, True),  # ArduPilot with GPS
            (0x000B, True),  # relative position alone: optical flow, wheels
            (0x0013, True),
            (0x033E, False),  # no attitude
            (0x033D, False),  # no velocity
            (0x0027, False),  # no position
            (0x03BF, False),  # constant position: it guesses
            (0x073F, False),  # PX4's glitch, or ArduPilot's estimator not started
            (0x833F, False),  # ArduPilot's glitch
        ],
    )
    def test_it_must_vouch_for_attitude_velocity_and_position(self, sound, flags, fits):
        sound.on_status(EstimatorStatus(flags, 0.0), 10.0)
        assert sound.told
        assert (sound.fault(10.0) == "") is fits

    def test_one_that_falls_silent_is_not_trusted(self, sound):
        sound.on_status(GOOD, 10.0)
        assert sound.fault(12.0) == ""
        assert "has not told its status for 2 s" in sound.fault(12.1)

    def test_rejected_measurements_count_once_they_last(self, sound):
        sound.on_status(GOOD, 10.0)
        for now_s, fits in ((10.2, True), (11.0, True), (11.2, False)):
            sound.on_status(EstimatorStatus(0x033F, 1.4), now_s)
            assert (sound.fault(now_s) == "") is fits
        assert "test ratio 1.4" in sound.fault(11.2)
        sound.on_status(GOOD, 11.4)
        assert sound.fault(11.4) == ""


class TestGps:
    def test_without_a_fix_from_the_beginning_it_is_none_of_the_estimates_sources(self, sound):
        sound.on_fix(GpsFix(1, 0), 10.0)
        assert sound.fault(100.0) == ""

    @pytest.mark.parametrize("lost", [GpsFix(3, 1000), GpsFix(2, 2000), GpsFix(0, 2000)])
    def test_a_fix_that_was_there_must_be_renewed(self, sound, lost):
        sound.on_fix(GpsFix(3, 1000), 10.0)
        for now_s in (10.5, 11.0, 11.5):
            sound.on_fix(lost, now_s)
        assert sound.fault(11.5) == ""
        assert "lost its fix for 1.5 s" in sound.fault(11.6)
        sound.on_fix(GpsFix(3, 3000), 12.0)
        assert sound.fault(12.0) == ""


class TestJumps:
    @pytest.mark.parametrize(("x", "fits"), [(0.01, True), (0.5, True), (0.6, False), (-4.0, False)])
    def test_a_position_moves_as_fast_as_it_says(self, sound, x, fits):
        sound.on_pose(position(1.0), 11.0)
        sound.on_pose(position(1.02, x), 11.02)
        assert (sound.fault(11.02) == "") is fits

    @pytest.mark.parametrize(("dims", "up_m", "up_m_s", "fits"), [
        (2, 3.0, 0.0, True),
        (3, 0.5, 0.0, True),
        (3, 0.7, 0.0, False),
        (3, -3.0, 0.0, False),
        (3, 0.7, 20.0, True),
    ])  # fmt: skip
    def test_a_height_counts_where_robots_fly(self, dims, up_m, up_m_s, fits):
        sound = Soundness(dims)
        sound.on_pose(LocalPosition(1.0, (0.0, 0.0), (0.0, 0.0)), 11.0)
        sound.on_pose(LocalPosition(1.02, (0.0, 0.0), (0.0, 0.0), -up_m, -up_m_s), 11.02)
        assert (sound.fault(11.02) == "") is fits
        level = (1.0, 0.0, 0.0, 0.0)
        sound = Soundness(dims)
        sound.on_pose(Odometry(1.0, (0.0, 0.0), (0.0, 0.0), level, 0.0, 0), 11.0)
        sound.on_pose(Odometry(1.02, (0.0, 0.0), (0.0, 0.0), level, 0.0, 0, -up_m, -up_m_s), 11.02)
        assert (sound.fault(11.02) == "") is fits

    def test_after_a_gap_it_may_be_further(self, sound):
        sound.on_pose(position(1.0), 11.0)
        sound.on_pose(position(3.0, 1.4), 13.0)
        assert sound.fault(13.0) == ""

    def test_a_jump_counts_for_a_second(self, sound):
        sound.on_pose(position(1.0), 11.0)
        sound.on_pose(position(1.02, 4.0), 11.02)
        sound.on_pose(position(1.04, 4.0), 11.04)
        assert sound.fault(12.0) == "the position jumped by 4.0 m"
        assert sound.fault(12.1) == ""

    def test_the_estimators_own_count_of_resets(self, sound):
        for boot_s, resets, fits in ((1.0, 255, True), (1.1, 255, True), (1.2, 0, False)):
            sound.on_pose(odometry(boot_s, resets), 10.0 + boot_s)
            assert (sound.fault(10.0 + boot_s) == "") is fits

    @pytest.mark.parametrize(("boot_s", "fits"), [(1.9, True), (2.2, False), (-0.2, False), (500.0, False)])
    def test_the_autopilots_clock_goes_as_ours(self, sound, boot_s, fits):
        """Another clock is another vehicle behind the same address, or this one started again."""
        sound.on_pose(position(1.0), 11.0)
        sound.on_pose(position(boot_s), 11.02)
        assert (sound.fault(11.02) == "") is fits
