"""Logs as a rosbag2 bag: a folder with one MCAP file of ROS messages and its metadata."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from edge_runtime.common.command_line import need
from edge_runtime.errors import ConfigError
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import LoggedObjectiveSet, Start, Tick
from edge_runtime.tools.replay.ros_messages import Message, definition, messages_of

VERSION: Final = 5
"""Of the metadata: every ROS 2 from Humble on reads it."""


class Bagged(msgspec.Struct, frozen=True):
    """What came of it."""

    messages: int
    ticks: int
    damage: tuple[str, ...]
    """Of each log that broke off: what was read until there is in the bag."""


def write_bag(logs: Sequence[Path], folder: Path) -> Bagged:
    """Write a team's logs into one bag; each robot has topics of its own.

    Raises:
        ConfigError: if the folder is there already or cannot be written, a log is none, or the library that
            writes ROS messages is not installed.
    """
    writing = need("mcap_ros2.writer", "rosbag")
    try:
        folder.mkdir()
        with (folder / f"{folder.name}_0.mcap").open("wb") as file, writing.Writer(file) as writer:
            return _Bag(folder, writer).fill(logs)
    except FileExistsError:
        raise ConfigError(f"--rosbag2 {folder}: is there already; name a new folder") from None
    except OSError as error:
        raise ConfigError(f"--rosbag2 {folder}: cannot be written ({error.strerror})") from error


class _Bag:
    """One bag while it is written."""

    def __init__(self, folder: Path, writer: Any) -> None:  # noqa: ANN401  # of an extra
        self._folder, self._writer = folder, writer
        self._schemas: dict[str, object] = {}
        self._counts: Counter[tuple[str, str]] = Counter()
        self._span_ns: tuple[int, int] | None = None
        self._ticks, self._damage = 0, list[str]()

    def fill(self, logs: Sequence[Path]) -> Bagged:
        for path in logs:
            for message, time_ns in self._read(path):
                self._add(message, time_ns)
        self._describe()
        return Bagged(self._counts.total(), self._ticks, tuple(self._damage))

    def _read(self, path: Path) -> Iterator[tuple[Message, int]]:
        start: Start | None = None
        names: tuple[str, ...] = ()
        for record in read_log(path):
            if isinstance(record, Start):
                start = record
            elif isinstance(record, LoggedObjectiveSet):
                names = tuple(one.name for one in record.objectives if one.active)
            elif isinstance(record, Tick) and start is not None:
                self._ticks += 1
                unix_s = start.started_unix_s + (record.inputs.deadline_s - start.started_s)
                time_ns = round(1e9 * max(unix_s, 0.0))
                yield from ((message, time_ns) for message in messages_of(record, time_ns, names))
            elif isinstance(record, Damage):
                self._damage.append(f"{path}: {record.message}")

    def _add(self, message: Message, time_ns: int) -> None:
        kind = message.kind
        if kind not in self._schemas:
            name = kind.replace("/", "/msg/")
            self._schemas[kind] = self._writer.register_msgdef(name, definition(kind))
        self._writer.write_message(message.topic, self._schemas[kind], message.fields, time_ns)
        self._counts[message.topic, kind] += 1
        first, last = self._span_ns or (time_ns, time_ns)
        self._span_ns = (min(first, time_ns), max(last, time_ns))

    def _describe(self) -> None:
        """Write what rosbag2 wants beside the file; JSON is YAML."""
        first, last = self._span_ns or (0, 0)
        name = f"{self._folder.name}_0.mcap"
        times = {
            "starting_time": {"nanoseconds_since_epoch": first},
            "duration": {"nanoseconds": last - first},
            "message_count": self._counts.total(),
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": kind.replace("/", "/msg/"),
                    "serialization_format": "cdr",
                    "offered_qos_profiles": "",
                },
                "message_count": count,
            }
            for (topic, kind), count in self._counts.items()
        ]
        information = {
            "version": VERSION,
            "storage_identifier": "mcap",
            "relative_file_paths": [name],
            **times,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "files": [{"path": name, **times}],
        }
        metadata = msgspec.json.encode({"rosbag2_bagfile_information": information})
        (self._folder / "metadata.yaml").write_bytes(msgspec.json.format(metadata, indent=2))
