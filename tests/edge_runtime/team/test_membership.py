"""Teams as the fleet file describes them: what opens, what is refused, and processes on the loopback."""

import hashlib
import random
import socket
from contextlib import ExitStack

import pytest
from fleet_processes import UNREACHABLE, Process, hostile, mission, robot

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, RobotState, Teammate
from edge_runtime.team.membership import Alone, open_fleet

OWN = RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0))


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

    def ranges_m(self):
        return (0.25,) * 12

    def tracked(self):
        return ()

    def readings(self):
        return ()


def test_without_a_carrier_the_team_is_the_local_one():
    with open_fleet(mission(DEFAULT_FLEET), Simulated()) as link:
        link.share(OWN, Command(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0)))
        view = link.team(link.locate(OWN))
        assert (view.own, view.teammates, view.fault) == (OWN, Simulated().teammates(), "")
        assert view.ranges_m == Simulated().ranges_m()
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


KEEP_CLEAR = '[[objectives]]\ntype = "obstacle_margin"\ndistance_m = 0.2\n'
ONE = "[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n"


def test_a_robot_that_could_see_no_obstacles_is_not_asked_to_keep_clear_of_them(write, tmp_path):
    path = write([robot(0), robot(1), KEEP_CLEAR])
    with pytest.raises(
        ConfigError, match=r'robots\[1\].ranges: "teammates" shows no obstacles, .*; allowed: the'
    ):
        mission(path, 1)
    with pytest.raises(ConfigError, match=r"robots\[0\].ranges"):
        mission(write([robot(0), robot(1)])).guide_of("new.toml", KEEP_CLEAR.encode())
    mission(write([robot(0, 'ranges = "127.0.0.1:47101"'), KEEP_CLEAR])).guide()
    alone = tmp_path / "alone.toml"
    alone.write_text(ONE + KEEP_CLEAR)
    open_fleet(mission(alone), Simulated())
    with pytest.raises(
        ConfigError, match="carrier: missing: it brings the ranges that obstacle_margin needs"
    ):
        open_fleet(mission(alone), Alone())
    alone.write_text(ONE + "[[obstacle]]\ncentre_m = [1, 1]\nradius_m = 0.1\n")
    with pytest.raises(ConfigError, match="obstacle: means nothing on a real robot"):
        open_fleet(mission(alone), Alone())


def test_a_robot_without_neighbours_waits_for_nobody(write):
    with open_fleet(mission(write([robot(0)])), Simulated()) as link:
        assert link.team(link.locate(OWN)).fault == ""


def test_the_example_of_a_team_is_the_built_in_fleet_with_addresses():
    example, built_in = load_fleet(DEFAULT_FLEET.with_name("udp.toml")), load_fleet(DEFAULT_FLEET)
    places = [(member.id, member.start_m, member.goal_m) for member in built_in.robots]
    assert [(member.id, member.start_m, member.goal_m) for member in example.robots] == places
    assert example.objective_set == built_in.objective_set


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


@pytest.fixture
def team(write):
    """Three robots as processes that have found each other over a network that loses a fifth."""
    path = write([robot(robot_id) for robot_id in range(3)])
    with ExitStack() as stack:
        processes = [Process(path, robot_id, 0.2, stack) for robot_id in range(3)]
        while processes[0].tick()["mates"] != [1, 2]:
            pass
        yield path, processes


def unheard(seen, robot_id):
    """Whether the last thirty ticks knew nothing newer of a robot."""
    return len(seen) > 30 and len({tick["newest"][robot_id] for tick in seen[-30:]}) == 1


def test_a_killed_process_is_masked_within_three_periods(team):
    _, (watching, _, victim) = team
    for _ in range(20):
        watching.tick()
    victim.process.kill()
    seen = [watching.tick()]
    while not (unheard(seen, "2") and seen[-1]["newest"]["1"] > seen[-30]["newest"]["1"]):
        seen.append(watching.tick())
    _, report = watching.end()
    heard = [tick["newest"]["2"] for tick in seen]
    visible = [2 in tick["mates"] for tick in seen[heard.index(heard[-1]) :]]
    assert visible == sorted(visible, reverse=True)
    assert visible.count(True) <= 4  # the tick that heard it last, and three periods
    assert report["masked"]["2"] >= visible.count(False)
    assert report["refused"].keys() <= {"unanswered"}
    assert report["failures"] == {}


def test_hostile_frames_change_nothing(team):
    path, (target, *_) = team
    host, _, port = load_fleet(path).robots[0].address.rpartition(":")
    draw, refused = random.Random(7), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        while refused < 3_000:
            tick = target.tick()
            refused = tick["refused"]
            assert max(map(int, tick["newest"].values())) < UNREACHABLE
            for _ in range(100):
                attacker.sendto(hostile(draw), (host, int(port)))
    rest, report = target.end()
    assert all(max(tick["newest"].values()) < UNREACHABLE for tick in rest)
    assert report["refused"].keys() - {"unanswered"} == {"foreign", "malformed"}
