"""edge-report on logs of real runs: what they say is on the page, what is wrong with them is said."""

import dataclasses
import html
import json
import math
import re

import foreign_logs
import msgspec
import numpy as np
import pytest
import sil_reports
from logs import in_space, write
from report_files import record

from edge_runtime.errors import ConfigError
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import Tick
from edge_runtime.recording.wire import LogReport
from edge_runtime.tools.replay.edge_replay import main as replay
from edge_runtime.tools.report.animate import animate_run
from edge_runtime.tools.report.digest import STAGES, digest
from edge_runtime.tools.report.edge_report import main
from edge_runtime.tools.report.sections import _verdicts
from edge_runtime.tools.report.team import fences, limits, separation, team_of
from firmware_bridge.sil.report.records import FaultDone, FaultStop

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return record(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def run(log):
    return digest(read_log(log), str(log))


def test_a_digest_holds_what_the_log_holds(log, run):
    ticks = [record for record in read_log(log) if isinstance(record, Tick)]
    assert len(ticks) == len(run.time_s) > 50
    assert (np.diff(run.time_s) > 0).all()
    for row in (0, len(ticks) // 2, -1):
        tick = ticks[row]
        assert run.motion[0][row].tolist() == [*tick.state.own.position_m, *tick.state.own.velocity_m_s]
        (mate,) = tick.state.teammates
        assert run.motion[5][row].tolist() == [*mate.state.position_m, *mate.state.velocity_m_s]
        assert run.age_s[5][row] == mate.age_s
        assert run.stage_us[row].tolist() == [getattr(tick.timing, stage) for stage in STAGES]
        assert [costs[row] for costs in run.costs.values()] == list(tick.action.costs)
        assert run.misses[row] == tick.inputs.misses
    assert run.end.stop_reason == "duration"
    assert list(run.costs) == ["speed_limit", "safety_margin", "geofence"]


def test_a_team_is_judged_against_what_was_asked(run):
    team = team_of([run])
    assert [track.name for track in team.tracks] == ["robot 0", "robot 5"]
    one, other = team.tracks
    expected = np.hypot(*(one.position_m - other.position_m).T)
    assert separation(one, team) == pytest.approx(expected)
    assert [(limit.value, limit.name) for limit in limits(team, "speed_limit", "limit_m_s", "m/s")] == [
        (0.3, "speed limit 0.3 m/s")
    ]
    assert [(fence.centre_m, fence.radius_m) for fence in fences(team)] == [((2.0, 2.0), 0.5)]
    assert one.goal_distance_m[0] == pytest.approx(0.3, abs=0.01)


def test_the_page_tells_of_everything(log, tmp_path, capsys):
    assert main([str(log), "-o", str(tmp_path / "page.html")]) == 0
    assert "page.html" in capsys.readouterr().out
    page = (tmp_path / "page.html").read_text()
    text = re.sub(r"<style>.*?</style>|<[^>]+>", " ", page, flags=re.DOTALL)
    for told in (
        "Run of 2 robots", "safety margin 0.25 m", "speed limit 0.3 m/s", "geofence", "tolerance 0.1 m",
        "duration in ms", "observe", "set", "Python 3.", "SHA-256", "duration", "x in m", "time in s",
    ):  # fmt: skip
        assert told in text, told
    assert len(page) < 1_000_000


def test_a_log_that_breaks_off_is_drawn_as_far_as_it_goes(log, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    assert main([str(cut), "-o", str(tmp_path / "page.html")]) == 1
    complaint = capsys.readouterr().err
    assert re.match(r"edge-report: .*cut\.mcap: .*after tick \d+\n$", complaint)
    page = (tmp_path / "page.html").read_text()
    assert "cut.mcap" in page
    assert "the log breaks off" in page


def refused(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_what_does_not_hold_together_is_one_line(log, tmp_path, capsys):
    page = tmp_path / "page.html"
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    (tmp_path / "junk.json").write_text('{"verdict": "fine"}')
    assert "is not an MCAP file" in refused(capsys, tmp_path / "junk.mcap", "-o", page)
    assert "is no report of this version's edge-sil" in refused(capsys, tmp_path / "junk.json", "-o", page)
    assert "No such file" in refused(capsys, tmp_path / "none.mcap", "-o", page)
    assert "cannot be written" in refused(capsys, log, "-o", tmp_path / "no" / "page.html")
    assert "would overwrite a file that is read" in refused(capsys, log, "-o", log)
    assert "see edge-report --help" in refused(capsys, log)


def test_the_page_of_a_run_in_the_loop_is_evidence(tmp_path):
    """It says when, by what, of what and against what the run was made, and how far each fault let it go."""
    kill = FaultDone(
        kind="kill", at_s=1.0, for_s=None, details="{}", done_s=1.0, stops=(FaultStop(1, 0.52, 0.17),)
    )
    report = sil_reports.report(*map(sil_reports.robot, range(2)), faults=(kill,))
    (tmp_path / "sil.json").write_bytes(msgspec.json.encode(report))
    assert main([str(tmp_path / "sil.json"), "-o", str(tmp_path / "page.html")]) == 0
    page = html.unescape((tmp_path / "page.html").read_text())
    for said in (
        "2026-03-14T09:26:53Z",
        "edge-sil --faults 'my faults.toml'",
        "commit " + "f" * 40,
        "a" * 64,
        "machine.wake_p99_ms",
        "robot 1 at rest after 0.52 s and 0.17 m",
    ):
        assert said in page


def test_two_runs_of_one_robot_are_no_team(log, tmp_path, capsys):
    other = record(tmp_path)
    assert "another run of robot 0" in refused(capsys, log, other, "-o", tmp_path / "page.html")


def test_each_stretch_is_judged_by_its_own_limits_once_the_team_has_braked(run):
    """A stricter limit halfway: the speed before it, and while the robots brake, breaks nothing."""
    first = run.sets[0]
    slow = msgspec.structs.replace(
        first[1],
        version=1,
        objectives=tuple(
            msgspec.structs.replace(item, parameters='{"limit_m_s": 0.1}')
            for item in first[1].objectives
            if item.kind == "speed_limit"
        ),
    )
    zero_s = run.start.started_unix_s
    times = zero_s + np.array([0.0, 4.0, 5.5, 6.5, 9.0])
    for last_m_s, kept in ((0.05, True), (0.2, False)):
        motion = np.zeros((5, 4))
        motion[:, 2] = 0.29, 0.29, 0.25, 0.25, last_m_s
        changed = dataclasses.replace(
            run, sets=(first, (zero_s + 5.0, slow)), time_s=times, motion={0: motion}
        )
        (verdict,) = [v for v in _verdicts(team_of([changed])) if v.name == "Greatest speed"]
        assert verdict.good is kept
        last = "0.050 under speed limit 0.1 m/s" if kept else "0.200 under speed limit 0.1 m/s, violated"
        assert (verdict.value, verdict.detail) == ("0.290 m/s", f"0.290 under speed limit 0.3 m/s; {last}")
        lines = limits(team_of([changed]), "speed_limit", "limit_m_s", "m/s")
        assert [(line.value, line.begin_s, line.end_s) for line in lines] == [
            (0.3, -math.inf, 5.0),
            (0.1, 5.0, math.inf),
        ]


def test_a_robot_that_never_had_a_pose(log, tmp_path, capsys):
    """It made no decision, and followed no objectives yet."""
    kept = [
        (topic, content)
        for topic, content in foreign_logs.messages_of(log)
        if topic in ("/start", "/events", "/end")
    ]
    poor = foreign_logs.write(tmp_path / "poor.mcap", kept)
    assert main([str(poor), "-o", str(tmp_path / "page.html")]) == 0
    assert "Run of 0 robots" in (tmp_path / "page.html").read_text()
    assert capsys.readouterr().err == ""


HOSTILE = "nav \x1b]0;all is well\x07\r\n$\\frac{$ \u202e <script>alert(1)</script>"


def test_names_that_are_commands_to_a_terminal_a_page_or_a_formula(log, tmp_path, capsys):
    def rename(content):
        for field in ("name", "mode", "message", "stop_reason", "host", "fault"):
            content = re.sub(
                rf'"{field}":"[^"]*"', lambda _, f=field: f'"{f}":{json.dumps(HOSTILE)}', content
            )
        return content

    messages = [
        (topic, rename(content.decode()).encode()) for topic, content in foreign_logs.messages_of(log)
    ]
    named = foreign_logs.write(tmp_path / "named_000.mcap", messages)
    assert main([str(named), "-o", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert not {letter for letter in page if not (letter.isprintable() or letter == "\n")}
    assert "<script>" not in page
    assert "nav ?]0;all is well???$" in page
    animate_run(LogReport(str(named), 1, 100, 0, ""), tmp_path / "run.gif")
    replay([str(named), "--policy", str(log.parent / "straight")])
    said = capsys.readouterr()
    assert (said.out + said.err).replace("\n", "").isprintable()


def test_a_disk_that_is_full(log, tmp_path, capsys):
    for name in ("page.html", "run.gif", "what.png"):
        (tmp_path / name).symlink_to("/dev/full")
    page, picture = tmp_path / "page.html", tmp_path / "what.png"
    full = "cannot be written (No space left on device)"
    assert refused(capsys, log, "-o", page) == f"edge-report: {page}: {full}"
    with pytest.raises(ConfigError, match=r"run\.gif: cannot be written \(No space left on device\)$"):
        animate_run(LogReport(str(log), 1, 100, 0, ""), tmp_path / "run.gif")
    (tmp_path / "none.toml").write_text("objectives = []\n")
    flags = ["--policy", str(log.parent / "straight"), "--objectives", str(tmp_path / "none.toml")]
    assert replay([str(log), *flags, "-o", str(picture)]) == 2
    assert capsys.readouterr().err == f"edge-replay: -o {picture}: {full}\n"


def test_robots_in_space_are_drawn_from_above_and_their_height_is_told(log, tmp_path, run):
    flying = in_space(log, tmp_path / "space_000.mcap", 2.5)
    assert main([str(flying), "-o", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert "Seen from above." in page
    assert "height in m" in page
    team, plane = team_of([digest(read_log(flying), "")]), team_of([run])
    for one, other in zip(team.tracks, plane.tracks, strict=True):
        assert one.position_m[:, 2].tolist() == [2.5] * len(one.time_s)
        np.testing.assert_allclose(one.speed_m_s, other.speed_m_s)
        np.testing.assert_allclose(one.goal_distance_m, other.goal_distance_m)
        np.testing.assert_allclose(separation(one, team), separation(other, plane))
    animate_run(LogReport(str(flying), 1, 0, 0, ""), tmp_path / "space.gif")
    assert (tmp_path / "space.gif").stat().st_size


def test_logs_of_the_plane_and_of_space_are_not_put_together(log, tmp_path, capsys):
    start, *rest = read_log(log)
    other = msgspec.structs.replace(start, robot_id=5, run="another")
    moved = in_space(write(tmp_path / "other.mcap", [other, *rest]), tmp_path / "space.mcap")
    assert main([str(log), str(moved), "-o", str(tmp_path / "page.html")]) == 2
    assert "some logs are of robots in the plane, others of robots in space" in capsys.readouterr().err
