"""What Linux tells of a CAN interface, read from ``ip -details -json link show``."""

import shutil
import subprocess

import msgspec

from edge_runtime.errors import BridgeError

LONGEST_FRAME_BITS = 160
"""A 29-bit frame of 8 bytes with all its stuff bits and the gap behind it."""
FASTEST_BITRATE = 1_000_000
"""Bits a second of the fastest classical CAN bus."""
ASKING_S = 5.0


class BitTiming(msgspec.Struct, frozen=True):
    """Of the arbitration phase."""

    bitrate: int = 0
    """Bits a second; 0 until it is set."""


class Controller(msgspec.Struct, frozen=True):
    """What only a real CAN controller has."""

    state: str = ""
    """ERROR-ACTIVE, ERROR-WARNING, ERROR-PASSIVE, BUS-OFF, STOPPED or SLEEPING."""
    restart_ms: int = 0
    """Time from bus-off to joining the bus again; 0: only by hand."""
    bittiming: BitTiming = BitTiming()
    bittiming_bitrate: int = 0
    """In place of ``bittiming`` where the adapter knows fixed rates only."""


class LinkInfo(msgspec.Struct, frozen=True):
    """The kind of an interface, and what is particular to it."""

    info_kind: str = ""
    """``can``, ``vcan`` (which has no controller) or something that is no CAN bus."""
    info_data: Controller = Controller()


class Interface(msgspec.Struct, frozen=True):
    """One interface; names as the tool prints them."""

    ifname: str
    flags: tuple[str, ...] = ()
    txqlen: int = 0
    """Frames that may wait to be sent."""
    linkinfo: LinkInfo = LinkInfo()

    @property
    def bitrate(self) -> int:
        """Bits a second; 0 if unknown."""
        return self.linkinfo.info_data.bittiming.bitrate or self.linkinfo.info_data.bittiming_bitrate

    @property
    def queue_s(self) -> float:
        """Time that a full queue takes on an otherwise idle bus; at an unknown bit rate, the least."""
        return self.txqlen * LONGEST_FRAME_BITS / (self.bitrate or FASTEST_BITRATE)


def show_interface(name: str) -> Interface:
    """Ask the system for an interface; changes nothing.

    Raises:
        BridgeError: if it does not exist, or the system cannot be asked.
    """
    ip = shutil.which("ip")
    if ip is None:
        raise BridgeError("the command `ip` is missing; run: apt install iproute2")
    try:
        done = subprocess.run(  # noqa: S603 - no shell; the name comes from our own user
            [ip, "-details", "-json", "link", "show", "dev", name],
            capture_output=True,
            timeout=ASKING_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise BridgeError(f"`ip link show dev {name}` did not answer within {ASKING_S:g} s") from error
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip().rstrip(".")
        raise BridgeError(f"{said or name}; is the adapter plugged in? see: ip link show type can")
    return parse_interface(done.stdout)


def parse_interface(output: bytes) -> Interface:
    """Read the tool's JSON, a list of one interface.

    Raises:
        BridgeError: if it is anything else.
    """
    try:
        (interface,) = msgspec.json.decode(output, type=tuple[Interface])
    except msgspec.DecodeError as error:
        raise BridgeError(
            f"`ip -details -json link show` printed what is not understood ({error})"
        ) from error
    return interface
