import pytest

from firmware_bridge.mavlink.messages import Heartbeat
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.vehicle import Vehicle

MANUAL, HOLD, AUTO, GUIDED = 0, 4, 10, 15


@pytest.fixture
def rover():
    return Vehicle(PROFILES["ardupilot_rover"])


def beat(vehicle, mode, armed):
    vehicle.on_heartbeat(Heartbeat(mode, armed), 1.0)


def take(vehicle):
    beat(vehicle, MANUAL, False)
    vehicle.expect_taking()
    beat(vehicle, GUIDED, False)
    beat(vehicle, GUIDED, True)
    vehicle.expect_driving()


def test_only_heartbeats_make_it_ready(rover):
    assert not rover.ready
    rover.expect_taking()
    assert not rover.ready
    beat(rover, GUIDED, False)
    assert not rover.ready
    beat(rover, MANUAL, True)
    assert not rover.ready
    beat(rover, GUIDED, True)
    assert rover.ready


def test_before_it_is_taken_the_operator_may_do_anything(rover):
    for mode, armed in ((GUIDED, True), (MANUAL, False), (AUTO, True), (GUIDED, True)):
        beat(rover, mode, armed)
    assert not rover.override


def test_taking_allows_the_present_mode_and_ours(rover):
    take(rover)
    assert not rover.override
    assert rover.ready


@pytest.mark.parametrize(("mode", "armed"), [(MANUAL, True), (AUTO, True), (HOLD, True), (GUIDED, False)])
def test_an_operators_hand_is_final(rover, mode, armed):
    take(rover)
    beat(rover, mode, armed)
    assert rover.override
    beat(rover, GUIDED, True)
    assert rover.override


def test_a_third_mode_while_taking_is_an_override(rover):
    beat(rover, MANUAL, False)
    rover.expect_taking()
    beat(rover, AUTO, False)
    assert "mode 0xa" in rover.override


def test_stopping_expects_the_stop_mode_but_no_other(rover):
    take(rover)
    rover.expect_stopping()
    beat(rover, GUIDED, True)
    beat(rover, HOLD, True)
    assert not rover.override
    beat(rover, MANUAL, True)
    assert rover.override


def test_a_robot_that_was_armed_when_taken_must_stay_armed(rover):
    beat(rover, GUIDED, True)
    rover.expect_driving()
    beat(rover, GUIDED, False)
    assert "disarmed" in rover.override


def test_the_first_reason_is_kept(rover):
    take(rover)
    beat(rover, AUTO, True)
    reason = rover.override
    beat(rover, GUIDED, False)
    assert rover.override == reason
