"""Between two robots on Zenoh: what one end's links, a TCP stream and datagrams, bring to the other's.

Each pair has a port of its own, on which the relay takes the connecting robot's links for the listening one.
"""

import selectors
import socket
from functools import partial
from typing import Final

from edge_runtime.config.network import Endpoint
from edge_runtime.network.datagrams import Datagrams, listen, speak
from firmware_bridge.sil.network.packet_queue import PacketQueue
from firmware_bridge.sil.scenario.ports import HOST, TAKEN, Tunnel

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
        self._upstream: dict[Endpoint, Datagrams] = {}
        self._datagrams = listen((HOST, tunnel.relay_port), _PACKET_BYTES, TAKEN)
        self._listener = socket.create_server((HOST, tunnel.relay_port))
        self._listener.setblocking(False)
        selector.register(self._datagrams, selectors.EVENT_READ, self._take_up)
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def _take_up(self) -> None:
        """Pass on what the connecting robot sent."""
        tunnel = self._tunnel
        for datagram in self._datagrams.receive():
            upstream = self._upstream.get(datagram.source) or self._open_upstream(datagram.source)
            send = partial(upstream.send, target=(HOST, tunnel.robot_port))
            self._queue.deliver(datagram.content, tunnel.connecting, tunnel.listening, send)

    def _open_upstream(self, place: Endpoint) -> Datagrams:
        """Speak to the listening robot from a port of its own, by which it tells its links apart."""
        upstream = self._upstream[place] = speak(HOST, _PACKET_BYTES)
        self._selector.register(upstream, selectors.EVENT_READ, partial(self._take_down, upstream, place))
        return upstream

    def _take_down(self, upstream: Datagrams, place: Endpoint) -> None:
        """Pass on what the listening robot sent."""
        tunnel, send = self._tunnel, partial(self._datagrams.send, target=place)
        for datagram in upstream.receive():
            self._queue.deliver(datagram.content, tunnel.listening, tunnel.connecting, send)

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
