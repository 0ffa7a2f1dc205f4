"""The network between the robots of a team in the loop: their ports, and what the relay passes on."""

import socket
import threading
import time
from contextlib import ExitStack

import pytest
from waiting import HANG_S

from firmware_bridge.sil.network.disturbance import RETRANSMISSION_S, Disturbance
from firmware_bridge.sil.network.relay import Line, Relay, RelaySpec
from firmware_bridge.sil.scenario.faults import Blackout, Delay, Loss
from firmware_bridge.sil.scenario.ports import Tunnel, free_network, free_ports
from firmware_bridge.sil.scenario.team_file import on_network, resolved, with_streams

ROBOTS = (2, 5, 7)
HOST = "127.0.0.1"


def table(**carrier):
    robots = [{"id": robot_id, "start_m": [0.0, 0.0], "goal_m": [1.0, 0.0]} for robot_id in ROBOTS]
    return {"carrier": {"key": "team.key", **carrier}, "robots": robots}


@pytest.mark.parametrize("relayed", [False, True])
def test_robots_on_udp_see_each_other_at_their_ports_or_relays(relayed):
    network = free_network(ROBOTS, zenoh=False, relayed=relayed)
    seen = {robot["id"]: robot for robot in on_network(table(), 5, network)["robots"]}
    assert seen[5]["address"] == f"{HOST}:{network.ports[5]}"
    assert seen[2]["address"] == f"{HOST}:{(network.relays if relayed else network.ports)[2]}"
    assert "zenoh" not in seen[2] and network.tunnels == {}


@pytest.mark.parametrize("wanted", [False, True])
def test_robots_of_a_plain_world_hear_their_poses_from_a_stream_where_that_is_wanted(wanted):
    robots = with_streams(table(), 4711, wanted=wanted)["robots"]
    assert {robot.get("pose", "") for robot in robots} == {f"{HOST}:4711" if wanted else ""}


@pytest.mark.parametrize("relayed", [False, True])
def test_robots_on_zenoh_connect_to_each_other_or_to_a_tunnel_of_each_pair(relayed):
    team = table(type="zenoh", router="tls/router.local:7447")
    network = free_network(ROBOTS, zenoh=True, relayed=relayed)
    moved = on_network(team, 5, network)
    seen = {robot["id"]: robot for robot in moved["robots"]}
    assert "router" not in moved["carrier"]
    assert seen[5]["zenoh"] == f"{HOST}:{network.zenoh[5]}"
    assert seen[2]["zenoh"] == f"{HOST}:{network.tunnels[5, 2] if relayed else network.zenoh[2]}"
    assert seen[7]["zenoh"] == f"{HOST}:{network.zenoh[7]}"  # which connects to 5
    assert set(network.tunnels) == ({(5, 2), (7, 2), (7, 5)} if relayed else set())


def test_no_port_is_given_twice():
    network = free_network(range(12), zenoh=True, relayed=True)
    every = [network.stream, *(port for ports in network[:-1] for port in ports.values())]
    assert len(set(every)) == len(every) == 1 + 12 * 3 + 66


def test_certificates_are_found_from_anywhere(tmp_path):
    tls = {"ca": "tls/ca.pem", "certificate": "robot-{id}.pem", "private_key": "/keys/robot-{id}.key"}
    assert resolved(table(type="zenoh", tls=tls), tmp_path)["carrier"]["tls"] == {
        "ca": f"{tmp_path}/tls/ca.pem",
        "certificate": f"{tmp_path}/robot-{{id}}.pem",
        "private_key": "/keys/robot-{id}.key",
    }


class Running:
    """A relay in a thread of this process."""

    def __init__(self, stack, faults=(), lines=(), tunnels=()):
        self.relay = Relay(RelaySpec(lines, tunnels, faults, 1, False))
        self.ended = False
        thread = threading.Thread(target=self.run)
        thread.start()
        stack.callback(thread.join)
        stack.callback(self.end)

    def run(self):
        while not self.ended:
            self.relay.pass_on()

    def end(self):
        self.ended = True


def udp(stack, port=0):
    one = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    one.bind((HOST, port))
    one.settimeout(HANG_S)
    return one


def test_a_tunnel_carries_datagrams_and_a_stream_both_ways():
    relay_port, robot_port = free_ports(2)
    with ExitStack() as stack:
        robot, links = udp(stack, robot_port), [udp(stack), udp(stack)]
        listener = stack.enter_context(socket.create_server((HOST, robot_port)))
        Running(stack, tunnels=(Tunnel(5, 2, relay_port, robot_port),))
        for number, link in enumerate(links):
            link.sendto(b"up%d" % number, (HOST, relay_port))
            packet, place = robot.recvfrom(99)
            assert packet == b"up%d" % number
            robot.sendto(b"down%d" % number, place)
            assert link.recv(99) == b"down%d" % number
        client = stack.enter_context(socket.create_connection((HOST, relay_port), HANG_S))
        server, _ = listener.accept()
        stack.enter_context(server)
        for one, other in ((client, server), (server, client)):
            one.sendall(b"some words")
            assert other.recv(99) == b"some words"
        server.close()
        assert client.recv(99) == b""  # what one end closes is closed at the other


def test_a_stream_whose_ends_close_at_once_takes_nothing_with_it():
    relay_port, robot_port = free_ports(2)
    with ExitStack() as stack:
        listener = stack.enter_context(socket.create_server((HOST, robot_port)))
        relay = Relay(RelaySpec((), (Tunnel(5, 2, relay_port, robot_port),), (), 1, False))
        client = stack.enter_context(socket.create_connection((HOST, relay_port), HANG_S))
        relay.pass_on()
        server, _ = listener.accept()
        server.close()
        client.close()
        relay.pass_on()  # hears of both ends together
        client = stack.enter_context(socket.create_connection((HOST, relay_port), HANG_S))
        relay.pass_on()
        server, _ = listener.accept()
        stack.enter_context(server)
        client.sendall(b"still here")
        relay.pass_on()
        relay.pass_on()  # delivers what the first one held
        server.settimeout(HANG_S)
        assert server.recv(99) == b"still here"


def test_a_blackout_stops_datagrams_and_holds_a_stream_until_it_is_over():
    relay_port, robot_port = free_ports(2)
    with ExitStack() as stack:
        robot, link = udp(stack, robot_port), udp(stack)
        listener = stack.enter_context(socket.create_server((HOST, robot_port)))
        dark = Blackout(at_s=0.0, for_s=2.0, robots=(5,))
        running = Running(stack, (dark,), tunnels=(Tunnel(5, 2, relay_port, robot_port),))
        client = stack.enter_context(socket.create_connection((HOST, relay_port), HANG_S))
        server, _ = listener.accept()
        stack.enter_context(server)
        running.relay.queue.t0_s = begin_s = time.monotonic()
        link.sendto(b"lost", (HOST, relay_port))
        client.sendall(b"first ")
        assert server.recv(99) == b"first "
        assert time.monotonic() >= begin_s + dark.for_s
        link.sendto(b"after", (HOST, relay_port))
        assert robot.recv(99) == b"after"


def test_a_stream_loses_nothing_but_time():
    faults = (Loss(at_s=0.0, for_s=9.0, share=1.0), Delay(at_s=9.0, for_s=1.0, delay_ms=30.0))
    disturbance = Disturbance(faults, seed=1)
    assert disturbance.stream_delay_s(2, 5, 1.0) == RETRANSMISSION_S
    assert disturbance.stream_delay_s(2, 5, 9.5) == pytest.approx(0.03)
    assert disturbance.stream_delay_s(2, 5, 10.5) == 0.0


def test_a_line_knows_its_senders():
    (own, other, relay_port) = free_ports(3)
    with ExitStack() as stack:
        receiver, sender, stranger = udp(stack, own), udp(stack, other), udp(stack)
        lines = (Line(2, relay_port, own), Line(5, free_ports(1)[0], other))
        running = Running(stack, (Blackout(at_s=0.0, for_s=1e6, robots=(5,)),), lines)
        running.relay.queue.t0_s = time.monotonic()
        sender.sendto(b"lost", (HOST, relay_port))
        stranger.sendto(b"heard", (HOST, relay_port))
        assert receiver.recv(99) == b"heard"
