"""What the doctor says of a team's network, on the loopback."""

import hashlib
import socket
from pathlib import Path

import pytest
from bundles import MANIFEST
from ports import free_port

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.team import examine_team
from edge_runtime.policy.bundle import Bundle


@pytest.fixture
def team(tmp_path):
    """Findings for robot 0 of a fleet whose robots have these addresses."""
    (tmp_path / "team.key").write_bytes(hashlib.sha256(b"a key for tests").digest())
    (tmp_path / "team.key").chmod(0o600)

    def examine(*addresses, listens=""):
        robots = [
            f'[[robots]]\nid = {i}\nstart_m = [0, {i}]\ngoal_m = [1, {i}]\naddress = "{address}"\n{listens}\n'
            for i, address in enumerate(addresses)
        ]
        path = tmp_path / "fleet.toml"
        path.write_text('[carrier]\nkey = "team.key"\n' + "".join(robots))
        return list(examine_team(mission(path), simulated=False))

    return examine


def mission(path):
    fleet = load_fleet(path)
    return Mission(0, fleet, Bundle(MANIFEST, None, Path()), fleet.objective_set, 50.0)


def local():
    host, port = free_port()
    return f"{host}:{port}"


def test_a_simulated_team_needs_no_network():
    (found,) = examine_team(mission(DEFAULT_FLEET), simulated=True)
    assert (found.name, found.verdict) == ("team", Verdict.OK)


def test_a_team_without_a_network_would_drive_blind():
    (found,) = examine_team(mission(DEFAULT_FLEET), simulated=False)
    assert found.verdict is Verdict.FAIL
    assert "carrier: missing" in found.detail


def test_a_lonely_robot_needs_no_network(tmp_path):
    (tmp_path / "alone.toml").write_text("[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n")
    (found,) = examine_team(mission(tmp_path / "alone.toml"), simulated=False)
    assert found.verdict is Verdict.OK


def test_a_team_on_this_machine_is_reachable_and_hears_nothing(team):
    own, other = local(), local()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind((other.split(":")[0], int(other.split(":")[1])))
        ear.setblocking(False)
        findings = team(own, other)
        with pytest.raises(BlockingIOError):
            ear.recv(1)
    assert [(found.name, found.verdict) for found in findings] == [
        ("team", Verdict.OK),
        ("neighbours", Verdict.OK),
    ]
    assert own in findings[0].detail
    assert other in findings[1].detail


def test_the_address_is_free_again_afterwards(team):
    own, other = local(), local()
    assert [found.verdict for found in (*team(own, other), *team(own, other))] == [Verdict.OK] * 4


def test_an_address_of_another_machine_fails(team):
    membership, _ = team("192.0.2.1:47000", local())
    assert membership.verdict is Verdict.FAIL
    assert "robots[0].address" in membership.detail


def test_a_key_that_others_can_read_fails(team, tmp_path):
    (tmp_path / "team.key").chmod(0o644)
    membership, _ = team(local(), local())
    assert membership.verdict is Verdict.FAIL
    assert "chmod 600" in membership.detail


def test_a_neighbour_without_a_route_fails(team):
    _, neighbours = team(local(), "192.0.2.1:47000")
    assert neighbours.verdict is Verdict.FAIL
    assert neighbours.detail.startswith("no route to robot 1 (")


def test_only_those_that_it_listens_to_count(team):
    _, neighbours = team(local(), "192.0.2.1:47000", listens="neighbours = []")
    assert (neighbours.verdict, neighbours.detail) == (Verdict.OK, "routes lead to all 0: none")
