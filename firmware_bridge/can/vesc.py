"""What a VESC does when its commands end, as it tells: its timeout, and the brake current after it.

COMM_GET_APPCONF goes out in one frame (command 8: our id, 0, 17). The answer comes to our id in pieces of
seven bytes (command 5: offset, bytes): 17, signature (4 bytes), controller id, timeout in ms (4), brake
current in A (4-byte float), and much more that differs by version. Big endian. Source: vedderb/bldc, commit
b9d287b (7.01) and branches release_5_03 to release_7_00, comm/comm_can.c and confgenerator.c.
"""

import struct

import msgspec

from firmware_bridge.can.asking import ask
from firmware_bridge.can.frame import Frame, Transport

LAST_ID = 0xFD
"""Controller ids from here down are ours, one for each VESC to answer to: their pieces cannot be mixed up."""
MOST_VESCS = 16
_PIECE, _SHORT = 5, 8
_GET_APPCONF = 17
_ANSWER = struct.Struct(">BIBIf")
_PIECE_BYTES = 7


class Vescs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """VESCs that are asked for their timeout."""

    controllers: tuple[int, ...]
    """CAN ids of the VESCs."""

    def __post_init__(self) -> None:
        most = LAST_ID - MOST_VESCS
        ids = self.controllers
        if not 0 < len(ids) <= MOST_VESCS or not all(0 <= number <= most for number in ids):
            raise ValueError(f"`controllers` must be up to {MOST_VESCS} ids in [0, {most}], got {list(ids)}")


def command_timeout_s(transport: Transport, vescs: Vescs) -> tuple[float, str]:
    """Return the longest timeout in s, and who told it; 0 if one VESC has none, or rolls on after it.

    Raises:
        BridgeError: if one does not answer.
    """
    told = {
        number: _ask(transport, number, LAST_ID - index) for index, number in enumerate(vescs.controllers)
    }
    for number, (timeout_s, brake_a) in told.items():
        if not timeout_s:
            return 0.0, f"as VESC {number} answers"
        if not brake_a > 0.0:
            return (
                0.0,
                f"VESC {number} lets the wheel roll on after {timeout_s:g} s: no timeout brake current",
            )
    return max(timeout_s for timeout_s, _ in told.values()), "as the VESCs answer"


def _ask(transport: Transport, number: int, our_id: int) -> tuple[float, float]:
    """Return timeout (s) and brake current (A) of one VESC."""
    pieces: dict[int, bytes] = {}

    def understand(frame: Frame) -> tuple[float, float] | None:
        if frame.frame_id == _PIECE << 8 | our_id and frame.extended and frame.data:
            pieces[frame.data[0]] = frame.data[1:]
        head = pieces.get(0, b"") + pieces.get(_PIECE_BYTES, b"")
        if len(head) < _ANSWER.size:
            return None
        command, _, who, timeout_ms, brake_a = _ANSWER.unpack_from(head)
        return (timeout_ms * 1e-3, brake_a) if (command, who) == (_GET_APPCONF, number) else None

    question = Frame(_SHORT << 8 | number, bytes((our_id, 0, _GET_APPCONF)), extended=True)
    return ask(transport, question, understand, f"VESC {number}")
