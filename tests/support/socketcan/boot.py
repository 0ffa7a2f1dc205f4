"""Boots the guest: user-mode Linux, a kernel in a process, which sees this machine's files read-only."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec
from socketcan.outcome import Outcome
from waiting import HANG_S

HERE = Path(__file__).parent
SHIM = HERE / "build" / "xstate.so"
LONGEST_S = 2 * HANG_S


def run_guest(folder: Path) -> dict[str, Outcome]:
    """Run every scenario in a fresh guest; ``folder`` is where it may write.

    Raises:
        AssertionError: if the guest ended without a report, with what it printed.
    """
    report = folder / "report.json"
    guest = subprocess.run(
        [
            "linux.uml",
            "rootfstype=hostfs",
            "rootflags=/",
            "ro",
            "mem=384M",
            f"init={HERE / 'init.sh'}",
            f"python={sys.executable}",
            f"tests={HERE.parent}",
            f"report={report}",
            "con=null",
            "con0=null,fd:1",
            "quiet",
        ],
        env={**os.environ, "LD_PRELOAD": str(SHIM), "TMPDIR": str(folder), "OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )
    assert report.is_file(), f"the guest left no report; it said:\n{guest.stdout[-5000:]}"
    outcomes = msgspec.json.decode(report.read_bytes(), type=list[Outcome])
    return {outcome.scenario: outcome for outcome in outcomes}
