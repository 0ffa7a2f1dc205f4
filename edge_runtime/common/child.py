"""Processes that belong to this one: started alike, spoken to over one socket, ended when that closes."""

import contextlib
import fcntl
import os
import socket
import subprocess
import sys

import msgspec


def start_child(
    module: str, task: msgspec.Struct, *shared: int, quiet: bool = False
) -> "tuple[socket.socket, subprocess.Popen[bytes]]":
    """Start ``python -m module FD TASK [FD ...]`` and return this end of a socket pair, and the process.

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
        first, *more = map(str, descriptors)
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            [sys.executable, "-m", module, first, msgspec.json.encode(task).decode(), *more],
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
