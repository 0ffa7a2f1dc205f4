"""MAVLink 2 bytes to records: cut, checked and, with a key, authenticated before anything looks at content.

Every frame that is not taken is counted under the reason.
"""

from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as dialect  # type: ignore[import-untyped]

from edge_runtime.errors import ConfigError
from firmware_bridge.mavlink.messages import Received
from firmware_bridge.mavlink.reading import READERS, DialectMessage
from firmware_bridge.mavlink.signing import SIGNATURE_BYTES, SIGNED_FLAG, SignatureCheck, Signing

MAGIC = 0xFD
HEADER_BYTES = 10
CRC_BYTES = 2
STRETCHES_A_DATAGRAM = 32
"""False beginnings looked through in one datagram: noise must not hold up a stop."""


class Tally:
    """How many frames came, and why some were not taken."""

    def __init__(self) -> None:
        self.accepted = 0
        self.damaged = 0
        """Stretches of noise, of frames with a wrong checksum or an unknown flag, of truncated ones."""
        self.unknown = 0
        """Messages outside the dialect: their checksum cannot be computed."""
        self.unusable = 0
        """Authentic, but not finite, or in axes that say nothing about north."""
        self.refused = {SignatureCheck.UNSIGNED: 0, SignatureCheck.ALTERED: 0, SignatureCheck.REPLAYED: 0}


class Decoder:
    """Cuts a byte stream into frames and yields the content of those that may be believed."""

    def __init__(self, signing: Signing | None = None) -> None:
        if dialect.MAVLINK_IGNORE_CRC:
            raise ConfigError("MAV_IGNORE_CRC is set: pymavlink would take damaged frames; unset it")
        self.tally = Tally()
        self._signing = signing
        self._parser = dialect.MAVLink(None)
        self._buffer = bytearray()
        self._in_noise = False

    def feed(self, data: bytes, *, whole: bool = False) -> Iterator[Received]:
        """Yield the messages that this project knows; silent about the others.

        Args:
            data: bytes in any portions.
            whole: whether they are a datagram, whose end no frame spans.
        """
        self._buffer += data
        stretches = 0
        while (frame := self._cut(whole)) is not None and stretches < STRETCHES_A_DATAGRAM:
            message = self._parse(frame)
            if message is None or not self._ends(frame, message):
                # The length may have been noise too: the next frame can begin right behind this magic byte.
                self._pass_over(1)
                stretches += whole
                continue
            if isinstance(message, dialect.MAVLink_unknown) and self._waits(frame, whole):
                return
            self._in_noise = False
            del self._buffer[: len(frame)]
            yield from self._judge(message, frame)
        if whole:
            self._pass_over(len(self._buffer))
            self._in_noise = False

    def _cut(self, whole: bool) -> bytes | None:
        """Return the next stretch that begins like a frame, as long as its header claims.

        The last one of a datagram may be shorter: its checksum then does not fit.
        """
        start = self._buffer.find(MAGIC)
        self._pass_over(len(self._buffer) if start < 0 else start)
        if len(self._buffer) < HEADER_BYTES:
            return None
        length = HEADER_BYTES + self._buffer[1] + CRC_BYTES
        length += SIGNATURE_BYTES if self._buffer[2] & SIGNED_FLAG else 0
        return bytes(self._buffer[:length]) if whole or len(self._buffer) >= length else None

    def _ends(self, frame: bytes, message: DialectMessage) -> bool:
        """Whether a frame ends where the next begins, which no checksum tells of an unknown message."""
        behind = self._buffer[len(frame) : len(frame) + 1]
        return not isinstance(message, dialect.MAVLink_unknown) or not behind or behind[0] == MAGIC

    def _waits(self, frame: bytes, whole: bool) -> bool:
        """Whether only what comes next can tell."""
        return not whole and len(frame) == len(self._buffer)

    def _pass_over(self, noise: int) -> None:
        """Drop bytes that are no frame; one stretch of them is one damage."""
        if noise:
            self.tally.damaged += not self._in_noise
            self._in_noise = True
            del self._buffer[:noise]

    def _parse(self, frame: bytes) -> DialectMessage | None:
        """Return pymavlink's message, or None if flags, length or checksum are wrong."""
        if frame[2] & ~SIGNED_FLAG:
            return None
        try:
            return self._parser.decode(bytearray(frame))
        except dialect.MAVError:
            return None

    def _judge(self, message: DialectMessage, frame: bytes) -> Iterator[Received]:
        if isinstance(message, dialect.MAVLink_unknown):
            self.tally.unknown += 1
            return
        verdict = SignatureCheck.ACCEPTED if self._signing is None else self._signing.verify(frame)
        if verdict is not SignatureCheck.ACCEPTED:
            self.tally.refused[verdict] += 1
            return
        self.tally.accepted += 1
        reader = READERS.get(message.get_msgId())
        if reader is None:
            return
        content = reader(message)
        if content is None:
            self.tally.unusable += 1
        else:
            yield Received(message.get_srcSystem(), message.get_srcComponent(), content)
