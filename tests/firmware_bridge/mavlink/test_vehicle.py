import pytest

from firmware_bridge.mavlink.messages import Heartbeat, Landed
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.vehicle import Vehicle

MANUAL, HOLD, AUTO, GUIDED = 0, 4, 10, 15
QUADROTOR, ROVER, ARDUPILOT = 2, 10, 3
STANDBY, ACTIVE = 3, 4
ON_GROUND, IN_AIR = 1, 2
COMMAND, STOP = PROFILES["ardupilot_rover"].command_mode, PROFILES["ardupilot_rover"].stop_mode


@pytest.fixture
def rover():
    return Vehicle(PROFILES["ardupilot_rover"])


def beat(vehicle, mode, armed, kind=ROVER, autopilot=ARDUPILOT, status=ACTIVE):
    vehicle.on_heartbeat(Heartbeat(mode, armed, kind, autopilot, status), 1.0)


def take(vehicle):
    beat(vehicle, MANUAL, False)
    vehicle.expect(COMMAND)
    beat(vehicle, GUIDED, False)
    beat(vehicle, GUIDED, True)


def test_only_heartbeats_make_it_ready(rover):
    assert not rover.ready
    rover.expect(COMMAND)
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
    rover.expect(COMMAND)
    beat(rover, AUTO, False)
    assert "mode 0xa" in rover.override


def test_stopping_expects_the_stop_mode_but_no_other(rover):
    take(rover)
    rover.expect(STOP)
    beat(rover, GUIDED, True)
    beat(rover, HOLD, True)
    assert not rover.override
    beat(rover, MANUAL, True)
    assert rover.override


def test_a_robot_that_was_armed_when_taken_must_stay_armed(rover):
    beat(rover, GUIDED, True)
    rover.expect(COMMAND)
    beat(rover, GUIDED, False)
    assert "disarmed" in rover.override


def test_the_first_reason_is_kept(rover):
    take(rover)
    beat(rover, AUTO, True)
    reason = rover.override
    beat(rover, GUIDED, False)
    assert rover.override == reason


def test_once_a_commanded_mode_was_there_the_one_before_is_an_operators(rover):
    """HOLD was present when the guard took the robot; later it is somebody's choice."""
    beat(rover, HOLD, False)
    rover.expect(COMMAND)
    beat(rover, HOLD, False)
    assert not rover.override
    beat(rover, GUIDED, False)
    beat(rover, HOLD, False)
    assert "mode 0x4" in rover.override


def test_a_stopped_robot_that_is_driven_again_is_an_operators(rover):
    take(rover)
    rover.expect(STOP)
    beat(rover, GUIDED, True)
    beat(rover, HOLD, True)
    beat(rover, GUIDED, True)
    assert "mode 0xf" in rover.override


@pytest.mark.parametrize(
    ("armed", "status", "landed", "grounded"),
    [
        (True, ACTIVE, None, False),
        (True, ACTIVE, IN_AIR, False),
        (False, ACTIVE, None, True),
        (True, STANDBY, None, True),  # ArduCopter armed on the ground, which it leaves after ten seconds
        (True, ACTIVE, ON_GROUND, True),  # PX4 is active as soon as it is armed
    ],
)
def test_a_copter_on_the_ground(armed, status, landed, grounded):
    copter = Vehicle(PROFILES["ardupilot_copter"])
    assert not copter.grounded
    if landed is not None:
        copter.on_landed(Landed(landed))
    beat(copter, 0, armed, QUADROTOR, status=status)
    assert copter.grounded is grounded


def test_a_rover_is_where_it_drives(rover):
    rover.on_landed(Landed(ON_GROUND))
    beat(rover, HOLD, False, status=STANDBY)
    assert not rover.grounded


def test_its_kind_must_be_the_profiles(rover):
    assert not rover.misfit
    beat(rover, GUIDED, True)
    assert not rover.misfit
    beat(rover, GUIDED, True, QUADROTOR)
    assert "a quadrotor under ArduPilot is not" in rover.misfit
