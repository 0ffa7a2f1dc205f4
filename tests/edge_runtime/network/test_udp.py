"""Real sockets on the loopback: nothing blocks, nothing raises, everything is counted."""

import errno

import pytest
from ports import free_port
from waiting import until

from edge_runtime.errors import ConfigError
from edge_runtime.network.datagrams import DRAIN
from edge_runtime.network.order_wire import PACKET_BYTES
from edge_runtime.network.team_wire import FRAME_BYTES
from edge_runtime.network.udp import UdpCarrier


@pytest.fixture(params=["127.0.0.1", "::1"])
def pair(request):
    try:
        one, two = free_port(request.param), free_port(request.param)
    except OSError:
        pytest.skip(f"{request.param} is not available here")
    carriers = UdpCarrier(one, {2: two}), UdpCarrier(two, {1: one})
    yield carriers
    for carrier in carriers:
        carrier.close()


def received(carrier, count):
    """Read until so much has come: a busy kernel delivers later."""
    found = []
    until(lambda: found.extend(carrier.receive()) or len(found) >= count)
    return [datagram.content for datagram in found]


def test_packets_arrive_in_order_and_once(pair):
    one, two = pair
    sent = [bytes([index]) * FRAME_BYTES for index in range(20)]
    for packet in sent:
        one.send(2, packet)
    assert received(two, 20) == sent
    assert list(two.receive()) == []
    assert not one.failures and not two.failures


def test_a_longer_packet_does_not_look_whole(pair):
    one, two = pair
    one.send(2, bytes(2 * PACKET_BYTES))
    one.send(2, b"")
    assert [len(content) for content in received(two, 2)] == [PACKET_BYTES + 1, 0]


def test_a_flood_costs_a_bounded_time(pair):
    one, two = pair
    for _ in range(4 * DRAIN):
        one.send(2, b"x")
    assert len(list(two.receive())) <= DRAIN


def test_what_the_system_refuses_is_counted(pair):
    one, _ = pair
    one.send(2, bytes(100_000))
    one.send(2, bytes(100_000))
    assert one.failures == {"EMSGSIZE": 2}


def test_failing_sockets_are_counted(pair):
    one, _ = pair

    class Failing:
        causes = iter([BlockingIOError(errno.EAGAIN, "full"), OSError(errno.ENETUNREACH, "away")])

        def sendto(self, *_):
            raise next(self.causes)

        def recvmsg_into(self, *_):
            raise OSError(errno.ENETDOWN, "down")

    kept, one._datagrams._socket = one._datagrams._socket, Failing()
    one.send(2, b"x")
    one.send(2, b"x")
    assert list(one.receive()) == []
    assert one.failures == {"EAGAIN": 1, "ENETUNREACH": 1, "ENETDOWN": DRAIN}
    one._datagrams._socket = kept


def test_a_taken_port_and_a_foreign_address_are_refused(pair):
    one, _ = pair
    host, port, *_ = one._datagrams._socket.getsockname()
    with pytest.raises(ConfigError, match=f"cannot listen on .* port {port} \\(Address already in use\\)"):
        UdpCarrier((host, port), {})
    with pytest.raises(ConfigError, match="Cannot assign requested address"):
        UdpCarrier(("203.0.113.1", port), {})
