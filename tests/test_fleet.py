"""Teams as the fleet file describes them: what opens, what is refused, and processes on the loopback."""

import hashlib
import json
import random
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest
from bundles import MANIFEST
from test_fleet_udp import free_port

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, RobotState, Teammate
from edge_runtime.network.order_wire import ORDER_MAGIC, Stop, encode_order
from edge_runtime.network.team_wire import FRAME_BYTES, Frame, encode
from edge_runtime.policy.bundle import Bundle
from edge_runtime.team.membership import open_fleet

OWN = RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0))
UNREACHABLE = 2**40
"""A sequence that no robot of these tests reaches."""


def mission(path, robot_id=0):
    fleet = load_fleet(path)
    return Mission(robot_id, fleet, Bundle(MANIFEST, None, Path()), fleet.steering, 50.0)


def robot(robot_id, extra=""):
    host, port = free_port()
    place = f"start_m = [0, {robot_id}]\ngoal_m = [1, {robot_id}]"
    return f'[[robots]]\nid = {robot_id}\n{place}\naddress = "{host}:{port}"\n{extra}\n'


@pytest.fixture
def write(tmp_path):
    def write_fleet(robots, carrier=""):
        (tmp_path / "team.key").write_bytes(hashlib.sha256(b"a key for tests").digest())
        (tmp_path / "team.key").chmod(0o600)
        path = tmp_path / "fleet.toml"
        path.write_text(f'[carrier]\nkey = "team.key"\n{carrier}\n' + "".join(robots))
        return path

    return write_fleet


class Simulated:
    def teammates(self):
        return (Teammate(RobotState(1, 0.0, (1.0, 0.0), (0.0, 0.0))),)


def test_without_a_carrier_the_team_is_the_local_one():
    with open_fleet(mission(DEFAULT_FLEET), Simulated()) as link:
        link.share(OWN, Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0)))
        view = link.team(link.locate(OWN))
        assert (view.own, view.teammates, view.fault) == (OWN, Simulated().teammates(), "")
        assert link.report() is None


def test_the_rules_come_from_the_fleet_file(write):
    robots = [robot(0), robot(1, "neighbours = [2]"), robot(2)]
    path = write(robots, "nearest = 2\nalone_s = 4\nmissing_s = 5")
    expected = {0: ((1, 2), 2), 1: ((2,), 1), 2: ((0, 1), 2)}
    for robot_id, (neighbours, nearest) in expected.items():
        with open_fleet(mission(path, robot_id), Simulated()) as link:
            rules = link._rules
            assert (rules.neighbours, rules.nearest) == (neighbours, nearest)
            assert (rules.stale_s, rules.alone_s, rules.missing_s) == (pytest.approx(0.06), 4.0, 5.0)
            assert link.team(link.locate(OWN)).teammates == ()


def test_a_robot_without_neighbours_waits_for_nobody(write):
    with open_fleet(mission(write([robot(0)])), Simulated()) as link:
        assert link.team(link.locate(OWN)).fault == ""


def test_the_example_of_a_team_is_the_built_in_fleet_with_addresses():
    example, built_in = load_fleet(DEFAULT_FLEET.with_name("udp.toml")), load_fleet(DEFAULT_FLEET)
    places = [(member.id, member.start_m, member.goal_m) for member in built_in.robots]
    assert [(member.id, member.start_m, member.goal_m) for member in example.robots] == places
    assert example.steering == built_in.steering


def test_keys_that_do_not_fit_name_the_file_and_the_key(write, tmp_path):
    path = write([robot(0), robot(1)])
    (tmp_path / "team.key").chmod(0o644)
    with pytest.raises(
        ConfigError, match=r"fleet.toml: carrier.key: key .* is open to other users; run: chmod"
    ):
        open_fleet(mission(path), Simulated())
    (tmp_path / "team.key").unlink()
    with pytest.raises(
        ConfigError, match=r"fleet.toml: carrier.key: key .*: No such file or directory; create"
    ):
        open_fleet(mission(path), Simulated())


def test_an_address_in_use_names_the_file_and_the_key(write):
    path = write([robot(0), robot(1)])
    complaint = (
        r"fleet.toml: robots\[1\].address: cannot listen on 127.0.0.1 port \d+ \(Address already in use\)"
    )
    with open_fleet(mission(path, 1), Simulated()), pytest.raises(ConfigError, match=complaint):
        open_fleet(mission(path, 1), Simulated())


class Process:
    """A robot of the team in a process of its own."""

    def __init__(self, path, robot_id, loss, stack):
        program = Path(__file__).with_name("fleet_process.py")
        command = [sys.executable, str(program), str(path), str(robot_id), str(loss)]
        self.process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stack.callback(self.process.kill)

    def tick(self):
        return json.loads(self.process.stdout.readline())

    def read_on(self):
        """Read in a thread from here on: a full pipe would hold the process up."""
        self.rows = []
        self.reader = threading.Thread(target=lambda: self.rows.extend(map(json.loads, self.process.stdout)))
        self.reader.start()

    def rest(self):
        """The ticks read in the thread, and the report, of a process that ends by itself."""
        self.reader.join(20)
        assert self.process.wait(5) == 0
        *ticks, report = self.rows
        return ticks, report

    def end(self):
        """The ticks not read yet, and the report."""
        self.process.send_signal(signal.SIGTERM)
        *ticks, report = map(json.loads, self.process.stdout)
        assert self.process.wait() == 0
        return ticks, report


@pytest.fixture
def team(write):
    """Three robots as processes that have found each other over a network that loses a fifth."""
    path = write([robot(robot_id) for robot_id in range(3)])
    with ExitStack() as stack:
        processes = [Process(path, robot_id, 0.2, stack) for robot_id in range(3)]
        while processes[0].tick()["mates"] != [1, 2]:
            pass
        yield path, processes


def test_a_killed_process_is_masked_within_three_periods(team):
    _, (watching, _, victim) = team
    for _ in range(20):
        watching.tick()
    victim.process.kill()
    after = [watching.tick() for _ in range(40)]
    rest, report = watching.end()
    seen = [*after, *rest]
    heard = [tick["newest"]["2"] for tick in seen]
    visible = [2 in tick["mates"] for tick in seen[heard.index(heard[-1]) :]]
    assert len(visible) > 30
    assert visible == sorted(visible, reverse=True)
    assert visible.count(True) <= 4  # the tick that heard it last, and three periods
    assert seen[-1]["newest"]["1"] > seen[0]["newest"]["1"]
    assert report["masked"]["2"] >= visible.count(False)
    assert report["refused"].keys() <= {"unanswered"}
    assert report["failures"] == {}


def test_hostile_frames_change_nothing(team):
    path, (target, *_) = team
    host, _, port = load_fleet(path).robots[0].address.rpartition(":")
    draw, sent = random.Random(7), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        while sent < 30_000:  # a busy machine drops some before they are read
            sequences = {int(sequence) for sequence in target.tick()["newest"].values()}
            assert max(sequences) < UNREACHABLE
            for _ in range(100):
                attacker.sendto(hostile(draw), (host, int(port)))
                sent += 1
    rest, report = target.end()
    assert all(max(tick["newest"].values()) < UNREACHABLE for tick in rest)
    assert report["refused"].keys() - {"unanswered"} == {"foreign", "malformed"}
    assert report["refused"]["foreign"] + report["refused"]["malformed"] >= 10_000


def hostile(draw):
    """A frame by somebody who knows everything but the key."""
    state = RobotState(draw.choice([1, 2]), draw.uniform(0, 1e6), (9.0, 9.0), (0.0, 0.0))
    sequence = UNREACHABLE + draw.randrange(2**32)
    frame = Frame(
        0, draw.getrandbits(64), sequence, draw.getrandbits(64), draw.getrandbits(64), state, (1.0, 1.0)
    )
    packet = bytearray(encode(frame, draw.randbytes(32)))
    kind = draw.randrange(6)
    if kind == 0:
        return draw.randbytes(draw.randrange(2 * FRAME_BYTES))
    if kind == 1:
        packet[-32:] = bytes(32)
    elif kind == 2:
        packet = packet[: draw.randrange(FRAME_BYTES)]
    elif kind == 3:
        packet = encode_order(Stop(1, 2, 0, draw.getrandbits(64), 1e12), draw.randbytes(32))
    elif kind == 4:
        packet = ORDER_MAGIC + draw.randbytes(draw.randrange(2 * FRAME_BYTES))
    return bytes(packet)
