"""The Bridge in the runtime's process: starts a guard, hands it commands, takes states back."""

import select
import signal
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from edge_runtime.common.child import start_child
from edge_runtime.control.bridge import Reaction
from edge_runtime.errors import BridgeError
from edge_runtime.messages import Command, RobotState
from firmware_bridge.guard.link import Setpoint
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.guard.wire import (
    PACKET_BYTES,
    Complaint,
    Counts,
    Event,
    Phase,
    decode_answer,
    encode_command,
    encode_stop,
)

OPENING_S = 30.0
"""Longest wait for a guard to open its link."""
STOPPING_S = 15.0
"""Longest wait for a guard to finish the stop sequence; more than its own bound."""

ENDING_S = 1.0
"""Longest wait for the system to tell how a guard ended whose socket has closed."""

MOST_POSES = 64
"""Of which the stamps are kept until somebody asks for them."""
_WITHHOLDS: Final = {
    (Phase.WATCHING, False): "nobody armed it, and --arm is not given",
    (Phase.WATCHING, True): "the guard waits for the firmware before it arms",
    (Phase.ENABLING, True): "the guard arms the robot",
    (Phase.RECOVERING, True): "the guard arms the robot again",
}
"""Why commands are kept back, by the guard's phase and whether it may arm."""

Self = TypeVar("Self", bound="GuardedBridge")


class GuardedBridge:
    """A robot behind a guard process; implements ``Bridge``.

    The guard stops the robot whenever this side goes away, so nothing here needs to be trusted.
    """

    def __init__(self, spec: GuardSpec) -> None:
        self.name: str = spec.link
        self.max_speed_m_s = spec.limits.speed_m_s
        self.max_yaw_rate_rad_s = spec.limits.yaw_rate_rad_s
        self.counts = Counts()
        """What became of the commands, as the guard last reported."""
        self.complaints: tuple[str, ...] = ()
        self.phase = Phase.WATCHING
        self._spec = spec
        self._firmware_timeout_s: float | None = None
        self._reason = ""
        self._state: RobotState | None = None
        self._new_poses: deque[float] = deque(maxlen=MOST_POSES)
        self._opened = False
        self._connected = False
        self._socket = socket.socket()
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self: Self) -> Self:
        """Start the guard and wait until it holds the bus.

        Raises:
            BridgeError: if the guard could not start, with its reason.
        """
        self._socket.close()
        self._socket, self._process = start_child("firmware_bridge.guard.process", self._spec)
        self._connected = True
        self._socket.setblocking(False)
        try:
            self._await_opening()
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the robot and wait until the guard has ended."""
        self._leave()

    @property
    def guard_pid(self) -> int:
        """Process number of the guard."""
        if self._process is None:
            raise BridgeError("the bridge is not open: use it in a with statement")
        return self._process.pid

    @property
    def poses(self: Self) -> Self:
        """This bridge, see `edge_runtime.control.start.PoseSource`."""
        return self

    def fileno(self) -> int:
        """Return the descriptor on which states arrive."""
        return self._socket.fileno()

    def new_poses(self) -> Sequence[float]:
        """Take in what has arrived; returns the stamps of the states that came since the last call."""
        self._receive()
        if not self._new_poses:
            return ()
        poses = tuple(self._new_poses)
        self._new_poses.clear()
        return poses

    @property
    def withholds(self) -> str:
        """Why the guard keeps commands back; empty while it drives."""
        return _WITHHOLDS.get((self.phase, self._spec.arm), "")

    @property
    def reaction(self) -> Reaction:
        """How this link answers faults, as far as the guard has told."""
        return Reaction(self._spec.deadline_s, self._firmware_timeout_s, self._spec.deceleration_m_s2)

    def read(self) -> RobotState | None:
        """Return the newest state, or None before the first."""
        self._receive()
        return self._state

    def write(self, command: Command) -> None:
        """Hand one command to the guard, once.

        Raises:
            BridgeError: if the guard has stopped the robot, has ended, or does not take commands.
        """
        setpoint = Setpoint(
            command.sequence, command.stamp_s, command.action, command.velocity_m_s, command.yaw_rate_rad_s
        )
        self._send(encode_command(setpoint))  # First of all; a guard that has stopped heeds no command.
        self._receive()
        if self.phase >= Phase.STOPPING:
            raise BridgeError(f"the guard stopped the robot: {self._reason}")

    def stop(self, reason: str) -> None:
        """Ask for the stop sequence and wait until it is done.

        Raises:
            BridgeError: if the guard does not report the end of the sequence.
        """
        self._receive()
        if self.phase < Phase.STOPPING:
            self._send(encode_stop(reason, time.monotonic()))
        self._await(lambda: self.phase >= Phase.STOPPED, STOPPING_S, "did not finish the stop sequence")

    def _await_opening(self) -> None:
        self._await(lambda: self._opened, OPENING_S, "did not open its link")
        if self.phase is Phase.FAILED:
            raise BridgeError(self._reason)

    def _await(self, settled: Callable[[], bool], longest_s: float, failure: str) -> None:
        end_s = time.monotonic() + longest_s
        while not settled() and self._connected:
            wait_s = end_s - time.monotonic()
            if wait_s <= 0.0:
                raise BridgeError(f"the guard {failure} within {longest_s:g} s")
            select.select((self._socket,), (), (), wait_s)
            self._receive()
        if not settled():
            raise BridgeError(f"the guard ended: {self._ending()}")

    def _send(self, packet: bytes) -> None:
        try:
            self._socket.send(packet)
        except BlockingIOError:
            raise BridgeError("the guard does not take commands: is it stopped or starved?") from None
        except OSError:
            self._receive()
            raise BridgeError(f"the guard ended: {self._ending()}") from None

    def _receive(self) -> None:
        while self._connected:
            try:
                packet = self._socket.recv(PACKET_BYTES)
            except BlockingIOError:
                return
            except OSError:
                packet = b""
            if packet:
                self._take(packet)
            else:
                self._connected = False

    def _take(self, packet: bytes) -> None:
        answer = decode_answer(packet)
        if isinstance(answer, Complaint):
            self.complaints += (answer.text,)
            return
        self.phase = answer.phase
        if isinstance(answer, Event):
            self._opened = True
            if answer.phase >= Phase.STOPPING and not self._reason:
                self._reason = answer.text
        else:
            self.counts = answer.counts
            self._firmware_timeout_s = answer.firmware_timeout_s
            if answer.state and (self._state is None or answer.state.stamp_s != self._state.stamp_s):
                self._new_poses.append(answer.state.stamp_s)
            self._state = answer.state or self._state

    def _ending(self) -> str:
        """Say why the guard ended: in its own words, or as the system saw it where it had none."""
        if self._reason or self._process is None:
            return self._reason
        try:
            code = self._process.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            return "its socket closed"
        return f"exit code {code}" if code >= 0 else f"signal {-code} ({signal.strsignal(-code)})"

    def _leave(self) -> None:
        """Close the socket, which makes the guard stop the robot, and wait for its end."""
        self._socket.close()
        self._connected = False
        if self._process is not None:
            try:
                self._process.wait(STOPPING_S)
            except subprocess.TimeoutExpired:
                raise BridgeError(
                    f"the guard (process {self._process.pid}) did not end within {STOPPING_S:g} s"
                ) from None
