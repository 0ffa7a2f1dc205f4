"""``python -m benchmarks faults`` measures what it says: it sees faults, and would see what gets through."""

import math
import select
from functools import partial

import msgspec
import numpy as np
import pytest

from benchmarks.common.result_file import replaced
from benchmarks.faults.bad_commands import bad_numbers, count_passed
from benchmarks.faults.bare_bus import open_sender
from benchmarks.faults.drive import DisturbedError
from benchmarks.faults.forged_frames import count_accepted
from benchmarks.faults.latency import bus_latencies, guard_latencies
from benchmarks.faults.robot import PERIOD_S, SPEED_M_S, CanRobot, MavlinkRobot
from benchmarks.faults.rows import FaultRow, faults_table, measured, timed
from benchmarks.faults.trials import FAULTS, LATEST_S, run_trial, undisturbed
from edge_runtime.errors import BridgeError
from firmware_bridge.guard import core as guard_core
from firmware_bridge.guard.link import SetpointLimits
from firmware_bridge.mavlink.signing import SignatureCheck, Signing

ROBOTS = pytest.mark.parametrize("kind", [CanRobot, MavlinkRobot])


def nothing(_count):
    pass


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.name}, {fault.robot.name}")
def test_every_fault_ends_in_a_stop(fault):
    stop, _ = undisturbed(partial(run_trial, fault))
    assert stop.seconds > 0.0
    # It goes on until it hears, then brakes as hard as its plant can at most.
    speed = 0.9 * SPEED_M_S
    least_m = speed * max(stop.seconds - PERIOD_S - LATEST_S, 0.0) + 0.5 * speed**2 / fault.robot.braking_m_s2
    assert stop.metres > 0.9 * least_m


def test_a_trial_is_repeated_only_if_the_machine_disturbed_it():
    outcomes = iter([DisturbedError("busy"), DisturbedError("busy"), 0.5, BridgeError("never stopped")])

    def trial():
        outcome = next(outcomes)
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    assert undisturbed(trial) == (0.5, 2)
    with pytest.raises(BridgeError, match="never stopped"):
        undisturbed(trial)


@ROBOTS
def test_the_bus_alone_delivers_every_frame(kind):
    delays = bus_latencies(kind, 20)
    assert len(delays) == 20
    assert min(delays) > 0.0


@ROBOTS
def test_a_frame_that_nobody_has_read_yet_has_arrived(kind):
    with kind() as robot:
        open_sender(robot.spec())()
        select.select([robot.wire], [], [])
        assert len(robot.arrivals()) == 1


@ROBOTS
def test_nothing_arrives_over_a_wire_that_was_cut(kind):
    with kind() as robot:
        robot.cut()
        open_sender(robot.spec())()
        select.select([robot.wire], [], [])
        assert robot.arrivals() == []
        assert robot.take_commands() == []


def test_only_what_was_measured_again_is_replaced():
    old = [FaultRow("a", "can", 1), FaultRow("a", "mavlink", 1), FaultRow("b", "can", 1)]
    newer = [FaultRow("c", "can", 2), FaultRow("a", "mavlink", 2)]
    assert replaced(old, newer, measured) == [old[0], newer[1], old[2], newer[0]]


@ROBOTS
def test_latencies_are_those_of_the_commands_that_arrived(kind):
    delays, _ = undisturbed(partial(guard_latencies, kind, 60))
    assert len(delays) >= 5  # and more than 60 where the runtime learns late that the robot drives
    assert min(delays) > 0.0


@ROBOTS
def test_bad_commands_are_counted_if_they_pass(kind, monkeypatch):
    with kind() as robot:
        assert count_passed(robot, 200, nothing) == 0
    monkeypatch.setattr(
        guard_core, "limit_fault", lambda s, _: "" if all(map(math.isfinite, s.velocity_m_s)) else "bad"
    )
    with kind() as robot:
        assert count_passed(robot, 200, nothing) > 0


def test_every_bad_command_is_bad():
    limits = SetpointLimits(1.5, (-2.0, -2.0), (2.0, 2.0))
    commands = bad_numbers(np.random.default_rng(1), 3000, limits)
    for a_x, a_y, v_x, v_y in commands:
        good = abs(a_x) <= 2.0 and abs(a_y) <= 2.0 and v_x * v_x + v_y * v_y <= 1.5**2
        assert not good
    slightly = [c for c in commands if all(map(math.isfinite, c)) and max(map(abs, c)) < 4.0]
    assert len(slightly) > 50


def test_forged_frames_are_counted_if_they_pass(monkeypatch):
    assert count_accepted(120, nothing) == 0
    monkeypatch.setattr(Signing, "verify", lambda *_: SignatureCheck.ACCEPTED)
    assert count_accepted(120, nothing) > 30


def test_rows_hold_percentiles_in_milliseconds():
    row = timed("fault", "can", [0.001 * n for n in range(1, 102)], metres=[0.5] * 101)
    assert msgspec.structs.asdict(row) == pytest.approx(
        {
            "fault": "fault",
            "bridge": "can",
            "trials": 101,
            "p50_ms": 51.0,
            "p95_ms": 96.0,
            "max_ms": 101.0,
            "p95_m": 0.5,
            "passed": None,
            "repeated": 0,
        }
    )
    lines = faults_table([row, FaultRow("forged", "mavlink", 100_000, passed=0)]).splitlines()
    assert lines[2:] == [
        "| fault | can | 101 | 51.0 | 96.0 | 101 | 0.500 |  |",
        "| forged | mavlink | 100,000 |  |  |  |  | 0 |",
    ]
