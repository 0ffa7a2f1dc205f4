"""The status frame: what one robot tells whoever watches the team.

The record in MessagePack, sealed with the team's key.
"""

from typing import Annotated, Final

import msgspec

from edge_runtime.common.bounds import Finite
from edge_runtime.network.seal import FrameError, Magic, Refusal, seal, unseal

LONGEST: Final = 8192
"""Bytes of the longest record that is read."""
FinitePlace = Annotated[tuple[Finite, ...], msgspec.Meta(min_length=2, max_length=3)]


class Span(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Recent durations in microseconds."""

    p50: Finite
    p99: Finite


class ObjectiveStatus(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One objective that steers the robot."""

    name: str
    limit: str
    """What it asks for, as text with its unit; empty where it is no single number."""
    cost: Finite
    """In squared action units; 0 while it is kept."""
    conflicts: Finite
    """Share of the newest sample's steps in which it pulled against another objective, in [0, 1]."""


class Status(msgspec.Struct, frozen=True, array_like=True, kw_only=True):
    """One robot, now."""

    robot_id: int
    started_s: Finite
    """When it started, by its own wall clock; with the sequence this orders all its statuses."""
    sequence: int
    sent_s: Finite
    """By its own wall clock."""
    position_m: FinitePlace | None
    """None, as of everything that is measured, while it is unknown."""
    velocity_m_s: FinitePlace | None
    heading_rad: Finite | None
    yaw_rate_rad_s: Finite | None
    action: tuple[Finite, ...]
    """The newest command's."""
    speed_limit_m_s: Finite | None
    goal_distance_m: Finite | None
    nearest_m: Finite | None
    """To the nearest teammate's centre, now; None if it sees none."""
    margin_m: Finite | None
    rate_hz: Finite
    """Ticks per second, from the first to the newest."""
    nominal_rate_hz: Finite
    missed: int
    """Deadlines missed since the start."""
    cut_short: int
    """Samples cut short by the deadline since the start."""
    tick: Span
    stages: dict[str, Span]
    objectives: tuple[ObjectiveStatus, ...]
    objectives_version: int
    ages_s: dict[int, Finite]
    """Ages of the teammates' states that the newest action rests on, by their ids."""
    stop_reason: str
    """Why the newest command is zero; empty in normal operation."""
    ended: str = ""
    """Why the run is over, in a robot's last words; empty while it runs."""
    unfamiliar: str = ""
    """The field of the newest observation that is furthest outside of what training had; empty if none is."""
    unfamiliar_ticks: int = 0
    """With any such field, since the start."""


_DECODER: Final = msgspec.msgpack.Decoder(Status)


def encode(status: Status, key: bytes) -> bytes:
    """Return the authenticated packet of a status."""
    return seal(Magic.STATUS, msgspec.msgpack.encode(status), key)


def decode(packet: bytes, key: bytes) -> Status:
    """Read a packet.

    Raises:
        FrameError: if it is malformed, was not made with this key, or holds a number that is not finite.
    """
    try:
        return _DECODER.decode(unseal(packet, Magic.STATUS, key, LONGEST))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise FrameError(Refusal.MALFORMED) from None
