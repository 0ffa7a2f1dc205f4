"""Runs in the guest: each scenario breaks something for real while the robot drives, and is written down."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
from can_peers import patient_spec
from socketcan.adapter import Adapter
from socketcan.chassis import MODE, Chassis
from socketcan.outcome import Outcome, Seen
from waiting import HANG_S, until

HALF = bytes.fromhex("01f4000000000000")
"""500 mm/s."""
DEADLINE_S = 0.5
"""The guard's: so long that a busy machine alone does not let it pass."""
AFTERWARDS_S = 1.2
"""Longer than the chassis' own timeout: whatever the guard still sends comes within it."""


class Drive:
    """One runtime and its guard, driving a chassis."""

    def __init__(self, adapter: Adapter) -> None:
        self.chassis = Chassis(adapter)
        self.runtime = subprocess.Popen(
            [sys.executable, "-m", "socketcan.runtime", _specification(adapter.interface)],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.fault_s = 0.0
        self._until(lambda: sum(data == HALF for _, _, data in self.chassis.frames) >= 10)
        self.guard_pid = int(self.runtime.stdout.readline())

    def fault(self) -> None:
        """Note the time of the fault, which the caller causes next."""
        self.fault_s = time.monotonic()

    def await_standby(self) -> None:
        """Serve until the stop sequence has come to its end."""
        self._until(lambda: self.chassis.frames[-1][1:] == (MODE, bytes(8)))

    def await_runtime(self) -> None:
        """Serve until the runtime has ended."""
        self._until(lambda: self.runtime.poll() is not None)

    def end(self, scenario: str, bus_state: str = "") -> Outcome:
        """End the runtime, wait for what may still come, write down."""
        if self.chassis.adapter.plugged:
            self.chassis.serve(AFTERWARDS_S)
        if self.runtime.poll() is None:
            self.runtime.kill()
        words = self.runtime.communicate()[0].split(maxsplit=2)
        _end(self.guard_pid)
        timed_out_s = self.chassis.timed_out_s if self.chassis.timeouts else None
        return Outcome(
            scenario,
            tuple(
                Seen(time_s - self.fault_s, frame_id, data.hex())
                for time_s, frame_id, data in self.chassis.frames
                if time_s > self.fault_s - 1.0
            ),
            reason=words[2].strip() if words else "",
            refused_after_s=float(words[0]) - self.fault_s if words else None,
            dropped=int(words[1]) if words else 0,
            bus_state=bus_state,
            stopped_by_firmware_s=None if timed_out_s is None else timed_out_s - self.fault_s,
        )

    def _until(self, condition: Callable[[], bool]) -> None:
        if not self.chassis.serve(HANG_S, condition):
            raise TimeoutError(f"never happened; frames: {self.chassis.frames[-20:]}")


def runtime_killed(adapter: Adapter) -> Outcome:
    """Kill -9 of the runtime."""
    drive = Drive(adapter)
    drive.fault()
    drive.runtime.kill()
    drive.await_standby()
    return drive.end("runtime killed")


def runtime_frozen(adapter: Adapter) -> Outcome:
    """SIGSTOP of the runtime."""
    drive = Drive(adapter)
    drive.fault()
    drive.runtime.send_signal(signal.SIGSTOP)
    drive.await_standby()
    return drive.end("runtime frozen")


def guard_killed(adapter: Adapter) -> Outcome:
    """Kill -9 of the guard."""
    drive = Drive(adapter)
    drive.fault()
    os.kill(drive.guard_pid, signal.SIGKILL)
    drive.await_runtime()
    return drive.end("guard killed")


def bus_off(adapter: Adapter) -> Outcome:
    """The controller goes bus-off and, once the runtime has ended, is brought back by hand."""
    drive = Drive(adapter)
    drive.fault()
    adapter.go_bus_off()
    drive.await_runtime()
    state = bus_state(adapter.interface)
    drive.chassis.set_interface("down")
    drive.chassis.set_interface("up")
    return drive.end("bus-off", state)


def interface_down(adapter: Adapter) -> Outcome:
    """Somebody takes the interface down and, once the runtime has ended, up again."""
    drive = Drive(adapter)
    drive.chassis.set_interface("down")
    drive.fault()
    drive.await_runtime()
    state = bus_state(adapter.interface)
    drive.chassis.set_interface("up")
    return drive.end("interface down", state)


def queue_full(adapter: Adapter) -> Outcome:
    """The bus takes nothing for half a second, then everything again."""
    drive = Drive(adapter)
    drive.fault()
    drive.chassis.serve(0.5, listening=False)
    drive.chassis.serve(0.5)
    drive.runtime.send_signal(signal.SIGINT)
    drive.await_standby()
    return drive.end("queue full")


def killed_behind_a_full_queue(adapter: Adapter) -> Outcome:
    """The runtime is killed while the bus takes nothing."""
    drive = Drive(adapter)
    drive.fault()
    drive.chassis.serve(0.4, listening=False)
    drive.runtime.kill()
    drive.chassis.serve(0.4, listening=False)
    drive.await_standby()
    return drive.end("killed behind a full queue")


def unplugged(adapter: Adapter) -> Outcome:
    """The adapter is pulled out: the interface is gone. No other scenario can follow."""
    drive = Drive(adapter)
    drive.fault()
    adapter.unplug()
    drive.runtime.wait(HANG_S)
    return drive.end("unplugged")


SCENARIOS = (
    runtime_killed,
    runtime_frozen,
    guard_killed,
    bus_off,
    interface_down,
    queue_full,
    killed_behind_a_full_queue,
    unplugged,
)


def bus_state(interface: str) -> str:
    """Return the controller's state as the kernel tells it."""
    shown = subprocess.run(
        ["ip", "-json", "-details", "link", "show", interface], stdout=subprocess.PIPE, check=True
    )
    (link,) = json.loads(shown.stdout)
    return link["linkinfo"]["info_data"]["state"]


def _specification(interface: str) -> str:
    return msgspec.json.encode(patient_spec(interface, deadline_s=DEADLINE_S)).decode()


def _end(process: int) -> None:
    """Wait for a guard, which is not our child, to end."""
    until(lambda: not Path(f"/proc/{process}").exists())


def run() -> Iterator[Outcome]:
    """Run every scenario."""
    adapter = Adapter()
    chassis = Chassis(adapter)
    chassis.set_interface("type", "can", "bitrate", "500000")
    chassis.set_interface("up")
    for scenario in SCENARIOS:
        yield scenario(adapter)


def main() -> None:
    """Write the report."""
    report = Path(sys.argv[1])
    outcomes = []
    for outcome in run():
        print(f"{time.monotonic():6.1f} s  {outcome.scenario}", flush=True)
        outcomes.append(outcome)
    report.write_bytes(msgspec.json.encode(outcomes))


if __name__ == "__main__":
    main()
