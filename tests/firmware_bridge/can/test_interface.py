"""The system's own words about a CAN interface, from a stand-in for ``ip``."""

from functools import partial

import pytest
from ip_fakes import CAN, SERIAL, VIRTUAL, install_ip
from waiting import HANG_S

from edge_runtime.errors import BridgeError
from firmware_bridge.can.interface import parse_interface, show_interface


@pytest.fixture
def ip(tmp_path, monkeypatch):
    monkeypatch.setattr("firmware_bridge.can.interface.ASKING_S", HANG_S)
    return partial(install_ip, tmp_path, monkeypatch)


def test_a_controller_is_read(ip):
    asked = ip(CAN)
    interface = show_interface("can0")
    assert asked.read_text() == "-details -json link show dev can0\n"
    controller = interface.linkinfo.info_data
    assert (interface.ifname, interface.txqlen, interface.bitrate) == ("can0", 10, 500_000)
    assert (controller.state, controller.restart_ms) == ("ERROR-ACTIVE", 100)
    assert "UP" in interface.flags


def test_a_full_queue_takes_its_frames_time(ip):
    ip(CAN)
    assert show_interface("can0").queue_s == pytest.approx(10 * 160 / 500_000)


@pytest.mark.parametrize("bitrate", [0, 250_000])
def test_an_adapter_of_fixed_rates_has_one_once_it_is_set(bitrate):
    set_up = SERIAL.replace('"bittiming_bitrate":0', f'"bittiming_bitrate":{bitrate}')
    assert parse_interface(set_up.encode()).bitrate == bitrate


def test_a_virtual_bus_has_no_controller(ip):
    ip(VIRTUAL)
    interface = show_interface("vcan0")
    assert (interface.linkinfo.info_kind, interface.bitrate) == ("vcan", 0)


def test_the_systems_own_words_explain_a_missing_interface(ip):
    ip(code=1, error='Device "can0" does not exist.')
    with pytest.raises(BridgeError, match=r'Device "can0" does not exist; is the adapter plugged in'):
        show_interface("can0")


def test_a_missing_tool_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BridgeError, match="apt install iproute2"):
        show_interface("can0")


def test_a_tool_that_hangs_is_given_up(ip, monkeypatch, tmp_path):
    ip(CAN)
    (tmp_path / "ip").write_text("#!/bin/sh\nexec /bin/sleep 30\n")
    monkeypatch.setattr("firmware_bridge.can.interface.ASKING_S", 0.1)
    with pytest.raises(BridgeError, match="did not answer within"):
        show_interface("can0")


@pytest.mark.parametrize("output", ["", "[]", "{}", "[{}]", '[{"ifname":"can0","txqlen":"many"}]', "\xff"])
def test_what_is_not_understood_is_said_so(output):
    with pytest.raises(BridgeError, match="not understood"):
        parse_interface(output.encode("latin-1"))
