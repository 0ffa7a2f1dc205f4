"""A run's records in the order of its log: what each file begins with, ticks, and the events between them."""

import time
from collections.abc import Callable
from pathlib import Path

from msgspec.structs import replace

from edge_runtime.recording.events import ERROR, INFO, WARNING, changes, event, objectives_event
from edge_runtime.recording.log_file import LogFile
from edge_runtime.recording.poses import team_poses
from edge_runtime.recording.rotation import LogFiles
from edge_runtime.recording.schema import TICK_CHANNELS, End, Event, LoggedObjectiveSet, Start, Tick
from edge_runtime.recording.wire import Complaint, LogPlan, Packet


class RunLog:
    """Writes one run.

    Args:
        plan: where, and how much of the disk.
        clock: monotonic time in seconds.
    """

    def __init__(self, plan: LogPlan, clock: Callable[[], float] = time.monotonic) -> None:
        self.files = LogFiles(plan, self._begin, clock)
        self._start: Start | None = None
        self._objectives: LoggedObjectiveSet | None = None
        self._newest: Tick | None = None
        self._time_ns = 0

    def write(self, record: Packet) -> None:
        """Write one record; `Start` comes first."""
        if isinstance(record, Tick):
            self._write_tick(record)
        elif isinstance(record, Start):
            self._start = record
            self._time_ns = round(1e9 * record.started_unix_s)
            self.files.add("start", record, self._time_ns)
            self._tell(event(self._time_ns, INFO, "start", f"policy {record.bundle.name}"))
        elif isinstance(record, LoggedObjectiveSet):
            self._objectives = record
            self.files.add("objectives", record, self._time_ns)
            self._tell(objectives_event(self._time_ns, record))
        elif isinstance(record, Complaint):
            self._tell(event(self._time_ns, WARNING, "firmware", record.text))
        else:
            self._write_end(record)

    def close(self) -> None:
        """Finish the newest file; a run that never began leaves none."""
        self.files.close()
        if self._start is None:
            Path(self.files.report().path).unlink(missing_ok=True)

    def _begin(self, file: LogFile, part: int) -> None:
        if self._start is not None:
            file.add("start", replace(self._start, part=part), self._time_ns)
        if self._objectives is not None:
            file.add("objectives", self._objectives, self._time_ns)

    def _write_tick(self, tick: Tick) -> None:
        number, before = tick.inputs.number, self._newest
        self._newest, self._time_ns = tick, self._unix_ns(tick.inputs.deadline_s)
        for change in changes(before, tick, self._time_ns):
            self._tell(change)
        for topic in TICK_CHANNELS:
            self.files.add(topic, getattr(tick, topic), self._time_ns, number)
        self.files.add("poses", team_poses(tick.state, self._time_ns), self._time_ns, number)
        self.files.count_tick()

    def _write_end(self, end: End) -> None:
        self._tell(event(self._time_ns, ERROR if end.failed else INFO, "stop", end.stop_reason))
        self.files.add("end", end, self._time_ns)

    def _tell(self, told: Event) -> None:
        self.files.add("events", told, self._time_ns)

    def _unix_ns(self, monotonic_s: float) -> int:
        if self._start is None:
            raise ValueError("a run's log begins with its Start")
        return round(1e9 * self._start.started_unix_s) + round(1e9 * (monotonic_s - self._start.started_s))
