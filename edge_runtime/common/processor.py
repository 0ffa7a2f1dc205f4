"""What this computer's processor calls itself."""

import platform
from pathlib import Path
from typing import Final

CPUINFO: Final = Path("/proc/cpuinfo")
DEVICE_TREE: Final = Path("/proc/device-tree/model")
"""Where boards without a BIOS, Jetsons among them, say what they are."""


def processor() -> str:
    """Return the processor's model, else the board's, else the architecture."""
    named = (
        line.partition(":")[2].strip()
        for line in _text(CPUINFO).splitlines()
        if line.startswith("model name")
    )
    return next(named, "") or _text(DEVICE_TREE).strip("\0 \n") or platform.machine()


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
