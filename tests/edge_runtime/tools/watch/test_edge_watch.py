"""edge-watch and the robot's side on real sockets and terminals."""

import os
import pty
import select
import signal
import socket
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from bundles import MANIFEST
from msgspec.structs import replace
from ports import free_port
from waiting import HANG_S, until
from watch_fakes import KEY, status

from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.guidance.guide import make_guide
from edge_runtime.messages import Command, GuidedAction, RobotState, Teammate, TeamState
from edge_runtime.network.datagrams import call
from edge_runtime.network.seal import Magic, seal
from edge_runtime.policy.bundle import Bundle
from edge_runtime.telemetry.status import LONGEST, decode, encode
from edge_runtime.telemetry.status_sender import FAREWELLS, RATE_HZ, StatusSender, Unwatched, open_watch
from edge_runtime.tools.watch.edge_watch import main
from edge_runtime.tools.watch.feed import ASK_S, FORGET_S, Feed

OWN = RobotState(0, 0.0, (0.0, 0.0), (0.3, 0.0))
TEAM = TeamState(OWN, (Teammate(RobotState(1, 0.0, (3.0, 4.0), (0.0, 0.0)), age_s=0.01),))
GUIDED = GuidedAction((0.1, 0.0), 10, costs=(0.0, 0.5), conflicts=(0, 4))
COMMAND = Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0), stop_reason="waits")
OBJECTIVES = """
[[objectives]]
type = "speed_limit"
limit_m_s = 0.3
[[objectives]]
type = "safety_margin"
distance_m = 0.25
"""


@pytest.fixture
def fleet(tmp_path):
    """A fleet file of two robots with a key and a free watcher's address."""
    (tmp_path / "team.key").write_bytes(KEY)
    (tmp_path / "team.key").chmod(0o600)
    robots = "".join(
        f"[[robots]]\nid = {index}\nstart_m = [0, {index}]\ngoal_m = [1, {index}]\n"
        f'address = "127.0.0.1:{free_port()[1]}"\n'
        for index in range(2)
    )
    path = tmp_path / "team.toml"
    watch = f'[watch]\naddress = "127.0.0.1:{free_port()[1]}"\n'
    path.write_text(f'[carrier]\nkey = "team.key"\n{watch}{robots}{OBJECTIVES}')
    return path


@pytest.fixture
def sender(fleet):
    """Makes a robot's sender on a clock that the test moves."""
    opened = []

    def make(address, clock):
        mission = mission_of(fleet)
        monitor = Monitor(mission.fleet, 1, 10, mission.objective_set)
        monitor.update(TEAM, GUIDED, COMMAND)
        timing = TimingRecord(("read", "act"))
        opened.append(StatusSender(mission, monitor, DeadlineGrid(0.02), timing, address, KEY, clock=clock))
        return opened[-1]

    yield make
    for each in opened:
        each.close()


def mission_of(path):
    loaded = load_fleet(path)
    return Mission(0, loaded, Bundle(MANIFEST, None, Path()), loaded.objective_set, 50.0)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_robot_tells_of_itself_a_few_times_a_second(sender, host):
    now = [0.0]
    try:
        address = free_port(host)
    except OSError:
        pytest.skip(f"{host} is not available here")
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(address)
        receiver.settimeout(HANG_S)
        robot = sender(address, lambda: now[0])
        for tick in range(50):
            now[0] = 0.02 * tick
            robot.tell(TEAM, GUIDED, COMMAND)
        heard = [decode(receiver.recv(8192), KEY) for _ in range(round(RATE_HZ))]
        receiver.setblocking(False)
        with pytest.raises(BlockingIOError):
            receiver.recv(8192)
    assert [each.sequence for each in heard] == [1, 2, 3, 4, 5]
    told = heard[-1]
    assert (told.goal_distance_m, told.nearest_m, told.ages_s) == (1.0, 5.0, {1: 0.01})
    assert [tuple(getattr(item, field) for field in item.__struct_fields__) for item in told.objectives] == [
        ("speed_limit", "0.3 m/s", 0.0, 0.0),
        ("safety_margin", "0.25 m", 0.5, 0.4),
    ]
    assert (told.speed_limit_m_s, told.margin_m, told.stop_reason) == (0.3, 0.25, "waits")
    assert list(told.stages) == ["wake", "read", "act"]


def test_what_the_network_does_not_take_is_counted(sender):
    robot = sender(("255.255.255.255", 9), lambda: 0.0)  # a broadcast, which no socket may send unasked
    robot.tell(TEAM, GUIDED, COMMAND)
    assert sum(robot.failures.values()) == 1


def test_the_last_words_say_why_the_run_ended(sender):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(HANG_S)
        robot = sender(receiver.getsockname(), lambda: 0.0)
        robot.end("nothing was told yet")
        robot.tell(TEAM, GUIDED, COMMAND)
        robot.end("goals held")
        heard = [decode(receiver.recv(8192), KEY) for _ in range(1 + FAREWELLS)]
    assert [each.ended for each in heard] == ["", *["goals held"] * FAREWELLS]
    assert [each.sequence for each in heard] == [1, 2, 3, 4]


def test_objectives_that_are_exchanged_are_told(sender, fleet, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(HANG_S)
        robot = sender(receiver.getsockname(), lambda: 0.0)
        slower = tmp_path / "slower.toml"
        slower.write_text(fleet.read_text().replace("0.3", "0.1"))
        asked = load_fleet(slower).objective_set
        robot.adopt(replace(make_guide(asked, MANIFEST.motion), version=7))
        robot.tell(TEAM, GUIDED, COMMAND)
        told = decode(receiver.recv(8192), KEY)
    assert (told.objectives_version, told.speed_limit_m_s, told.objectives[0].limit) == (7, 0.1, "0.1 m/s")


def test_without_a_watcher_nobody_is_told(tmp_path, fleet):
    path = tmp_path / "alone.toml"
    lines = fleet.read_text().splitlines()
    start = lines.index("[watch]")
    path.write_text("\n".join(lines[:start] + lines[start + 2 :]))
    mission = mission_of(path)
    watch = open_watch(
        mission, Monitor(mission.fleet, 1, 10, mission.objective_set), DeadlineGrid(0.02), TimingRecord(())
    )
    assert isinstance(watch, Unwatched)


class Talking:
    """Robots that send a status each time they are asked to."""

    def __init__(self, fleet):
        host, port = load_fleet(fleet).watch.address.split(":")
        self.address, self.sequence = (host, int(port)), 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def say(self, *robot_ids):
        self.sequence += 1
        for robot_id in robot_ids:
            now = time.time()
            told = status(robot_id, self.sequence, sent_s=now, started_s=now)
            self.socket.sendto(encode(told, KEY), self.address)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()


def watch(fleet, *flags, **options):
    command = [sys.executable, "-m", "edge_runtime.tools.watch", "--fleet", str(fleet), *flags]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.parametrize("robots", [(0, 1), (1,)])
def test_once_says_whether_everybody_is_there(fleet, robots):
    def asked():
        """Whether all that talk were heard in its few seconds, which a busy machine may sleep through."""
        with Talking(fleet) as team, watch(fleet, "--once") as process:
            while process.poll() is None:
                team.say(*robots)
                time.sleep(0.05)
            shown = process.stdout.read().splitlines()
            driving = [index for index, line in enumerate(shown) if "driving" in line]
            assert process.stderr.read() == ""
            assert process.returncode == int(driving != [0, 1])
            assert set(driving) <= set(robots)
            return driving == list(robots)

    until(asked)


def test_a_pipe_gets_plain_lines_and_a_signal_ends_them(fleet):
    with Talking(fleet) as team, watch(fleet) as process:
        shown = ""
        while "robot 1  driving" not in shown:
            team.say(0, 1)
            shown += arrived(process.stdout.fileno()).decode()
        process.send_signal(signal.SIGTERM)
        assert (process.wait(timeout=HANG_S), process.stderr.read()) == (0, "")
    assert "\x1b" not in shown


def test_a_script_asks_beside_somebodys_screen(fleet):
    """The first one passes on what it hears, and sees no less for it."""
    with Talking(fleet) as team, watch(fleet) as first:
        shown = ""
        while "robot 1  driving" not in shown:
            team.say(0, 1)
            shown += arrived(first.stdout.fileno()).decode()

        def asked():
            with watch(fleet, "--once") as second:
                while second.poll() is None:
                    team.say(0, 1)
                    time.sleep(0.02)
                    arrived(first.stdout.fileno())
                assert "passes on what it hears" in second.stderr.read()
                assert (second.stdout.read().count("driving") == 2) == (second.returncode == 0)
                return second.returncode == 0

        until(asked)  # a busy machine may sleep through its few seconds
        team.say(0, 1)
        first.send_signal(signal.SIGTERM)
        assert first.wait(timeout=HANG_S) == 0


class Clock:
    now_s = 0.0

    def __call__(self):
        return self.now_s


def test_who_holds_the_address_passes_on_to_this_machine_alone_and_is_followed():
    place, clock = free_port(), Clock()
    packet = encode(status(0), KEY)
    with Feed(place, KEY, clock) as first, Feed(place, KEY, clock) as second, call(place, 99) as robot:
        assert (first.first_hand, second.first_hand) == (True, False)
        robot.send(seal(Magic.LISTEN, b"", bytes(32)), place)  # not made with the key: it gets nothing
        robot.send(packet, place)
        assert until(lambda: list(first.receive())) == [packet]
        assert until(lambda: list(second.receive())) == [packet]
        assert not list(robot.receive())
        first.close()
        clock.now_s += ASK_S
        list(second.receive())
        assert second.first_hand
        robot.send(packet, place)
        assert until(lambda: list(second.receive())) == [packet]


def test_who_asks_no_more_is_forgotten():
    place, clock = free_port(), Clock()
    with Feed(place, KEY, clock) as first, call(place, LONGEST) as listener, call(place, 99) as robot:
        packet = encode(status(0), KEY)
        for asks, passed in ((True, True), (False, False)):
            if asks:
                listener.send(seal(Magic.LISTEN, b"", KEY), place)
            robot.send(packet, place)
            assert until(lambda: list(first.receive())) == [packet]
            assert until(lambda: list(listener.receive())) if passed else not list(listener.receive())
            clock.now_s += FORGET_S


def arrived(descriptor):
    """What a process wrote, after a short wait at most."""
    ready, _, _ = select.select([descriptor], [], [], 0.05)
    return os.read(descriptor, 65536) if ready else b""


def screen_of(output, columns=80, rows=24):
    pyte = pytest.importorskip("pyte")
    screen = pyte.Screen(columns, rows)
    pyte.ByteStream(screen).feed(output)
    return "\n".join(screen.display)


@pytest.mark.parametrize("end", [b"q", b"\x03"], ids=["q", "ctrl-c"])
def test_a_terminal_gets_a_screen_and_is_left_as_it_was(fleet, end):
    pytest.importorskip("rich")
    pytest.importorskip("pyte")
    command = [sys.executable, "-m", "edge_runtime.tools.watch", "--fleet", str(fleet)]
    child, terminal = pty.fork()
    if child == 0:
        size = {"TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
        os.execve(sys.executable, command, {**os.environ, **size})  # noqa: S606
    before, output = termios.tcgetattr(terminal), b""
    with Talking(fleet) as team:
        while not all(words in screen_of(output) for words in ("2 of 2", "driving", "q ends")):
            team.say(0, 1)  # a busy machine shows half a screen
            output += arrived(terminal)
        os.write(terminal, end)
        while b"\x1b[?1049l" not in output:
            output += arrived(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert termios.tcgetattr(terminal) == before
    os.close(terminal)


@pytest.mark.parametrize(
    "old, new, expected",
    [
        ("[watch]", "[watch]\nport = 3", "watch.port: unknown key; allowed: address"),
        ("127.0.0.1:", "192.0.2.1:", "is this the machine that [watch] names"),
        ('key = "team.key"', 'key = "none.key"', "No such file"),
    ],
)
def test_what_does_not_hold_together_is_one_line(fleet, capsys, old, new, expected):
    fleet.write_text(fleet.read_text().replace(old, new))
    assert main(["--fleet", str(fleet), "--once"]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith("edge-watch: ")
    assert expected in complaint
    assert complaint.count("\n") == 1


def test_a_fleet_without_a_watcher_is_told_how(tmp_path, capsys):
    (tmp_path / "fleet.toml").write_text("[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n")
    assert main(["--fleet", str(tmp_path / "fleet.toml")]) == 2
    assert 'watch: missing; add [watch] address = "' in capsys.readouterr().err
