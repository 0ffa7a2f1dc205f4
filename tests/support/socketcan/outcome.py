"""What the guest reports of each scenario."""

import msgspec


class Seen(msgspec.Struct, frozen=True):
    """A frame at the firmware's end of the bus."""

    after_s: float
    """Since the fault; before it, negative."""
    frame_id: int
    data: str
    """Hexadecimal."""


class Outcome(msgspec.Struct, frozen=True):
    """One scenario: what the firmware saw, and how the runtime learned of it."""

    scenario: str
    frames: tuple[Seen, ...]
    """From the last second before the fault on."""
    reason: str
    """What ended the runtime, in its own words; empty if it was killed."""
    refused_after_s: float | None
    """When the guard first refused a command of the runtime."""
    dropped: int
    """Frames that the bus did not take, as the guard told the runtime."""
    bus_state: str
    """Of the controller, as the kernel told it after the fault; empty if there was none."""
    stopped_by_firmware_s: float | None
    """When the firmware's own timeout stopped the robot, if it had to."""
