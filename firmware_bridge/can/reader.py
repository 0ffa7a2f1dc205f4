"""One feedback message's bytes into its signals, by a plan made once from the DBC: most of a guard's work."""

from typing import SupportsFloat, cast

from cantools.database.can import Message

from firmware_bridge.can.layout import place


class Reader:
    """Decodes one message; one that is multiplexed by cantools, which takes several times as long."""

    def __init__(self, message: Message) -> None:
        self.name = message.name
        self.length = message.length
        """Bytes of its data."""
        self._message = message
        self._multiplexed = message.is_multiplexed()
        self._places = [(f"{self.name}.{s.name}", *place(s, message.length)) for s in message.signals]

    def read(self, data: bytes) -> dict[str, float]:
        """Return the physical values by ``Message.Signal``, as cantools does; a float may be no number.

        Raises:
            DecodeError: of cantools, if the data have a page that the message does not know.
        """
        if self._multiplexed:
            decoded = self._message.decode_simple(data, decode_choices=False)
            return {f"{self.name}.{name}": float(cast(SupportsFloat, v)) for name, v in decoded.items()}
        big, little = int.from_bytes(data, "big"), int.from_bytes(data, "little")
        values: dict[str, float] = {}
        for path, _, _, scale, offset, _, most, mask, shift, is_little, floating in self._places:
            bits = (little if is_little else big) >> shift & mask
            if floating is not None:
                (raw,) = floating.unpack(bits.to_bytes(floating.size, "big"))
            else:
                raw = bits if bits <= most else bits - mask - 1  # two's complement
            values[path] = raw * scale + offset
        return values
