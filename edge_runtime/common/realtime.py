"""What a process can do for punctual ticks: no collector pauses, real-time priority."""

import ctypes
import gc
import os
import sys
from typing import Final

from edge_runtime.errors import ConfigError

PRIORITY: Final = 40
"""Of SCHED_FIFO: above everything ordinary, below the kernel's interrupt threads (50)."""
SWITCH_S: Final = 2e-4
"""How long the loop may wait for the interpreter while a thread computes; Python's own is 5 ms."""
_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2


def freeze_garbage() -> None:
    """Exempt everything allocated so far from garbage collection; call once, after start-up."""
    gc.collect()
    gc.freeze()


def switch_threads_often() -> None:
    """Have threads that check objectives or write to a terminal soon give the loop its interpreter back.

    It holds for the whole process, so whoever owns the process calls it, once.
    """
    sys.setswitchinterval(SWITCH_S)


def enter_realtime() -> None:
    """Schedule this process ahead of all ordinary ones (SCHED_FIFO) and keep its memory from being paged out.

    A loop that never sleeps would then lock out everything else on its core: wait by sleeping, never by
    spinning.

    Raises:
        ConfigError: if the system refuses either; the process is left as it was.
    """
    if not hasattr(os, "sched_setscheduler"):
        raise ConfigError("real-time scheduling needs Linux; run without it")
    before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        raise ConfigError(
            f"real-time scheduling was refused ({error.strerror}): allow it, for example with "
            f"`LimitRTPRIO={PRIORITY}` in the systemd unit or CAP_SYS_NICE, or run without it"
        ) from error
    try:
        _lock_memory()
    except OSError as error:
        os.sched_setscheduler(0, before, parameters)
        raise ConfigError(
            f"locking memory was refused ({error.strerror}): allow it, for example with "
            "`LimitMEMLOCK=infinity` in the systemd unit or CAP_IPC_LOCK, or run without it"
        ) from error


def leave_realtime() -> None:
    """Schedule this thread, and those that it begins from now on, as ordinary ones."""
    if in_realtime():
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def in_realtime() -> bool:
    """Whether this process runs ahead of all ordinary ones."""
    return hasattr(os, "sched_getscheduler") and os.sched_getscheduler(0) == os.SCHED_FIFO


def _lock_memory() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def main() -> int:
    """Try it, for who wants to know: ``python -m edge_runtime.common.realtime``; 1 where it is refused."""
    try:
        enter_realtime()
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
