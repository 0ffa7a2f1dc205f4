"""One message's signals into its bytes, by a plan made once from the DBC: encoding is in every command's way.

A signal's place is a shift in the message's bytes, read as one integer, big- or little-endian as it is.
Source of the bit numbering: Vector's DBC file format, as cantools reads it.
"""

import struct
from collections.abc import Mapping
from typing import NamedTuple

from cantools.database.can import Message, Signal

_FLOATS = {16: struct.Struct(">e"), 32: struct.Struct(">f"), 64: struct.Struct(">d")}
_LARGEST_FLOAT = {16: 65504.0, 32: 3.4e38, 64: 1.7e308}


class Place(NamedTuple):
    """Where one signal stands in its message's bytes, and how."""

    low: float
    high: float
    scale: float
    offset: float
    least: int
    """Integer on the wire; unused for floats."""
    most: int
    mask: int
    shift: int
    little: bool
    floating: struct.Struct | None
    """None for integers."""


class Layout:
    """Encodes one message that has no multiplexer."""

    def __init__(self, message: Message) -> None:
        self._bytes = message.length
        self._places = {signal.name: place(signal, message.length) for signal in message.signals}
        self.ranges = {name: (place.low, place.high) for name, place in self._places.items()}
        """The least and the greatest physical value that each signal carries."""
        self._big = self._little = 0
        self._big, self._little = self._written(dict.fromkeys(self.ranges, 0.0))

    def encode(self, values: Mapping[str, float]) -> bytes:
        """Return the data; physical values saturate before they are scaled, those not given count as 0."""
        big, little = self._written(values)
        if little:
            big |= int.from_bytes(little.to_bytes(self._bytes, "little"), "big")
        return big.to_bytes(self._bytes, "big")

    def _written(self, values: Mapping[str, float]) -> tuple[int, int]:
        """Return the big-endian and the little-endian signals, each as they lie in the bytes."""
        big, little = self._big, self._little
        for name, value in values.items():
            low, high, scale, offset, least, most, mask, shift, is_little, floating = self._places[name]
            raw = ((low if value < low else high if value > high else value) - offset) / scale
            if floating is None:
                number = round(raw)
                bits = (least if number < least else most if number > most else number) & mask
            else:
                bits = int.from_bytes(floating.pack(raw), "big")
            if is_little:
                little = little & ~(mask << shift) | bits << shift
            else:
                big = big & ~(mask << shift) | bits << shift
        return big, little


def place(signal: Signal, message_bytes: int) -> Place:
    """Find a signal in a message of so many bytes."""
    low, high = _range(signal)
    little = signal.byte_order == "little_endian"
    byte, bit = divmod(signal.start, 8)
    # A big-endian signal starts with its most significant bit, and bytes count from the left.
    shift = signal.start if little else 8 * (message_bytes - 1 - byte) + bit - signal.length + 1
    return Place(
        low=low,
        high=high,
        scale=float(signal.scale),
        offset=float(signal.offset),
        least=-(1 << signal.length - 1) if signal.is_signed else 0,
        most=(1 << signal.length - signal.is_signed) - 1,
        mask=(1 << signal.length) - 1,
        shift=shift,
        little=little,
        floating=_FLOATS[signal.length] if signal.is_float else None,
    )


def _range(signal: Signal) -> tuple[float, float]:
    if signal.is_float:
        raw_high = _LARGEST_FLOAT[signal.length]
        raw_low = -raw_high
    elif signal.is_signed:
        raw_low, raw_high = -(2.0 ** (signal.length - 1)), 2.0 ** (signal.length - 1) - 1
    else:
        raw_low, raw_high = 0.0, 2.0**signal.length - 1
    low, high = sorted((raw_low * signal.scale + signal.offset, raw_high * signal.scale + signal.offset))
    if signal.minimum is not None:
        low = max(low, float(signal.minimum))
    if signal.maximum is not None:
        high = min(high, float(signal.maximum))
    return low, high
