"""Reads a log, in order and up to its damage."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Channel, DataEnd, Message
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from edge_runtime.errors import ConfigError
from edge_runtime.recording.json_codec import decoder
from edge_runtime.recording.schema import CHANNELS, LOG_FORMAT, TICK_CHANNELS, Record, Tick

LARGEST_RECORD: Final = 1 << 26
"""A length beyond this is damage; chunks are a hundredth of it."""
_DECODERS: Final = {topic: decoder(record) for topic, (_, record) in CHANNELS.items()}
_SKIPPED: Final = ("poses",)
"""Drawn from ``state``."""


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
        with path.open("rb") as file:
            yield from _records(file, path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error


def _records(file: BinaryIO, path: Path) -> Iterator[Record | Damage]:
    parts: dict[str, Any] = {}
    started, newest = False, -1
    for item in _messages(file, path):
        if isinstance(item, Damage):
            where = f"after tick {newest}" if newest >= 0 else "before its first tick"
            yield Damage(f"{item.message} {where}")
            return
        topic, message = item
        if not started:
            _check_start(topic, message.data, path)
            started = True
        if topic in _SKIPPED or topic not in CHANNELS:
            continue
        try:
            record: Any = _DECODERS[topic].decode(message.data)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            yield Damage(f"a message on /{topic} does not read ({error}) after tick {newest}")
            return
        if topic not in TICK_CHANNELS:
            yield record
            continue
        parts[topic] = record
        if topic == TICK_CHANNELS[-1] and len(parts) == len(TICK_CHANNELS):
            newest = parts["inputs"].number
            yield Tick(**parts)
            parts.clear()


def _messages(file: BinaryIO, path: Path) -> Iterator[tuple[str, Message] | Damage]:
    """Yield topics, without their slash, and messages; at last what is wrong, if anything is."""
    topics: dict[int, str] = {}
    records = StreamReader(file, validate_crcs=True, record_size_limit=LARGEST_RECORD).records
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
            yield Damage(f"is damaged ({type(error).__name__}: {error})")
            return
        if record is None:
            return
        if isinstance(record, Channel):
            topics[record.id] = record.topic.removeprefix("/")
        elif isinstance(record, Message) and record.channel_id in topics:
            yield topics[record.channel_id], record
        whole = whole or isinstance(record, DataEnd)


def _check_start(topic: str, message: bytes, path: Path) -> None:
    try:
        found = msgspec.json.decode(message, type=_Format).format if topic == "start" else ""
    except msgspec.DecodeError:
        found = ""
    if not found:
        raise ConfigError(f"{path}: is an MCAP file, but no log of edge-run: it does not begin with /start")
    if found != LOG_FORMAT:
        raise ConfigError(
            f"{path}: is a log of format {found!r}, this version reads {LOG_FORMAT!r}; "
            "read it with the version of cfpg-edge that wrote it"
        )
