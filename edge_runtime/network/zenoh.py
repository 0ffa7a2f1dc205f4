"""Frames over Zenoh, for many robots and several networks; orders and streams stay on UDP.

Each pair of robots has a topic for either direction, so that access control can tell who publishes as whom.
Zenoh's threads stamp and queue what arrives; the control loop takes it, and never waits for them.
"""

import importlib
import itertools
import json
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any, Final

from edge_runtime.config.fleet import Fleet
from edge_runtime.config.network import CarrierSettings
from edge_runtime.errors import ConfigError
from edge_runtime.network.datagrams import DRAIN, Datagram
from edge_runtime.network.seal import Magic
from edge_runtime.network.team_wire import FRAME_BYTES
from edge_runtime.network.tls import tls_files
from edge_runtime.network.udp import UdpCarrier
from edge_runtime.network.zenoh_session import Json, session_config, topic

CLOSE_S: Final = 1.0
"""How long closing may take: after malformed input Zenoh's own may hang."""
NOBODY: Final = -1
"""The sender of what came over UDP: no frame is anybody's there."""


def open_zenoh(fleet: Fleet, settings: CarrierSettings, robot_id: int, udp: UdpCarrier) -> "ZenohCarrier":
    """Open a robot's end of its team on Zenoh.

    Args:
        fleet: the team.
        settings: its carrier's.
        robot_id: of this robot.
        udp: carries orders and streams.

    Raises:
        ConfigError: if the extra is not installed, a certificate does not fit, or no session can be opened.
    """
    try:
        zenoh = importlib.import_module("zenoh")
    except ImportError as error:
        raise ConfigError(
            f"carrier.type: \"zenoh\" needs an extra ({error}); run: pip install 'cfpg-edge[zenoh]'"
        ) from error
    tls = tls_files(settings.tls, fleet.path.parent, robot_id) if settings.tls else None
    others = [robot for robot in fleet.robots if robot.id != robot_id]
    config = session_config(settings, fleet.robot(robot_id), others, tls)
    try:
        return ZenohCarrier(zenoh, robot_id, [robot.id for robot in others], config, udp)
    except zenoh.ZError as error:
        raise ConfigError(_unusable(fleet, settings, robot_id, error)) from error


class ZenohCarrier:
    """Carries frames over a Zenoh session, and everything else over UDP.

    Args:
        zenoh: the library.
        own: this robot's id.
        others: the other robots' ids.
        config: of the session; see `edge_runtime.network.zenoh_session`.
        udp: carries orders and streams; closed with this one.

    Raises:
        zenoh.ZError: if the session cannot be opened.
    """

    def __init__(
        self, zenoh: ModuleType, own: int, others: Sequence[int], config: Json, udp: UdpCarrier
    ) -> None:
        self.failures: Counter[str] = udp.failures
        self._udp, self._error = udp, zenoh.ZError
        self._arrived: deque[Datagram] = deque(maxlen=DRAIN)
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self._publishers = {other: self._publisher(zenoh, topic(own, other)) for other in others}
        for other in others:
            # "indirect" would put an unbounded queue and one more thread between.
            handler = zenoh.handlers.Callback(self._listener(other), indirect=False)
            self._session.declare_subscriber(topic(other, own), handler)

    def send(self, robot_id: int, packet: bytes) -> None:
        """Send a frame to a robot, or a request to a stream's source, once."""
        publisher = self._publishers.get(robot_id)
        if publisher is None:
            self._udp.send(robot_id, packet)
            return
        try:
            publisher.put(packet)
        except self._error as error:
            self.failures[_first_line(error)] += 1

    def reply(self, datagram: Datagram, packet: bytes) -> None:
        """Answer an operator over UDP, once."""
        self._udp.reply(datagram, packet)

    def receive(self) -> Iterator[Datagram]:
        """Take up to ``DRAIN`` frames and as many other packets, in turn: neither can crowd out the other."""
        for pair in itertools.zip_longest(self._frames(), self._udp.receive()):
            for datagram, sender in zip(pair, (None, NOBODY), strict=True):
                if datagram is not None:
                    yield datagram if sender is None else datagram._replace(sender=sender)

    def fileno(self) -> int:
        """Return the descriptor on which streams arrive, which is UDP's."""
        return self._udp.fileno()

    def close(self) -> None:
        """Leave the network, or give up on it after ``CLOSE_S``: the process ends all the same."""
        self._udp.close()
        closing = threading.Thread(target=self._close, daemon=True)
        closing.start()
        closing.join(CLOSE_S)

    def _close(self) -> None:
        try:
            self._session.close()
        except self._error as error:
            self.failures[_first_line(error)] += 1

    def _frames(self) -> Iterator[Datagram]:
        for _ in range(len(self._arrived)):
            yield self._arrived.popleft()

    def _publisher(self, zenoh: ModuleType, name: str) -> Any:  # noqa: ANN401  # an optional library's
        return self._session.declare_publisher(
            name,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            reliability=zenoh.Reliability.BEST_EFFORT,
        )

    def _listener(self, sender: int) -> Callable[[Any], None]:
        def listen(sample: Any) -> None:  # noqa: ANN401  # an optional library's
            arrival_s = time.monotonic()
            content = bytes(sample.payload)[: FRAME_BYTES + 1]  # one more: longer ones must not look whole
            if not content.startswith(Magic.TEAM):
                content = b""  # orders and streams come over UDP: this counts as malformed
            self._arrived.append(Datagram(content, None, arrival_s, sender))

        return listen


def _first_line(error: Exception) -> str:
    """Return what Zenoh says, without the place in its source."""
    return str(error).partition(" at /")[0].partition("\n")[0].strip()


def _unusable(fleet: Fleet, settings: CarrierSettings, robot_id: int, error: Exception) -> str:
    if settings.router:
        cause = f"Zenoh cannot reach {settings.router} ({_first_line(error)})"
        return f"carrier.router: {cause}; does the router run, and take this robot in?"
    index = [robot.id for robot in fleet.robots].index(robot_id)
    cause = f"Zenoh cannot use {fleet.robots[index].zenoh} ({_first_line(error)})"
    return f"robots[{index}].zenoh: {cause}; is it this machine's, and free?"
