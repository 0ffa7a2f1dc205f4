"""The end of a run: its text is whole for who reads, and nobody who does not read holds it up."""

import fcntl
import io
import os
import subprocess
import sys

import pytest
from bundles import write_straight_bundle
from waiting import HANG_S

from edge_runtime.run.final_output import say

TEXT = "Ångström\n" * 30_000
"""More than a pipe holds."""


def test_a_slow_reader_gets_the_whole_text():
    code = "import sys; from edge_runtime.run.final_output import say; say(sys.stdin.read(), sys.stdout)"
    done = subprocess.run(
        [sys.executable, "-X", "utf8", "-c", code], input=TEXT.encode(), capture_output=True, check=True
    )
    assert (done.stdout.decode(), done.stderr) == (f"{TEXT}\n", b"")


def test_a_stream_without_a_descriptor():
    stream = io.StringIO()
    say("done", stream)
    assert stream.getvalue() == "done\n"


@pytest.mark.skipif(not hasattr(fcntl, "F_GETPIPE_SZ"), reason="fills a pipe as Linux has it")
def test_a_full_pipe_that_nobody_reads_lets_the_process_end(tmp_path):
    bundle = write_straight_bundle(tmp_path / "straight")
    reader, writer = os.pipe()
    os.write(writer, bytes(fcntl.fcntl(writer, fcntl.F_GETPIPE_SZ)))
    flags = ["--robot-id", "0", "--policy", bundle, "--rate", "50", "--duration", "0.5"]
    flags += ["--no-log", "--json", tmp_path / "run.json"]
    with subprocess.Popen(
        [sys.executable, "-m", "edge_runtime.run", *map(str, flags)], stdout=writer, stderr=subprocess.PIPE
    ) as process:
        try:
            assert process.wait(timeout=HANG_S) == 0
        finally:
            process.kill()
        assert process.stderr.read() == b""
    assert (tmp_path / "run.json").stat().st_size
    os.close(reader)
    os.close(writer)
