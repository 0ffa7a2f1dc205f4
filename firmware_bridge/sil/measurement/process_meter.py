"""Samples what every process costs, once a second while a run lasts."""

from firmware_bridge.sil.measurement.processes import ProcessGroup, Usage, machine_busy_s, usage
from firmware_bridge.sil.report.records import ProcessCost

PERIOD_S = 1.0
SETTLING_SHARE = 0.25
"""Of the run: then everything has been touched once, and memory should not grow any more."""
_MIB = 2**20


class Span:
    """One process from its first sample to its newest."""

    def __init__(self, first: Usage) -> None:
        self.first = self.newest = first
        self.settled: Usage | None = None
        """The first one after the first quarter of the run."""


class Meter:
    """Follows what processes cost; keeps nothing that grows with the run.

    Args:
        processes: whose; names are those of children, and of their children as ``child/part``.
        own_pid: of the harness.
        duration_s: of the run.
    """

    def __init__(self, processes: ProcessGroup, own_pid: int, duration_s: float) -> None:
        self._processes, self._own_pid, self._settling_s = processes, own_pid, SETTLING_SHARE * duration_s
        self._pids: dict[str, int] = {}
        self._spans: dict[str, Span] = {}
        self._begin_s = self._end_s = self._busy_before_s = self._busy_s = 0.0

    def sample(self, now_s: float) -> None:
        """Look at everything now; the first time, find out who there is."""
        self._end_s, self._busy_s = now_s, machine_busy_s()
        if not self._pids:
            self._begin_s, self._busy_before_s = now_s, self._busy_s
            self._pids = {name: child.popen.pid for name, child in self._processes.children.items()}
            self._pids |= {**self._processes.notice_grandchildren(), "harness": self._own_pid}
            found = {name: usage(pid) for name, pid in self._pids.items()}
            self._spans = {name: Span(one) for name, one in found.items() if one is not None}
        settled = now_s - self._begin_s >= self._settling_s
        for name, span in self._spans.items():
            if (newest := usage(self._pids[name])) is not None:
                span.newest = newest
                if settled and span.settled is None:
                    span.settled = newest

    def costs(self) -> tuple[ProcessCost, ...]:
        """Return what each process cost from the first sample to its last."""
        return tuple(self._cost(name, span) for name, span in self._spans.items())

    def others_cpu_cores(self) -> float:
        """Return what everybody else took meanwhile, in cores."""
        passed_s = self._end_s - self._begin_s
        if passed_s <= 0.0:
            return 0.0
        ours = sum(span.newest.cpu_s - span.first.cpu_s for span in self._spans.values())
        return max(0.0, self._busy_s - self._busy_before_s - ours) / passed_s

    def _cost(self, name: str, span: Span) -> ProcessCost:
        passed_s = self._end_s - self._begin_s
        grown = span.newest.memory_bytes - (span.settled or span.first).memory_bytes
        return ProcessCost(
            name=name,
            cpu_cores=(span.newest.cpu_s - span.first.cpu_s) / passed_s if passed_s > 0.0 else 0.0,
            memory_mib=span.newest.memory_bytes / _MIB,
            memory_growth_mib=grown / _MIB,
        )
