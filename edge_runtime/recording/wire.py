"""What the loop's process and the logger's tell each other: a record a packet, its kind in front.

A tick is handed over in the parts that the loop has at hand, and becomes a `Tick` in the logger's process: to
build one in the loop would cost more than to pack it.
"""

from typing import Final

import msgspec

from edge_runtime.messages import Command, GuidedAction, TeamState, Vector
from edge_runtime.observation.familiarity import Unfamiliar
from edge_runtime.recording.schema import (
    End,
    Inputs,
    LoggedObjectiveSet,
    Observation,
    StageTimes,
    Start,
    Tick,
)

PACKET_BYTES: Final = 1 << 19
"""More than any record or report, and than a socket takes."""


class LogPlan(msgspec.Struct, frozen=True):
    """Where a run is recorded."""

    folder: str
    run: str
    """Name of the run, see `edge_runtime.recording.folder.run_name`."""
    file_bytes: int
    """A file that has grown beyond this is closed, and the next one begun."""
    file_s: float
    """So is one that has been written for so long."""
    keep_bytes: int
    """What all logs in the folder may take."""


class LogReport(msgspec.Struct, frozen=True):
    """What became of a run's record."""

    path: str
    """The newest file."""
    files: int
    ticks: int
    """Recorded."""
    lost: int
    """Ticks that are in no file."""
    failure: str
    """Why, if the system said; empty if all is well."""


class Complaint(msgspec.Struct, frozen=True):
    """What the robot's firmware complains of; it goes into the channel of events."""

    text: str


Packet = Start | LoggedObjectiveSet | Tick | Complaint | End
TickParts = tuple[
    int,  # number of the tick
    float,  # its deadline
    int,  # deadlines missed so far
    int,  # version of the objectives
    Vector,  # start noise
    Vector,  # action commanded before
    float,  # time since the first tick
    TeamState,
    bytes | memoryview,  # observation, 32-bit floats
    GuidedAction,
    Command,
    list[float],  # stage times
    Unfamiliar,
]
_TICK: Final = b"T"
_KINDS: Final[dict[bytes, type[Start | LoggedObjectiveSet | Complaint | End]]] = {
    b"S": Start,
    b"O": LoggedObjectiveSet,
    b"C": Complaint,
    b"E": End,
}
_LETTERS: Final = {kind: letter for letter, kind in _KINDS.items()}
_DECODERS: Final = {letter: msgspec.msgpack.Decoder(kind) for letter, kind in _KINDS.items()}
_PARTS: Final = msgspec.msgpack.Decoder(
    tuple[
        int,
        float,
        int,
        int,
        Vector,
        Vector,
        float,
        TeamState,
        bytes,
        GuidedAction,
        Command,
        tuple[float, ...],
        Unfamiliar,
    ]
)
_encoder: Final = msgspec.msgpack.Encoder()
_encode: Final = _encoder.encode
_encode_into: Final = _encoder.encode_into


def encode_packet(record: Start | LoggedObjectiveSet | Complaint | End) -> bytes:
    """Return the packet of a record; MessagePack keeps every float's bits."""
    return _LETTERS[type(record)] + _encode(record)


def tick_packet() -> bytearray:
    """Return what `pack_tick` packs ticks into; used again and again, it stays where it is in memory."""
    return bytearray(_TICK)


def pack_tick(parts: TickParts, packet: bytearray) -> None:
    """Make ``packet`` that of a tick."""
    _encode_into(parts, packet, len(_TICK))


def decode_packet(packet: bytes) -> Packet:
    """Return the record of a packet."""
    letter, body = packet[:1], memoryview(packet)[1:]
    if letter != _TICK:
        return _DECODERS[letter].decode(body)
    parts = _PARTS.decode(body)
    inputs, (team, seen, guided, command, laps, unfamiliar) = Inputs(*parts[:7]), parts[7:]
    observation = Observation(tuple(memoryview(seen).cast("f")), unfamiliar.field, unfamiliar.seconds)
    return Tick(inputs, team, observation, guided, command, StageTimes(*laps))


def encode_report(report: LogReport) -> bytes:
    """Return the logger's answer."""
    return _encode(report)


def decode_report(packet: bytes) -> LogReport:
    """Return the report that `encode_report` was given."""
    return msgspec.msgpack.decode(packet, type=LogReport)
