"""One autopilot's messages over one port: transport, codec and signing together."""

from collections.abc import Iterator
from pathlib import Path

from edge_runtime.common.key_file import read_key
from edge_runtime.errors import BridgeError
from firmware_bridge.mavlink.decoder import Decoder, Tally
from firmware_bridge.mavlink.encoder import COMPANION, Encoder
from firmware_bridge.mavlink.messages import Content, Heartbeat, Outgoing
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.signing import Signing, Timestamps
from firmware_bridge.mavlink.transport import Address, Transport, open_transport

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
_NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: a station or a companion that took the autopilot's component number."""


class Channel:
    """Speaks to one autopilot and hears only that one: the first that sent a heartbeat that may be believed.

    Raises:
        ConfigError: if the signing key cannot be used.
    """

    def __init__(self, options: MavlinkOptions) -> None:
        self.home: Address | None = None
        """Where the autopilot's first heartbeat came from; nothing from elsewhere is heard."""
        self.rival: Address | None = None
        """Where else an autopilot with the same system id spoke from."""
        self.impostors = 0
        """Heartbeats under the autopilot's numbers by what says that it is none."""
        self._address = options.address
        self._autopilot = (options.system_id, AUTOPILOT)
        self._signing = _open_signing(options)
        self._decoder = Decoder(self._signing)
        self._encoder = Encoder(options.source_system, self._autopilot, self._signing)
        self._transport: Transport | None = None
        self._forgotten = 0

    @property
    def dropped(self) -> int:
        """Frames that the port did not take, or of which the network said that they did not arrive."""
        return 0 if self._transport is None else self._transport.dropped - self._forgotten

    @property
    def tally(self) -> Tally:
        """What came in, and why some of it was not taken."""
        return self._decoder.tally

    def open(self) -> None:
        """Open the port.

        Raises:
            BridgeError: if it cannot be opened.
        """
        self._transport = open_transport(self._address)

    def close(self) -> None:
        """Close the port, keep the signing timestamp."""
        if self._transport is not None:
            self._transport.close()
        if self._signing is not None:
            self._signing.timestamps.close()

    def filenos(self) -> tuple[int, ...]:
        """Return the port's descriptor."""
        return () if self._transport is None else (self._transport.fileno(),)

    def receive(self) -> Iterator[Content]:
        """Yield what the autopilot has sent.

        Raises:
            BridgeError: if the port is gone.
        """
        transport = self._opened()
        for portion in transport.receive():
            for received in self._decoder.feed(portion, whole=transport.datagrams):
                ours = (received.system_id, received.component_id) == self._autopilot
                if ours and self._is_home(received.content, transport.sender):
                    yield received.content
            if self.home is None:
                # It may speak MAVLink 1, or sign with a clock that lags, until it has heard from us.
                transport.answer(transport.sender)

    def _is_home(self, content: Content, sender: Address) -> bool:
        """Whether this comes from the one autopilot; its first heartbeat makes an address its home."""
        if isinstance(content, Heartbeat):
            if content.autopilot == _NO_AUTOPILOT:
                self.impostors += 1
                return False
            if self.home is None:
                self.home = sender
                self._opened().answer(sender)
            elif sender != self.home:
                self.rival = sender
        return sender == self.home

    def send(self, content: Outgoing, now_s: float) -> None:
        """Send one message now, or drop and count it.

        Raises:
            BridgeError: if the port is gone, or the signing timestamp cannot be kept.
        """
        self._opened().send(self._encoder.encode(content, now_s))

    def forget_dropped(self) -> None:
        """What was said before anybody was known to listen does not count."""
        self._forgotten = self._opened().dropped

    def renew_signing(self) -> None:
        """Keep signing timestamps in reserve; cheap enough for every second."""
        if self._signing is not None:
            self._signing.timestamps.renew()

    def _opened(self) -> Transport:
        if self._transport is None:
            raise BridgeError("the MAVLink link is not open")
        return self._transport


def _open_signing(options: MavlinkOptions) -> Signing | None:
    if not options.signing_key:
        return None
    path = Path(options.signing_key)
    key = read_key(path)
    sender = f"{options.source_system}-{COMPANION}"
    return Signing(key, Timestamps(path.with_name(f"{path.name}.{sender}.timestamp")))
