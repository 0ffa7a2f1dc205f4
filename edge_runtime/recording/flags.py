"""The flags of edge-run that say where a run is recorded, and how much of the disk that may take."""

import argparse
import random
import time
from pathlib import Path
from typing import Final

from edge_runtime.common.flag_types import number
from edge_runtime.errors import ConfigError
from edge_runtime.recording.folder import default_folder, next_number, run_name
from edge_runtime.recording.wire import LogPlan

_MB: Final = 1_000_000
_positive = number(1e-3, 1e9)


def add_log_flags(parser: argparse.ArgumentParser) -> None:
    """Add them."""
    flags = parser.add_argument_group("the run's log (MCAP, opens in Foxglove; edge-replay repeats it)")
    add = flags.add_argument
    add("--no-log", dest="log", action="store_false", help="record nothing")
    add("--log-dir", type=Path, metavar="DIR", help="folder for logs (default: one of the user's own)")
    add("--log-file-mb", type=_positive, default=100.0, metavar="MB", help="size of one file (default: 100)")
    add("--log-file-s", type=_positive, default=300.0, metavar="S", help="length of one file (default: 300)")
    add(
        "--log-keep-mb",
        type=_positive,
        default=2000.0,
        metavar="MB",
        help="what all logs in the folder may take; the oldest are deleted first (default: 2000)",
    )


def make_log_plan(flags: argparse.Namespace) -> LogPlan:
    """Return where the run is recorded.

    Raises:
        ConfigError: if the cap leaves no room beside the file being written, or no folder is known.
    """
    if flags.log_keep_mb < 2.0 * flags.log_file_mb:
        raise ConfigError(
            f"--log-keep-mb {flags.log_keep_mb:g}: must be at least twice "
            f"--log-file-mb, which is {flags.log_file_mb:g}"
        )
    folder = flags.log_dir or default_folder()
    started_at, identity = (
        time.strftime("%Y%m%dT%H%M%SZ", time.gmtime()),
        random.SystemRandom().getrandbits(32),
    )
    return LogPlan(
        folder=str(folder),
        run=run_name(next_number(folder), started_at, flags.robot_id, identity),
        file_bytes=int(_MB * flags.log_file_mb),
        file_s=flags.log_file_s,
        keep_bytes=int(_MB * flags.log_keep_mb),
    )
