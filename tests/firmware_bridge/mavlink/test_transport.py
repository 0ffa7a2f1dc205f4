import contextlib
import errno
import os
import pty
import socket

import pytest
from ports import free_port
from waiting import HANG_S, until

from edge_runtime.errors import BridgeError, ConfigError
from edge_runtime.network.datagrams import DRAIN
from firmware_bridge.mavlink.serial_port import LONGEST_QUEUE
from firmware_bridge.mavlink.transport import open_transport, parse_address


class TellingSocket:
    """Says once, on receiving and on sending, what an ICMP message makes a kernel say."""

    def __init__(self, wrapped, word):
        self._wrapped, self._words = wrapped, {"recvmsg_into": word, "sendto": word}

    def __getattr__(self, name):
        if name not in self._words:
            return getattr(self._wrapped, name)
        word = self._words.pop(name)

        def say(*_):
            raise OSError(word, os.strerror(word))

        return say


@pytest.fixture
def robot():
    """The autopilot's end of a UDP link."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.settimeout(HANG_S)
        yield end


@pytest.fixture
def listening(robot):
    _, port = free_port()
    transport = open_transport(f"udpin:127.0.0.1:{port}")
    robot.connect(("127.0.0.1", port))
    yield transport
    transport.close()


@pytest.fixture
def cable():
    controller, device = pty.openpty()
    transport = open_transport(f"serial:{os.ttyname(device)}:57600")
    yield transport, controller
    transport.close()
    for descriptor in (controller, device):
        with contextlib.suppress(OSError):
            os.close(descriptor)


def received(transport):
    return until(lambda: list(transport.receive()))


@pytest.mark.parametrize(
    ("address", "parts"),
    [
        ("udpin:0.0.0.0:14550", ("udpin", "0.0.0.0", 14550)),  # noqa: S104 - only parsed
        ("udpout:fc.local:14540", ("udpout", "fc.local", 14540)),
        ("serial:/dev/ttyACM0:921600", ("serial", "/dev/ttyACM0", 921600)),
    ],
)
def test_addresses(address, parts):
    assert parse_address(address) == parts


@pytest.mark.parametrize(
    "address",
    [
        "",
        "udpin",
        "udpin:14550",
        "udpin::14550",
        "tcp:h:1",
        "udpin:h:0",
        "udpin:h:65536",
        "serial:/dev/x:fast",
    ],
)
def test_what_is_no_address_is_refused_with_the_forms(address):
    with pytest.raises(ConfigError, match="udpin:HOST:PORT, udpout:HOST:PORT or serial:DEVICE:BAUD"):
        parse_address(address)


class TestUdp:
    def test_a_listener_answers_once_it_is_told_whom(self, listening, robot):
        listening.send(b"nobody is known yet")
        robot.send(b"first")
        assert received(listening) == [b"first"]
        listening.send(b"not yet told")
        assert listening.dropped == 2
        listening.answer(listening.sender)
        listening.send(b"hello")
        assert robot.recv(100) == b"hello"
        assert listening.dropped == 2

    def test_every_portion_names_its_sender_and_diverts_no_answers(self, listening, robot):
        robot.send(b"first")
        received(listening)
        assert listening.sender == robot.getsockname()
        listening.answer(listening.sender)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(b"noise", robot.getpeername())
            assert received(listening) == [b"noise"]
            assert listening.sender[1] == stranger.getsockname()[1]
        listening.send(b"hello")
        assert robot.recv(100) == b"hello"

    def test_a_caller_sends_first_and_keeps_its_peer(self, robot):
        transport = open_transport(f"udpout:127.0.0.1:{robot.getsockname()[1]}")
        transport.answer(("192.0.2.1", 1))
        transport.send(b"hello")
        data, address = robot.recvfrom(100)
        robot.sendto(b"answer", address)
        assert (data, received(transport)) == (b"hello", [b"answer"])
        transport.close()

    def test_a_peer_that_is_not_up_yet_is_no_error(self, robot):
        port = robot.getsockname()[1]
        robot.close()
        transport = open_transport(f"udpout:127.0.0.1:{port}")
        until(lambda: transport.send(b"hello") or list(transport.receive()) or transport.dropped)
        assert list(transport.receive()) == []
        transport.close()

    @pytest.mark.parametrize(
        "word",
        [
            errno.ECONNREFUSED,
            errno.EHOSTUNREACH,
            errno.ENETUNREACH,
            errno.EHOSTDOWN,
            errno.ENETDOWN,
            errno.ENOPROTOOPT,
            errno.EPROTO,
            errno.EPERM,
            errno.EMSGSIZE,
        ],
    )
    def test_what_the_network_says_of_earlier_frames_ends_nothing(self, listening, robot, word):
        """ICMP: prohibited, no route, too big (the kernel's icmp_err_convert): passed over and counted."""
        robot.send(b"first")
        received(listening)
        listening.answer(listening.sender)
        port = listening._socket
        port._socket = TellingSocket(port._socket, word)
        robot.send(b"second")
        assert received(listening) == [b"second"]
        listening.send(b"hello")
        assert listening.dropped == 2

    def test_a_flood_is_taken_in_portions(self, listening, robot):
        for _ in range(DRAIN + 5):
            robot.send(b"x")
        assert 0 < len(received(listening)) <= DRAIN

    def test_a_port_in_use_is_refused(self, robot):
        with pytest.raises(BridgeError, match="in use"):
            open_transport(f"udpin:127.0.0.1:{robot.getsockname()[1]}")

    def test_an_address_of_another_machine_is_refused(self):
        with pytest.raises(BridgeError, match="is the address this machine's"):
            open_transport("udpin:192.0.2.1:14550")


class TestSerial:
    def test_bytes_both_ways(self, cable):
        transport, controller = cable
        assert list(transport.receive()) == []
        os.write(controller, b"from the autopilot")
        assert received(transport) == [b"from the autopilot"]
        transport.answer(transport.sender)
        transport.send(b"to it")
        assert os.read(controller, 100) == b"to it"
        assert not transport.datagrams

    def test_a_full_port_drops(self, cable, monkeypatch):
        transport, _ = cable
        monkeypatch.setattr(type(transport._port), "out_waiting", LONGEST_QUEUE + 1)
        transport.send(b"a setpoint of the past")
        assert transport.dropped == 1

    def test_an_unplugged_cable_is_an_error(self, cable):
        transport, controller = cable
        os.close(controller)
        with pytest.raises(BridgeError, match="serial port"):
            list(transport.receive())
        with pytest.raises(BridgeError, match="serial port"):
            for _ in range(3):
                transport.send(b"x")

    def test_a_port_that_does_not_exist_is_refused(self):
        with pytest.raises(BridgeError, match="--mavlink serial:/dev/nowhere:57600"):
            open_transport("serial:/dev/nowhere:57600")

    def test_a_baud_rate_that_does_not_exist_is_refused(self, cable):
        with pytest.raises(BridgeError, match="--mavlink serial"):
            open_transport(f"serial:{cable[0]._port.name}:0")


def test_a_name_that_leads_nowhere_is_refused():
    with pytest.raises(BridgeError, match=r"cannot reach autopilot\.invalid port 14550"):
        open_transport("udpout:autopilot.invalid:14550")
