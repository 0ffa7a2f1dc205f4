"""The wall clock jumps by an hour while a team drives: the processes' own, and a whole kernel's.

``tests/support/socketcan/install.sh`` installs what the kernel needs, and a C compiler.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from functools import partial

import pytest
from paths import ROOT, SUPPORT
from quiet import on_a_quiet_machine
from sil_reports import LENIENT
from socketcan.boot import LONGEST_S, SHIM
from waiting import HANG_S

from benchmarks.sil.clock import own_clock

HOUR_S = 3600
SETTLED_S = 4.0
"""In the guest, two seconds after its jump: whoever took it for age has stopped."""

JUMPS = 10
needs_compiler = pytest.mark.skipif(
    not os.environ.get("CI") and not shutil.which("cc"), reason="there is no C compiler"
)
CLOCK = """
import socket, struct, sys, time
mine = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
mine.bind(("127.0.0.1", 0))
mine.setsockopt(socket.SOL_SOCKET, 35, 1)  # SO_TIMESTAMPNS
def stamp():
    (_, _, content), = mine.recvmsg(9, 64)[1]
    seconds, nanoseconds = struct.unpack("@ll", content)
    return seconds + 1e-9 * nanoseconds
def waited():
    sent = time.time()
    mine.sendto(b"first", mine.getsockname())
    time.sleep(0.05)
    return stamp() - sent < 0.04
while not waited():  # the kernel turns its stamps on when it has time to
    pass
begin, steady = time.time(), time.monotonic()
mine.sendto(b"before", mine.getsockname())
time.clock_settime(time.CLOCK_REALTIME, begin + 3600)
mine.sendto(b"after", mine.getsockname())
print(stamp() - begin, stamp() - begin, time.time() - begin, time.monotonic() - steady)
"""


@needs_compiler
def test_a_clock_of_their_own_jumps_for_processes_as_a_kernels_would(tmp_path):
    """Also in the kernel's stamps: a packet that waits keeps the stamp of before."""
    environment = {**os.environ, **own_clock(tmp_path)}
    run = partial(subprocess.run, env=environment, capture_output=True, text=True, check=True)
    before, after, wall, steady = map(float, run([sys.executable, "-c", CLOCK]).stdout.split())
    assert -1.0 < before < HOUR_S / 2 < after < 1.5 * HOUR_S
    assert HOUR_S / 2 < wall < 1.5 * HOUR_S and steady < HOUR_S / 2
    other = float(run([sys.executable, "-c", "import time; print(time.time())"]).stdout)
    assert other - time.time() > HOUR_S / 2  # whoever shares the clock sees it


@needs_compiler
@pytest.mark.integration
@pytest.mark.parametrize("bridge", ["can", "mavlink"])
@on_a_quiet_machine
def test_jumps_of_the_wall_clock_cost_no_ticks(tmp_path, bridge):
    """On a busy machine a tick may be missed now and then; one a jump would be many."""
    fault = '[[fault]]\nkind = "clock_jump"\nat_s = {}\nwhole_machine = true\n'
    (tmp_path / "faults.toml").write_text("".join(fault.format(0.3 * (jump + 1)) for jump in range(JUMPS)))
    (tmp_path / "limits.toml").write_text("[run]\nuncounted_misses = 0\n[machine]\n")
    flags = ("--robots", "2", "--bridge", bridge, "--rate", "10", "--duration", "4")
    files = ("--faults", "faults.toml", "--limits", "limits.toml", "--json", "report.json")
    done = subprocess.run(
        [sys.executable, "-m", "firmware_bridge.sil.edge_sil", *flags, *files],
        env={**os.environ, **own_clock(tmp_path), "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert all(fault["done_s"] for fault in report["faults"])
    for robot in report["robots"]:
        assert robot["stop_reason"] == "SIGTERM"
        assert robot["deadline_misses"] < JUMPS
        assert robot["fleet_used_age_ms"]["max"] < 10e3
        assert robot["pose_to_command_age_ms"]["max"] < 10e3


@pytest.mark.integration
@pytest.mark.skipif(
    not os.environ.get("CI") and not (shutil.which("linux.uml") and SHIM.is_file()),
    reason="user-mode Linux is not installed: run tests/support/socketcan/install.sh as root",
)
@on_a_quiet_machine
def test_a_jump_of_the_wall_clock_leaves_the_team_alone(tmp_path):
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "clock_jump"\nat_s = 2.0\nwhole_machine = true\n'
    )
    (tmp_path / "limits.toml").write_text(LENIENT)
    guest = subprocess.run(
        [
            "linux.uml",
            "rootfstype=hostfs",
            "rootflags=/",
            "ro",
            "mem=1G",
            f"init={SUPPORT / 'sil_guest' / 'init.sh'}",
            f"python={sys.executable}",
            f"root={ROOT}",
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
        # A starved guest stands now and then; one that took the jump for age stands for good.
        rested_s = sum(max(end - max(begin, SETTLED_S), 0.0) for begin, end in robot["halts_s"])
        assert rested_s < report["duration_s"] - SETTLED_S - 0.2
