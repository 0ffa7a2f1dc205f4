"""Libraries at work on what strangers wrote: in a child process that takes only so much time and memory.

Code of other people that reads files of other people may loop, ask for all memory, or end its process. The
child does, and its parent has a line of text.
"""

import os
import resource
import select
import signal
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from edge_runtime.common.child import start_child
from edge_runtime.common.printable import first_line, printable
from edge_runtime.errors import EdgeError

MIB: Final = 1 << 20
_LONGEST_REPLY: Final = 1 << 16
_WAIT: Final = 2
"""Times the processor time: how long the child may last, with all that it waits for."""


class Bounds(msgspec.Struct, frozen=True):
    """What a child may take."""

    seconds: int
    """Of processor time."""
    memory_mib: int
    """Beyond what it has when it begins with its task."""


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """What a child is to do: base of each module's own."""

    bounds: Bounds


class ChildError(EdgeError):
    """What the child found wrong with its task, or how it ended; for the caller to say of what."""


class _Reply(msgspec.Struct, frozen=True):
    result: str = ""
    error: str = ""


AnyTask = TypeVar("AnyTask", bound=Task)


def result_of(module: str, task: Task) -> str:
    """Let ``python -m module``, whose main is `work`, do a task, and return its result.

    Raises:
        ChildError: says in one line why there is none.
    """
    ours, process = start_child(module, task, quiet=True)
    longest_s = _WAIT * task.bounds.seconds
    with ours:
        try:
            if not select.select((ours,), (), (), longest_s)[0]:
                raise ChildError(f"takes longer than {longest_s} s")
            reply = ours.recv(_LONGEST_REPLY)
        finally:
            process.kill()
            code = process.wait()
    if not reply:
        raise ChildError(_ending(code, task.bounds))
    found = msgspec.json.decode(reply, type=_Reply)
    if found.error:
        raise ChildError(found.error)
    return found.result


def work(arguments: Sequence[str], kind: type[AnyTask], do: Callable[[AnyTask], str]) -> int:
    """Be the child: do the task within its bounds, and reply; returns the exit code."""
    with socket.socket(fileno=int(arguments[0])) as parent:
        task = msgspec.json.decode(arguments[1], type=kind)
        _bound(task.bounds)
        try:
            reply = _Reply(result=do(task))
        except EdgeError as error:
            reply = _Reply(error=printable(str(error)))
        except MemoryError:
            reply = _Reply(error=f"takes more than {task.bounds.memory_mib} MiB of memory")
        except Exception as error:  # noqa: BLE001  # libraries meet what they were not made for
            reply = _Reply(error=f"{type(error).__name__}: {first_line(error)}")
        parent.send(msgspec.json.encode(reply))
    return 0


def _bound(bounds: Bounds) -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    memory = pages * resource.getpagesize() + bounds.memory_mib * MIB
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime) + 1 + bounds.seconds
    for limit, value in (
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, seconds),
    ):
        hard = resource.getrlimit(limit)[1]
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(limit, (value, hard))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the parent says what ended the child


def _ending(code: int, bounds: Bounds) -> str:
    if code == -signal.SIGXCPU:
        return f"takes more than {bounds.seconds} s of processor time"
    if code == -signal.SIGABRT:
        return f"ended its reader, as one that needs more than {bounds.memory_mib} MiB of memory does"
    name = signal.Signals(-code).name if code < 0 else f"code {code}"
    return f"ended its reader ({name})"
