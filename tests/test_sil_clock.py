"""The wall clock jumps by an hour while a team drives: for real, in a kernel that has a clock of its own.

``tests/socketcan/install.sh`` installs what this needs.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from socketcan.boot import LONGEST_S, SHIM

HERE = Path(__file__).parent
HOUR_S = 3600

pytestmark = pytest.mark.skipif(
    not os.environ.get("CI") and not (shutil.which("linux.uml") and SHIM.is_file()),
    reason="user-mode Linux is not installed: run tests/socketcan/install.sh as root",
)


def test_a_jump_of_the_wall_clock_leaves_the_team_alone(tmp_path):
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "clock_jump"\nat_s = 2.0\nwhole_machine = true\n'
    )
    (tmp_path / "limits.toml").write_text("[run]\n[machine]\n")
    guest = subprocess.run(
        [
            "linux.uml",
            "rootfstype=hostfs",
            "rootflags=/",
            "ro",
            "mem=1G",
            f"init={HERE / 'sil_guest' / 'init.sh'}",
            f"python={sys.executable}",
            f"root={HERE.parent}",
            f"files={tmp_path}",
            "con=null",
            "con0=null,fd:1",
            "quiet",
        ],
        env={**os.environ, "LD_PRELOAD": str(SHIM), "OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )
    report = (tmp_path / "report.json").read_text()
    assert report, guest.stdout[-3000:]
    report = json.loads(report)
    [jump] = report["faults"]
    assert jump["done_s"] >= 2.0
    assert int((tmp_path / "jumped").read_text()) > HOUR_S / 2  # the guest's own clock, mid-run
    for robot in report["robots"]:
        assert robot["stop_reason"] == "SIGTERM"
        # An hour would be 14400 deadlines, and states an hour old: nothing of the kind.
        assert robot["runtime_misses"] < 100
        assert robot["fleet_used_age_ms"]["max"] < 60e3
        assert robot["pose_to_command_age_ms"]["max"] < 60e3
        assert all(end - begin < 3.0 for begin, end in robot["halts_s"])
