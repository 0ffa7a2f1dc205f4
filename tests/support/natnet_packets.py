"""Builds NatNet packets as Motive sends them, by the SDK's published layout, for both bitstreams."""

import socket
import struct

MARKER = struct.pack("<3f", 1.0, 2.0, 3.0)


def packet(message, payload):
    return struct.pack("<HH", message, len(payload)) + payload


def server_info(version=(4, 1), group=None, port=1511):
    name = b"Motive".ljust(256, b"\0")
    address = socket.inet_aton(group) if group else bytes(4)
    multicast = struct.pack("<QH?", 10**7, port, group is not None) + address
    return packet(1, name + bytes([3, 1, 0, 0, *version, 0, 0]) + multicast)


def rigid_body(number, position, quaternion=(0.0, 0.0, 0.0, 1.0), tracked=True):
    return struct.pack("<i3f4ffh", number, *position, *quaternion, 1e-4, int(tracked))


def listed(entries, version):
    """Count, from 4.1 on the size, and the entries."""
    body = b"".join(entries)
    size = struct.pack("<i", len(body)) if version >= (4, 1) else b""
    return struct.pack("<i", len(entries)) + size + body


def frame(bodies, stamp_s, version=(4, 1), marker_sets=2, unlabelled=3):
    """A frame of data with everything that may stand before and after the rigid bodies."""
    sets = [b"set\0" + struct.pack("<i", index) + MARKER * index for index in range(marker_sets)]
    skeleton = struct.pack("<ii", 5, 1) + rigid_body(77, (9.0, 9.0, 9.0))
    labelled = struct.pack("<i3ffhf", 1, 1.0, 2.0, 3.0, 0.01, 0, 0.0)
    parts = [
        struct.pack("<i", 1234),
        listed(sets, version),
        listed([MARKER] * unlabelled, version),
        listed(bodies, version),
        listed([skeleton], version),
        listed([], version) if version >= (4, 1) else b"",  # assets
        listed([labelled], version),
        listed([], version),  # force plates
        listed([], version),  # devices
        struct.pack("<IIdQQQ", 0, 0, stamp_s, 1, 2, 3),
        struct.pack("<II", 4, 5) if version >= (4, 1) else b"",
        struct.pack("<hi", 0, 0),
    ]
    return packet(7, b"".join(parts))
