"""What the loop's process and the logger's tell each other: one record a packet, its kind in front."""

from typing import Final

import msgspec

from edge_runtime.log_schema import End, ObjectiveSet, Start, Tick

PACKET_BYTES: Final = 1 << 20
"""More than any packet: a team of a thousand robots has its start in a tenth of it."""


class LogPlan(msgspec.Struct, frozen=True):
    """Where a run is recorded."""

    folder: str
    run: str
    """Name of the run, see `edge_runtime.log_folder.run_name`."""
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


Packet = Start | ObjectiveSet | Tick | End
_KINDS: Final[dict[bytes, type[Packet]]] = {b"S": Start, b"O": ObjectiveSet, b"T": Tick, b"E": End}
_LETTERS: Final = {kind: letter for letter, kind in _KINDS.items()}
_DECODERS: Final = {letter: msgspec.msgpack.Decoder(kind) for letter, kind in _KINDS.items()}
_encode: Final = msgspec.msgpack.Encoder().encode


def encode_packet(record: Packet) -> bytes:
    """Return the packet of a record; MessagePack keeps every float's bits."""
    return _LETTERS[type(record)] + _encode(record)


def decode_packet(packet: memoryview) -> Packet:
    """Return the record of a packet that `encode_packet` made."""
    record: Packet = _DECODERS[bytes(packet[:1])].decode(packet[1:])
    return record


def encode_report(report: LogReport) -> bytes:
    """Return the logger's answer."""
    return _encode(report)


def decode_report(packet: bytes) -> LogReport:
    """Return the report that `encode_report` was given."""
    return msgspec.msgpack.decode(packet, type=LogReport)
