"""What the doctor says of a CAN robot: interfaces as ``ip`` prints them, a chassis on a multicast bus."""

import time
from functools import partial

import can
import pytest
from can_peers import Chassis, guard_spec, multicast_address, patient_spec
from ip_fakes import CAN, SERIAL, VIRTUAL, install_ip
from waiting import HANG_S, until

from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Verdict, examine
from edge_runtime.policy.bundle import packaged_bundle
from firmware_bridge.can.bridge import CanFlags
from firmware_bridge.can.diagnostics import (
    bit_rate,
    examine_interface,
    examine_link,
    feedback,
    is_up,
    queue,
    restart,
    serial_port,
    setting,
)
from firmware_bridge.can.interface import parse_interface
from firmware_bridge.can.link import make_link
from firmware_bridge.guard.diagnostics import firmware_timeout
from firmware_bridge.guard.spec import GuardFlags

PERIOD_S = 0.02


def changed(old, new):
    assert old in CAN
    return parse_interface(CAN.replace(old, new).encode())


@pytest.fixture
def ip(tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_bridge.can.interface.ASKING_S", HANG_S)
    return partial(install_ip, tmp_path, monkeypatch)


HEALTHY = parse_interface(CAN.encode())


def test_a_healthy_interface():
    found = is_up(HEALTHY)
    assert (found.verdict, found.detail) == (Verdict.OK, "can0 is up, ERROR-ACTIVE")
    assert bit_rate(HEALTHY).detail == "500000 bit/s"
    assert queue(HEALTHY, PERIOD_S).verdict is Verdict.OK


def test_a_virtual_bus_is_up():
    assert is_up(parse_interface(VIRTUAL.encode())).detail == "vcan0 is up, virtual"


@pytest.mark.parametrize(
    ("old", "new", "verdict", "remedy"),
    [
        ('"NOARP","UP"', '"NOARP"', Verdict.FAIL, "run: ip link set can0 up"),
        ("ERROR-ACTIVE", "BUS-OFF", Verdict.FAIL, "type can restart"),
        ("ERROR-ACTIVE", "ERROR-PASSIVE", Verdict.WARN, "termination"),
        ('"info_kind":"can"', '"info_kind":"veth"', Verdict.FAIL, "link show type can"),
    ],
)
def test_an_interface_that_frames_do_not_pass(old, new, verdict, remedy):
    found = is_up(changed(old, new))
    assert found.verdict is verdict
    assert remedy in found.remedy


def test_a_bit_rate_that_was_never_set():
    """A controller cannot be up without one; a serial adapter may have its own."""
    unset = '"bitrate":0'
    assert bit_rate(changed('"bitrate":500000', unset)).verdict is Verdict.WARN
    down = CAN.replace('"bitrate":500000', unset).replace('"NOARP","UP"', '"NOARP"')
    assert bit_rate(parse_interface(down.encode())).verdict is Verdict.FAIL


def test_an_automatic_restart_sends_what_waited():
    assert restart(HEALTHY).verdict is Verdict.WARN
    assert restart(changed('"restart_ms":100', '"restart_ms":0')).verdict is Verdict.OK


def test_a_queue_that_holds_up_a_stop():
    found = queue(changed('"txqlen":10', '"txqlen":1000'), PERIOD_S)
    assert (found.verdict, found.detail) == (Verdict.WARN, "1000 frames, 320.0 ms until the last has left")


def test_a_queue_at_an_unknown_rate_is_taken_for_a_fast_one():
    found = queue(parse_interface(SERIAL.replace('"txqlen":10', '"txqlen":1000').encode()), PERIOD_S)
    assert (found.verdict, found.detail) == (
        Verdict.WARN,
        "1000 frames, 160.0 ms or more until the last has left",
    )


def test_each_property_has_a_line(ip):
    ip(CAN)
    names = [found.name for found in examine_interface("can0", PERIOD_S)]
    assert names == ["CAN interface", "bit rate", "restart-ms", "transmit queue"]


def test_a_virtual_bus_has_one_line(ip):
    ip(VIRTUAL)
    assert [found.name for found in examine_interface("vcan0", PERIOD_S)] == ["CAN interface"]


def test_a_missing_interface_has_one_line(ip):
    ip(code=1, error="none")
    (found,) = examine_interface("can0", PERIOD_S)
    assert (found.name, found.verdict) == ("CAN interface", Verdict.FAIL)


def test_a_port_that_is_none(tmp_path):
    assert serial_port(str(tmp_path / "ttyTHS1")).verdict is Verdict.FAIL
    assert serial_port("/dev/null").verdict is Verdict.OK


@pytest.mark.parametrize(
    ("timeout_s", "allow", "verdict"),
    [
        (0.5, False, Verdict.OK),
        (1.0, False, Verdict.OK),
        (1.1, False, Verdict.FAIL),
        (0.0, False, Verdict.FAIL),
        (None, False, Verdict.FAIL),
        (None, True, Verdict.WARN),
        (0.5, True, Verdict.OK),
    ],
)
def test_the_firmware_must_stop_by_itself(timeout_s, allow, verdict):
    found = firmware_timeout(timeout_s, "says the profile", allow_unsafe=allow)
    assert found.verdict is verdict
    assert "says the profile" in found.detail


@pytest.fixture
def address():
    return multicast_address()


@pytest.fixture
def listen(address):
    def listen(arm, seconds=20.0):
        link = make_link(patient_spec(address))
        return examine("feedback", lambda: feedback(link, arm, seconds))

    return listen


@pytest.fixture
def listen_for(listen):
    """Listen for a second, again and again, until something of the chassis was heard."""

    def listen_for(words):
        return until(lambda: found if words in (found := listen(arm=True, seconds=1.0)).detail else None)

    return listen_for


def test_a_chassis_in_standby_is_heard_and_left_alone(address, listen):
    channel, _, port = address.removeprefix("udp_multicast:").partition("?port=")
    with can.Bus(interface="udp_multicast", channel=channel, port=int(port)) as ear, Chassis(address):
        armed, unarmed = listen(arm=True), listen(arm=False)
        ids = {message.arbitration_id for message in iter(lambda: ear.recv(0.0), None)}
    assert armed.verdict is Verdict.OK
    assert "SystemState.ControlMode = 0" in armed.detail
    assert unarmed.verdict is Verdict.WARN
    assert "pass --arm" in unarmed.remedy
    assert ids == {0x211, 0x221}


def test_a_chassis_that_is_enabled_already(address, listen):
    with Chassis(address, control_mode=1):
        assert "takes commands already" in listen(arm=False).detail


def test_a_chassis_in_its_operators_hand(address, listen):
    with Chassis(address, control_mode=3):
        found = listen(arm=True)
    assert found.verdict is Verdict.FAIL
    assert "operator" in found.detail


def test_a_chassis_with_a_fault(address, listen_for):
    with Chassis(address) as chassis:
        chassis.vehicle_state = 2
        found = listen_for("VehicleState")
    assert (found.verdict, found.detail) == (
        Verdict.FAIL,
        "the firmware reports a fault (SystemState.VehicleState = 2)",
    )


def test_a_chassis_that_warns(address, listen):
    with Chassis(address) as chassis:
        chassis.errors = {"BatteryLow": 1}
        found = listen(arm=True)
    assert found.verdict is Verdict.WARN
    assert "the firmware warns (SystemState.BatteryLow = 1)" in found.detail


def test_what_nobody_has_confirmed_is_named():
    assert setting("the wheels' radius", confirmed=True).verdict is Verdict.OK
    found = setting("the wheels' radius", confirmed=False)
    assert (found.verdict, found.detail) == (Verdict.FAIL, "not confirmed: the wheels' radius")
    assert "set it to true" in found.remedy


def test_a_vescs_settings_are_findings_each(tmp_path):
    flags = CanFlags("udp_multicast:239.75.1.1?port=43200", "vesc", GuardFlags())
    found = [f for f in examine_link(mission(tmp_path), flags) if f.name == "setting"]
    assert [f.verdict for f in found] == [Verdict.FAIL] * 3
    assert "Minimum ERPM is 0" in found[1].detail


def test_frames_that_cannot_be_read_are_told(address, listen_for):
    with Chassis(address) as chassis:
        chassis.corrupt = True
        assert listen_for("frames could not be read").verdict is Verdict.FAIL


def test_silence_is_bounded(listen):
    began = time.monotonic()
    found = listen(arm=True, seconds=0.1)
    assert time.monotonic() - began >= 0.1
    assert (found.verdict, found.detail) == (Verdict.FAIL, "no SystemState received yet")


def test_a_bus_that_cannot_be_opened():
    link = make_link(guard_spec("no-such-interface:0"))
    assert examine("feedback", lambda: feedback(link, arm=True)).verdict is Verdict.FAIL


def mission(folder):
    (folder / "alone.toml").write_text("[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n")
    fleet = load_fleet(folder / "alone.toml")
    return Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, 50.0)


def test_a_limo_is_looked_for_at_its_port(tmp_path):
    found = next(
        examine_link(mission(tmp_path), CanFlags(str(tmp_path / "ttyTHS1"), "agilex_limo", GuardFlags()))
    )
    assert (found.name, found.verdict) == ("serial port", Verdict.FAIL)
