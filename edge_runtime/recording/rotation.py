"""A run's files, one after the other, and what becomes of them on a disk that refuses."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.recording.folder import file_name, make_room
from edge_runtime.recording.log_file import LogFile
from edge_runtime.recording.wire import LogPlan, LogReport

RETRY_S: Final = 5.0
"""After a disk has refused, a new file is tried so often."""
Preamble = Callable[[LogFile, int], None]
"""Writes what every file begins with; given the file and its number within the run."""


class LogFiles:
    """Takes a run's records; a disk that refuses costs those since the last `flush`, and they are counted.

    Args:
        plan: where, and how much of the disk.
        preamble: what every file begins with.
        clock: monotonic time in seconds.
    """

    def __init__(
        self, plan: LogPlan, preamble: Preamble, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._plan, self._preamble, self._clock = plan, preamble, clock
        self._file: LogFile | None = None
        self._files = self._flushed = self._pending = self._lost = 0
        self._path = self._failure = ""
        self._opened_s = 0.0

    def open(self) -> None:
        """Begin the next file; the report says so if that fails."""
        plan, folder = self._plan, Path(self._plan.folder)
        path, self._opened_s = folder / file_name(plan.run, self._files), self._clock()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            make_room(folder, plan.keep_bytes - plan.file_bytes)
            self._file = LogFile(path)
            self._path, self._files = str(path), self._files + 1
            self._preamble(self._file, self._files - 1)
        except OSError as error:
            self._refuse(error, path)

    def add(self, topic: str, record: msgspec.Struct, time_ns: int, sequence: int = 0) -> None:
        """Add one message, if there is a file."""
        if self._file is not None:
            try:
                self._file.add(topic, record, time_ns, sequence)
            except OSError as error:
                self._refuse(error, self._file.path)

    def count_tick(self) -> None:
        """Count a tick whose messages have all been added."""
        if self._file is None:
            self._lost += 1
        else:
            self._pending += 1

    def flush(self) -> None:
        """Make what was added so far outlive this process; begin the next file where it is time to."""
        if self._file is None:
            if self._clock() >= self._opened_s + RETRY_S:
                self.open()
        elif self._end_chunk(self._file) and self._is_full(self._file):
            self.close()
            self.open()

    def close(self) -> None:
        """Finish the file."""
        file = self._file
        if file is not None and self._end_chunk(file):
            try:
                file.close()
                self._file = None
            except OSError as error:
                self._refuse(error, file.path)

    def report(self) -> LogReport:
        """Sum up."""
        return LogReport(self._path, self._files, self._flushed, self._lost, self._failure)

    def _end_chunk(self, file: LogFile) -> bool:
        try:
            file.flush()
        except OSError as error:
            self._refuse(error, file.path)
            return False
        self._flushed, self._pending = self._flushed + self._pending, 0
        return True

    def _is_full(self, file: LogFile) -> bool:
        plan = self._plan
        return file.whole_bytes > plan.file_bytes or self._clock() > self._opened_s + plan.file_s

    def _refuse(self, error: OSError, path: Path) -> None:
        self._failure = f"{path}: {error.strerror}"
        self._lost, self._pending = self._lost + self._pending, 0
        if self._file is not None:
            self._file.abandon()
            self._file = None
