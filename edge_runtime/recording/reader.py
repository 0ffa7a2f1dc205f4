"""Reads a log, in order and up to its damage."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from edge_runtime.common.printable import first_line
from edge_runtime.common.regular_file import open_regular
from edge_runtime.errors import ConfigError
from edge_runtime.recording.json_codec import decoder
from edge_runtime.recording.schema import (
    CHANNELS,
    LATEST_S,
    READ_FORMATS,
    TICK_CHANNELS,
    Inputs,
    Record,
    Start,
    Tick,
)

LARGEST_LOG: Final = 1 << 34
"""Bytes: a hundred and more files as edge-run ends them."""
LARGEST_RECORD: Final = 1 << 23
"""Bytes of a record, and of a chunk unpacked; edge-run ends a chunk at an eighth of it."""
DENSEST: Final = 200
"""A chunk that unpacks to more times its size is none of a robot's: those come to 5."""
_DECODERS: Final = {topic: decoder(record) for topic, (_, record) in CHANNELS.items()}
_SKIPPED: Final = ("poses", "")
"""Drawn from ``state``, and those of no channel of ours."""


class Damage(msgspec.Struct, frozen=True):
    """Where reading had to end; always the last that is read."""

    message: str
    """What is wrong, and up to where the log is whole; one line, without the file's name."""


class _Format(msgspec.Struct):
    format: str


def read_log(path: Path) -> Iterator[Record | Damage]:
    """Yield a log's records: `Start`, `LoggedObjectiveSet`, then ticks, events and further sets as they came.

    A file that was cut off, as by a killed logger or a full disk, or that is damaged yields all records
    before that, then a `Damage`.

    Raises:
        ConfigError: if it cannot be read, or is no log of edge-run, or is one of another format.
    """
    try:
        with open_regular(path, LARGEST_LOG) as file:
            yield from _records(file, path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error


def _records(file: BinaryIO, path: Path) -> Iterator[Record | Damage]:
    parts: dict[str, Any] = {}
    start: Start | None = None
    started, newest = False, None
    for item in _messages(file, path):
        if isinstance(item, Damage):
            yield _damage(item.message, newest)
            return
        topic, message = item
        if not started:
            _check_start(topic, message.data, path)
            started = True
        if topic in _SKIPPED:
            continue
        try:
            record: Any = _DECODERS[topic].decode(message.data)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            yield _damage(f"a message on /{topic} does not read ({first_line(error)})", newest)
            return
        if topic not in TICK_CHANNELS:
            start = record if isinstance(record, Start) else start
            yield record
            continue
        parts[topic] = record
        if topic == TICK_CHANNELS[-1] and len(parts) == len(TICK_CHANNELS):
            inputs = parts["inputs"]
            if not _follows(inputs, newest):
                yield _damage(f"tick {inputs.number} is out of order", newest)
                return
            tick = Tick(**parts)
            if fault := tick.fault(start.fleet.dims) if start else "":
                yield _damage(f"tick {inputs.number} has {fault}", newest)
                return
            newest = inputs
            yield tick
            parts.clear()


def _follows(inputs: Inputs, before: Inputs | None) -> bool:
    if before is None:
        return inputs.number >= 0 and 0.0 <= inputs.deadline_s <= LATEST_S
    return inputs.number > before.number and before.deadline_s <= inputs.deadline_s <= LATEST_S


def _damage(message: str, newest: Inputs | None) -> Damage:
    return Damage(
        f"{message} " + ("before its first tick" if newest is None else f"after tick {newest.number}")
    )


def _messages(file: BinaryIO, path: Path) -> Iterator[tuple[str, Message] | Damage]:
    """Yield topics, without their slash, and messages; at last what is wrong, if anything is."""
    topics: dict[int, str] = {}
    records = _unpacked(file)
    whole = False
    while True:
        try:
            record = next(records, None)
        except InvalidMagic as error:
            if topics:
                yield Damage("its last bytes are not those of an MCAP file")
                return
            raise ConfigError(f"{path}: is not an MCAP file") from error
        except (EndOfFile, struct.error):  # between fields, or within one
            if file.tell() < len(MCAP0_MAGIC):
                raise ConfigError(f"{path}: is not an MCAP file") from None
            yield Damage("its index is cut off" if whole else "ends early")
            return
        except Exception as error:  # noqa: BLE001  # damage shows as whatever the bytes are taken for
            yield Damage(f"is damaged ({type(error).__name__}: {first_line(error)})")
            return
        if record is None:
            return
        if isinstance(record, Channel):
            topic = record.topic.removeprefix("/")
            topics[record.id] = topic if topic in CHANNELS else ""
        elif isinstance(record, Message) and record.channel_id in topics:
            yield topics[record.channel_id], record
        whole = whole or isinstance(record, DataEnd)


class _Stream:
    """The file, of which nothing is read that is longer than a record may be."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, size: int) -> bytes:
        if not 0 <= size <= LARGEST_RECORD:
            raise ValueError(f"a length of {size} bytes")
        return self._file.read(size)


def _unpacked(file: BinaryIO) -> Iterator[McapRecord]:
    """Yield the file's records, those of its chunks each in its place."""
    reader = StreamReader(
        _Stream(file),  # type: ignore[arg-type]  # all that it asks for
        emit_chunks=True,
        validate_crcs=True,
        record_size_limit=LARGEST_RECORD,
    )
    for record in reader.records:
        if isinstance(record, Chunk):
            _check_chunk(record)
            yield from breakup_chunk(record, validate_crc=True)
        else:
            yield record


def _check_chunk(chunk: Chunk) -> None:
    """Refuse, before it is unpacked, what takes more memory or time than a robot's log."""
    if chunk.compression not in ("", "zstd"):
        raise ValueError(f"compressed by {chunk.compression}")
    if chunk.compression:
        size = max(chunk.uncompressed_size, zstandard.frame_content_size(chunk.data))
        if size > min(LARGEST_RECORD, DENSEST * len(chunk.data)):
            raise ValueError(f"a chunk of {len(chunk.data)} bytes that unpacks to {size}")


def _check_start(topic: str, message: bytes, path: Path) -> None:
    try:
        found = msgspec.json.decode(message, type=_Format).format if topic == "start" else ""
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        found = ""
    if not found:
        raise ConfigError(f"{path}: is an MCAP file, but no log of edge-run: it does not begin with /start")
    if found not in READ_FORMATS:
        raise ConfigError(
            f"{path}: is a log of format {found!r}, this version reads {', '.join(READ_FORMATS)}; "
            "read it with the version of cfpg-edge that wrote it"
        )
