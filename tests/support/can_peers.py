"""Peers for the CAN tests: a chassis on a multicast bus, and a runtime in a process of its own."""

import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable
from pathlib import Path

import msgspec
import tomli_w
from ports import free_port
from waiting import HANG_S, until

from firmware_bridge.can.feedback import PlanarPose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.link import CanOptions
from firmware_bridge.can.profile import profile_path
from firmware_bridge.guard.link import SetpointLimits
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.kinematics.base import BaseMotion
from firmware_bridge.sil.firmware.agilex import AgilexChassis
from firmware_bridge.sil.firmware.node import FirmwareLoop, FirmwareNode
from firmware_bridge.sil.firmware.wires import CanWire
from firmware_bridge.sil.firmware.world import BaseState
from firmware_bridge.sil.scenario.ports import multicast_bus

MARK = 0x7FF
"""Nothing of the chassis': a frame by which a test knows that all frames before it have arrived."""
_profiles = tempfile.TemporaryDirectory()


def multicast_address() -> str:
    """A bus between processes that no other test uses."""
    return multicast_bus(free_port()[1])


def guard_spec(address: str, profile: str = "agilex_v2", **changes: object) -> GuardSpec:
    path = Path(profile) if profile.endswith(".toml") else profile_path(profile)
    options = msgspec.Raw(msgspec.json.encode(CanOptions(address, str(path), PlanarPose())))
    spec = GuardSpec("can", 3, 0.1, SetpointLimits(1.5, (-1.0, -1.0), (1.0, 1.0)), options, arm=True)
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


class Obedient:
    """A plant whose only robot moves as it is told at once, and never gets anywhere."""

    def __init__(self) -> None:
        self.motion = BaseMotion()

    def step(self, motions) -> None:
        (self.motion,) = motions

    def state(self, robot: int) -> BaseState:
        return BaseState((0.0, 0.0), 0.0, self.motion.forward_m_s, self.motion.yaw_rad_s)


class Chassis(AgilexChassis):
    """The harness's chassis, served by a thread, with all patience; records commands."""

    def __init__(self, address: str, control_mode: int = 0) -> None:
        super().__init__()
        self.control_mode, self.timeout_s = control_mode, HANG_S
        self._wire, self._address, self._marks = CanWire(address), address, 0
        self.frames: list[tuple[int, bytes]] = []
        self.on_command = lambda heard: self.frames.append(heard.packet[:2])
        self._loop = FirmwareLoop(Obedient(), [FirmwareNode(self, self._wire)])
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Chassis":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def ids(self) -> list[int]:
        return [frame_id for frame_id, _ in self.frames]

    def data(self, frame_id: int) -> list[bytes]:
        return [data for sent_id, data in list(self.frames) if sent_id == frame_id]

    def wait(self, condition, by=None) -> None:
        until(condition, 0.005, lambda: f"frames: {self.frames[-20:]}", by)

    def settle(self) -> None:
        """Wait until whatever is under way on the bus has arrived."""
        marks, other = self._marks, CanWire(self._address)
        other.send(Frame(MARK, b""))
        self.wait(lambda: self._marks > marks)
        other.close()

    def _take(self, packet: Frame, arrival_s: float) -> Iterable[Frame]:
        self._marks += packet.frame_id == MARK
        return super()._take(packet, arrival_s)

    def _run(self) -> None:
        with self._loop:
            while not self._ending.is_set():
                self._loop.turn()


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
