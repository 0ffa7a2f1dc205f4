"""Which kernel runs, and what a Jetson says of its power mode."""

import os
import platform

import pytest

from edge_runtime.doctor import kernel as module
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.kernel import examine_kernel, kernel

MODES = """
< POWER_MODEL ID=0 NAME=15W >
CPU_ONLINE CORE_0 1
CPU_ONLINE CORE_5 1
CPU_A78_0 MIN_FREQ 0
CPU_A78_0 MAX_FREQ 1497600
< POWER_MODEL ID=1 NAME=7W >
CPU_ONLINE CORE_0 1
CPU_ONLINE CORE_5 0
CPU_A78_0 MAX_FREQ 960000
< POWER_MODEL ID=2 NAME=MAXN_SUPER >
CPU_ONLINE CORE_0 1
CPU_ONLINE CORE_5 1
CPU_A78_0 MAX_FREQ -1
"""


@pytest.fixture
def jetson(tmp_path, monkeypatch):
    """A machine with an nvpmodel that says what the test wants."""
    (tmp_path / "modes").write_text(MODES)
    monkeypatch.setattr(module, "MODES", tmp_path / "modes")
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    def says(text, stream=1):
        program = tmp_path / "nvpmodel"
        program.write_text(f"#!/bin/sh\ntest \"$1\" = -q && printf '{text}' >&{stream}\n")
        program.chmod(0o755)
        return {finding.name: finding for finding in examine_kernel(wants_realtime=False)}["power mode"]

    return says


@pytest.mark.parametrize(("said", "verdict", "told"), [
    ("NV Power Mode: MAXN_SUPER\n2\n", Verdict.OK, "2, MAXN_SUPER, the fastest"),
    ("NV Power Mode: 15W\n0\n", Verdict.WARN, "0, 15W; 2, MAXN_SUPER is faster"),
    ("nothing", Verdict.WARN, "nvpmodel -q does not tell it: nothing"),
])  # fmt: skip
def test_the_fastest_mode_is_not_always_number_0(jetson, said, verdict, told):
    found = jetson(said)
    assert (found.verdict, found.detail) == (verdict, told)
    assert "sudo nvpmodel -m 2" in found.remedy or "15W" not in told


def test_without_a_list_of_modes_the_one_that_runs_is_told(jetson, tmp_path):
    (tmp_path / "modes").unlink()
    assert jetson("NV Power Mode: 15W\n0\n").detail == "0, 15W"


def test_which_kernel_runs(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "REALTIME", tmp_path / "realtime")
    monkeypatch.setattr(platform, "version", lambda: "#1 SMP PREEMPT")
    assert platform.release() in kernel(False).detail
    assert (kernel(False).verdict, kernel(True).verdict) == (Verdict.OK, Verdict.WARN)
    (tmp_path / "realtime").write_text("1\n")
    assert kernel(True).detail.endswith(", PREEMPT_RT")
