"""AgileX chassis: what their states mean, bit by bit as the vendor's sources have them."""

import math

import pytest

from firmware_bridge.can.codec import CanCodec
from firmware_bridge.can.feedback import FeedbackRules
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.profile import load_profile, profile_path
from firmware_bridge.guard.link import Condition
from firmware_bridge.kinematics.base import motion_for

NORMAL = {"vehicle": 0, "control": 1, "errors": 0, "byte6": 0}
FINE = {"agilex_v2": {}, "agilex_omni": {}, "agilex_hunter": {}, "agilex_limo": {"byte6": 2}}
BATTERY, BATTERY_LOW, REMOTE, DRIVER, COMPUTER, ENCODER = 0x0001, 0x0002, 0x0004, 0x0100, 0x0200, 0x0080
MOTORS = (0x0008, 0x0010, 0x0020, 0x0040)
"""SYSTEM_ERROR_*_MASK of ugv_sdk's agilex_message.h."""


class Chassis:
    """A profile with its rules, told frames."""

    def __init__(self, name) -> None:
        path = profile_path(name)
        self.profile = load_profile(path)
        self.codec = CanCodec(self.profile, path)
        self.rules = FeedbackRules(self.profile.feedback)

    def health(self, *frames):
        for frame in (*frames, Frame(0x221, bytes(8))):
            decoded = self.codec.decode(frame)
            if decoded is not None:
                self.rules.take(decoded, 10.0)
        return self.rules.health(10.0)


def system_state(vehicle, control, errors, byte6):
    return Frame(0x211, bytes([vehicle, control, 0, 240, errors >> 8, errors & 0xFF, byte6, 77]))


def health(name, **changes):
    return Chassis(name).health(system_state(**{**NORMAL, **FINE[name], **changes}))


@pytest.mark.parametrize("name", FINE)
class TestEachChassis:
    def test_takes_commands_when_all_is_well(self, name):
        found = health(name)
        assert (found.condition, found.warning) == (Condition.READY, "")

    @pytest.mark.parametrize("error", [BATTERY, DRIVER, ENCODER, *MOTORS, 0x0800, 0x1000, 0x8000])
    def test_stops_for_an_error_though_its_state_is_normal(self, name, error):
        found = health(name, errors=error)
        assert found.condition is Condition.FAULT
        assert "the firmware reports a fault (SystemState." in found.detail

    @pytest.mark.parametrize("error", [BATTERY_LOW, REMOTE, 0x0400])
    def test_warns_and_drives_on(self, name, error):
        found = health(name, errors=error)
        assert found.condition is Condition.READY
        assert found.warning.startswith("the firmware warns (SystemState.")

    def test_stops_for_what_it_does_not_know(self, name):
        assert health(name, vehicle=7).condition is Condition.FAULT
        assert health(name, control=9).condition is Condition.OVERRIDE

    def test_is_its_operators_by_remote_control_and_emergency_stop(self, name):
        assert health(name, control=3).condition is Condition.OVERRIDE
        assert health(name, vehicle=1, errors=DRIVER).condition is Condition.OVERRIDE

    def test_waits_in_standby(self, name):
        assert health(name, control=0).condition is Condition.WAITING


@pytest.mark.parametrize("name", ["agilex_v2", "agilex_hunter"])
def test_another_commander_on_the_serial_port_is_an_override(name):
    assert health(name, control=2).condition is Condition.OVERRIDE


def test_the_serial_port_is_the_limos_own():
    assert health("agilex_limo", control=2).condition is Condition.READY


def test_a_computer_that_is_not_heard_is_known_to_the_computer():
    assert health("agilex_v2", errors=COMPUTER).condition is Condition.READY
    assert health("agilex_hunter", errors=COMPUTER).condition is Condition.FAULT


@pytest.mark.parametrize("mode", [0, 1, 255])
def test_a_limo_in_another_motion_mode_is_not_commanded(mode):
    found = health("agilex_limo", byte6=mode)
    assert found.condition is Condition.WAITING
    assert f"SystemState.ModeOrBrake = {mode}" in found.detail


def test_a_hunter_with_its_brake_locked_is_not_commanded():
    assert health("agilex_hunter", byte6=1).condition is Condition.WAITING


class TestRanger:
    """0x211 after ranger_ros2's frame_211.cpp, 0x291 after ugv_sdk and frame_291.cpp."""

    def health(self, state="00 01 01 E0 00 00 00 00", mode="00 00"):
        frames = [Frame(0x211, bytes.fromhex(state)), Frame(0x291, bytes.fromhex(mode) + bytes(6))]
        return Chassis("agilex_ranger").health(*frames)

    def test_takes_commands_with_both_axles_steering(self):
        assert self.health().condition is Condition.READY

    @pytest.mark.parametrize("mode", ["01 00", "02 00", "03 00", "04 00", "00 01", "09 00"])
    def test_waits_in_another_motion_mode_and_while_it_changes(self, mode):
        found = self.health(mode=mode)
        assert found.condition is Condition.WAITING
        assert "MotionModeState." in found.detail

    def test_needs_its_motion_mode_told(self):
        chassis = Chassis("agilex_ranger")
        found = chassis.health(Frame(0x211, bytes.fromhex("00 01 01 E0 00 00 00 00")))
        assert (found.condition, found.detail) == (Condition.FAULT, "no MotionModeState received yet")

    @pytest.mark.parametrize(
        ("byte", "bit", "condition"),
        [
            *((5, bit, Condition.FAULT) for bit in range(5)),
            *((6, bit, Condition.FAULT) for bit in (0, 2, 3, 4, 5, 6, 7)),
            *((7, bit, Condition.FAULT) for bit in (0, 1, 3, 4, 5, 6)),
            (7, 2, Condition.READY),
            (7, 7, Condition.OVERRIDE),
        ],
    )
    def test_each_error_has_a_rule(self, byte, bit, condition):
        data = bytearray.fromhex("00 01 01 E0 00 00 00 00")
        data[byte] = 1 << bit
        found = self.health(bytes(data).hex())
        assert found.condition is condition
        assert bool(found.warning) is (condition is Condition.READY)

    def test_is_asked_for_its_motion_mode_and_never_for_lateral_speed(self):
        chassis = Chassis("agilex_ranger")
        enable = [chassis.codec.encode_step(step) for step in chassis.profile.enable]
        assert [(sent.frame_id, sent.data[0]) for sent in enable] == [(0x441, 0), (0x421, 1), (0x141, 0)]
        for velocity in ((0.5, 0.3), (0.2, -0.9), (-0.4, 0.1)):
            (sent,) = chassis.codec.encode(motion_for(velocity, 0.4, chassis.profile.base))
            assert sent.frame_id == 0x111
            assert sent.data[2:6] == bytes(4)

    def test_turns_as_the_vendors_own_odometry_says(self):
        """yaw rate = 2 v / (L / |tan(d)| + W): ranger_ros, kinematics_model.hpp, with its parameters."""
        chassis = Chassis("agilex_ranger")
        motion = motion_for((0.6, 0.1), 0.0, chassis.profile.base)
        (sent,) = chassis.codec.encode(motion)
        speed, angle = (int.from_bytes(sent.data[i : i + 2], "big", signed=True) / 1e3 for i in (0, 6))
        vendors = math.copysign(2.0 * speed / (0.494 / abs(math.tan(angle)) + 0.364), angle)
        assert vendors == pytest.approx(0.1 / 0.4, rel=0.01)
        told = chassis.codec.decode(Frame(0x221, sent.data))
        chassis.rules.take(told, 10.0)
        measured = chassis.rules.motion(chassis.profile.feedback.motion, chassis.profile.base)
        assert measured.yaw_rad_s == pytest.approx(vendors, rel=1e-3)


def test_a_hunter_turns_as_the_vendors_own_odometry_says():
    """Middle's angle = atan(L / (L / tan(d) + W / 2)): hunter_ros, ConvertInnerAngleToCentral."""
    hunter = Chassis("agilex_hunter")
    motion = motion_for((0.6, 0.2), 0.0, hunter.profile.base)
    central = math.atan(0.65 / (0.65 / math.tan(motion.steering_rad) + 0.605 / 2))
    assert motion.forward_m_s * math.tan(central) / 0.65 == pytest.approx(motion.yaw_rad_s)
    assert motion.yaw_rad_s == pytest.approx(0.2 / 0.65)
