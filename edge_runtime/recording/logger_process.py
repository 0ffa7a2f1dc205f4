"""The process that writes a run's log, so that no disk and no collector ever holds up the loop.

``python -m edge_runtime.recording.logger_process FD PLAN`` is started by `edge_runtime.recording.recorder`.
Twice a second it writes what came and ends a chunk, and it goes on until the socket closes: the log of a loop
that was killed is complete.
"""

import contextlib
import gc
import os
import signal
import socket
import sys
from typing import Final

import msgspec

from edge_runtime.recording.inbox import Inbox
from edge_runtime.recording.run_log import RunLog
from edge_runtime.recording.wire import LogPlan, decode_packet, encode_report

PERIOD_S: Final = 0.5
NICENESS: Final = 10
"""The loop goes first where they share a core."""
SIGNALS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""Meant for the loop; the logger ends after it."""


def serve(inbox: Inbox, run: RunLog) -> None:
    """Write what arrives until the loop's end of the connection closes."""
    over = False
    while not over:
        over = inbox.over.wait(PERIOD_S)
        for packet in inbox.drain():
            run.write(decode_packet(packet))
        if not over:
            run.files.flush()
    run.close()


def be_ordinary() -> None:
    """Leave the processor to whoever is in more of a hurry; a real-time parent's priority is not for this."""
    with contextlib.suppress(OSError):  # what may not be asked for everywhere is not needed either
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(NICENESS)


def main(arguments: list[str]) -> int:
    """Run as the loop's child: answer once the first file is open, or why it is not, and once at the end."""
    connection = socket.socket(fileno=int(arguments[0]))
    os.set_inheritable(connection.fileno(), False)
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    be_ordinary()
    run = RunLog(msgspec.json.decode(arguments[1], type=LogPlan))
    run.files.open()
    opened = run.files.report()
    connection.send(encode_report(opened))
    if opened.failure:
        return 2
    gc.freeze()
    serve(Inbox(connection), run)
    with contextlib.suppress(OSError):  # the loop was killed
        connection.send(encode_report(run.files.report()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
