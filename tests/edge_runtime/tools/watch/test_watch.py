"""What robots tell whoever watches them, and how it is kept and shown."""

import importlib
import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from watch_fakes import KEY, Clocks, status, watched

from edge_runtime.network.seal import FrameError
from edge_runtime.network.team_wire import FRAME_BYTES
from edge_runtime.network.team_wire import decode as decode_frame
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.telemetry.status import LONGEST, ObjectiveStatus, Span, Status, decode, encode
from edge_runtime.tools.watch import plain, text

finite = st.floats(-1e12, 1e12)
places = st.tuples(finite, finite) | st.tuples(finite, finite, finite)
STATUSES = st.builds(
    Status,
    robot_id=st.integers(0, 2**16 - 1),
    position_m=st.none() | places,
    nearest_m=st.none() | finite,
    ages_s=st.dictionaries(st.integers(0, 2**16 - 1), finite, max_size=8),
    stages=st.dictionaries(st.text(max_size=9), st.builds(Span, finite, finite), max_size=7),
    objectives=st.lists(st.builds(ObjectiveStatus, st.text(), st.text(), finite, finite), max_size=3).map(
        tuple
    ),
    speed_limit_m_s=st.none() | finite,
    margin_m=st.none() | finite,
    **dict.fromkeys(("sequence", "missed", "cut_short", "objectives_version"), st.integers(0, 2**63)),
    **dict.fromkeys(("started_s", "sent_s", "rate_hz", "nominal_rate_hz"), finite),
    goal_distance_m=st.none() | finite,
    velocity_m_s=st.none() | places,
    heading_rad=st.none() | finite,
    yaw_rate_rad_s=st.none() | finite,
    action=st.lists(finite, min_size=1, max_size=8).map(tuple),
    tick=st.builds(Span, finite, finite),
)


@given(STATUSES)
def test_a_status_arrives_as_it_was_sent(sent):
    assert decode(encode(sent, KEY), KEY) == sent


@given(st.integers(0), st.integers(0, 7))
def test_any_changed_bit_is_refused(place, bit):
    packet = bytearray(encode(status(), KEY))
    packet[place % len(packet)] ^= 1 << bit
    with pytest.raises(FrameError):
        decode(bytes(packet), KEY)


@pytest.mark.parametrize("number", [math.nan, math.inf, -1e300])
@pytest.mark.parametrize("field", ["sent_s", "rate_hz", "goal_distance_m", "nearest_m", "margin_m"])
def test_numbers_that_no_robot_has_are_refused(field, number):
    with pytest.raises(FrameError):
        decode(encode(status(**{field: number}), KEY), KEY)


@given(st.binary(max_size=300))
def test_junk_is_refused(junk):
    with pytest.raises(FrameError):
        decode(junk, KEY)


def test_a_status_never_passes_for_a_frame():
    packet = encode(status(), KEY)
    for candidate in (packet, packet[:FRAME_BYTES], packet.ljust(FRAME_BYTES, b"\0")):
        with pytest.raises(FrameError):
            decode_frame(candidate, KEY)


def test_a_packet_over_the_longest_is_refused():
    with pytest.raises(FrameError, match="malformed"):
        decode(encode(status(stop_reason="x" * LONGEST), KEY), KEY)


def test_only_newer_statuses_of_the_fleet_with_its_key_count():
    team = watched(status(0, 5))
    team.hear(encode(status(0, 5), KEY))
    team.hear(encode(status(0, 4), KEY))
    team.hear(encode(replace(status(0, 99), started_s=999.0), KEY))  # a recording of an earlier run
    team.hear(encode(status(9, 1), KEY))
    team.hear(encode(status(1, 1), bytes(32)))
    assert team.dropped == {"not newer": 3, "unknown robot": 1, "foreign": 1}
    assert team.heard[0].status.sequence == 5
    team.hear(encode(replace(status(0, 1), started_s=1010.0), KEY))
    assert team.heard[0].status.sequence == 1
    assert not team.all_heard


def test_silence_is_said():
    clocks = Clocks()
    team = watched(status(0), status(1), robots=2, clocks=clocks)
    assert team.all_heard
    assert text.state(team, 0).text == "driving"
    clocks.now_s = 0.9
    team.hear(encode(status(1, 2), KEY))
    clocks.now_s = 1.5
    assert [text.state(team, robot).text for robot in (0, 1)] == ["silent for 2 s", "driving"]
    assert not team.all_heard


def test_a_clock_that_is_far_off_is_said():
    team = watched(status(0, sent_s=1001.0 - 7 * 86_400))
    assert text.state(team, 0) == ("clock -604800 s off", False)


@pytest.mark.parametrize(
    "cell, fields, expected",
    [
        (text.speed, {}, ("0.20/0.30", True)),
        (text.speed, {"velocity_m_s": (0.3, 0.4)}, ("0.50/0.30", False)),
        (text.speed, {"speed_limit_m_s": None}, ("0.20", None)),
        (text.nearest, {}, ("0.40/0.25", True)),
        (text.nearest, {"nearest_m": 0.2}, ("0.20/0.25", False)),
        (text.nearest, {"nearest_m": None}, ("-", None)),
        (text.speed, {"velocity_m_s": None}, ("-", None)),
        (text.goal, {"goal_distance_m": None}, ("-", None)),
        (text.missed, {"missed": 2}, ("2", False)),
    ],
)
def test_limits_are_judged(cell, fields, expected):
    assert cell(status(**fields)) == expected


def test_objectives_say_what_they_ask():
    assert SpeedLimit(limit_m_s=0.3, weight=2.0).asks == "0.3 m/s"
    assert SafetyMargin(distance_m=0.25).asks == "0.25 m"


def test_plain_lines_hold_everything():
    team = watched(status(0, stop_reason="the bus\x1b[2J is gone"), status(1), robots=3)
    stopped, driving, unheard = plain.lines(team)
    assert "robot 0  stopped" in stopped
    assert stopped.endswith("stop: the bus?[2J is gone")
    for fact in (
        "speed 0.20/0.30 m/s",
        "rate 49.9/50 Hz",
        "set 3",
        "oldest 100 ms",
        "safety_margin 0.25 m  0.125",
    ):
        assert fact in driving
    assert unheard.endswith("robot 2  not heard yet")


def rendered(team, width, height=24):
    console = pytest.importorskip("rich.console")
    view = importlib.import_module("edge_runtime.tools.watch.view")
    terminal = console.Console(file=io.StringIO(), width=width, height=height, force_terminal=True)
    terminal.print(view.TeamView(team, "team.toml", "q ends"))
    return terminal.file.getvalue()


def test_a_team_of_four_fits_a_terminal_of_80_by_24():
    view = re.sub(r"\x1b\[[0-9;]*m", "", rendered(watched(*map(status, range(4))), 80))
    assert len(view.splitlines()) <= 24
    assert max(map(len, view.splitlines())) <= 80
    assert "…" not in view
    for fact in (
        "4 of 4 robots heard",
        "0.20/0.30",
        "0.40/0.25",
        "12.3/123",
        "0.3 m/s  0.000",
        "40%",
        "of 3",
    ):
        assert fact in view


def test_height_and_turning_are_told_of_robots_that_have_them():
    flying = status(1, position_m=(0.0, 0.0, 1.25), velocity_m_s=(0.0, 0.0, 0.1))
    team = watched(status(0), flying, status(2, yaw_rate_rad_s=-0.5), robots=3)
    told = ("", "height 1.25 m", "heading 0.50 rad, turning -0.50 rad/s")
    for line, expected in zip(plain.lines(team), told, strict=True):
        assert expected in line
        assert ("height" in line, "turning" in line) == ("height" in expected, "turning" in expected)
    view = rendered(team, 80)
    assert "robot 1: height 1.25 m" in view
    assert "robot 2: heading 0.50 rad, turning -0.50 rad/s" in view


@pytest.mark.parametrize("width", [1, 20, 40, 200])
def test_any_width_is_drawn(width):
    assert rendered(watched(status(0), status(1, stop_reason="x" * 300)), width)


def test_no_robot_writes_to_the_terminal():
    hostile = "\x1b]0;owned\x07\x1b[2J"
    objectives = (ObjectiveStatus(hostile, hostile, 0.0, 0.0),)
    team = watched(status(0, stop_reason=hostile, objectives=objectives, stages={hostile: Span(1.0, 1.0)}))
    assert not re.search(r"\x1b(?!\[[0-9;]*m)|\x07", rendered(team, 80))


def test_no_color_means_none(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    assert not re.search(r"\x1b\[[0-9;]*3\dm", rendered(watched(status(0)), 80))


def test_a_run_that_ended_is_not_called_silent():
    """Also long after its last words; who starts anew drives again."""
    clocks = Clocks()
    team = watched(status(0, 1, ended="goals held"), robots=1, clocks=clocks)
    clocks.now_s = 60.0
    assert text.state(team, 0) == ("ended: goals held", None)
    assert not team.all_heard
    team.hear(encode(status(0, 1, started_s=1060.0, sent_s=1061.0), KEY))
    assert text.state(team, 0) == ("driving", True)
