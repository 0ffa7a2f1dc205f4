"""What all packets of a team have in common: a magic in front, and behind it all an HMAC-SHA256.

The magics stand in one list, for most packets are made with one key: a packet of one kind must never pass for
one of another.
"""

import enum
import functools
import hmac
from typing import Final

TAG_BYTES: Final = 32


@enum.unique
class Magic(bytes, enum.Enum):
    """What a packet begins with; the last byte is the version of its layout, and changes with that."""

    TEAM = b"CFP\x03"
    """See `edge_runtime.network.team_wire`."""
    ORDER = b"CFO\x01"
    ANSWER = b"CFA\x01"
    """See `edge_runtime.network.order_wire`."""
    STREAM = b"CFS\x02"
    """See `edge_runtime.network.stream_wire`."""
    STATUS = b"CFW\x02"
    """See `edge_runtime.telemetry.status`."""
    LISTEN = b"CFL\x01"
    """See `edge_runtime.tools.watch.feed`."""


MAGIC_BYTES: Final = 4


class Refusal(enum.Enum):
    """Why a received packet was dropped."""

    MALFORMED = "malformed"
    """Not of this length or version, or of fields that no robot sends."""
    FOREIGN = "foreign"
    """Not made with the team's key."""
    MISDIRECTED = "misdirected"
    """Made for another robot, or by a robot that the fleet does not know."""
    IMPERSONATED = "impersonated"
    """Made by a robot as which the carrier did not let it through."""
    NOT_FINITE = "not finite"
    OTHER_BODY = "it moves or acts in other dimensions"
    """It runs a policy for another body."""
    EXPIRED = "expired"
    """An operator's order for an earlier run or an earlier time: a recording."""
    UNANSWERED = "unanswered"
    """Opens a session without the answer to our challenge: the first frames of any robot, or a recording."""
    DUPLICATE = "duplicate"
    """Received before."""
    REORDERED = "reordered"
    """Overtaken by a newer one."""
    REPLAYED = "replayed"
    """Too far behind the newest one to have been overtaken."""
    TICK_LEAPS = "its tick of the team leaps"
    SEQUENCE_LEAPS = "its sequence leaps"
    RESTARTS = "it restarts again and again"
    """Made with the key, and no robot's that is in order: it lies, or its memory is damaged."""


DOUBTS: Final = (Refusal.OTHER_BODY, Refusal.TICK_LEAPS, Refusal.SEQUENCE_LEAPS, Refusal.RESTARTS)
"""What a teammate is kept out for, until it says what it can have come to."""


class FrameError(ValueError):
    """A packet that is to be dropped."""

    def __init__(self, cause: Refusal) -> None:
        super().__init__(cause.value)
        self.cause = cause


def seal(magic: Magic, body: bytes, key: bytes) -> bytes:
    """Return the authenticated packet of a body."""
    content = magic + body
    return content + _tag(content, key)


def unseal(packet: bytes, magic: Magic, key: bytes, most_bytes: int, least_bytes: int = 0) -> bytes:
    """Return the body of a packet of one kind.

    Args:
        packet: as it was received.
        magic: of its kind.
        key: the one that it must be made with.
        most_bytes: greatest length of a body of this kind.
        least_bytes: smallest length.

    Raises:
        FrameError: if it is another kind's, too long or too short, or not made with this key.
    """
    size = len(packet) - MAGIC_BYTES - TAG_BYTES
    if not least_bytes <= size <= most_bytes or not packet.startswith(magic):
        raise FrameError(Refusal.MALFORMED)
    content, tag = packet[:-TAG_BYTES], packet[-TAG_BYTES:]
    if not hmac.compare_digest(_tag(content, key), tag):
        raise FrameError(Refusal.FOREIGN)
    return content[MAGIC_BYTES:]


def _tag(content: bytes, key: bytes) -> bytes:
    mac = _keyed(key).copy()
    mac.update(content)
    return mac.digest()


@functools.lru_cache(maxsize=8)
def _keyed(key: bytes) -> hmac.HMAC:
    """Take the key in once: with every packet it would cost a third of the whole."""
    return hmac.new(key, digestmod="sha256")
