"""How a process of ours is started: its arguments, its session, its socket."""

import os
import subprocess
import sys

import msgspec
import pytest

import edge_runtime.common.child as child_module
from edge_runtime.common.child import start_child


class Task(msgspec.Struct, frozen=True):
    name: str


ECHO = """
import os, socket, sys
connection = socket.socket(fileno=int(sys.argv[1]))
print("to nobody")
connection.send(" ".join([sys.argv[2], str(os.getsid(0) == os.getpid()), *sys.argv[3:]]).encode())
os.write(int(sys.argv[3]), b"shared")
"""


@pytest.mark.parametrize("quiet", [False, True])
def test_a_child_speaks_over_its_socket_and_has_what_it_shares(quiet, tmp_path, monkeypatch, capfd):
    (tmp_path / "echo.py").write_text(ECHO)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    ours, theirs = os.pipe()
    connection, process = start_child("echo", Task("one"), theirs, quiet=quiet)
    assert process.wait(30) == 0
    text = connection.recv(4096).decode()
    assert text.startswith('{"name":"one"} True ')
    assert connection.recv(1) == b""  # nobody else holds its end
    assert os.read(ours, 100) == b"shared"
    assert capfd.readouterr().out == ("" if quiet else "to nobody\n")
    connection.close()
    os.close(ours)
    os.close(theirs)


def test_a_child_is_our_own_interpreter_in_a_session_of_its_own(monkeypatch):
    started = []
    monkeypatch.setattr(child_module.subprocess, "Popen", lambda *a, **k: started.append((a, k)))
    connection, _ = start_child("some.module", Task("one"))
    connection.close()
    (((arguments,), options),) = started
    assert arguments[:3] == [sys.executable, "-m", "some.module"]
    assert arguments[4:] == ['{"name":"one"}']
    # Ctrl-C on the terminal must not reach the child before its parent has told it to stop.
    assert options == {
        "pass_fds": (int(arguments[3]),),
        "stdin": subprocess.DEVNULL,
        "stdout": None,
        "start_new_session": True,
    }


def test_a_closed_stream_of_ours_becomes_none_of_the_child(tmp_path):
    """The system gives the lowest number that is free: to the socket, if output is closed."""
    (tmp_path / "echo.py").write_text(ECHO)
    code = (
        "import os, sys, msgspec; os.close(1); memory = os.memfd_create('m'); assert memory == 1\n"
        "from edge_runtime.common.child import start_child\n"
        "class Task(msgspec.Struct): name: str\n"
        "connection, process = start_child('echo', Task('one'), memory, quiet=True)\n"
        "assert process.wait(30) == 0 and connection.recv(4096)\n"
        "assert os.pread(memory, 100, 0) == b'shared'\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
