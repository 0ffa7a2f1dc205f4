"""What makes a report evidence: when, by what and of what the run was made."""

import hashlib
import os
import platform
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from edge_runtime import __version__
from edge_runtime.common.commit import commit
from edge_runtime.common.processor import processor
from firmware_bridge.sil.report.records import Evidence
from firmware_bridge.sil.scenario.scenario import Scenario


def gather(scenario: Scenario, arguments: Sequence[str]) -> Evidence:
    """Describe a run that begins now.

    Args:
        scenario: the run.
        arguments: of the command line.

    Raises:
        OSError: if a file of the run cannot be read.
    """
    request = scenario.request
    files = {"fleet": request.fleet, "faults": request.faults, "limits": request.limits}
    digests = {name: _digest(path) for name, path in files.items() if path is not None}
    return Evidence(
        started_at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        command=("edge-sil", *arguments),
        version=__version__,
        commit=commit(),
        python=platform.python_version(),
        numpy=np.__version__,
        machine=f"{platform.node()}, {processor()}, {os.cpu_count()} cores, {platform.release()}",
        sha256={"policy": scenario.bundle.sha256, **digests},
        limits=_limits(scenario),
    )


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _limits(scenario: Scenario) -> dict[str, float]:
    """What was judged, by its key in the limits file."""
    return {
        f"{table}.{key}": value
        for table, keys in msgspec.to_builtins(scenario.limits).items()
        for key, value in keys.items()
        if value is not None
    }
