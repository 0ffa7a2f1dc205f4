"""Every command by its name: what an installed script calls, imported only when it is run."""

import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NoReturn

from edge_runtime.common.command_line import command, need

COMMANDS: Final = {
    "edge-run": "edge_runtime.run.edge_run",
    "edge-replay": "edge_runtime.tools.replay.edge_replay",
    "edge-sil": "firmware_bridge.sil.edge_sil",
    "edge-doctor": "edge_runtime.doctor.edge_doctor",
    "edge-watch": "edge_runtime.tools.watch.edge_watch",
    "edge-report": "edge_runtime.tools.report.edge_report",
    "edge-ctl": "edge_runtime.tools.ctl.edge_ctl",
    "edge-pose": "edge_runtime.tools.pose.edge_pose",
    "edge-train": "export.edge_train",
    "edge-export": "export.edge_export",
}
"""Modules that offer ``main`` and ``make_parser``."""


def launch(name: str, module: str) -> NoReturn:
    """Run a command to the end of this process; an interruption while it is loaded is one line too."""

    def main(arguments: Sequence[str] | None) -> int:
        code: int = need(module, "train").main(arguments)  # robots lack what a workstation has
        return code

    code = command(name)(main)()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the interpreter's end would show a traceback
    sys.exit(code)


def _script(name: str) -> Callable[[], NoReturn]:
    return partial(launch, name, COMMANDS[name])


edge_run = _script("edge-run")
edge_replay = _script("edge-replay")
edge_sil = _script("edge-sil")
edge_doctor = _script("edge-doctor")
edge_watch = _script("edge-watch")
edge_report = _script("edge-report")
edge_ctl = _script("edge-ctl")
edge_pose = _script("edge-pose")
edge_train = _script("edge-train")
edge_export = _script("edge-export")
