"""Checks of what decides how late a wake-up may come: the kernel, and on a Jetson its power mode."""

import platform
import re
import shutil
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from edge_runtime.doctor.finding import Finding, examine, ok, warn

REALTIME: Final = Path("/sys/kernel/realtime")
"""Holds a 1 where the kernel is PREEMPT_RT."""
MODES: Final = Path("/etc/nvpmodel.conf")
ASKING_S: Final = 10.0


def examine_kernel(*, wants_realtime: bool) -> Iterator[Finding]:
    """Check the kernel, and the power mode where there are any."""
    yield examine("kernel", partial(kernel, wants_realtime))
    if shutil.which("nvpmodel"):
        yield examine("power mode", power_mode)


def kernel(wants_realtime: bool) -> Finding:
    """Which kernel runs, and whether it is made for real time."""
    named = f"{platform.system()} {platform.release()}"
    if _preempts():
        return ok(f"{named}, PREEMPT_RT")
    late = f"{named}, not PREEMPT_RT: under load a wake-up may come some milliseconds late"
    return warn(late, "see docs/jetson.md for a real-time kernel") if wants_realtime else ok(late)


def _preempts() -> bool:
    told = REALTIME.read_text().strip() == "1" if REALTIME.is_file() else False
    return told or "PREEMPT_RT" in platform.version()


def power_mode() -> Finding:
    """Whether a Jetson runs in its fastest mode, which is not always number 0."""
    done = subprocess.run(
        ["nvpmodel", "-q"],  # noqa: S607  # NVIDIA's own, wherever its release has it
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=ASKING_S,
    )
    found = re.search(r"NV Power Mode:\s*(\S+)\s+(\d+)", done.stdout)
    if found is None:
        cause = " ".join((done.stderr or done.stdout).split())
        return warn(f"nvpmodel -q does not tell it: {cause}", "run: sudo nvpmodel -q")
    name, number = found[1], int(found[2])
    fastest = _fastest(MODES.read_text(errors="replace")) if MODES.is_file() else None
    if fastest is None or fastest[0] == number:
        return ok(f"{number}, {name}" + (", the fastest" if fastest else ""))
    return warn(
        f"{number}, {name}; {fastest[0]}, {fastest[1]} is faster", f"run: sudo nvpmodel -m {fastest[0]}"
    )


def _fastest(modes: str) -> tuple[int, str] | None:
    """Number and name of the mode with the fastest processor, then with the most cores; None without any."""
    best: tuple[float, int, int, str] | None = None
    for block in re.split(r"(?=<\s*POWER_MODEL\b)", modes):
        head = re.match(r"<\s*POWER_MODEL\s+ID=(\d+)\s+NAME=([^\s>]+)", block)
        if head is None:
            continue
        speeds = [
            float(number) for number in re.findall(r"^CPU_\S+\s+MAX_FREQ\s+(-?\d+)", block, re.MULTILINE)
        ]
        cores = len(re.findall(r"^CPU_ONLINE\s+CORE_\d+\s+1\b", block, re.MULTILINE))
        speed = min((float("inf") if each < 0.0 else each for each in speeds), default=0.0)  # -1: no limit
        here = (speed, cores, -int(head[1]), head[2])
        best = here if best is None or here > best else best
    return None if best is None else (-best[2], best[3])
