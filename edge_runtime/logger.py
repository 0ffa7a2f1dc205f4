"""The process that writes a run's log, so that no disk and no collector ever holds up the loop.

``python -m edge_runtime.logger FD PLAN`` is started by `edge_runtime.recorder`. It empties the socket ten
times a second rather than wake for every tick, ends a chunk twice a second, and goes on until the socket
closes: the log of a loop that was killed is complete.
"""

import contextlib
import gc
import os
import signal
import socket
import sys
import time
from typing import Final

import msgspec

from edge_runtime.log_run import RunLog
from edge_runtime.log_wire import PACKET_BYTES, LogPlan, decode_packet, encode_report

POLL_S: Final = 0.1
FLUSH_S: Final = 0.5
NICENESS: Final = 10
"""The loop goes first where they share a core."""
SIGNALS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""Meant for the loop; the logger ends after it."""


def serve(connection: socket.socket, run: RunLog) -> None:
    """Write what arrives until the loop's end closes."""
    connection.setblocking(False)
    buffer = bytearray(PACKET_BYTES)
    due_s = time.monotonic() + FLUSH_S
    while _drain(connection, buffer, run):
        if time.monotonic() >= due_s:
            run.files.flush()
            due_s = time.monotonic() + FLUSH_S
        time.sleep(POLL_S)
    run.close()


def _drain(connection: socket.socket, buffer: bytearray, run: RunLog) -> bool:
    """Take what has arrived; whether more may come."""
    while True:
        try:
            size = connection.recv_into(buffer)
        except BlockingIOError:
            return True
        except ConnectionResetError:
            return False
        if not size:
            return False
        run.take(decode_packet(memoryview(buffer)[:size]))


def main(arguments: list[str]) -> int:
    """Run as the loop's child: answer once the first file is open, or why it is not, and once at the end."""
    connection = socket.socket(fileno=int(arguments[0]))
    os.set_inheritable(connection.fileno(), False)
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    os.nice(NICENESS)
    run = RunLog(msgspec.json.decode(arguments[1], type=LogPlan))
    run.files.open()
    opened = run.files.report()
    connection.send(encode_report(opened))
    if opened.failure:
        return 2
    gc.freeze()
    serve(connection, run)
    with contextlib.suppress(OSError):  # the loop was killed
        connection.send(encode_report(run.files.report()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
