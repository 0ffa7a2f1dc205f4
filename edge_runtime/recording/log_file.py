"""One file of a log: an MCAP file with a channel for each kind of record.

Records gather in chunks, which the file has only once they are whole: `LogFile.flush` ends one. Without it,
with the library's default chunks of 1 MiB, a process killed after 5 s of a 100 Hz run leaves no readable
message at all.
"""

import fcntl
import os
from pathlib import Path
from typing import Final

import msgspec
from mcap.writer import Writer

from edge_runtime.recording.json_codec import encode, json_schema
from edge_runtime.recording.schema import CHANNELS, LOG_FORMAT

PROFILE: Final = "cfpg"


class _Stream:
    """Where the library writes: every write goes to the system whole, or raises."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._position = descriptor, 0

    def write(self, content: bytes) -> int:
        left = memoryview(content)
        while left:
            left = left[os.write(self._descriptor, left) :]
        self._position += len(content)
        return len(content)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Nothing is held back."""


class LogFile:
    """A new log file, locked while it is open.

    Raises:
        OSError: from any method, if the system refuses it; then only `abandon` may follow.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.whole_bytes = 0
        """Size of what has been flushed."""
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        fcntl.flock(self._descriptor, fcntl.LOCK_EX)
        self._stream = _Stream(self._descriptor)
        self._writer = Writer(self._stream, enable_data_crcs=True)  # type: ignore[arg-type]  # three methods
        self._channels: dict[str, int] = {}
        try:
            self._writer.start(PROFILE, LOG_FORMAT)
            self._writer.flush()  # type: ignore[no-untyped-call]
        except OSError:
            self.abandon()
            path.unlink()  # a full disk may take the name of a file: it must be free for the next try
            raise
        for topic, (name, record) in CHANNELS.items():
            schema = self._writer.register_schema(name, "jsonschema", json_schema(record))
            self._channels[topic] = self._writer.register_channel(f"/{topic}", "json", schema)
        self.whole_bytes = self._stream.tell()

    def add(self, topic: str, record: msgspec.Struct, time_ns: int, sequence: int = 0) -> None:
        """Add one message to the chunk in progress."""
        self._writer.add_message(self._channels[topic], time_ns, encode(record), time_ns, sequence)

    def flush(self) -> None:
        """End the chunk: what was added so far outlives this process, though not a loss of power."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self.whole_bytes = self._stream.tell()

    def close(self) -> None:
        """Write the index and close the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        os.close(self._descriptor)

    def abandon(self) -> None:
        """Leave the file as it was after the last flush, without an index."""
        os.ftruncate(self._descriptor, self.whole_bytes)
        os.close(self._descriptor)
