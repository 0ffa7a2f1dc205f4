"""What the doctor says of a machine, against what the machine then does."""

import ctypes
import os
import resource
import shutil
import subprocess
import sys
import time
from collections import namedtuple
from importlib import metadata

import pytest

from edge_runtime.doctor import machine as doctor_machine
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.machine import clock, disk, examine_machine, log_folder, realtime, versions

ASKED_AND_TRIED = """
import os, resource
from edge_runtime.doctor.machine import realtime
from edge_runtime.errors import ConfigError
from edge_runtime.common.realtime import enter_realtime
{before}
print(realtime(True).verdict.name, os.sched_getscheduler(0) == os.SCHED_OTHER)
try:
    enter_realtime()
except ConfigError:
    print("FAIL")
else:
    print("OK")
"""


WITHOUT_RIGHTS = """
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096, 4096))
os.setuid(65534)
"""


@pytest.mark.parametrize(
    "before",
    ["", pytest.param(WITHOUT_RIGHTS, marks=pytest.mark.skipif(os.getuid() != 0, reason="needs root"))],
    ids=["as it is", "without rights"],
)
def test_what_is_said_of_real_time_comes_true(before):
    script = ASKED_AND_TRIED.format(before=before)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    said, tried = done.stdout.splitlines()
    assert said == f"{tried} True", done.stderr


@pytest.fixture
def no_rights(monkeypatch):
    monkeypatch.setattr(doctor_machine, "_capabilities", lambda: 0)
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (0, 0))


@pytest.mark.usefixtures("no_rights")
@pytest.mark.parametrize(("wanted", "verdict"), [(True, Verdict.FAIL), (False, Verdict.WARN)])
def test_missing_rights_matter_as_far_as_they_are_needed(wanted, verdict):
    found = realtime(wanted)
    assert found.verdict is verdict
    assert "LimitRTPRIO=40 and LimitMEMLOCK=infinity" in found.remedy


@pytest.mark.usefixtures("no_rights")
def test_capabilities_are_enough(monkeypatch):
    monkeypatch.setattr(doctor_machine, "_capabilities", lambda: 1 << 23 | 1 << 14)
    assert realtime(True).verdict is Verdict.OK
    monkeypatch.setattr(doctor_machine, "_capabilities", lambda: 1 << 23)
    assert "RTPRIO" not in realtime(True).remedy


def test_real_time_needs_linux(monkeypatch):
    monkeypatch.delattr(os, "sched_setscheduler")
    assert "needs Linux" in realtime(True).detail


def test_versions_are_those_that_are_installed():
    found = versions()
    assert found.verdict is Verdict.OK
    assert f"numpy {metadata.version('numpy')}" in found.detail
    assert sys.version.split()[0] in found.detail


def test_an_old_or_missing_library_is_named(monkeypatch):
    real = metadata.version

    def version(name):
        if name == "msgspec":
            raise metadata.PackageNotFoundError(name)
        return "1.2.3" if name == "numpy" else real(name)

    monkeypatch.setattr(metadata, "version", version)
    found = versions()
    assert found.verdict is Verdict.FAIL
    assert "numpy 1.2.3" in found.detail
    assert "msgspec missing" in found.detail
    assert found.remedy == "run: pip install 'numpy>=1.24' 'msgspec>=0.19'"


def test_another_python_is_refused(monkeypatch):
    monkeypatch.setattr("platform.python_version", lambda: "3.9.1")
    assert versions().verdict is Verdict.FAIL


def test_a_checkout_without_metadata_is_only_warned_of(monkeypatch):
    monkeypatch.setattr(doctor_machine, "DISTRIBUTION", "no-such-distribution")
    assert versions().verdict is Verdict.WARN


Libc = namedtuple("Libc", "adjtimex", defaults=[None])


@pytest.mark.parametrize(
    ("libc", "verdict", "said"),
    [
        (Libc(lambda _timex: 0), Verdict.OK, "wall clock synchronised"),
        (Libc(lambda _timex: 5), Verdict.WARN, "wall clock not synchronised"),
        (Libc(lambda _timex: -1), Verdict.WARN, "does not tell"),
        (object(), Verdict.WARN, "does not tell"),
    ],
)
def test_the_kernel_says_whether_the_clock_is_synchronised(monkeypatch, libc, verdict, said):
    monkeypatch.setattr(ctypes, "CDLL", lambda _name: libc)
    found = clock()
    assert found.verdict is verdict
    assert said in found.detail


def test_reading_the_clock_changes_nothing_and_gives_a_state():
    assert clock().verdict in (Verdict.OK, Verdict.WARN)


def test_a_coarse_clock_fails(monkeypatch):
    monkeypatch.setattr(time, "get_clock_info", lambda _name: namedtuple("Info", "resolution")(4e-3))
    assert clock().verdict is Verdict.FAIL


@pytest.mark.parametrize(
    ("free", "verdict"), [(2**20, Verdict.FAIL), (2**28, Verdict.WARN), (2**31, Verdict.OK)]
)
def test_room_for_reports(monkeypatch, tmp_path, free, verdict):
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: namedtuple("Usage", "free")(free))
    assert disk(tmp_path).verdict is verdict


def test_a_missing_directory_cannot_be_written(tmp_path):
    assert "cannot be written" in disk(tmp_path / "none").detail


def test_every_check_is_made_and_named(tmp_path):
    found = examine_machine(wants_realtime=False, reports=tmp_path, logs=tmp_path / "logs")
    assert [finding.name for finding in found] == ["versions", "real time", "kernel", "clock", "logs", "disk"]


def test_the_folder_of_the_logs_needs_what_they_may_take(monkeypatch, tmp_path):
    """It need not be there yet; what lies in it counts for the logs."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: namedtuple("Usage", "free")(3 * 2**30))
    logs = tmp_path / "state" / "logs"
    assert log_folder(logs, 3 * 2**30).verdict is Verdict.OK
    found = log_folder(logs, 4 * 2**30)
    assert found.verdict is Verdict.WARN
    assert str(tmp_path) in found.detail and "may take 4.00 GiB more" in found.detail
    logs.mkdir(parents=True)
    with (logs / "old.mcap").open("wb") as file:
        file.truncate(2**30)
    assert log_folder(logs, 4 * 2**30).verdict is Verdict.OK


def makes_user_namespaces():
    command = ["unshare", "--user", "--map-root-user", "true"]
    return (
        shutil.which("unshare") and not subprocess.run(command, check=False, capture_output=True).returncode
    )


@pytest.mark.skipif(not makes_user_namespaces(), reason="no user namespaces here")
def test_rights_in_name_only_are_found_out():
    """The root of a container that an ordinary user started has every capability, and is refused."""
    code = "from edge_runtime.doctor.machine import realtime; print(realtime(True).verdict.name)"
    command = ["unshare", "--user", "--map-root-user", sys.executable, "-c", code]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == "FAIL\n"
