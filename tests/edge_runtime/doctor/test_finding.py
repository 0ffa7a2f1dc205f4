"""Findings: one line each, whatever a check meets."""

import pytest

from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, line, ok, warn
from edge_runtime.errors import BridgeError


def raising(error):
    def check():
        raise error

    return check


def test_a_check_is_named():
    assert examine("clock", lambda: ok("fine")) == Finding(Verdict.OK, "fine", "", "clock")


@pytest.mark.parametrize("error", [BridgeError("no bus; plug it in"), OSError("no bus; plug it in")])
def test_what_cannot_be_reached_has_failed(error):
    assert examine("bus", raising(error)) == Finding(Verdict.FAIL, "no bus; plug it in", "", "bus")


def test_an_own_mistake_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        examine("bus", raising(ZeroDivisionError()))


def test_lines_are_aligned_and_end_with_the_remedy():
    found = [examine("bus", lambda: fail("down", "set it up")), examine("clock", lambda: ok("fine"))]
    assert [line(finding, colour=False) for finding in found] == [
        "fail  bus               down; set it up",
        "ok    clock             fine",
    ]


def test_a_detail_of_several_lines_becomes_one():
    assert line(warn("first\n  second", "third"), colour=False).endswith("first second; third")


@pytest.mark.parametrize(("make", "code"), [(ok, 32), (warn, 33), (fail, 31)])
def test_only_the_word_is_coloured(make, code):
    found = make("text", "remedy") if make is not ok else ok("text")
    head, _, tail = line(found, colour=True).partition("\x1b[0m")
    assert head.startswith(f"\x1b[{code}m")
    assert "\x1b" not in tail
    assert head.removeprefix(f"\x1b[{code}m") + tail == line(found, colour=False)
