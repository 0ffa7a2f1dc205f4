"""``python -m benchmarks peers``: does every command reach other people's ROS, exactly once?

Guards drive robots by rospy, rosnodejs, rclpy of two distributions and Cyclone DDS, as `make ros` installs
them, all at once in a network namespace of their own, at 20 Hz. It is the tests' own
`tests/firmware_bridge/ros/test_peers.py`, with more commands; one that is lost, repeated or out of order is
named, and makes it fail.
"""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.common.flags import COUNT, make_parser
from benchmarks.common.result_page import table

ROOT = Path(__file__).parents[2]
RATE_HZ = 20


def main(arguments: Sequence[str]) -> int:
    """Run all, print the table; returns 1 if a command did not arrive exactly once."""
    parser = make_parser("peers", __doc__)
    parser.add_argument("--seconds", type=COUNT, default=60, help="of driving (60)")
    commands = RATE_HZ * parser.parse_args(arguments).seconds
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        done = subprocess.run(  # noqa: S603 - this repository's own script
            [
                *("sh", ROOT / "tests/support/ros/alone.sh", sys.executable, "-m", "pytest", "-n", "5"),
                *("-m", "integration", "-k", "arrives_once", f"--commands={commands}"),
                *(f"--junitxml={report}", "tests/firmware_bridge/ros/test_peers.py"),
            ],
            cwd=ROOT,
            check=False,
        )
        if report.exists():
            print(table(["peer", f"{commands} commands"], _rows(report)))
    return min(done.returncode, 1)


def _rows(report: Path) -> list[list[str]]:
    """What the tests found, a peer a row."""
    cases = ElementTree.parse(report).getroot().iter("testcase")  # noqa: S314 - pytest's own
    return [[case.get("name", "").partition("[")[2].rstrip("]"), _said(case)] for case in cases]


def _said(case: ElementTree.Element) -> str:
    told = next(iter(case.findall("failure") + case.findall("error") + case.findall("skipped")), None)
    return "each exactly once" if told is None else told.get("message", "").partition("\n")[0]
