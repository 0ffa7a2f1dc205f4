"""Teams over Zenoh on the loopback: sessions, access control and closing, against the library itself."""

import hashlib
import json
import os
import random
import shutil
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
import waiting
from bundles import MANIFEST
from fleet_fakes import ids
from fleet_processes import Process, hostile
from paths import ROOT
from ports import free_port

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Verdict
from edge_runtime.doctor.team import examine_team
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, RobotState
from edge_runtime.network import zenoh_session
from edge_runtime.network.team_wire import Frame, encode
from edge_runtime.network.tls import tls_files
from edge_runtime.network.zenoh_session import session_config, topic
from edge_runtime.policy.bundle import Bundle
from edge_runtime.team.membership import Alone, open_fleet

zenoh = pytest.importorskip("zenoh", reason="the extra `zenoh` is not installed")

KEY = hashlib.sha256(b"a key for tests").digest()
COMMAND = (0.0, 0.0)


def free_place():
    host, port = free_port()
    return f"{host}:{port}"


def robot(robot_id, extra=None):
    extra = f'zenoh = "{free_place()}"' if extra is None else extra
    place = f"start_m = [0, {robot_id}]\ngoal_m = [1, {robot_id}]"
    return f'[[robots]]\nid = {robot_id}\n{place}\naddress = "{free_place()}"\n{extra}\n'


@pytest.fixture
def write(tmp_path):
    def write_fleet(robots, carrier=""):
        (tmp_path / "team.key").write_bytes(KEY)
        (tmp_path / "team.key").chmod(0o600)
        path = tmp_path / "fleet.toml"
        head = f'[carrier]\ntype = "zenoh"\nkey = "team.key"\n{carrier}\n'
        path.write_text(head + "".join(robots))
        return path

    return write_fleet


def mission(path, robot_id=0):
    fleet = load_fleet(path)
    return Mission(robot_id, fleet, Bundle(MANIFEST, None, Path()), fleet.objective_set, 50.0)


class Member:
    """A robot of the team in this process, which is told when to tick."""

    def __init__(self, path, robot_id, stack):
        self.robot_id = robot_id
        self.link = stack.enter_context(open_fleet(mission(path, robot_id), Alone()))

    def tick(self):
        own = RobotState(self.robot_id, time.monotonic(), (0.0, float(self.robot_id)), (0.0, 0.0))
        view = self.link.team(self.link.locate(own))
        self.link.share(own, Command(self.robot_id, 0, own.stamp_s, COMMAND, COMMAND))
        return ids(view)


def until(condition, members=()):
    """Let the members tick until something holds."""
    waiting.until(
        lambda: condition([member.tick() for member in members]),
        pause_s=0.02,
        tell=lambda: [member.link.report() for member in members],
    )


def all_heard(seen):
    return all(len(mates) == len(seen) - 1 for mates in seen)


# Certificates, by the openssl command as docs/security.md shows it.


def pipe(path):
    path.unlink()
    os.mkfifo(path)


def issue(folder, name, ca="ca"):
    """Make a certificate with a common name, and the authority's where it is missing."""
    make_key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    if not (folder / f"{ca}.pem").exists():
        files = ["-keyout", f"{ca}.key", "-out", f"{ca}.pem"]
        openssl(folder, "req", "-x509", *make_key, *files, "-days", "2", "-subj", f"/CN={ca}")
    files = ["-keyout", f"{name}.key", "-out", f"{name}.csr"]
    openssl(folder, "req", *make_key, *files, "-subj", f"/CN={name}")
    (folder / "leaf.ext").write_text("basicConstraints=CA:FALSE\nsubjectAltName=DNS:robot\n")
    by = ["-CA", f"{ca}.pem", "-CAkey", f"{ca}.key", "-CAcreateserial", "-extfile", "leaf.ext"]
    openssl(folder, "x509", "-req", "-in", f"{name}.csr", *by, "-out", f"{name}.pem", "-days", "2")
    (folder / f"{name}.key").chmod(0o600)


def openssl(folder, *words):
    done = subprocess.run(["openssl", *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


TLS = '[carrier.tls]\nca = "ca.pem"\ncertificate = "robot-{id}.pem"\nprivate_key = "robot-{id}.key"\n'
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


@pytest.fixture
def certificates(tmp_path):
    for name in ("robot-0", "robot-1", "robot-2", "router"):
        issue(tmp_path, name)
    return tmp_path


def open_session(config):
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def test_three_processes_hear_each_other_and_mask_one_that_is_killed(write):
    path = write([robot(robot_id) for robot_id in range(3)])
    with ExitStack() as stack:
        watching, other, victim = (Process(path, robot_id, 0.0, stack) for robot_id in range(3))
        while watching.tick()["mates"] != [1, 2]:
            pass
        victim.process.kill()
        while watching.tick()["mates"] != [1]:
            pass
        _, report = watching.end()
        _, others = other.end()
    for told in (report, others):
        assert told["accepted"] > 0
        assert told["failures"] == {}
        assert told["refused"].keys() <= {"unanswered"}
    assert report["masked"]["2"] > 0


def test_foreign_frames_are_dropped_and_counted(write):
    path = write([robot(0), robot(1)])
    draw = random.Random(5)
    with ExitStack() as stack:
        members = [Member(path, robot_id, stack) for robot_id in (0, 1)]
        until(all_heard, members)
        fleet = load_fleet(path)
        attacker = session_config(fleet.carrier, robot_2(), fleet.robots, None)
        attacker["listen"]["endpoints"] = []
        session = stack.enter_context(open_session(attacker))

        def attack(_):
            for _ in range(20):
                session.put(topic(1, 0), hostile(draw))
            session.put(topic(1, 0), bytes(100_000))
            refused = members[0].link.report().refused
            return refused.get("foreign", 0) > 50 and refused.get("malformed", 0) > 20

        until(attack, members)
        until(all_heard, members)
        assert members[0].link.report().refused.keys() <= {"foreign", "malformed", "unanswered"}


def robot_2():
    """Somebody who is not in the fleet file, and connects to all who are."""
    record = load_fleet(DEFAULT_FLEET).robots[2]
    return type(record)(2, record.start_m, record.goal_m, zenoh=free_place())


def test_a_member_is_not_heard_as_another_nor_over_udp(write):
    """It has the team's key, but each topic is one robot's, and no frame comes over UDP."""
    path = write([robot(robot_id) for robot_id in range(3)])
    host, _, port = load_fleet(path).robots[0].address.rpartition(":")
    forged = encode(frame(sender=1, receiver=0), KEY)
    with ExitStack() as stack:
        members = [Member(path, robot_id, stack) for robot_id in range(3)]
        until(all_heard, members)
        sender = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        ways = {
            "UDP": lambda: sender.sendto(forged, (host, int(port))),
            "its own topic": lambda: members[2].link._carrier.send(0, forged),
        }
        for way in ways.values():
            before = members[0].link.report().refused.get("impersonated", 0)

            def refused(_, way=way, before=before):
                way()  # once more: a busy network may lose it
                return members[0].link.report().refused.get("impersonated", 0) > before + 5

            until(refused, members)
        newest = members[0].link._peers[1].newest
        assert newest.state.position_m == (0.0, 1.0)


def frame(sender, receiver):
    return Frame(receiver, 7, 2**40, 7, 7, RobotState(sender, 0.0, (9.0, 9.0), (0.0, 0.0)), (0.0, 0.0))


@needs_openssl
def test_a_certificate_lets_a_robot_publish_as_nobody_else(write, certificates):
    path = write([robot(robot_id) for robot_id in range(3)], TLS)
    fleet = load_fleet(path)
    with ExitStack() as stack:
        members = [Member(path, robot_id, stack) for robot_id in (0, 1)]
        mesh = [other for other in fleet.robots if other.id != 2]
        config = session_config(
            fleet.carrier, fleet.robot(2), mesh, tls_files(fleet.carrier.tls, certificates, 2)
        )
        del config["access_control"]  # robot 2 has been taken over: only the others still hold it back
        session = stack.enter_context(open_session(config))
        heard = members[0].link._carrier._arrived

        def as_itself(_):
            session.put(topic(2, 0), encode(frame(sender=2, receiver=0), bytes(32)))
            return any(datagram.sender == 2 for datagram in list(heard))  # Zenoh's threads add to it

        until(as_itself)
        heard.clear()
        for _ in range(50):
            session.put(topic(1, 0), encode(frame(sender=1, receiver=0), bytes(32)))
            session.put("cfpg/**", b"as all")
        until(as_itself)  # what was sent before has come or never will
        assert {datagram.sender for datagram in list(heard)} == {2}


@needs_openssl
def test_a_certificate_of_another_authority_does_not_get_in(write, certificates):
    path = write([robot(robot_id) for robot_id in range(3)], TLS)
    fleet = load_fleet(path)
    issue(certificates, "robot-2", ca="other")
    shutil.copy(certificates / "other.pem", certificates / "both.pem")
    with (certificates / "both.pem").open("ab") as both:
        both.write((certificates / "ca.pem").read_bytes())
    with ExitStack() as stack:
        members = [Member(path, robot_id, stack) for robot_id in (0, 1)]
        until(lambda seen: seen == [[1], [0]], members)
        foreign = type(fleet.carrier.tls)("both.pem", "robot-2.pem", "robot-2.key")
        mesh = [other for other in fleet.robots if other.id != 2]
        config = session_config(fleet.carrier, fleet.robot(2), mesh, tls_files(foreign, certificates, 2))
        config["connect"] |= {"timeout_ms": 500, "exit_on_failure": True}
        with pytest.raises(zenoh.ZError, match="connect"):
            open_session(config)


@needs_openssl
def test_robots_hear_each_other_through_a_router_as_documented(write, certificates, monkeypatch):
    place = free_place()
    path = write([robot(robot_id, "") for robot_id in range(3)], f'router = "tls/{place}"\n{TLS}')
    with pytest.raises(ConfigError, match=r"fleet.toml: carrier.router: Zenoh cannot reach tls/"):
        open_fleet(mission(path), Alone())
    monkeypatch.setattr(zenoh_session, "ROUTER_WAIT_MS", 1000 * int(waiting.HANG_S))
    page = (ROOT / "docs" / "security.md").read_text()
    text = page.partition("```json5\n")[2].partition("```")[0]
    text = text.replace("0.0.0.0:7447", place).replace("/etc/cfpg-edge/tls", str(certificates))
    with ExitStack() as stack:
        stack.enter_context(zenoh.open(zenoh.Config.from_json5(text)))
        members = [Member(path, robot_id, stack) for robot_id in range(3)]
        until(all_heard, members)
        until(lambda _: ways(members[0]) == {"tls", "quic"}, members)
        evil, heard = members[2].link._carrier._session, members[0].link._carrier._arrived
        for _ in range(50):
            evil.put(topic(1, 0), b"as robot 1")

        def senders():
            return {datagram.sender for datagram in list(heard) if not datagram.content}  # neither is a frame

        until(lambda _: evil.put(topic(2, 0), b"as itself") or senders())
        assert senders() == {2}


def ways(member):
    """The protocols of a member's links."""
    return {str(link.dst).partition("/")[0] for link in member.link._carrier._session.info.links()}


def test_closing_gives_up_on_a_session_that_hangs(write):
    released = threading.Event()

    class Hanging:
        def close(self):
            released.wait()

    with ExitStack() as stack:
        member = Member(write([robot(0), robot(1)]), 0, stack)
        carrier = member.link._carrier
        session, carrier._session = carrier._session, Hanging()
        closing = threading.Thread(target=carrier.close)
        closing.start()
        closing.join(waiting.HANG_S)
        assert not closing.is_alive()
        released.set()
        carrier._session = session


def test_garbage_on_its_port_neither_ends_a_member_nor_keeps_it_from_closing(write):
    path = write([robot(0), robot(1)])
    draw = random.Random(3)
    with ExitStack() as stack:
        members = [Member(path, robot_id, stack) for robot_id in (0, 1)]
        until(all_heard, members)
        host, _, port = load_fleet(path).robots[0].zenoh.rpartition(":")
        for _ in range(20):
            with socket.create_connection((host, int(port))) as attacker:
                attacker.sendall(draw.randbytes(2000))
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
                attacker.sendto(draw.randbytes(200), (host, int(port)))
        until(all_heard, members)


def test_the_doctor_checks_a_team_on_zenoh(write):
    team, neighbours = examine_team(mission(write([robot(0), robot(1)])), simulated=False)
    assert (team.verdict, neighbours.verdict) == (Verdict.OK, Verdict.OK)
    place = free_place()
    with socket.socket() as taken:
        host, _, port = place.rpartition(":")
        taken.bind((host, int(port)))
        taken.listen()
        path = write([robot(0, f'zenoh = "{place}"'), robot(1)])
        team, _ = examine_team(mission(path), simulated=False)
    assert team.verdict is Verdict.FAIL
    assert f"robots[0].zenoh: Zenoh cannot use {place}" in team.detail


def test_the_example_is_the_one_for_udp_on_another_carrier():
    example, udp = (load_fleet(DEFAULT_FLEET.with_name(name)) for name in ("zenoh.toml", "udp.toml"))
    assert example.carrier.type == "zenoh"
    assert [(r.id, r.start_m, r.goal_m, r.address) for r in example.robots] == [
        (r.id, r.start_m, r.goal_m, r.address) for r in udp.robots
    ]
    assert example.objective_set == udp.objective_set


def test_without_the_extra_it_is_refused_in_one_line(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(ConfigError, match=r"carrier.type: .*pip install 'cfpg-edge\[zenoh\]'") as caught:
        open_fleet(mission(write([robot(0), robot(1)])), Alone())
    assert "\n" not in str(caught.value)


@needs_openssl
@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda at: (at / "robot-0.key").chmod(0o644), r"carrier.tls.private_key: .* is open to other users"),
        (lambda at: (at / "robot-0.key").unlink(), r"carrier.tls.private_key: .* cannot be read \(No such"),
        (lambda at: (at / "robot-0.pem").unlink(), r"carrier.tls.certificate: .* cannot be used .*No such"),
        (lambda at: (at / "ca.pem").unlink(), r"carrier.tls.ca: .* cannot be used \(No such file"),
        (lambda at: (at / "ca.pem").write_text("x"), r"carrier.tls.ca: .* cannot be used"),
        (lambda at: pipe(at / "ca.pem"), r"carrier.tls.ca: .* cannot be used \(not a regular file"),
        (lambda at: pipe(at / "robot-0.pem"), r"carrier.tls.certificate: .*not a regular file"),
        (lambda at: pipe(at / "robot-0.key"), r"carrier.tls.private_key: .*not a regular file"),
        (
            lambda at: shutil.copy(at / "robot-1.pem", at / "robot-0.pem"),
            r"carrier.tls.certificate: .*MISMATCH",
        ),
        (lambda at: issue(at, "robot-0", ca="other"), r"carrier.tls.certificate: .*local issuer"),
        (
            lambda at: [shutil.copy(at / f"robot-1.{end}", at / f"robot-0.{end}") for end in ("pem", "key")],
            r"carrier.tls.certificate: .* is of 'robot-1', not of 'robot-0'",
        ),
    ],
)
def test_certificates_that_do_not_fit_are_refused(write, certificates, spoil, complaint):
    path = write([robot(0), robot(1)], TLS)
    spoil(certificates)
    with pytest.raises(ConfigError, match=complaint) as caught:
        open_fleet(mission(path), Alone())
    assert "\n" not in str(caught.value)
    assert "fleet.toml: carrier.tls." in str(caught.value)


@pytest.mark.parametrize(
    ("robots", "carrier", "complaint"),
    [
        (['zenoh = "10.0.0.1"'], "", r"robots\[0\]: `address` must be one machine's IP and port"),
        ([""], "", r"robots\[0\].zenoh: missing"),
        (["", ""], 'router = "tls/here"', r"carrier.router: must be such as tls/router.local:7447"),
        (["", ""], 'router = "tls/here:7447"', r"carrier.router: .*add \[carrier.tls\]"),
        (["", ""], f'router = "tcp/here:7447"\n{TLS}', r'carrier.router: .*use "tls/...'),
        (['zenoh = "10.0.0.1:1"'], 'router = "tcp/here:7447"', r"robots\[0\].zenoh: means nothing"),
        (['zenoh = "10.0.0.1:1"', 'zenoh = "10.0.0.1:1"'], "", r"robots\[1\].zenoh: .* is taken"),
        ([""], '[carrier.tls]\nca = "ca.pem"', r"carrier.tls.certificate: missing; allowed: ca, certificate"),
        ([""], f"{TLS}cipher = 1", r"carrier.tls.cipher: unknown key; allowed: ca, certificate, private_key"),
    ],
)
def test_what_does_not_hold_together_is_refused(write, robots, carrier, complaint):
    path = write([robot(index, extra) for index, extra in enumerate(robots)], carrier)
    with pytest.raises(ConfigError, match=complaint):
        load_fleet(path)


@pytest.mark.parametrize("key", ['router = "tcp/here:7447"', TLS])
def test_what_only_zenoh_has_is_refused_without_it(write, key):
    path = write([robot(0, "")], key)
    path.write_text(path.read_text().replace('type = "zenoh"', 'type = "udp"'))
    with pytest.raises(ConfigError, match=r'means nothing unless \[carrier\] has type = "zenoh"'):
        load_fleet(path)
