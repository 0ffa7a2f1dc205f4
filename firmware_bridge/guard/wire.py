"""Frames between runtime and guard: one fixed-layout struct per AF_UNIX SOCK_SEQPACKET packet.

Every frame starts with magic, kind, sequence and a CLOCK_MONOTONIC stamp, which both processes share.
"""

import enum
import math
import struct

import msgspec

from edge_runtime.messages import LONGEST_ACTION, RobotState, Vector
from firmware_bridge.guard.link import Setpoint

MAGIC = 0xCF63
"""Marks the layouts below; change it with any of them."""
PACKET_BYTES = 512
"""More than the longest frame."""

_HEADER = struct.Struct("<HBxQd")
_COMMANDS = {
    (action, dims): struct.Struct(f"<HBxQdBB6x{action + dims + 1}d")
    for action in range(1, LONGEST_ACTION + 1)
    for dims in (2, 3)
}
"""By the numbers of components of action and velocity, which stand before them; the yaw rate comes last."""
_SHAPE_AT = _HEADER.size
_STOP = struct.Struct("<HBxQd96s")
_REPORT = struct.Struct("<HBxQdBB8d5Qd")
"""The second byte: components of position and velocity, 0 without a state; three of each are sent."""
_EVENT = struct.Struct("<HBxQdB240s")


class Kind(enum.IntEnum):
    """What a frame carries; the first two go to the guard, the others come from it."""

    COMMAND = 1
    STOP = 2
    REPORT = 3
    EVENT = 4
    COMPLAINT = 5


_COMMAND_MARK = struct.pack("<HB", MAGIC, Kind.COMMAND)
_REPORT_MARK = struct.pack("<HB", MAGIC, Kind.REPORT)


class Phase(enum.IntEnum):
    """Where the guard stands. It only moves forward, except between DRIVING and RECOVERING."""

    WATCHING = 0
    """Open, listening, has never touched the robot."""
    ENABLING = 1
    DRIVING = 2
    RECOVERING = 3
    STOPPING = 4
    STOPPED = 5
    """Latched: only a new guard drives again."""
    FAILED = 6
    """The guard could not start, or something failed that it does not know; a moving robot is stopped."""


class Counts(msgspec.Struct, frozen=True, gc=False):
    """What became of the commands."""

    forwarded: int = 0
    refused: int = 0
    """Stale or duplicate."""
    withheld: int = 0
    """Valid, while the robot was not driving."""
    dropped: int = 0
    """Frames that the bus did not take."""
    recoveries: int = 0


class StopRequest(msgspec.Struct, frozen=True, gc=False):
    """The runtime asks for the stop sequence."""

    reason: str


class Report(msgspec.Struct, frozen=True, gc=False):
    """The robot's newest state, if any, the guard's, and what the firmware says of itself."""

    phase: Phase
    counts: Counts
    state: RobotState | None
    firmware_timeout_s: float | None = None
    """Silence after which the firmware stops by itself; None: unknown, 0: off."""


class Event(msgspec.Struct, frozen=True, gc=False):
    """A change of phase and its cause."""

    phase: Phase
    text: str


class Complaint(msgspec.Struct, frozen=True, gc=False):
    """What the firmware complains of; nothing changes for it."""

    text: str


class WireError(ValueError):
    """A packet that no correct peer sends."""


def encode_command(setpoint: Setpoint) -> bytes:
    """Return the packet of one command."""
    shape = len(setpoint.action), len(setpoint.velocity_m_s)
    return _COMMANDS[shape].pack(
        MAGIC,
        Kind.COMMAND,
        setpoint.sequence,
        setpoint.stamp_s,
        *shape,
        *setpoint.action,
        *setpoint.velocity_m_s,
        setpoint.yaw_rate_rad_s,
    )


def encode_stop(reason: str, stamp_s: float) -> bytes:
    """Return the packet that asks for a stop."""
    return _STOP.pack(MAGIC, Kind.STOP, 0, stamp_s, _text(reason, 96))


def decode_request(packet: bytes) -> Setpoint | StopRequest:
    """Read a packet in the guard; whether the numbers are sane is the guard's business.

    Raises:
        WireError: if it is not exactly one command or stop.
    """
    if packet.startswith(_COMMAND_MARK) and len(packet) > _SHAPE_AT + 1:
        return _command(packet)
    kind = _kind(packet)
    if kind == Kind.STOP and len(packet) == _STOP.size:
        return StopRequest(_untext(_STOP.unpack(packet)[4]))
    raise WireError(f"kind {kind} in {len(packet)} bytes")


def encode_report(report: Report, stamp_s: float) -> bytes:
    """Return the packet of a report; ``stamp_s`` stands in where there is no state yet."""
    state, counts = report.state, report.counts
    numbers: Vector = (0.0,) * 8
    dims = 0
    if state is not None:
        dims = len(state.position_m)
        rest = (0.0,) * (3 - dims)
        turn = state.heading_rad, state.yaw_rate_rad_s
        numbers = (*state.position_m, *rest, *state.velocity_m_s, *rest, *turn)
    return _REPORT.pack(
        MAGIC,
        Kind.REPORT,
        0 if state is None else state.robot_id,
        stamp_s if state is None else state.stamp_s,
        report.phase,
        dims,
        *numbers,
        *msgspec.structs.astuple(counts),
        math.nan if report.firmware_timeout_s is None else report.firmware_timeout_s,
    )


def encode_event(event: Event | Complaint, stamp_s: float) -> bytes:
    """Return the packet of an event or a complaint."""
    if isinstance(event, Complaint):
        return _EVENT.pack(MAGIC, Kind.COMPLAINT, 0, stamp_s, 0, _text(event.text, 240))
    return _EVENT.pack(MAGIC, Kind.EVENT, 0, stamp_s, event.phase, _text(event.text, 240))


def decode_answer(packet: bytes) -> Report | Event | Complaint:
    """Read a packet in the runtime.

    Raises:
        WireError: if it is not exactly one report, event or complaint.
    """
    if packet.startswith(_REPORT_MARK) and len(packet) == _REPORT.size:
        return _report(packet)
    kind = _kind(packet)
    if kind == Kind.COMPLAINT and len(packet) == _EVENT.size:
        return Complaint(_untext(_EVENT.unpack(packet)[5]))
    if kind == Kind.EVENT and len(packet) == _EVENT.size:
        _, _, _, _, phase, text = _EVENT.unpack(packet)
        return Event(_phase(phase), _untext(text))
    raise WireError(f"kind {kind} in {len(packet)} bytes")


def _report(packet: bytes) -> Report:
    _, _, robot_id, stamp_s, phase, dims, *numbers, timeout_s = _REPORT.unpack(packet)
    place, speed, turn, counts = numbers[:3], numbers[3:6], numbers[6:8], numbers[8:]
    if dims not in (0, 2, 3):
        raise WireError(f"a state of {dims} components")
    state = RobotState(robot_id, stamp_s, tuple(place[:dims]), tuple(speed[:dims]), *turn)
    known = None if math.isnan(timeout_s) else timeout_s
    return Report(_phase(phase), Counts(*counts), state if dims else None, known)


def _command(packet: bytes) -> Setpoint:
    action, dims = packet[_SHAPE_AT], packet[_SHAPE_AT + 1]
    layout = _COMMANDS.get((action, dims))
    if layout is None or len(packet) != layout.size:
        raise WireError(f"an action of {action} and a velocity of {dims} components in {len(packet)} bytes")
    _, _, sequence, stamp_s, _, _, *numbers = layout.unpack(packet)
    return Setpoint(sequence, stamp_s, tuple(numbers[:action]), tuple(numbers[action:-1]), numbers[-1])


def _kind(packet: bytes) -> int:
    if len(packet) < _HEADER.size:
        raise WireError(f"{len(packet)} bytes are no frame")
    magic, kind, _, _ = _HEADER.unpack_from(packet)
    if magic != MAGIC:
        raise WireError(f"magic {magic:#06x} instead of {MAGIC:#06x}")
    return int(kind)


def _phase(number: int) -> Phase:
    try:
        return Phase(number)
    except ValueError:
        raise WireError(f"phase {number}") from None


def _text(text: str, size: int) -> bytes:
    return text.encode()[:size]


def _untext(raw: bytes) -> str:
    return raw.rstrip(b"\0").decode(errors="replace")
