"""The guard on a real SocketCAN bus, in a kernel of its own: full queues and dead interfaces for real.

``tests/support/socketcan/install.sh`` installs what this needs.
"""

import os
import shutil

import pytest
from socketcan.boot import SHIM, run_guest
from socketcan.chassis import TIMEOUT_S

pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(
        not os.environ.get("CI") and not (shutil.which("linux.uml") and SHIM.is_file()),
        reason="user-mode Linux is not installed: run tests/support/socketcan/install.sh as root",
    ),
]

MOTION, BRAKE, MODE = 0x111, 0x131, 0x421
HALF = "01f4000000000000"
ZERO = "0000000000000000"
BRAKED = "0100000000000000"
QUEUE = 10 + 2
"""The interface's default transmit queue, a frame in the driver, and one that was under way at the fault."""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    return run_guest(tmp_path_factory.mktemp("guest"))


def after(outcome):
    return [(frame.frame_id, frame.data) for frame in outcome.frames if frame.after_s >= 0.0]


def stop_of(outcome):
    """The frames after the last full-speed command."""
    frames = after(outcome)
    last = max((index for index, frame in enumerate(frames) if frame == (MOTION, HALF)), default=-1)
    return frames[last + 1 :]


def assert_ramped_stop(outcome):
    stop = stop_of(outcome)
    speeds = [int(data[:4], 16) for frame_id, data in stop if frame_id == MOTION]
    assert speeds == sorted(speeds, reverse=True)
    assert 0 < speeds[0] < 500
    assert_ends_in_standby(stop)


def assert_ends_in_standby(stop):
    """Three zeros, brake, standby: nothing after."""
    assert stop[-5:] == [*[(MOTION, ZERO)] * 3, (BRAKE, BRAKED), (MODE, ZERO)]


def assert_firmware_stopped_alone(outcome):
    """Nothing but commands that were under way reached the firmware, whose own timeout acted."""
    assert set(after(outcome)) <= {(MOTION, HALF)}
    assert len(after(outcome)) <= QUEUE
    last_s = outcome.frames[-1].after_s
    assert outcome.stopped_by_firmware_s >= last_s + TIMEOUT_S


@pytest.mark.parametrize("scenario", ["runtime killed", "runtime frozen"])
def test_a_dead_runtime_stops_the_robot(outcomes, scenario):
    assert_ramped_stop(outcomes[scenario])
    assert outcomes[scenario].stopped_by_firmware_s is None


def test_a_dead_guard_leaves_the_robot_to_its_own_timeout(outcomes):
    assert_firmware_stopped_alone(outcomes["guard killed"])
    assert "the guard ended" in outcomes["guard killed"].reason


def test_bus_off_ends_the_commands_for_good(outcomes):
    """The interface came up again before the end: nothing more was sent through it."""
    assert outcomes["bus-off"].bus_state == "BUS-OFF"
    assert "bus-off" in outcomes["bus-off"].reason
    assert outcomes["bus-off"].refused_after_s > 0.0
    assert_firmware_stopped_alone(outcomes["bus-off"])


def test_an_interface_that_went_down_ends_the_commands_for_good(outcomes):
    assert outcomes["interface down"].bus_state == "STOPPED"
    assert "down" in outcomes["interface down"].reason
    assert_firmware_stopped_alone(outcomes["interface down"])


def test_an_adapter_pulled_out_ends_the_run(outcomes):
    assert "the bus can0 is lost" in outcomes["unplugged"].reason


def test_a_full_queue_drops_the_newest_and_drives_on(outcomes):
    outcome = outcomes["queue full"]
    assert outcome.dropped > 0
    assert after(outcome).count((MOTION, HALF)) > QUEUE
    assert_ramped_stop(outcome)


def test_a_stop_gets_through_once_the_queue_drains(outcomes):
    outcome = outcomes["killed behind a full queue"]
    assert after(outcome).count((MOTION, HALF)) <= QUEUE
    assert_ends_in_standby(stop_of(outcome))
