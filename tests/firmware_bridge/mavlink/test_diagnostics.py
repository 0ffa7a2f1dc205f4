"""What the doctor says of an autopilot, and that it asks for nothing but the time and one parameter."""

from types import SimpleNamespace

import pytest
from mavlink_peers import HOME, ScriptedAutopilot, Ticks, vehicle_frame
from pymavlink.dialects.v20 import ardupilotmega as common

import firmware_bridge.mavlink.channel as mavlink_channel
import firmware_bridge.mavlink.conversation as conversation
from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Verdict, examine
from edge_runtime.errors import ConfigError
from edge_runtime.motion.models import PointForce
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.guard.spec import GuardFlags
from firmware_bridge.mavlink.bridge import MavlinkFlags
from firmware_bridge.mavlink.diagnostics import autopilot, examine_link, mode, signing
from firmware_bridge.mavlink.messages import Heartbeat
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.signing import clock_ticks
from firmware_bridge.sil.firmware.intervals import Intervals
from firmware_bridge.sil.firmware.telemetry import ATTITUDE, HEARTBEAT, POSITION

FLAGS = MavlinkFlags("udpin:127.0.0.1:14550", "px4")
PX4 = PROFILES["px4"]
REQUEST_MESSAGE = 512
ROVER_FLAGS = MavlinkFlags("udpin:127.0.0.1:14550", "ardupilot_rover")


def beat(mode, armed):
    return Heartbeat(mode, armed, kind=10, autopilot=12, status=4)


@pytest.fixture(autouse=True)
def _no_time_for_others(monkeypatch):
    """What is on the link speaks at once or never; no time passes but by looking at the clock."""
    monkeypatch.setattr(conversation, "LISTENING_S", 0.0)
    monkeypatch.setattr(conversation, "LISTEN_S", 1.0)
    monkeypatch.setattr(conversation, "time", SimpleNamespace(monotonic=Ticks()))


@pytest.fixture
def mission():
    fleet = load_fleet(DEFAULT_FLEET)
    return Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, 20.0)


@pytest.fixture
def peer(monkeypatch):
    """A PX4 that is at the other end of whatever is opened."""
    vehicle = ScriptedAutopilot("px4", Ticks())
    monkeypatch.setattr(mavlink_channel, "open_transport", lambda _address: vehicle)
    return vehicle


@pytest.fixture
def rover(monkeypatch):
    """An ArduPilot Rover, there in the same way."""
    vehicle = ScriptedAutopilot("ardupilot_rover", Ticks())
    monkeypatch.setattr(mavlink_channel, "open_transport", lambda _address: vehicle)
    return vehicle


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "link.key"
    path.write_bytes(bytes(range(32)))
    path.chmod(0o600)
    return path


def hear(profile="px4", signing_key=""):
    dynamics = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.05)
    options = MavlinkOptions(profile, FLAGS.address, dynamics, signing_key=str(signing_key))
    heard = conversation.listen(options)
    return heard, examine("autopilot", lambda: autopilot(heard, options))


def verdicts(findings):
    return {finding.name: finding.verdict for finding in findings}


def details(findings):
    return {finding.name: f"{finding.detail}; {finding.remedy}" for finding in findings}


def findings_of(peer, mission, flags=FLAGS, **traits):
    """What is found of a vehicle with these traits."""
    for name, value in traits.items():
        setattr(peer, name, value)
    return list(examine_link(mission, flags))


@pytest.mark.usefixtures("peer")
def test_an_autopilot_that_is_ready_to_be_armed(mission):
    findings = list(examine_link(mission, FLAGS))
    assert verdicts(findings) == {
        "signing": Verdict.WARN,
        "autopilot": Verdict.OK,
        "vehicle": Verdict.OK,
        "answers": Verdict.OK,
        "mode": Verdict.OK,
        "firmware timeout": Verdict.OK,
        "stopping": Verdict.WARN,
        "pose": Verdict.OK,
        "estimator": Verdict.OK,
    }
    assert details(findings)["firmware timeout"].startswith(
        "0.5 s, as the autopilot answers for COM_OF_LOSS_T"
    )


def test_nothing_is_commanded(peer, mission):
    list(examine_link(mission, FLAGS))
    asked = {message.get_type() for message in peer.heard}
    assert asked == {"TIMESYNC", "PARAM_REQUEST_READ", "COMMAND_LONG"}
    assert {m.command for m in peer.heard if m.get_type() == "COMMAND_LONG"} == {REQUEST_MESSAGE}


@pytest.mark.parametrize(("allow", "verdict"), [(False, Verdict.FAIL), (True, Verdict.WARN)])
def test_a_timeout_over_a_second(peer, mission, allow, verdict):
    peer.parameters["COM_OF_LOSS_T"] = 3.0
    flags = MavlinkFlags(FLAGS.address, "px4", GuardFlags(allow_unsafe_firmware_timeout=allow))
    assert verdicts(examine_link(mission, flags))["firmware timeout"] is verdict


def test_an_autopilot_that_does_not_tell_its_timeout(peer):
    peer.parameters.clear()
    heard, found = hear()
    assert found.verdict is Verdict.OK
    assert heard.facts.timeout_s is None


def test_silence_is_bounded_and_explained(peer):
    peer.silent = True
    heard, found = hear()
    assert heard.facts.vehicle.heartbeat is None
    assert found.verdict is Verdict.FAIL
    assert "(0 frames of others" in found.detail


def test_another_system_is_not_taken_for_the_autopilot(peer):
    peer.codec.srcSystem = 7
    _, found = hear()
    assert found.verdict is Verdict.FAIL
    assert "(0 frames of others" not in found.detail


def test_a_port_that_cannot_be_opened(mission):
    flags = MavlinkFlags("udpin:192.0.2.1:14550", "px4")
    findings = list(examine_link(mission, flags))
    assert verdicts(findings) == {"signing": Verdict.WARN, "autopilot": Verdict.FAIL}


def test_signed_frames_are_verified(peer, key):
    peer.sign(key.read_bytes(), clock_ticks() + 1_000_000)
    heard, found = hear(signing_key=key)
    assert found.verdict is Verdict.OK
    assert heard.facts.timeout_s == 0.5


@pytest.mark.usefixtures("peer")
def test_an_autopilot_that_does_not_sign_is_refused(key):
    _, found = hear(signing_key=key)
    assert found.verdict is Verdict.FAIL
    assert "unsigned refused by signing" in found.detail


def test_a_key_that_cannot_be_used_ends_the_talk(peer, mission, key):
    key.chmod(0o644)
    flags = MavlinkFlags(FLAGS.address, "px4", signing_key=str(key))
    (found,) = examine_link(mission, flags)
    assert (found.name, found.verdict) == ("signing", Verdict.FAIL)
    assert "chmod 600" in found.detail
    assert peer.heard == []


@pytest.mark.parametrize(
    ("address", "required", "verdict"),
    [
        ("udpin:127.0.0.1:1", False, Verdict.WARN),
        ("udpin:127.0.0.1:1", True, Verdict.FAIL),
        ("serial:/dev/ttyACM0:57600", False, Verdict.OK),
        ("serial:/dev/ttyACM0:57600", True, Verdict.FAIL),
    ],
)
def test_without_a_key(address, required, verdict):
    assert signing(MavlinkFlags(address, "px4", require_signing=required)).verdict is verdict


def test_a_key_is_named(key):
    found = signing(MavlinkFlags("udpin:127.0.0.1:1", "px4", signing_key=str(key)))
    assert (found.verdict, found.detail) == (Verdict.OK, f"on, the key {key} is readable")


@pytest.mark.parametrize(
    ("heartbeat", "verdict", "said"),
    [
        (beat(6 << 16, armed=False), Verdict.OK, "OFFBOARD, disarmed"),
        (beat(PX4.stop_mode.reported, armed=True), Verdict.WARN, "HOLD, armed"),
        (beat(1 << 16, armed=False), Verdict.OK, "0x10000, another than OFFBOARD or HOLD, disarmed"),
    ],
)
def test_modes_have_names(heartbeat, verdict, said):
    found = mode(heartbeat, PX4)
    assert (found.verdict, found.detail) == (verdict, said)


def test_a_wrong_flag_is_refused_at_once(mission):
    with pytest.raises(ConfigError, match="--mavlink-autopilot"):
        examine_link(mission, MavlinkFlags(FLAGS.address, "pixhawk"))


class TestWhatARunWouldFind:
    """Each in the words that the guard would use."""

    def test_a_vehicle_that_the_profile_is_not_for(self, rover, mission):
        found = findings_of(rover, mission, vehicle_type=2)
        assert verdicts(found)["vehicle"] is Verdict.FAIL
        assert "a quadrotor under ArduPilot is not what --mavlink-autopilot px4" in details(found)["vehicle"]

    def test_a_copter_on_the_ground(self, peer, mission):
        found = findings_of(peer, mission, vehicle_type=2, armed=False)
        assert verdicts(found)["vehicle"] is Verdict.WARN
        assert "a pilot takes it off" in details(found)["vehicle"]

    def test_two_vehicles_with_one_number(self, peer, mission):
        frame = vehicle_frame(common.MAVLink_heartbeat_message(10, 12, 0x81, 4, 4, 3))
        found = findings_of(peer, mission, others=[(HOME, frame), (("10.0.0.3", 14550), frame)])
        assert verdicts(found)["autopilot"] is Verdict.FAIL
        assert "two vehicles have one system id" in details(found)["autopilot"]

    def test_a_station_under_the_autopilots_number(self, peer, mission):
        frame = vehicle_frame(common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        found = findings_of(peer, mission, others=[(HOME, frame)])
        assert verdicts(found)["autopilot"] is Verdict.WARN
        assert "1 heartbeats under its number" in details(found)["autopilot"]

    def test_a_vehicle_that_answers_nothing_even_under_the_flag(self, peer, mission, monkeypatch):
        """It wants signed frames: its timeout stays unknown, which the flag would let pass."""
        monkeypatch.setattr(type(peer), "send", lambda *_: None)
        flags = MavlinkFlags(FLAGS.address, "px4", GuardFlags(allow_unsafe_firmware_timeout=True))
        found = verdicts(findings_of(peer, mission, flags))
        assert (found["answers"], found["pose"]) == (Verdict.FAIL, Verdict.FAIL)
        assert found["firmware timeout"] is Verdict.WARN

    def test_a_vehicle_without_a_position(self, peer, mission):
        assert verdicts(findings_of(peer, mission, located=False))["pose"] is Verdict.FAIL

    def test_a_rovers_own_timeout_and_what_shortens_it(self, rover, mission):
        found = findings_of(rover, mission, ROVER_FLAGS, parameters={})
        assert verdicts(found)["firmware timeout"] is Verdict.FAIL
        assert "3 s" in details(found)["firmware timeout"]
        assert "guided_timeout.lua" in details(found)["firmware timeout"]

    @pytest.mark.parametrize(("loop_hz", "verdict"), [(50.0, Verdict.OK), (10.0, Verdict.FAIL)])
    def test_how_often_a_pose_can_come(self, rover, mission, loop_hz, verdict):
        found = findings_of(rover, mission, ROVER_FLAGS, loop_rate_hz=loop_hz)
        assert verdicts(found)["pose"] is verdict
        said = details(found)["pose"]
        assert f"at SCHED_LOOP_RATE {loop_hz:g} a position comes every {1250 / loop_hz:g} ms" in said
        assert "--rate 20 needs one every 100 ms" in said

    def test_an_estimator_that_does_not_vouch_for_its_position(self, peer, mission):
        found = findings_of(peer, mission, estimator_flags=0xA7)
        assert verdicts(found)["estimator"] is Verdict.FAIL

    def test_an_estimator_that_tells_nothing(self, peer, mission):
        peer.intervals = Intervals((HEARTBEAT, ATTITUDE, POSITION))
        assert verdicts(findings_of(peer, mission))["estimator"] is Verdict.WARN
