"""The status frame: what one robot tells whoever watches the team.

A magic number, the record in MessagePack, then HMAC-SHA256 of both with the team's key. The magic keeps a
status from ever passing for a frame of `edge_runtime.network.team_wire`, which the same key signs.
"""

import hmac
from typing import Final

import msgspec

from edge_runtime.messages import Vector2

MAGIC: Final = b"CFS\x01"
"""Its last byte is the version of the record; change it with the record."""
LONGEST: Final = 8192
"""Bytes of the longest packet that is read."""
_TAG_BYTES: Final = 32


class Span(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Recent durations in microseconds."""

    p50: float
    p99: float


class ObjectiveStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One objective that steers the robot."""

    name: str
    limit: str
    """What it asks for, as text with its unit; empty where it is no single number."""
    cost: float
    """In squared action units; 0 while it is kept."""
    conflicts: float
    """Share of the newest sample's steps in which it pulled against another objective, in [0, 1]."""


class Status(msgspec.Struct, frozen=True, array_like=True, kw_only=True):
    """One robot, now."""

    robot_id: int
    started_s: float
    """When it started, by its own wall clock; with the sequence this orders all its statuses."""
    sequence: int
    sent_s: float
    """By its own wall clock."""
    position_m: Vector2
    velocity_m_s: Vector2
    speed_limit_m_s: float | None
    goal_distance_m: float
    nearest_m: float
    """To the nearest teammate's centre, now; infinite if it sees none."""
    margin_m: float | None
    rate_hz: float
    """Ticks per second, from the first to the newest."""
    nominal_rate_hz: float
    missed: int
    """Deadlines missed since the start."""
    cut_short: int
    """Samples cut short by the deadline since the start."""
    tick: Span
    stages: dict[str, Span]
    objectives: tuple[ObjectiveStatus, ...]
    objectives_version: int
    ages_s: dict[int, float]
    """Ages of the teammates' states that the newest action rests on, by their ids."""
    stop_reason: str
    """Why the newest command is zero; empty in normal operation."""


_DECODER: Final = msgspec.msgpack.Decoder(Status)


class StatusError(ValueError):
    """A packet that is to be dropped."""


def encode(status: Status, key: bytes) -> bytes:
    """Return the authenticated packet of a status."""
    body = MAGIC + msgspec.msgpack.encode(status)
    return body + hmac.digest(key, body, "sha256")


def decode(packet: bytes, key: bytes) -> Status:
    """Read a packet.

    Raises:
        StatusError: if it is malformed or was not made with this key.
    """
    body, tag = packet[:-_TAG_BYTES], packet[-_TAG_BYTES:]
    if len(packet) > LONGEST or not body.startswith(MAGIC):
        raise StatusError("malformed")
    if not hmac.compare_digest(hmac.digest(key, body, "sha256"), tag):
        raise StatusError("foreign")
    try:
        return _DECODER.decode(body[len(MAGIC) :])
    except msgspec.DecodeError as error:
        raise StatusError("malformed") from error
