"""Between two robots on Zenoh: what one end's links, a TCP stream and datagrams, bring to the other's.

Each pair has a port of its own, on which the relay takes the connecting robot's links for the listening one.
"""

import selectors
import socket
from functools import partial
from typing import Final

from firmware_bridge.sil.network.packet_queue import PacketQueue
from firmware_bridge.sil.scenario.ports import HOST, Tunnel

_PACKET_BYTES: Final = 65535


class TunnelEnds:
    """The sockets of one tunnel.

    Args:
        tunnel: which.
        queue: takes what passes.
        selector: calls what it was given with a socket that can be read, with nothing.
    """

    def __init__(self, tunnel: Tunnel, queue: PacketQueue, selector: selectors.BaseSelector) -> None:
        self._tunnel, self._queue, self._selector = tunnel, queue, selector
        self._upstream: dict[tuple[str, int], socket.socket] = {}
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        for one in (self._datagrams, self._listener):
            one.setblocking(False)
            one.bind((HOST, tunnel.relay_port))
        self._listener.listen()
        selector.register(self._datagrams, selectors.EVENT_READ, self._take_up)
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def _take_up(self) -> None:
        """Pass on what the connecting robot sent."""
        tunnel = self._tunnel
        while True:
            try:
                packet, place = self._datagrams.recvfrom(_PACKET_BYTES)
            except OSError:
                return
            upstream = self._upstream.get(place) or self._open_upstream(place)
            self._queue.deliver(packet, tunnel.connecting, tunnel.listening, upstream.send)

    def _open_upstream(self, place: tuple[str, int]) -> socket.socket:
        """Speak to the listening robot from a port of its own, by which it tells its links apart."""
        upstream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        upstream.setblocking(False)
        upstream.connect((HOST, self._tunnel.robot_port))
        self._upstream[place] = upstream
        self._selector.register(upstream, selectors.EVENT_READ, partial(self._take_down, upstream, place))
        return upstream

    def _take_down(self, upstream: socket.socket, place: tuple[str, int]) -> None:
        """Pass on what the listening robot sent."""
        tunnel, send = self._tunnel, partial(self._send_to, place)
        while True:
            try:
                packet = upstream.recv(_PACKET_BYTES)
            except OSError:
                return
            self._queue.deliver(packet, tunnel.listening, tunnel.connecting, send)

    def _send_to(self, place: tuple[str, int], packet: bytes) -> None:
        self._datagrams.sendto(packet, place)

    def _accept(self) -> None:
        tunnel = self._tunnel
        client, _ = self._listener.accept()
        try:
            robot = socket.create_connection((HOST, tunnel.robot_port))
        except OSError:
            client.close()  # it is not up yet, or no more; the other one tries again
            return
        for one in (client, robot):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            one.setblocking(False)
        up = _Stream(client, robot, tunnel.connecting, tunnel.listening)
        down = _Stream(robot, client, tunnel.listening, tunnel.connecting)
        for stream in (up, down):
            self._selector.register(stream.source, selectors.EVENT_READ, partial(self._take_piece, stream))

    def _take_piece(self, stream: "_Stream") -> None:
        try:
            piece = stream.source.recv(_PACKET_BYTES)
        except OSError:
            piece = b""
        if not piece:
            self._close(stream)
            return
        way = (stream.sender, stream.receiver, stream.target.sendall)
        stream.due_s = self._queue.stream(piece, *way, stream.due_s)

    def _close(self, stream: "_Stream") -> None:
        """Let both ends of a connection go."""
        for one in (stream.source, stream.target):
            if one.fileno() >= 0:
                self._selector.unregister(one)
                one.close()


class _Stream:
    """One direction of a TCP connection."""

    def __init__(self, source: socket.socket, target: socket.socket, sender: int, receiver: int) -> None:
        self.source, self.target, self.sender, self.receiver = source, target, sender, receiver
        self.due_s = 0.0
        """When its newest piece arrives."""
