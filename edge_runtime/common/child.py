"""Other processes of ours: started alike, from what is installed alone; a child speaks over one socket."""

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
    module: str, task: msgspec.Struct, *, quiet: bool = False
) -> "tuple[socket.socket, subprocess.Popen[bytes]]":
    """Run ``module FD TASK`` and return this end of a socket pair, and the process.

    FD is the child's end, of SOCK_SEQPACKET; TASK is in JSON. It is in a session of its own, so that the
    terminal's Ctrl-C reaches only this process.

    Args:
        module: what the child runs.
        task: what it is to do.
        quiet: whether its output goes nowhere: who reads ours must not wait for a child that hangs.
    """
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with its:
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and module
            python_command(module, its.fileno(), msgspec.json.encode(task).decode()),
            pass_fds=(its.fileno(),),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL if quiet else None,
            start_new_session=True,
        )
    return ours, process
