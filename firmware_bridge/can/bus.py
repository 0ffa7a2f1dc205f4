"""Frames over python-can: SocketCAN on a robot, UDP multicast in tests, or any other of its adapters."""

import errno
import logging
from collections.abc import Iterator
from urllib.parse import parse_qsl

import can

from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.can.frame import Frame

BUS_OFF = 0x40
"""Error class of an error frame, Linux's CAN_ERR_BUSOFF; python-can's bus state does not change with it."""
FRAMES_A_PASS = 64
"""Frames read before commands get their turn."""


def bus_arguments(address: str) -> dict[str, str | int]:
    """Read ``can0`` or ``interface:channel?key=value&...`` into python-can's arguments.

    Raises:
        ConfigError: if the address has another form.
    """
    place, _, query = address.partition("?")
    interface, colon, channel = place.partition(":")
    if not colon:
        interface, channel = "socketcan", place
    options = dict(parse_qsl(query))
    if not interface or not channel or len(options) != len(query.split("&")) - (not query):
        raise ConfigError(f"--bus {address}: expected can0, or interface:channel such as slcan:/dev/ttyACM0")
    numbers = {key: int(value) if value.isdigit() else value for key, value in options.items()}
    return {"interface": interface, "channel": channel, **numbers}


class CanBus:
    """A python-can bus as a Transport; sends each frame once and never periodically."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._arguments = bus_arguments(address)
        self._bus: can.BusABC | None = None

    def open(self) -> None:
        """Open the bus.

        Raises:
            BridgeError: if there is no such interface, or its driver is missing.
        """
        logging.getLogger("can").setLevel(logging.CRITICAL)  # What it would log is raised as well.
        try:
            self._bus = can.Bus(**self._arguments)  # type: ignore[arg-type]
            self._bus.fileno()
        except (can.CanError, OSError, ValueError, TypeError, NotImplementedError) as error:
            raise BridgeError(
                f"--bus {self._address}: cannot be opened ({error}); see `ip -details link show type can`"
            ) from error

    def close(self) -> None:
        """Shut the bus down."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def fileno(self) -> int:
        """File descriptor that is readable when frames have arrived."""
        return self._open_bus().fileno()

    def send(self, frame: Frame) -> bool:
        """Hand one frame to the driver; False if its queue is full."""
        message = can.Message(
            arbitration_id=frame.frame_id, data=frame.data, is_extended_id=frame.extended, check=False
        )
        try:
            self._open_bus().send(message, timeout=0)
        except can.CanOperationError as error:
            if _is_full(error):
                return False
            raise BridgeError(f"the bus {self._address} is lost ({error})") from error
        return True

    def receive(self) -> Iterator[Frame]:
        """Yield the frames that have arrived, at most FRAMES_A_PASS.

        Raises:
            BridgeError: on bus-off, or if the interface went down.
        """
        bus = self._open_bus()
        for _ in range(FRAMES_A_PASS):
            try:
                message = bus.recv(timeout=0)
            except (can.CanError, OSError) as error:
                raise BridgeError(f"the bus {self._address} is lost ({error})") from error
            if message is None:
                return
            if message.is_error_frame:
                self._refuse_bus_off(message)
            elif not message.is_remote_frame:
                yield Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)

    def _refuse_bus_off(self, message: can.Message) -> None:
        if message.arbitration_id & BUS_OFF:
            raise BridgeError(f"the bus {self._address} went bus-off: check wiring, termination and bit rate")

    def _open_bus(self) -> can.BusABC:
        if self._bus is None:
            raise BridgeError(f"the bus {self._address} is not open")
        return self._bus


def _is_full(error: can.CanOperationError) -> bool:
    """Whether the transmit queue is full: ENOBUFS is raised at once, whatever the timeout."""
    return error.error_code in (errno.ENOBUFS, errno.EAGAIN) or "buffer full" in str(error)
