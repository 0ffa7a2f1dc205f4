"""The commands of docs/first-robot-ros.md run, beside genuine robots of ROS 1 and ROS 2."""

import contextlib
import subprocess
import sys

import pytest
from doc_pages import ROOT, blocks, commands, program
from ros_peers import Ros, domain, master, needs_ros1, needs_ros2
from waiting import until

pytestmark = pytest.mark.integration
PAGE = ROOT / "docs" / "first-robot-ros.md"
LINES = [found for words, _ in commands(PAGE) if (found := program(words))]


def test_the_page_has_both_ros_and_both_programs():
    seen = {(module, word) for module, words in LINES for word in words if word.startswith("ros")}
    assert len(seen) == 4


@needs_ros1
@needs_ros2
@pytest.mark.parametrize(("module", "words"), LINES, ids=str)
def test_a_command_of_the_page(module, words, monkeypatch, tmp_path):
    (tmp_path / "one.toml").write_text(blocks(ROOT / "docs" / "first-robot-can.md", "toml")[0])
    ros = Ros(1, "rospy") if "ros1" in words else Ros(2, "kilted")
    more = ["--ros-path", ros.options().python_path[0]]
    if not module.startswith("edge_runtime.doctor"):
        more += ["--duration", "1", "--guard-deadline", "1", "--no-log"]

    def run_through():
        """A command that has run; not one whose guard stopped the robot because the machine was busy."""
        done = subprocess.run(
            [sys.executable, "-m", module, *words, *more],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        return None if "no fresh command" in done.stderr else done

    with start(ros, monkeypatch), ros.peer():
        done = until(run_through)
    assert done.returncode == 0, done.stdout + done.stderr


def start(ros, monkeypatch):
    if ros.kind == 1:
        return master(monkeypatch)
    domain(monkeypatch)
    return contextlib.nullcontext()
