"""Real-time set-up in a process of its own, where it is permitted and where it is refused."""

import gc
import os
import subprocess
import sys

import pytest

from edge_runtime.common import realtime
from edge_runtime.common.realtime import enter_realtime, freeze_garbage
from edge_runtime.errors import ConfigError


def in_process(script):
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)


def permitted():
    return (
        in_process("from edge_runtime.common.realtime import enter_realtime; enter_realtime()").returncode
        == 0
    )


def test_permitted_means_scheduled_and_locked():
    if not permitted():
        pytest.skip("this machine refuses real-time scheduling")
    done = in_process(
        "import os\nfrom edge_runtime.common.realtime import enter_realtime\nenter_realtime()\n"
        "print(os.sched_getscheduler(0) == os.SCHED_FIFO, os.sched_getparam(0).sched_priority)\n"
        "print(int(next(l for l in open('/proc/self/status') if l.startswith('VmLck')).split()[1]) > 1000)\n"
    )
    assert done.stdout == "True 40\nTrue\n"


def test_who_leaves_is_ordinary_again():
    if not permitted():
        pytest.skip("this machine refuses real-time scheduling")
    done = in_process(
        "import os\nfrom edge_runtime.common.realtime import enter_realtime, in_realtime, leave_realtime\n"
        "enter_realtime()\nleave_realtime()\n"
        "print(in_realtime(), os.sched_getscheduler(0) == os.SCHED_OTHER)\n"
    )
    assert done.stdout == "False True\n"


def refuse(*_arguments):
    raise PermissionError(1, "Operation not permitted")


def test_a_refused_priority_names_the_remedy(monkeypatch):
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with pytest.raises(
        ConfigError, match=r"scheduling was refused \(Operation not permitted\).*LimitRTPRIO=40"
    ):
        enter_realtime()


def test_refused_memory_names_the_remedy_and_gives_the_priority_back(monkeypatch):
    calls = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda _pid, policy, _parameters: calls.append(policy))
    monkeypatch.setattr(realtime, "_lock_memory", refuse)
    with pytest.raises(ConfigError, match=r"locking memory was refused .*LimitMEMLOCK=infinity"):
        enter_realtime()
    assert calls == [os.SCHED_FIFO, os.sched_getscheduler(0)]


@pytest.mark.skipif(os.getuid() != 0, reason="needs root to give rights up")
def test_the_kernels_refusal_arrives_as_an_error():
    done = in_process(
        "import os, resource\nfrom edge_runtime.common.realtime import _lock_memory\n"
        "resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096, 4096))\nos.setuid(65534)\n"
        "try:\n    _lock_memory()\nexcept OSError as error:\n    print(error.errno > 0)"
    )
    assert done.stdout == "True\n"


def test_a_system_without_schedulers_is_told_so(monkeypatch):
    monkeypatch.delattr(os, "sched_setscheduler")
    with pytest.raises(ConfigError, match="needs Linux"):
        enter_realtime()


def test_frozen_garbage_is_not_visited():
    before = gc.get_freeze_count()
    freeze_garbage()
    try:
        assert gc.get_freeze_count() > before
    finally:
        gc.unfreeze()
