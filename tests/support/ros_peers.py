"""Robots made of other people's ROS: a master, nodes by several libraries in processes of their own."""

import contextlib
import json
import os
import random
import socket
import subprocess
import threading
import time
from pathlib import Path

import msgspec
import pytest
import tomli_w
from ports import free_port
from waiting import HANG_S, until

from edge_runtime.errors import BridgeError
from edge_runtime.messages import Command
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.link import SetpointLimits
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.guard.wire import Phase
from firmware_bridge.ros.link import RosOptions
from firmware_bridge.ros.profile import load_profile, profile_path

SUPPORT = Path(__file__).parent / "ros"
BUILD = Path(__file__).parents[2] / "build" / "ros"
DEBIAN = "/usr/lib/python3/dist-packages"
SPEED_M_S = 0.5
NAMESPACE = "/a200_0000"
_claims: list[socket.socket] = []

needs_ros1 = pytest.mark.skipif(not Path(DEBIAN, "rospy").is_dir(), reason="`make ros` installs rospy")
HAVE_ROS2 = [name for name in ("kilted", "jazzy") if (BUILD / name / "bin" / "python").exists()]
needs_node = pytest.mark.skipif(
    not (BUILD / "node" / "installed.json").exists(), reason="`make ros` installs rosnodejs"
)
needs_ros2 = pytest.mark.skipif(len(HAVE_ROS2) < 2, reason="`make ros` installs two distributions of rclpy")


def site_packages(distribution: str) -> Path:
    (found,) = (BUILD / distribution / "lib").glob("python3*/site-packages")
    return found


def libraries(distribution: str) -> str:
    """What setup.bash sets for the loader: the wheels keep their libraries in several folders."""
    folders = [BUILD / distribution / "lib", *site_packages(distribution).glob("ros_*.libs")]
    return os.pathsep.join(map(str, folders))


def environment() -> dict[str, str]:
    """What peers are started with: their own libraries, and rosnodejs's messages."""
    node = BUILD / "node"
    paths = {
        "NODE_PATH": node / "node_modules", "CMAKE_PREFIX_PATH": node / "generated",
        "ROS_PACKAGE_PATH": node / "definitions",
    }  # fmt: skip
    kept = {name: value for name, value in os.environ.items() if name != "LD_LIBRARY_PATH"}
    return kept | {name: str(path) for name, path in paths.items()}


class Peer:
    """A node in a process of its own; what it heard is in ``commands``."""

    def __init__(self, command: list[str], config: dict[str, object]) -> None:
        self.commands: list[dict[str, object]] = []
        self.timeouts: list[dict[str, object]] = []
        """Each time that its controller stopped by itself."""
        self._answers: list[dict[str, object]] = []
        self._log = []
        self.process = subprocess.Popen(
            [*command, json.dumps(config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=SUPPORT / "peers",
            env=environment(),
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Peer":
        self.wait(lambda: self._answers)
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self.process.stdin.write('["end"]\n')
            self.process.stdin.close()
        try:
            self.process.wait(HANG_S)
        finally:
            self.process.kill()

    def tell(self, *words: object) -> None:
        """Have it do something, and wait until it has."""
        done = len(self._answers)
        self.process.stdin.write(json.dumps(words) + "\n")
        self.process.stdin.flush()
        self.wait(lambda: len(self._answers) > done)

    def wait(self, condition, tell=lambda: "") -> None:
        until(
            condition, 0.005, lambda: f"{tell()} {self._log[-5:]}, heard {self.commands[-5:]}", self.process
        )

    def forward(self) -> list[float]:
        return [heard["command"][0] for heard in list(self.commands)]

    def _listen(self) -> None:
        for line in self.process.stdout:
            try:
                words = json.loads(line)
            except ValueError:
                self._log.append(line)
                continue
            kinds = {"command": self.commands, "timed_out": self.timeouts}
            kinds.get(next(iter(words)), self._answers).append(words)


class Ros:
    """One ROS as a test needs it: who the peers are, what a guard is started with."""

    def __init__(self, kind: int, library: str, profile: str = "") -> None:
        self.kind, self.library = kind, library
        self.profile = profile or ("husky_noetic" if kind == 1 else "clearpath_jazzy")
        self.message = load_profile(profile_path(self.profile)).message

    def peer(self, **changes: object) -> Peer:
        stem = {"kilted": "rclpy", "jazzy": "rclpy"}.get(self.library, self.library)
        config = {**self.robot(), **changes}
        if stem == "rosnodejs":
            return Peer(["node", "rosnodejs_peer.js"], config)
        python = "/usr/bin/python3" if stem == "rospy" else str(BUILD / self.library / "bin" / "python")
        return Peer([python, f"{stem}_peer.py"], config)

    def robot(self) -> dict[str, object]:
        if self.kind == 1:
            controller = "/husky_velocity_controller"
            return {
                "node": "robot", "message": self.message, "command": "/cmd_vel",
                "odometry": f"{controller}/odom", "stop": "/e_stop",
                "parameter": f"{controller}/cmd_vel_timeout", "timeout": 0.25,
            }  # fmt: skip
        controller = f"{NAMESPACE}/platform_velocity_controller"
        return {
            "node": controller, "message": self.message, "command": f"{NAMESPACE}/cmd_vel",
            "odometry": f"{NAMESPACE}/platform/odom", "stop": f"{NAMESPACE}/platform/emergency_stop",
            "parameter": f"{controller}/cmd_vel_timeout", "timeout": 0.5,
        }  # fmt: skip

    def options(self, **changes: object) -> RosOptions:
        path = (DEBIAN,) if self.kind == 1 else (str(site_packages("kilted")),)
        namespace = "" if self.kind == 1 else NAMESPACE
        options = RosOptions(self.kind, str(profile_path(self.profile)), namespace, python_path=path)
        return msgspec.structs.replace(options, **changes)

    def spec(self, deadline_s: float = HANG_S, **changes: object) -> GuardSpec:
        options = msgspec.Raw(msgspec.json.encode(self.options(**changes)))
        return GuardSpec(
            f"ros{self.kind}", 0, deadline_s, SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0)), options, arm=True
        )

    def profile_with(self, folder: Path, **changes: object) -> str:
        """A copy of the packaged profile; what is stale is so much later than a busy machine makes it."""
        table = msgspec.toml.decode(profile_path(self.profile).read_bytes())
        table.pop("emergency_stop_silent_s", None)
        path = folder / "changed.toml"
        path.write_text(tomli_w.dumps({"stale_s": 5.0, "recoveries": 0, **table, **changes}))
        return str(path)


def drive(bridge: GuardedBridge, enough, sequence: int = 0, period_s: float = 0.02) -> int:
    """Command straight on until enough has happened; returns the next command's number."""

    def step() -> bool:
        nonlocal sequence
        bridge.read()
        bridge.write(Command(0, sequence, time.monotonic(), (0.0, 0.0), (SPEED_M_S, 0.0)))
        sequence += 1
        return enough()

    until(step, period_s, lambda: f"{bridge.phase.name} {bridge.counts}")
    return sequence


def stopped(bridge: GuardedBridge) -> str:
    """Command until the guard has stopped the robot; returns the line that says why."""
    with pytest.raises(BridgeError) as caught:
        drive(bridge, lambda: False)
    until(lambda: bridge.read() and bridge.phase >= Phase.STOPPED)
    return str(caught.value)


@contextlib.contextmanager
def master(monkeypatch, place=None):
    """A ROS 1 master at a host and port, by default of its own."""
    host, port = place or free_port()
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{host}:{port}")
    monkeypatch.setenv("ROS_IP", host)
    process = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL)
    try:
        until(lambda: _answers(host, port), by=process)
        yield process
    finally:
        process.terminate()
        process.wait(HANG_S)


def _answers(host: str, port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection((host, port)):
        return True
    return False


def _free_domain() -> int:
    """One that this process alone has taken: by a name that the kernel gives only once."""
    while True:
        number, claim = random.SystemRandom().randrange(1, 100), socket.socket(socket.AF_UNIX)
        with contextlib.suppress(OSError):
            claim.bind(f"\0a ROS domain for a test: {number}")
            _claims.append(claim)
            return number


def domain(monkeypatch) -> None:
    """A ROS 2 domain that no other test uses, on the loopback alone."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(_free_domain()))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("LD_LIBRARY_PATH", libraries("kilted"))
