"""What the harness records while a team drives: all of it, in memory that was there before."""

import tracemalloc

from firmware_bridge.sil.measurement.process_meter import Meter
from firmware_bridge.sil.measurement.processes import ProcessGroup, Usage
from firmware_bridge.sil.measurement.samples import LONGEST_S, MARGIN_S, Samples


def test_all_samples_come_back_in_their_order():
    samples = Samples(rate_hz=10.0, duration_s=1.0)
    values = [
        0.5 * number for number in range(round(10.0 * (1.0 + MARGIN_S)) + 7)
    ]  # seven more than expected
    for value in values:
        samples.append(value)
    assert samples.tolist() == values
    assert Samples(10.0, 1.0).tolist() == []


def test_samples_that_were_expected_take_no_memory():
    samples = Samples(rate_hz=100.0, duration_s=60.0)
    tracemalloc.start()
    try:
        for _ in range(6000):
            samples.append(0.25)
        grown, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert grown < 1000


def test_an_endless_run_takes_no_endless_memory():
    samples = Samples(rate_hz=1.0, duration_s=1e6)
    assert samples._values.buffer_info()[1] == LONGEST_S


def test_growth_counts_from_the_first_quarter_on(tmp_path, monkeypatch):
    """Whoever died keeps what it had; who came later is nobody's."""
    memory = {1: [50, 60, 61, 64], 2: [10, 11, 12]}
    step = 0

    def usage(pid):
        return Usage(0.5 * step, memory[pid][step] << 20) if step < len(memory[pid]) else None

    monkeypatch.setattr("firmware_bridge.sil.measurement.process_meter.machine_busy_s", lambda: 2.0 * step)
    monkeypatch.setattr("firmware_bridge.sil.measurement.process_meter.usage", usage)
    processes = ProcessGroup(tmp_path)
    monkeypatch.setattr(processes, "notice_grandchildren", lambda: {"robot_0/guard": 2})
    meter = Meter(processes, own_pid=1, duration_s=4.0)
    for step in range(4):
        meter.sample([0.0, 1.0, 2.0, 4.0][step])
    costs = {cost.name: cost for cost in meter.costs()}
    assert (costs["harness"].memory_growth_mib, costs["harness"].memory_mib) == (4.0, 64.0)
    assert costs["robot_0/guard"].memory_growth_mib == 1.0
    assert costs["harness"].cpu_cores == 1.5 / 4.0
    assert meter.others_cpu_cores() == (6.0 - 1.5 - 1.0) / 4.0
