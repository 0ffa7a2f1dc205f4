"""What an operator sends to a robot, and what it answers: sealed MessagePack.

No message acts twice or later: an order names the operator's session, the robot's boot and when it expires
by the robot's own clock, both of which the operator has from the robot's answer; an answer repeats the
session, a random number, and the number of the message that it answers.
"""

from typing import Annotated, Final, Literal

import msgspec

from edge_runtime.common.bounds import Finite
from edge_runtime.network.seal import MAGIC_BYTES, TAG_BYTES, FrameError, Magic, Refusal, seal, unseal
from edge_runtime.network.team_wire import LAST_TICK

FILE_BYTES: Final = 8192
"""Longest objectives file."""
_BODY_BYTES: Final = FILE_BYTES + 1024
PACKET_BYTES: Final = MAGIC_BYTES + _BODY_BYTES + TAG_BYTES
"""Longest packet."""

Size = Annotated[int, msgspec.Meta(ge=0, lt=2**32)]
Stage = Literal["none", "receiving", "checking", "accepted", "refused", "committed", "applied"]


class Order(msgspec.Struct, frozen=True, tag_field="order"):
    """Base of what an operator sends."""

    session: int
    number: int
    """Counts the session's messages."""
    receiver: int
    boot_id: int
    """Of the robot's run that is meant."""
    expires_s: Finite
    """By the robot's monotonic clock."""


class Ask(Order, frozen=True, tag="ask"):
    """Asks for the robot's standing; the only order for any boot and time."""


class Propose(Order, frozen=True, tag="propose", kw_only=True):
    """Asks whether the robot would follow these objectives; nothing changes yet."""

    version: Annotated[int, msgspec.Meta(ge=1, lt=2**32)]
    file: Annotated[str, msgspec.Meta(max_length=255)]
    """Name of the objectives file, for messages."""
    content: Annotated[bytes, msgspec.Meta(max_length=FILE_BYTES)]


class Offer(Order, frozen=True, tag="offer", kw_only=True):
    """Asks whether the robot would run a signed policy whose files follow in chunks; nothing changes yet."""

    version: Annotated[int, msgspec.Meta(ge=1, lt=2**32)]
    """Of what the team follows, as in `Propose`; the policy's own is in its signature."""
    files: Annotated[
        tuple[tuple[Annotated[str, msgspec.Meta(max_length=64)], Size], ...], msgspec.Meta(max_length=8)
    ]
    """Names and sizes in bytes, in the order in which they are sent."""


class Chunk(Order, frozen=True, tag="chunk", kw_only=True):
    """The next bytes of the files that this session offers, which are sent as one stream."""

    offset: Size
    content: Annotated[bytes, msgspec.Meta(max_length=FILE_BYTES)]


class Halt(Order, frozen=True, tag="halt"):
    """Commands rest for as long as the session goes on asking: policies are exchanged at standstill."""


class Commit(Order, frozen=True, tag="commit", kw_only=True):
    """Makes what this session proposed the robot's objectives, at a tick of the team."""

    tick: Annotated[int, msgspec.Meta(ge=1, le=LAST_TICK)]


class Abort(Order, frozen=True, tag="abort"):
    """Takes back what this session proposed, unless it is committed."""


class Stop(Order, frozen=True, tag="stop"):
    """Ends the run; the robot is commanded to rest."""


class Standing(msgspec.Struct, frozen=True):
    """A robot's answer to any order."""

    session: int
    number: int
    robot_id: int
    boot_id: int
    stamp_s: Finite
    """The robot's monotonic time."""
    tick: Annotated[int, msgspec.Meta(ge=0, le=LAST_TICK)]
    """The team's."""
    rate_hz: Finite
    """Over the last second; 0 in the first one."""
    nominal_rate_hz: Finite
    version: Annotated[int, msgspec.Meta(ge=0, lt=2**32 - 1)]
    """Of the objectives that it follows."""
    digest: int
    stage: Stage
    """Of what the session proposed."""
    complaint: str
    """Why it was refused."""
    stop_reason: str
    """Why the newest command is zero; empty if the robot drives."""
    stopped: bool
    """The run ends, by an operator's order."""
    follows: str = ""
    """What the objectives that it follows ask for, in words."""
    received: int = 0
    """Bytes of the offered files that have come without a gap."""
    at_rest: bool = False
    """Whether it was told to rest, and rests."""
    policy: str = ""
    """The name of what it runs, and the beginning of its manifest's digest."""


AnyOrder = Ask | Propose | Offer | Chunk | Halt | Commit | Abort | Stop
_order_decoder = msgspec.msgpack.Decoder(AnyOrder)
_answer_decoder = msgspec.msgpack.Decoder(Standing)


def encode_order(order: Order, key: bytes) -> bytes:
    """Return the authenticated packet of an order."""
    return seal(Magic.ORDER, msgspec.msgpack.encode(order), key)


def encode_answer(standing: Standing, key: bytes) -> bytes:
    """Return the authenticated packet of an answer."""
    return seal(Magic.ANSWER, msgspec.msgpack.encode(standing), key)


def decode_order(packet: bytes, key: bytes) -> AnyOrder:
    """Read an order.

    Raises:
        FrameError: if it is malformed or not made with this key.
    """
    try:
        return _order_decoder.decode(unseal(packet, Magic.ORDER, key, _BODY_BYTES))
    except (msgspec.MsgspecError, RecursionError):
        raise FrameError(Refusal.MALFORMED) from None


def decode_answer(packet: bytes, key: bytes) -> Standing:
    """Read an answer; raises as `decode_order`."""
    try:
        return _answer_decoder.decode(unseal(packet, Magic.ANSWER, key, _BODY_BYTES))
    except (msgspec.MsgspecError, RecursionError):
        raise FrameError(Refusal.MALFORMED) from None
