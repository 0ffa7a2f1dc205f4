"""Peers for the CAN tests: a chassis on a multicast bus, and a runtime in a process of its own."""

import random
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import can
import msgspec
import tomli_w
from ports import free_port
from waiting import HANG_S, until

from firmware_bridge.can.feedback import Pose
from firmware_bridge.can.link import CanOptions
from firmware_bridge.can.profile import profile_path
from firmware_bridge.guard.link import Limits
from firmware_bridge.guard.spec import GuardSpec

COMMANDS = (0x111, 0x131, 0x421, 0x441)
MARK = 0x7FF
"""Nothing of the chassis': a frame by which a test knows that all frames before it have arrived."""
_profiles = tempfile.TemporaryDirectory()


def multicast_address() -> str:
    """A bus between processes that no other test uses."""
    draw = random.SystemRandom()
    return f"udp_multicast:239.75.{draw.randrange(256)}.{draw.randrange(1, 255)}?port={free_port()[1]}"


def guard_spec(address: str, profile: str = "agilex_v2", **changes: object) -> GuardSpec:
    path = Path(profile) if profile.endswith(".toml") else profile_path(profile)
    options = msgspec.Raw(msgspec.json.encode(CanOptions(address, str(path), Pose())))
    spec = GuardSpec("can", 3, 0.1, Limits(1.5, 1.0), options, arm=True)
    return msgspec.structs.replace(spec, **changes)


def patient_profile(
    name: str = "agilex_v2", stale_s: float = HANG_S, enable_timeout_s: float = HANG_S
) -> str:
    """A copy of a packaged profile that lets firmware answer as late as a busy machine makes it."""
    source = profile_path(name)
    table = msgspec.toml.decode(source.read_bytes())
    table["dbc"] = str(source.parent / table["dbc"])
    table["enable_timeout_s"] = enable_timeout_s
    table["feedback"]["stale_s"] = dict.fromkeys(table["feedback"]["stale_s"], stale_s)
    path = Path(_profiles.name) / f"{name}_{stale_s:g}_{enable_timeout_s:g}.toml"
    path.write_text(tomli_w.dumps(table))
    return str(path)


def patient_spec(address: str, profile: str = "", **changes: object) -> GuardSpec:
    """What a guard in a process of its own is started with: nothing that must happen in time decides."""
    patient = {"deadline_s": HANG_S, **changes}
    return guard_spec(address, profile or patient_profile(), **patient)


class Chassis:
    """An AgileX chassis, protocol 2, after its manual: reports every 20 ms, obeys 0x421, records commands."""

    def __init__(self, address: str, control_mode: int = 0) -> None:
        channel, _, port = address.removeprefix("udp_multicast:").partition("?port=")
        self._channel, self._port, self._marks = channel, int(port), 0
        self.bus = can.Bus(interface="udp_multicast", channel=channel, port=self._port)
        self.frames: list[tuple[int, bytes]] = []
        self.control_mode, self.vehicle_state, self.silent = control_mode, 0, False
        self.speed = b"\0\0"
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Chassis":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self.bus.shutdown()

    def ids(self) -> list[int]:
        return [frame_id for frame_id, _ in self.frames]

    def data(self, frame_id: int) -> list[bytes]:
        return [data for sent_id, data in list(self.frames) if sent_id == frame_id]

    def wait(self, condition) -> None:
        until(condition, 0.005, lambda: f"frames: {self.frames[-20:]}")

    def settle(self) -> None:
        """Wait until whatever is under way on the bus has arrived."""
        marks = self._marks
        with can.Bus(interface="udp_multicast", channel=self._channel, port=self._port) as other:
            other.send(can.Message(arbitration_id=MARK, is_extended_id=False))
            self.wait(lambda: self._marks > marks)

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ending.is_set():
            message = self.bus.recv(max(due - time.monotonic(), 0.0))
            if message is not None and message.arbitration_id in COMMANDS:
                self._take(message)
            self._marks += message is not None and message.arbitration_id == MARK
            if time.monotonic() >= due:
                due += 0.02
                self._report()

    def _take(self, message: can.Message) -> None:
        data = bytes(message.data)
        self.frames.append((message.arbitration_id, data))
        if message.arbitration_id == 0x421 and self.control_mode != 3:
            self.control_mode = data[0]
        if message.arbitration_id == 0x111:
            self.speed = data[:2]

    def _report(self) -> None:
        if self.silent:
            return
        system = bytes([self.vehicle_state, self.control_mode, 0x01, 0x00, 0, 0, 0, 0])
        for frame_id, data in ((0x211, system), (0x221, self.speed + bytes(6))):
            self.bus.send(can.Message(arbitration_id=frame_id, data=data, is_extended_id=False))


RUNTIME = """
import sys, time, msgspec
from edge_runtime.messages import Command
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.guard.guarded_bridge import GuardedBridge
with GuardedBridge(msgspec.json.decode(sys.argv[1], type=GuardSpec)) as bridge:
    print(bridge.guard_pid, flush=True)
    for sequence in range(1_000_000):
        bridge.write(Command(3, sequence, time.monotonic(), (0.0, 0.0), (0.5, 0.0)))
        time.sleep(0.02)
"""


def start_runtime(spec: GuardSpec) -> tuple["subprocess.Popen[str]", int]:
    """Start a runtime that commands 0.5 m/s at 50 Hz; returns it and its guard's process number."""
    runtime = subprocess.Popen(
        [sys.executable, "-c", RUNTIME, msgspec.json.encode(spec).decode()],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert runtime.stdout is not None
    return runtime, int(runtime.stdout.readline())
