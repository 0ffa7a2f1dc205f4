"""edge-ctl against real processes on the loopback, a fifth of whose packets is lost."""

import hashlib
import re
import signal
from contextlib import ExitStack
from functools import partial

import pytest
from fleet_processes import Process, robot
from waiting import until

from edge_runtime.network.order_wire import FILE_BYTES
from edge_runtime.tools.ctl import edge_ctl as ctl

SLOW = '[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.1\n'


@pytest.fixture
def write(tmp_path):
    """A fleet of so many robots, with the key of its team and another one for its operator."""

    def write_fleet(count, carrier='operator_key = "operator.key"'):
        for name in ("team.key", "operator.key"):
            (tmp_path / name).write_bytes(hashlib.sha256(name.encode()).digest())
            (tmp_path / name).chmod(0o600)
        path = tmp_path / "fleet.toml"
        robots = "".join(robot(robot_id) for robot_id in range(count))
        path.write_text(f'[carrier]\nkey = "team.key"\n{carrier}\n{robots}')
        (tmp_path / "slow.toml").write_text(SLOW)
        return path

    return write_fleet


@pytest.fixture
def team(write):
    """Four robots that have found each other."""
    path = write(4)
    with ExitStack() as stack:
        processes = [Process(path, robot_id, 0.2, stack) for robot_id in range(4)]
        for process in processes:
            while len(process.tick()["mates"]) < 3:
                pass
        yield path, processes


def until_told(expected, capsys, act):
    """Act until this is the complaint: on a busy machine another robot may be too slow at first."""

    def told():
        assert act() == 1
        return capsys.readouterr().err == expected

    until(told)


def order(action, path, *more, timeout_s=8):
    """Give an order; the robots have as long to answer as there may be."""
    return ctl.main([action, *map(str, more), "--timeout", str(timeout_s), "--fleet", str(path)])


def test_all_change_at_one_tick_and_all_stop(team, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(ctl, "LEAD_S", 5.0)  # a busy machine may hold up the commitment, or a robot
    path, processes = team
    assert order("objectives", path, tmp_path / "slow.toml") == 0
    said = capsys.readouterr().out
    tick = int(re.fullmatch(r"4 robots follow version 1 from tick (\d+) on\n", said)[1])
    assert order("status", path) == 0
    rows = capsys.readouterr().out.splitlines()[1:]
    assert [row.split()[:5] for row in rows] == [
        [str(robot_id), "straight", "1", "speed_limit", "0.1"] for robot_id in range(4)
    ]
    assert order("stop", path) == 0
    assert capsys.readouterr().out == "4 robots stopped\n"
    for process in processes:
        ticks, report = process.rest()
        assert [row["version"] for row in ticks] == [int(row["tick"] >= tick) for row in ticks]
        assert ticks[0]["version"] == 0 and ticks[-1]["version"] == 1
        assert report["own_objectives_version"] == 1
        assert report["disagreed"] == {}


def test_without_one_of_them_nothing_changes(team, tmp_path, capsys):
    path, processes = team
    processes[2].process.send_signal(signal.SIGSTOP)
    until_told(
        "edge-ctl: nothing was changed: robot 2 does not answer\n",
        capsys,
        partial(order, "objectives", path, tmp_path / "slow.toml", timeout_s=0.5),
    )
    assert order("stop", path, timeout_s=3) == 1
    assert "robot 2 does not answer, and may drive" in capsys.readouterr().err
    processes[2].process.send_signal(signal.SIGCONT)
    assert {row["version"] for row in processes[0].rest()[0]} == {0}


def test_the_teams_key_orders_nothing_where_the_operator_has_an_own_one(write, tmp_path, capsys):
    path = write(1)
    with ExitStack() as stack:
        process = Process(path, 0, 0.0, stack)
        process.tick()
        key = ("--key-file", tmp_path / "team.key")
        assert order("stop", path, *key, timeout_s=0.3) == 1
        assert "0 robots stopped: robot 0 does not answer" in capsys.readouterr().err
        assert order("stop", path) == 0


def test_what_a_robot_refuses_is_said(write, tmp_path, capsys):
    """The own objective lies on the operator's machine only."""
    path = write(1)
    away = tmp_path / "away"
    away.mkdir()
    (away / "only_here.py").write_text(
        "from edge_runtime.objectives import Objective, Slope\n"
        "class Mine(Objective, frozen=True, kw_only=True):\n"
        "    def evaluate(self, motion, outlook):\n        return Slope(0.0)\n"
    )
    (away / "mine.toml").write_text('[[objectives]]\ntype = "only_here:Mine"\n')
    with ExitStack() as stack:
        process = Process(path, 0, 0.0, stack)
        process.tick()
        assert order("objectives", path, away / "mine.toml") == 1
        complaint = capsys.readouterr().err
        assert complaint.startswith("edge-ctl: nothing was changed: robot 0 refuses: ")
        assert "mine.toml: objectives[0].type: 'only_here:Mine' was not named by the files that" in complaint
        assert order("status", path) == 0
        assert order("stop", path) == 0


@pytest.mark.parametrize(
    "arguments, content, expected",
    [
        (["objectives"], "", "`objectives` needs a FILE"),
        (["stop", "{file}"], "", "`objectives` needs a FILE, `policy` a DIR, others none"),
        (["halt"], "", "argument action: invalid choice: 'halt'"),
        (["status", "--timeout", "nan"], "", "argument --timeout: must be a number in [0.1, 8], got 'nan'"),
        (["objectives", "{file}"], "x", "{file}: is not TOML"),
        (["objectives", "{file}"], SLOW.replace("0.1", "-1"), "{file}: objectives[0]: `limit_m_s` must be"),
        (["objectives", "{file}"], SLOW.replace("speed", "sped"), "{file}: objectives[0].type: unknown"),
        (
            ["objectives", "{file}"],
            "#" * (FILE_BYTES + 1),
            "{file}: has 8193 bytes; robots take at most 8192",
        ),
        (["objectives", "{file}.none"], "", "{file}.none: cannot be read (No such file or directory)"),
        (["status", "--key-file", "{file}"], "", "key {file} is open to other users; run: chmod 600"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_sent(write, tmp_path, capsys, arguments, content, expected):
    path, file = write(1), tmp_path / "file.toml"
    file.write_text(content)
    file.chmod(0o644)
    assert ctl.main([*(word.format(file=file) for word in arguments), "--fleet", str(path)]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith("edge-ctl: " + expected.format(file=file))
    assert complaint.count("\n") == 1


def test_a_team_without_a_network_cannot_be_ordered(tmp_path, capsys):
    path = tmp_path / "fleet.toml"
    path.write_text("[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 1]\n")
    assert order("stop", path) == 2
    assert (
        "fleet.toml: carrier: missing: these robots are simulated in one process" in capsys.readouterr().err
    )
