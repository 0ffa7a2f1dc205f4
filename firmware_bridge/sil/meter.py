"""Samples what every process costs, once a second while a run lasts."""

import msgspec

from firmware_bridge.sil.processes import Crew, Usage, machine_busy_s, usage
from firmware_bridge.sil.report import ProcessCost

PERIOD_S = 1.0
_MIB = 2**20


class Sample(msgspec.Struct, frozen=True):
    """All processes at one moment."""

    time_s: float
    usage: dict[str, Usage]
    busy_s: float
    """Processor time of the whole machine."""


class Meter:
    """Collects samples; ``names`` are those of children, and of their children as ``child/module``."""

    def __init__(self, crew: Crew, own_pid: int) -> None:
        self._crew, self._own_pid = crew, own_pid
        self._samples: list[Sample] = []
        self._pids: dict[str, int] = {}

    def sample(self, now_s: float) -> None:
        """Look at everything now; the first time, find out who there is."""
        if not self._samples:
            self._pids = {name: child.popen.pid for name, child in self._crew.children.items()}
            self._pids |= {**self._crew.notice_grandchildren(), "harness": self._own_pid}
        found = {name: usage(pid) for name, pid in self._pids.items()}
        known = {name: one for name, one in found.items() if one is not None}
        self._samples.append(Sample(now_s, known, machine_busy_s()))

    def costs(self) -> tuple[ProcessCost, ...]:
        """Return what each process cost from the first sample to its last."""
        return tuple(self._cost(name) for name in self._pids if name in self._samples[0].usage)

    def others_cpu_cores(self) -> float:
        """Return what everybody else took meanwhile, in cores."""
        first, last = self._samples[0], self._samples[-1]
        passed_s = last.time_s - first.time_s
        if passed_s <= 0.0:
            return 0.0
        ours = sum(self._span(name)[1].cpu_s - self._span(name)[0].cpu_s for name in first.usage)
        return max(0.0, last.busy_s - first.busy_s - ours) / passed_s

    def _cost(self, name: str) -> ProcessCost:
        first, last = self._span(name)
        passed_s = self._samples[-1].time_s - self._samples[0].time_s
        settled = [s.usage[name] for s in self._samples[len(self._samples) // 4 :] if name in s.usage]
        grown = last.memory_bytes - (settled[0] if settled else first).memory_bytes
        return ProcessCost(
            name=name,
            cpu_cores=(last.cpu_s - first.cpu_s) / passed_s if passed_s > 0.0 else 0.0,
            memory_mib=last.memory_bytes / _MIB,
            memory_growth_mib=grown / _MIB,
        )

    def _span(self, name: str) -> tuple[Usage, Usage]:
        every = [sample.usage[name] for sample in self._samples if name in sample.usage]
        return every[0], every[-1]
