"""An ODrive's own watchdog over CANSimple: read through its parameters and, where allowed, turned on.

RxSdo (command 0x04): opcode, endpoint id (2 bytes), reserved, value. TxSdo (0x05) answers a read: reserved,
endpoint id, reserved, value. Little endian. Source: ODrive's documentation, "CAN Protocol", "CAN Bus Guide".
"""

import struct

import msgspec

from edge_runtime.errors import BridgeError
from firmware_bridge.can.asking import ask
from firmware_bridge.can.frame import Frame, Transport

_GET_VERSION, _RX_SDO, _TX_SDO = 0x00, 0x04, 0x05
_READ, _WRITE = 0, 1
_SDO = struct.Struct("<BHB")
_FLOAT = struct.Struct("<f")


class Watchdog(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The drives' own command timeout; off when they leave the factory."""

    timeout_s: float
    """What ``--arm`` sets."""
    nodes: tuple[int, ...]
    """CAN ids of the drives."""
    firmware: str
    """Version of the drives, such as 0.6.10: endpoint ids differ from one to the next."""
    timeout_endpoint: int
    """Id of axis0.config.watchdog_timeout in that version's flat_endpoints.json."""
    enable_endpoint: int
    """Id of axis0.config.enable_watchdog."""

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout_s <= 1.0:
            raise ValueError(f"`timeout_s` must lie in (0, 1], got {self.timeout_s}")
        if not self.nodes or not all(0 <= node < 64 for node in self.nodes):
            raise ValueError(f"`nodes` must be node ids in [0, 63], got {list(self.nodes)}")
        for endpoint in (self.timeout_endpoint, self.enable_endpoint):
            if not 0 < endpoint < 2**16:
                raise ValueError(f"endpoint ids must lie in [1, 65535], got {endpoint}")


def watchdog_timeout_s(transport: Transport, watchdog: Watchdog, turn_on: bool) -> float:
    """Return the drives' longest timeout in s as they tell it, 0 if the watchdog of one is off.

    With ``turn_on`` it is set first, and read back. Blocks for some 10 ms, longer if a drive is silent.

    Raises:
        BridgeError: if a drive does not answer, has another firmware, or does not keep what was set.
    """
    drives = [_Drive(transport, node) for node in watchdog.nodes]
    for drive in drives:  # Endpoints of another firmware are other parameters: ask before anything is set.
        drive.check_version(watchdog.firmware)
        if turn_on:
            drive.turn_on(watchdog)
    timeouts_s = [drive.timeout_s(watchdog) for drive in drives]
    return max(timeouts_s) if all(timeouts_s) else 0.0


class _Drive:
    """One node on an open bus."""

    def __init__(self, transport: Transport, node: int) -> None:
        self._transport = transport
        self._node = node

    def check_version(self, expected: str) -> None:
        answer = self._ask(_GET_VERSION, b"", _GET_VERSION, b"")
        version = ".".join(map(str, answer[4:7]))
        if version != expected:
            raise BridgeError(
                f"ODrive node {self._node} has firmware {version}: put its endpoint ids and "
                f"firmware = {version!r} into the profile's [watchdog], it says {expected}"
            )

    def turn_on(self, watchdog: Watchdog) -> None:
        """Set the timeout, and only then the watchdog: one that is on at 0 s stops the drive at once."""
        self._set(watchdog.timeout_endpoint, _FLOAT.pack(watchdog.timeout_s), "watchdog_timeout")
        self._set(watchdog.enable_endpoint, b"\1", "enable_watchdog")

    def timeout_s(self, watchdog: Watchdog) -> float:
        """Return the timeout in s as the drive tells it, 0 if it is off."""
        if self._read(watchdog.enable_endpoint)[0] == 0:
            return 0.0
        return float(_FLOAT.unpack(self._read(watchdog.timeout_endpoint))[0])

    def _set(self, endpoint: int, value: bytes, name: str) -> None:
        if not self._transport.send(self._frame(_RX_SDO, _SDO.pack(_WRITE, endpoint, 0) + value)):
            raise BridgeError(f"ODrive node {self._node}: the transmit queue is full, is the bus connected?")
        kept = self._read(endpoint)[: len(value)]
        if kept != value:
            raise BridgeError(
                f"ODrive node {self._node} keeps axis0.config.{name} at {kept.hex()}, not {value.hex()}: is "
                f"{endpoint} its id in the firmware's flat_endpoints.json?"
            )

    def _read(self, endpoint: int) -> bytes:
        """Return the four bytes of a parameter, zero where it has fewer."""
        request = _SDO.pack(_READ, endpoint, 0)
        return self._ask(_RX_SDO, request, _TX_SDO, request[1:3])[4:].ljust(4, b"\0")

    def _ask(self, command: int, request: bytes, answer: int, place: bytes) -> bytes:
        """Send until a frame answers that is longer than a request and has ``place`` at byte 1."""
        frame_id = self._frame(answer).frame_id

        def understand(frame: Frame) -> bytes | None:
            long = frame.frame_id == frame_id and not frame.extended and len(frame.data) > _SDO.size
            return frame.data if long and frame.data[1:].startswith(place) else None

        return ask(self._transport, self._frame(command, request), understand, f"ODrive node {self._node}")

    def _frame(self, command: int, data: bytes = b"") -> Frame:
        return Frame(self._node << 5 | command, data)
