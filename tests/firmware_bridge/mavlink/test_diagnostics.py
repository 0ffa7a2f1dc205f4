"""What the doctor says of an autopilot, and that it asks for nothing but the time and one parameter."""

import pytest
from mavlink_peers import ScriptedAutopilot, Ticks

import firmware_bridge.mavlink.channel as mavlink_channel
from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Verdict, examine
from edge_runtime.errors import ConfigError
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.guard.spec import GuardFlags
from firmware_bridge.mavlink.bridge import MavlinkFlags
from firmware_bridge.mavlink.diagnostics import autopilot, examine_link, listen, mode, signing
from firmware_bridge.mavlink.messages import Heartbeat
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import PROFILES
from firmware_bridge.mavlink.signing import clock_ticks

FLAGS = MavlinkFlags("udpin:127.0.0.1:14550", "px4")
PX4 = PROFILES["px4"]


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
def key(tmp_path):
    path = tmp_path / "link.key"
    path.write_bytes(bytes(range(32)))
    path.chmod(0o600)
    return path


def hear(longest_s=0.1, signing_key=""):
    dynamics = Dynamics(mass_kg=1.0, drag=0.25, dt_s=0.05)
    options = MavlinkOptions("px4", FLAGS.address, dynamics, signing_key=str(signing_key))
    heard = listen(options, PX4, longest_s)
    return heard, examine("autopilot", lambda: autopilot(heard, options))


def verdicts(findings):
    return {finding.name: finding.verdict for finding in findings}


@pytest.mark.usefixtures("peer")
def test_an_autopilot_that_is_ready_to_be_armed(mission):
    findings = list(examine_link(mission, FLAGS))
    assert verdicts(findings) == {
        "signing": Verdict.WARN,
        "autopilot": Verdict.OK,
        "mode": Verdict.OK,
        "firmware timeout": Verdict.OK,
    }
    assert findings[3].detail.startswith("0.5 s, as the autopilot answers for COM_OF_LOSS_T")


def test_nothing_is_commanded(peer, mission):
    list(examine_link(mission, FLAGS))
    assert {message.get_type() for message in peer.heard} == {"TIMESYNC", "PARAM_REQUEST_READ"}


@pytest.mark.parametrize(("allow", "verdict"), [(False, Verdict.FAIL), (True, Verdict.WARN)])
def test_a_timeout_over_a_second(peer, mission, allow, verdict):
    peer.parameters["COM_OF_LOSS_T"] = 3.0
    flags = MavlinkFlags(FLAGS.address, "px4", GuardFlags(allow_unsafe_firmware_timeout=allow))
    assert verdicts(examine_link(mission, flags))["firmware timeout"] is verdict


def test_an_autopilot_that_does_not_tell_its_timeout(peer):
    peer.parameters.clear()
    heard, found = hear()
    assert found.verdict is Verdict.OK
    assert heard.firmware_timeout_s is None


def test_silence_is_bounded_and_explained(peer):
    peer.silent = True
    heard, found = hear()
    assert heard.heartbeat is None
    assert found.verdict is Verdict.FAIL
    assert "(0 frames taken" in found.detail


def test_another_system_is_not_taken_for_the_autopilot(peer):
    peer.codec.srcSystem = 7
    _, found = hear()
    assert found.verdict is Verdict.FAIL
    assert "(0 frames taken" not in found.detail


def test_a_port_that_cannot_be_opened(mission):
    flags = MavlinkFlags("udpin:192.0.2.1:14550", "px4")
    findings = list(examine_link(mission, flags))
    assert verdicts(findings) == {"signing": Verdict.WARN, "autopilot": Verdict.FAIL}


def test_signed_frames_are_verified(peer, key):
    peer.sign(key.read_bytes(), clock_ticks() + 1_000_000)
    heard, found = hear(longest_s=5.0, signing_key=key)
    assert found.verdict is Verdict.OK
    assert heard.firmware_timeout_s == 0.5


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
        (Heartbeat(6 << 16, armed=False), Verdict.OK, "OFFBOARD, disarmed"),
        (Heartbeat(PX4.stop_mode.reported, armed=True), Verdict.WARN, "HOLD, armed"),
        (Heartbeat(1 << 16, armed=False), Verdict.OK, "0x10000, another than OFFBOARD or HOLD, disarmed"),
    ],
)
def test_modes_have_names(heartbeat, verdict, said):
    found = mode(heartbeat, PX4)
    assert (found.verdict, found.detail) == (verdict, said)


def test_a_wrong_flag_is_refused_at_once(mission):
    with pytest.raises(ConfigError, match="--mavlink-autopilot"):
        examine_link(mission, MavlinkFlags(FLAGS.address, "pixhawk"))
