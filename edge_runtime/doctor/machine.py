"""Checks of the machine: versions, real-time rights, clocks, room for reports. Nothing is switched on."""

import ctypes
import os
import platform
import resource
import shutil
import subprocess
import time
from collections.abc import Iterator
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from edge_runtime.common.child import python_command
from edge_runtime.common.realtime import PRIORITY
from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, ok, warn
from edge_runtime.doctor.kernel import examine_kernel

DISTRIBUTION: Final = "cfpg-edge"
TRIAL: Final = "edge_runtime.common.realtime"
"""Enters real time in a process of its own, and ends."""
COARSEST_CLOCK_S: Final = 1e-4
LEAST_FREE_BYTES: Final = 10 * 2**20
"""A run's report takes some kilobytes; below this a system itself begins to fail."""
SCARCE_FREE_BYTES: Final = 2**30
_TIME_ERROR: Final = 5
"""What adjtimex(2) returns while the clock is not synchronised."""
_TIMEX_BYTES: Final = 512
"""More than any system's ``struct timex``, whose first field, zero, asks for a mere reading."""
_CAP_IPC_LOCK: Final = 14
_CAP_SYS_NICE: Final = 23


def examine_machine(
    *, wants_realtime: bool, reports: Path | None = None, logs: Path | None = None, logs_bytes: int = 0
) -> Iterator[Finding]:
    """Check what holds for every robot.

    Args:
        wants_realtime: whether --realtime is asked for.
        reports: the folder that takes the report; none is written where None.
        logs: the folder that takes the logs; nothing is recorded where None.
        logs_bytes: what the logs in it may take.
    """
    yield examine("versions", versions)
    yield examine("real time", partial(realtime, wants_realtime))
    yield from examine_kernel(wants_realtime=wants_realtime)
    yield examine("clock", clock)
    if logs:
        yield examine("logs", partial(log_folder, logs, logs_bytes))
    if reports:
        yield examine("disk", partial(disk, reports))


def versions() -> Finding:
    """Whether interpreter and libraries are those that this release was made for."""
    try:
        described = metadata.metadata(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return warn(f"{DISTRIBUTION} is not installed: nothing tells what it needs", "run: pip install .")
    python = platform.python_version()
    if not SpecifierSet(described["Requires-Python"]).contains(python, prereleases=True):
        return fail(f"Python {python} is not {described['Requires-Python']}", "install another Python")
    needed = [Requirement(text) for text in metadata.requires(DISTRIBUTION) or ()]
    return _libraries(python, [r for r in needed if r.marker is None or r.marker.evaluate({"extra": ""})])


def _libraries(python: str, needed: list[Requirement]) -> Finding:
    found, wrong = [f"Python {python}"], []
    for requirement in needed:
        try:
            version = metadata.version(requirement.name)
        except metadata.PackageNotFoundError:
            version = "missing"
        found.append(f"{requirement.name} {version}")
        if version == "missing" or not requirement.specifier.contains(version, prereleases=True):
            wrong.append(requirement)
    if wrong:
        return fail(", ".join(found), "run: pip install " + " ".join(f"'{r}'" for r in wrong))
    return ok(", ".join(found))


def realtime(wanted: bool) -> Finding:
    """Whether --realtime would be permitted."""
    if not hasattr(os, "sched_setscheduler"):
        return warn("real-time scheduling needs Linux", "run without --realtime")
    held = _capabilities()
    missing = []
    if not held >> _CAP_SYS_NICE & 1 and not _limit_allows(resource.RLIMIT_RTPRIO, PRIORITY):
        missing.append(f"LimitRTPRIO={PRIORITY}")
    if not held >> _CAP_IPC_LOCK & 1 and not _limit_allows(resource.RLIMIT_MEMLOCK, None):
        missing.append("LimitMEMLOCK=infinity")
    judge = fail if wanted else warn
    if missing:
        return judge(
            "SCHED_FIFO or locked memory is not permitted",
            f"put {' and '.join(missing)} into the systemd unit, or run without --realtime",
        )
    # Rights may be there in name only: a container's own root has all, and is refused all the same.
    tried = subprocess.run(python_command(TRIAL), capture_output=True, text=True, check=False)  # noqa: S603
    if tried.returncode:
        return judge(tried.stderr.strip(), "start the container with --cap-add SYS_NICE as the host's root")
    return ok(f"SCHED_FIFO {PRIORITY} and locked memory are permitted")


def _capabilities() -> int:
    for row in Path("/proc/self/status").read_text().splitlines():
        if row.startswith("CapEff:"):
            return int(row.split()[1], 16)
    return 0


def _limit_allows(which: int, least: int | None) -> bool:
    """Whether a soft limit is at least this; unlimited where None is asked for."""
    soft = resource.getrlimit(which)[0]
    return soft == resource.RLIM_INFINITY or (least is not None and soft >= least)


def clock() -> Finding:
    """Whether ticks can be timed, and the wall clock is right; signing and reports rest on it."""
    resolution_s = time.get_clock_info("monotonic").resolution
    detail = f"monotonic to {resolution_s * 1e9:.0f} ns"
    if resolution_s > COARSEST_CLOCK_S:
        return fail(detail, "use a kernel with high-resolution timers")
    synchronised = _synchronised()
    if synchronised is None:
        return warn(f"{detail}; the system does not tell whether it is synchronised", "compare it by hand")
    if not synchronised:
        return warn(f"{detail}, wall clock not synchronised", "start chrony or systemd-timesyncd")
    return ok(f"{detail}, wall clock synchronised")


def _synchronised() -> bool | None:
    """Read the kernel's own state of the wall clock; None where it does not tell."""
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "adjtimex"):
        return None
    state = int(libc.adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES)))
    return None if state < 0 else state != _TIME_ERROR


def log_folder(folder: Path, most_bytes: int) -> Finding:
    """Whether the logs find the room that they may take; the folder itself is made by the first run."""
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    found = disk(existing)
    taken = sum(path.stat().st_size for path in folder.glob("*.mcap")) if folder.is_dir() else 0
    wanted, free = most_bytes - taken, shutil.disk_usage(existing).free
    if found.verdict is not Verdict.OK or free >= wanted:
        return found
    return warn(
        f"{found.detail}; the logs may take {wanted / 2**30:.2f} GiB more",
        "free some space, or set --log-keep-mb lower",
    )


def disk(folder: Path) -> Finding:
    """Whether reports can be written."""
    if not os.access(folder, os.W_OK):
        return fail(f"{folder} cannot be written", "choose another folder")
    free = shutil.disk_usage(folder).free
    detail = f"{free / 2**30:.2f} GiB free in {folder}"
    if free < LEAST_FREE_BYTES:
        return fail(detail, "free some space")
    return warn(detail, "free some space") if free < SCARCE_FREE_BYTES else ok(detail)
