"""How a process of ours is started: its arguments, its session, its socket."""

import subprocess
import sysconfig
from pathlib import Path

import msgspec
import pytest
from waiting import HANG_S

import edge_runtime.common.child as child_module
from edge_runtime.common.child import python_command, start_child


class Task(msgspec.Struct, frozen=True):
    name: str


ECHO = """
import os, socket, sys
connection = socket.socket(fileno=int(sys.argv[1]))
print("to nobody")
connection.send(f"{sys.argv[2]} {os.getsid(0) == os.getpid()}".encode())
"""


@pytest.mark.parametrize("quiet", [False, True])
def test_a_child_speaks_over_its_socket(quiet, tmp_path, monkeypatch, capfd):
    (tmp_path / "echo.py").write_text(ECHO)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    connection, process = start_child("echo", Task("one"), quiet=quiet)
    assert process.wait(HANG_S) == 0
    assert connection.recv(4096) == b'{"name":"one"} True'
    assert connection.recv(1) == b""  # nobody else holds its end
    assert capfd.readouterr().out == ("" if quiet else "to nobody\n")
    connection.close()


def test_a_child_is_our_own_interpreter_in_a_session_of_its_own(monkeypatch):
    started = []
    monkeypatch.setattr(child_module.subprocess, "Popen", lambda *a, **k: started.append((a, k)))
    connection, _ = start_child("some.module", Task("one"))
    connection.close()
    (((arguments,), options),) = started
    assert arguments == python_command("some.module", arguments[-2], '{"name":"one"}')
    # Ctrl-C on the terminal must not reach the child before its parent has told it to stop.
    assert options == {
        "pass_fds": (int(arguments[-2]),),
        "stdin": subprocess.DEVNULL,
        "stdout": None,
        "start_new_session": True,
    }


HOSTILE = "import pathlib; pathlib.Path(__file__).with_name('was_run').touch(); raise SystemExit(7)"
LIBRARIES = ("can", "cantools", "json", "mcap", "msgspec", "numpy", "pymavlink", "runpy", "serial")


@pytest.fixture
def hostile_folder(tmp_path):
    """A folder that holds modules of the names that our processes import."""
    for name in LIBRARIES:
        (tmp_path / f"{name}.py").write_text(HOSTILE)
    return tmp_path


OLDER_PYTHON = (
    "-c",
    "import sys; del sys.path[0], sys.argv[0]; import runpy; "
    "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)",
)


@pytest.mark.parametrize("safely", [child_module._SAFELY, OLDER_PYTHON])
def test_nothing_is_imported_from_the_folder_that_a_process_is_started_in(
    safely, hostile_folder, monkeypatch
):
    monkeypatch.setattr(child_module, "_SAFELY", safely)
    command = python_command("serial.tools.list_ports", "--help")
    done = subprocess.run(command, cwd=hostile_folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.partition(" ")[0]) == (0, "usage:")
    assert not (hostile_folder / "was_run").exists()


@pytest.mark.parametrize(
    "flags, said",
    [
        ("--bridge sim", ""),
        ("--bridge can --bus nosuch0 --profile agilex_v2", "nosuch0"),
        ("--bridge mavlink --mavlink udpin:192.0.2.1:1 --mavlink-autopilot ardupilot_rover", "192.0.2.1"),
    ],
)
def test_neither_guard_nor_logger_imports_from_there(flags, said, hostile_folder):
    (hostile_folder / "one.toml").write_text("[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n")
    script = Path(sysconfig.get_path("scripts")) / "edge-run"
    own = "--robot-id 0 --fleet one.toml --rate 50 --duration 0.3 --log-dir logs"
    done = subprocess.run(
        [script, *own.split(), *flags.split()],
        cwd=hostile_folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert not (hostile_folder / "was_run").exists()
    assert done.returncode == (2 if said else 0)
    assert said in done.stderr
