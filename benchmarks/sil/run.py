"""Runs one case as a user would: edge-sil in a process of its own, its report read back."""

import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from benchmarks.sil.cases import Case
from benchmarks.sil.clock import own_clock
from edge_runtime.common.child import python_command
from edge_runtime.errors import BridgeError
from firmware_bridge.sil.report.records import SilReport
from firmware_bridge.sil.scenario.team_file import write_key

SLOW = '[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.15\n'
HOSTILE_FRAMES, HOSTILE_FRAMES_SHORT = 100_000, 5_000


def run_case(case: Case, *, short: bool, realtime: bool) -> SilReport:
    """Return the report of one run.

    Raises:
        BridgeError: if edge-sil could not carry it to its end, with its words.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        duration_s = case.short_s if short else case.long_s
        flags = ["--fleet", _fleet(case.fleet, folder)] if case.fleet else ["--robots", case.robots]
        flags += ["--bridge", case.bridge, "--rate", case.rate_hz]
        flags += ["--duration", duration_s]
        if case.realtime and realtime:
            flags.append("--realtime")
        if case.pose_hz:
            flags += ["--pose-stream", case.pose_hz]
        if case.faults:
            flags += ["--faults", _timeline(case, folder, duration_s, short=short)]
        return edge_sil(folder, flags, own_clock(folder) if case.own_clock else {})


def edge_sil(folder: Path, flags: Sequence[object], environment: Mapping[str, str]) -> SilReport:
    """Return the report of a run under these flags, which goes to a folder; ``environment`` is added to ours.

    Raises:
        BridgeError: if edge-sil could not carry it to its end, with its words.
    """
    path = folder / "report.json"
    done = subprocess.run(  # noqa: S603 - our own interpreter and module
        python_command("firmware_bridge.sil", *flags, "--json", path),
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    report = path.read_bytes() if path.exists() else b""
    if not report:
        raise BridgeError(done.stderr.strip().splitlines()[-1])
    return msgspec.json.decode(report, type=SilReport)


def _fleet(path: Path, folder: Path) -> Path:
    write_key(folder / "team.key")
    (folder / path.name).write_bytes(path.read_bytes())
    return folder / path.name


def _timeline(case: Case, folder: Path, duration_s: float, *, short: bool) -> Path:
    (folder / "slow.toml").write_text(SLOW)
    path = folder / "faults.toml"
    frames = HOSTILE_FRAMES_SHORT if short else HOSTILE_FRAMES
    numbers = {"half": duration_s / 2, "whole": duration_s - 1.0, "duration": duration_s, "frames": frames}
    path.write_text("[[fault]]\n" + case.faults.format(**numbers))
    return path
