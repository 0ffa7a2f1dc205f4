"""python-can as a transport: a real multicast bus, and a bus whose driver misbehaves as SocketCAN's does."""

import errno
import random
import time

import can
import pytest

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
    ],
)
def test_addresses(address, arguments):
    assert bus_arguments(address) == arguments


@pytest.mark.parametrize("address", ["", "socketcan:", ":can0", "can0?x", "can0?a=1&b"])
def test_wrong_addresses(address):
    with pytest.raises(ConfigError, match="--bus"):
        bus_arguments(address)


@pytest.mark.parametrize("address", ["can77", "nosuch:x", "udp_multicast:not-an-address"])
def test_a_bus_that_does_not_open_is_named(address):
    with pytest.raises(BridgeError, match=f"--bus {address}: cannot be opened"):
        CanBus(address).open()


def test_frames_go_both_ways():
    port = random.randrange(43200, 60000)
    address = f"udp_multicast:239.75.{random.randrange(256)}.7?port={port}"
    bus, peer = CanBus(address), CanBus(address)
    bus.open()
    peer.open()
    sent = [Frame(0x111, b"\1\2"), Frame(0x301, b"\3", extended=True)]
    assert all(map(bus.send, sent))
    received, end = [], time.monotonic() + 10
    while len(received) < 2 and time.monotonic() < end:
        received += peer.receive()
    assert received == sent
    assert peer.fileno() > 0
    bus.close()
    peer.close()
    peer.close()
    with pytest.raises(BridgeError, match="not open"):
        peer.fileno()


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
