"""Frames over python-can: SocketCAN on a robot, UDP multicast in tests, or any other of its adapters."""

import contextlib
import errno
import importlib
import inspect
import logging
import re
from collections.abc import Iterable, Iterator
from urllib.parse import parse_qsl

import can
from can.interfaces import BACKENDS
from can.interfaces.slcan import slcanBus
from can.interfaces.socketcan import SocketcanBus
from can.typechecking import CanFilter
from can.util import cast_from_string

from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.can.frame import Frame, Identifier

BUS_OFF = 0x40
"""Error class of an error frame, Linux's CAN_ERR_BUSOFF; python-can's bus state does not change with it."""
SIMULATED = "sim"
"""The address of a bus with a simulated chassis on it, and nothing plugged in."""
SIMULATED_KIND = ("agilex_v2.dbc", "differential")
"""DBC and base of the profiles that such a chassis is for."""
FRAMES_A_PASS = 64
"""Frames read before commands get their turn."""


def bus_arguments(address: str) -> dict[str, str | int | float | bool]:
    """Read ``can0``, ``sim`` or ``interface:channel?key=value&...`` into python-can's arguments.

    Raises:
        ConfigError: if the address has another form, or gives what the interface does not know.
    """
    if address == SIMULATED:
        return {"interface": "cfpg_sim", "channel": SIMULATED}
    place, _, query = address.partition("?")
    interface, colon, channel = place.partition(":")
    if not colon:
        interface, channel = "socketcan", place
    options = dict(parse_qsl(query))
    if not interface or not channel or len(options) != len(query.split("&")) - (not query):
        raise ConfigError(f"--bus {address}: expected can0, or interface:channel such as slcan:/dev/ttyACM0")
    known = _options_of(interface)
    for key in options:
        if known and key not in known:
            raise ConfigError(f"--bus {address}: {interface} knows no {key!r}; it knows: {', '.join(known)}")
    values = {key: cast_from_string(value) for key, value in options.items()}
    return {"interface": interface, "channel": channel, **values}


def _options_of(interface: str) -> list[str]:
    """Return what an interface's constructor names or documents; nothing if its driver is missing.

    python-can's interfaces take any keyword and forget those that they do not know.
    """
    logging.getLogger("can").setLevel(logging.CRITICAL)  # What it would log is raised as well.
    module, name = BACKENDS.get(interface, ("", ""))
    try:
        kind = getattr(importlib.import_module(module), name)
    except Exception:  # noqa: BLE001 - a driver may fail in any way while it is imported; opening it says how
        return []
    documented = re.findall(r":param (?:[^:\n]+ )?(\w+):", f"{kind.__doc__}{kind.__init__.__doc__}")
    named = {*inspect.signature(kind.__init__).parameters, *documented}
    return sorted(named - {"self", "channel", "kwargs"})


class CanBus:
    """A python-can bus as a Transport; sends each frame once and never periodically."""

    def __init__(self, address: str) -> None:
        self.malformed = 0
        """Frames so far that the adapter's driver could not read."""
        self._address = address
        self._arguments = bus_arguments(address)
        self._bus: can.BusABC | None = None

    def open(self) -> None:
        """Open the bus as the address says: python-can's own files and variables count for nothing.

        Raises:
            BridgeError: if there is no such interface, or its driver is missing.
        """
        try:
            self._bus = can.Bus(ignore_config=True, **self._arguments)  # type: ignore[arg-type]
            self._bus.fileno()
        except Exception as error:  # an adapter's driver raises what it likes
            raise BridgeError(
                f"--bus {self._address}: cannot be opened ({error}); see `ip -details link show type can`"
            ) from error

    def close(self) -> None:
        """Shut the bus down; an adapter that is gone needs no farewell."""
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def hear_only(self, identifiers: Iterable[Identifier]) -> None:
        """Have the kernel drop other data frames, if it knows frames; errors of the bus still come."""
        bus = self._open_bus()
        if isinstance(bus, SocketcanBus):
            masks = {False: 0x7FF, True: 0x1FFFFFFF}
            bus.set_filters([CanFilter(can_id=i, can_mask=masks[e], extended=e) for i, e in identifiers])

    def fileno(self) -> int:
        """File descriptor that is readable when frames have arrived."""
        return self._open_bus().fileno()

    def send(self, frame: Frame) -> bool:
        """Hand one frame to the driver; False if its queue is full."""
        message = can.Message(
            arbitration_id=frame.frame_id, data=frame.data, is_extended_id=frame.extended, check=False
        )
        bus = self._open_bus()
        try:
            bus.send(message, timeout=0)
        except Exception as error:  # an adapter's driver raises what it likes
            if _is_full(error):
                return False
            raise BridgeError(f"the bus {self._address} is lost ({error})") from error
        return True

    def receive(self) -> Iterator[Frame]:
        """Yield the frames that have arrived, at most FRAMES_A_PASS; those that cannot be read are counted.

        Raises:
            BridgeError: on bus-off, or if the interface went down.
        """
        bus = self._open_bus()
        for _ in range(FRAMES_A_PASS):
            try:
                message = bus.recv(timeout=0)
            except Exception as error:  # an adapter's driver raises what it likes
                if _is_lost(error):
                    raise BridgeError(f"the bus {self._address} is lost ({error})") from error
                self.malformed += 1
                _skip_line(bus, error)
                continue
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


def _is_full(error: Exception) -> bool:
    """Whether the transmit queue is full: ENOBUFS is raised at once, whatever the timeout."""
    code = getattr(error, "error_code", None)
    return code in (errno.ENOBUFS, errno.EAGAIN) or "buffer full" in str(error)


def _is_lost(error: Exception) -> bool:
    """Whether the system or the adapter failed; all else comes from the bytes of one frame."""
    return isinstance(error.__cause__ or error, (OSError, can.CanError))


def _skip_line(bus: can.BusABC, error: Exception) -> None:
    """Discard what slcan keeps of a line that is no text: it would stumble over it for ever."""
    if isinstance(bus, slcanBus) and isinstance(error.__cause__, UnicodeDecodeError):
        bus.flush()
