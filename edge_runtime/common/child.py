"""Other processes of ours: started alike, from what is installed alone; a child speaks over one socket."""

import contextlib
import fcntl
import os
import socket
import subprocess
import sys
from typing import Final

import msgspec

# Without its safe path, Python looks for modules first in the folder that it is started in.
_SAFELY: Final = (
    ("-P", "-m")
    if sys.version_info >= (3, 11)
    else (
        "-c",
        "import sys; del sys.path[0], sys.argv[0]; import runpy; "
        "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)",
    )
)


def python_command(module: str, *arguments: object) -> list[str]:
    """Return the command line that runs an installed module, whatever lies in the folder it is started in."""
    return [sys.executable, *_SAFELY, module, *map(str, arguments)]


def start_child(
    module: str, task: msgspec.Struct, *shared: int, quiet: bool = False
) -> "tuple[socket.socket, subprocess.Popen[bytes]]":
    """Run ``module FD TASK [FD ...]`` and return this end of a socket pair, and the process.

    FD is the child's end, of SOCK_SEQPACKET; TASK is in JSON; then come the descriptors that it shares. It is
    in a session of its own, so that the terminal's Ctrl-C reaches only this process.

    Args:
        module: what the child runs.
        task: what it is to do.
        shared: descriptors that it takes along.
        quiet: whether its output goes nowhere: who reads ours must not wait for a child that hangs.
    """
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with its, contextlib.ExitStack() as copies:
        descriptors = tuple(_beyond_streams(number, copies) for number in (its.fileno(), *shared))
        first, *more = descriptors
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            python_command(module, first, msgspec.json.encode(task).decode(), *more),
            pass_fds=descriptors,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL if quiet else None,
            start_new_session=True,
        )
    return ours, process


def _beyond_streams(descriptor: int, copies: contextlib.ExitStack) -> int:
    """Copy a descriptor to a number that is no stream's: the system gives those out where ours are closed."""
    copy = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    copies.callback(os.close, copy)
    return copy
