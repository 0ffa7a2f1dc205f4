"""Clocks that a test moves."""

import contextlib
import select
import time
from functools import partialmethod
from types import SimpleNamespace
from unittest import mock

from waiting import HANG_S

from edge_runtime.control.rate import DeadlineGrid
from edge_runtime.recording import recorder
from edge_runtime.recording.recorder import Recorder
from edge_runtime.run import loop
from firmware_bridge.simulation.bridge import SimBridge


class Clock:
    """Time that passes by sleeping, and by ``now`` being moved."""

    def __init__(self, oversleep=0.0):
        self.now, self.oversleep = 100.0, oversleep

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        assert seconds >= 0.0
        self.now += seconds + self.oversleep


def simulate_waits(monkeypatch, module):
    """Let a module's time pass only by its waits, each of which lasts as long as it may."""
    clock = Clock()
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=clock))
    monkeypatch.setattr(module, "select", SimpleNamespace(select=lambda *waits: clock.sleep(waits[-1])))


@contextlib.contextmanager
def simulated_time():
    """Runs of edge-run's loop in here miss no tick and cut no sample short: their time passes by sleeping.

    It is ahead of the real one, and a tenth as long; the loop waits for its logger. Gives the clock.
    """
    clock = Clock()
    clock.now = time.monotonic() + 3600.0

    def sleep(seconds):
        clock.sleep(seconds)
        time.sleep(0.1 * seconds)

    def grid(period_s, *_):
        return DeadlineGrid(period_s, clock, sleep)

    send = Recorder._send

    def send_patiently(record, packet):
        select.select((), (record._socket,), (), HANG_S)
        return send(record, packet)

    with (
        mock.patch.object(loop, "StateGrid", grid),
        mock.patch.object(loop, "time", SimpleNamespace(monotonic=clock)),
        mock.patch.object(SimBridge, "__init__", partialmethod(SimBridge.__init__, clock=clock)),
        mock.patch.object(Recorder, "_send", send_patiently),
        mock.patch.multiple(recorder, OPENING_S=HANG_S, CLOSING_S=HANG_S),
    ):
        yield clock
