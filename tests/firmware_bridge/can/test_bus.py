"""python-can as a transport: a real multicast bus, and a bus whose driver misbehaves as SocketCAN's does."""

import contextlib
import errno
import os
import pty
import random
import socket
import struct
import tty

import can
import pytest
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.utils import pack_filters
from can_peers import multicast_address
from waiting import until

from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.can.bus import CanBus, bus_arguments
from firmware_bridge.can.frame import Frame


@pytest.mark.parametrize(
    ("address", "arguments"),
    [
        ("can0", {"interface": "socketcan", "channel": "can0"}),
        ("slcan:/dev/ttyACM0", {"interface": "slcan", "channel": "/dev/ttyACM0"}),
        (
            "pcan:PCAN_USBBUS1?bitrate=500000&state=x",
            {"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrate": 500000, "state": "x"},
        ),
        (
            "slcan:/dev/ttyACM0?listen_only=false&sleep_after_open=0.5",
            {"interface": "slcan", "channel": "/dev/ttyACM0", "listen_only": False, "sleep_after_open": 0.5},
        ),
        ("gs_usb:0?index=1", {"interface": "gs_usb", "channel": "0", "index": 1}),
    ],
)
def test_addresses(address, arguments):
    assert bus_arguments(address) == arguments


@pytest.mark.parametrize("address", ["", "socketcan:", ":can0", "can0?x", "can0?a=1&b"])
def test_wrong_addresses(address):
    with pytest.raises(ConfigError, match="--bus"):
        bus_arguments(address)


@pytest.mark.parametrize("address", ["can0?nosuch=1", "slcan:/dev/ttyACM0?bitrate=500000&baud=9600"])
def test_what_an_interface_does_not_know_is_refused_with_what_it_does(address):
    interface = "slcan" if "slcan" in address else "socketcan"
    known = "bitrate" if "slcan" in address else "receive_own_messages"
    with pytest.raises(ConfigError, match=rf"--bus .*: {interface} knows no '(nosuch|baud)'; .*{known}"):
        bus_arguments(address)


@pytest.mark.parametrize("address", ["can77", "nosuch:x", "udp_multicast:not-an-address"])
def test_a_bus_that_does_not_open_is_named(address):
    with pytest.raises(BridgeError, match=f"--bus {address}: cannot be opened"):
        CanBus(address).open()


def test_frames_go_both_ways():
    address = multicast_address()
    bus, peer = CanBus(address), CanBus(address)
    bus.open()
    peer.open()
    sent = [Frame(0x111, b"\1\2"), Frame(0x301, b"\3", extended=True)]
    assert all(map(bus.send, sent))
    received = []
    until(lambda: received.extend(peer.receive()) or len(received) >= 2)
    assert received == sent
    assert peer.fileno() > 0
    bus.close()
    peer.close()
    peer.close()
    with pytest.raises(BridgeError, match="not open"):
        peer.fileno()


def test_python_cans_own_configuration_counts_for_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".canrc").write_text("[default]\nhop_limit = 7\n[default2]\n")
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    monkeypatch.setitem(can.rc, "fd", True)
    made = []
    monkeypatch.setattr(
        can.interfaces.udp_multicast.UdpMulticastBus, "__init__", lambda _, *a, **k: made.append((a, k))
    )
    with contextlib.suppress(BridgeError, AttributeError):
        CanBus("udp_multicast:239.75.1.7?port=43200").open()
    assert made == [(("239.75.1.7",), {"port": 43200})]


@pytest.fixture
def adapter():
    """A slcan adapter on a pseudo terminal: what it sends, and the bus that reads it."""
    end, computer = pty.openpty()
    tty.setraw(end)
    bus = CanBus(f"slcan:{os.ttyname(computer)}?sleep_after_open=0")
    bus.open()
    yield end, bus
    bus.close()
    for descriptor in (end, computer):
        os.close(descriptor)


def received(bus, frames):
    """Read until so many frames have come."""
    found = []
    until(lambda: found.extend(bus.receive()) or len(found) >= frames)
    return found


GOOD = b"t22181122334455667788\r"


@pytest.mark.parametrize(
    "junk",
    [
        b"t211\r",
        b"t2118112\r",
        b"t2118zz\r",
        b"t21181122\xff\r",
        b"\xfe\xff\r",
        b"T1\r",
        b"d221\r",
        b"txyz8\r",
    ],
)
def test_a_cut_line_or_noise_is_counted_and_changes_nothing(adapter, junk):
    end, bus = adapter
    os.write(end, GOOD)
    assert received(bus, 1) == [Frame(0x221, bytes.fromhex("1122334455667788"))]
    os.write(end, junk)
    heard = []
    until(lambda: heard.extend(bus.receive()) or bus.malformed)
    assert heard == []
    os.write(end, GOOD)
    assert received(bus, 1) == [Frame(0x221, bytes.fromhex("1122334455667788"))]
    assert bus.malformed == 1


def test_an_adapter_that_is_pulled_out_is_lost(adapter):
    end, bus = adapter
    os.close(end)
    try:
        with pytest.raises(BridgeError, match="is lost"):
            received(bus, 1)
    finally:
        os.dup2(os.open(os.devnull, os.O_RDWR), end)


def test_a_datagram_that_is_no_frame_is_counted():
    port = random.randrange(43200, 60000)
    group = f"239.75.{random.randrange(256)}.7"
    bus, peer = CanBus(f"udp_multicast:{group}?port={port}"), CanBus(f"udp_multicast:{group}?port={port}")
    bus.open()
    peer.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for junk in (b"\xc1", b"\x05", b"", b"\x93\1\2\3", struct.pack("<d", 1.0)):
            sender.sendto(junk, (group, port))
    peer.send(Frame(0x111, b"\1"))
    heard = []
    until(lambda: heard.extend(bus.receive()) or (heard and bus.malformed >= 5))
    assert (heard, bus.malformed) == ([Frame(0x111, b"\1")], 5)
    bus.close()
    peer.close()


class Driver:
    """A bus that answers what the test puts in."""

    def __init__(self) -> None:
        self.arriving: list[object] = []
        self.failure: Exception | None = None
        self.sent: list[can.Message] = []

    def fileno(self):
        return 3

    def shutdown(self):
        pass

    def recv(self, timeout):
        assert timeout == 0
        if not self.arriving:
            return None
        arrived = self.arriving.pop(0)
        if isinstance(arrived, Exception):
            raise arrived
        return arrived

    def send(self, message, timeout):
        assert timeout == 0
        if self.failure is not None:
            raise self.failure
        self.sent.append(message)


@pytest.fixture
def driver(monkeypatch):
    made = Driver()
    monkeypatch.setattr(can, "Bus", lambda **_: made)
    return made


@pytest.fixture
def bus(driver):  # noqa: ARG001  # what it opens
    opened = CanBus("can0")
    opened.open()
    return opened


def test_the_kernel_drops_frames_that_are_of_no_interest(monkeypatch):
    asked = []
    monkeypatch.setattr(can, "Bus", lambda **_: SocketcanBus.__new__(SocketcanBus))
    for name, does in (("fileno", lambda _: 3), ("__del__", lambda _: None)):
        monkeypatch.setattr(SocketcanBus, name, does)
    monkeypatch.setattr(
        SocketcanBus, "_apply_filters", lambda _, filters: asked.append(pack_filters(filters))
    )
    opened = CanBus("can0")
    opened.open()
    opened.hear_only([(0x211, False), (0x301, True)])
    extended = 1 << 31
    assert asked == [struct.pack("=4I", 0x211, 0x7FF | extended, 0x301 | extended, 0x1FFFFFFF | extended)]


def test_a_bus_that_knows_no_filters_brings_everything(driver, bus):
    bus.hear_only([(0x211, False)])
    driver.arriving = [can.Message(arbitration_id=0x301)]
    assert list(bus.receive()) == [Frame(0x301, b"", extended=True)]


@pytest.mark.parametrize(
    "failure",
    [
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Failed to transmit", errno.EAGAIN),
        can.CanOperationError("Transmit buffer full"),
    ],
)
def test_a_full_queue_drops_the_newest(driver, bus, failure):
    driver.failure = failure
    assert bus.send(Frame(0x111, b"")) is False


def test_an_interface_that_went_down_is_lost(driver, bus):
    driver.failure = can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
    with pytest.raises(BridgeError, match="lost"):
        bus.send(Frame(0x111, b""))
    driver.arriving = [can.CanOperationError("Network is down", errno.ENETDOWN)]
    with pytest.raises(BridgeError, match="lost"):
        list(bus.receive())


def test_bus_off_comes_as_an_error_frame(driver, bus):
    warning = can.Message(is_error_frame=True, arbitration_id=0x04, data=bytes(8))
    data = can.Message(arbitration_id=0x211, data=b"\1", is_extended_id=False)
    request = can.Message(arbitration_id=0x211, is_remote_frame=True, is_extended_id=False)
    driver.arriving = [warning, request, data]
    assert list(bus.receive()) == [Frame(0x211, b"\1")]
    driver.arriving = [data, can.Message(is_error_frame=True, arbitration_id=0x44, data=bytes(8))]
    received = bus.receive()
    assert next(received) == Frame(0x211, b"\1")
    with pytest.raises(BridgeError, match="bus-off"):
        next(received)


def test_a_flood_gives_way_to_commands(driver, bus):
    driver.arriving = [can.Message(arbitration_id=1, is_extended_id=False)] * 100
    assert len(list(bus.receive())) == 64
    assert len(list(bus.receive())) == 36
