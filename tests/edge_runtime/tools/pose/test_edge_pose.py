"""edge-pose: recordings and a scripted Motive on one side, a robot's own link on the other."""

import contextlib
import errno
import json
import math
import re
import select
import socket
import struct
import threading
import time
from types import SimpleNamespace

import pytest
from fleet_processes import mission, robot
from natnet_packets import frame, rigid_body, server_info
from ports import free_port
from waiting import HANG_S, until

from edge_runtime.config.network import endpoint
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState
from edge_runtime.network.stream_wire import Kind
from edge_runtime.team.membership import Alone, open_fleet
from edge_runtime.tools.pose import edge_pose as command
from edge_runtime.tools.pose import feeds
from edge_runtime.tools.pose.feeds import NatNetFeed, _publish
from edge_runtime.tools.pose.recording import Sample, read_recording
from edge_runtime.tools.pose.stream_host import StreamHost
from edge_runtime.tools.pose.velocity import MotionFit, VelocityFit

KEY = bytes(range(32))


@pytest.fixture
def place():
    return free_port()


@pytest.fixture
def path(tmp_path, place):
    """A fleet of two robots, one of which gets its pose from a stream, as body 7."""
    (tmp_path / "team.key").write_bytes(KEY)
    (tmp_path / "team.key").chmod(0o600)
    file = tmp_path / "fleet.toml"
    source = f'pose = "{place[0]}:{place[1]}"\nrigid_body = 7\nneighbours = []'
    file.write_text('[carrier]\nkey = "team.key"\n' + robot(0, source) + robot(1))
    return file


def watch(path, arrived):
    """The states that robot 0 takes itself to be in, tick by tick, until one is as wanted."""
    seen = []

    def look():
        own = link.locate(RobotState(0, time.monotonic(), (9.0, 9.0), (9.0, 9.0)))
        if own:
            seen.append(own)
        return own and arrived(own)

    with open_fleet(mission(path), Alone()) as link:
        until(look, pause_s=0.005)
    return seen


def test_the_velocity_of_a_straight_line_is_its_slope():
    fit = VelocityFit()
    found = [fit.add(0.01 * k, (0.3 * 0.01 * k, 1.0 - 0.2 * 0.01 * k)) for k in range(20)]
    assert found[:2] == [None, None]
    for velocity in found[2:]:
        assert velocity == pytest.approx((0.3, -0.2))


def test_the_velocity_is_that_of_the_middle_of_the_window():
    """Under constant acceleration the fitted slope is exact there: 25 ms ago."""
    fit = VelocityFit()
    for k in range(100):
        velocity = fit.add(0.005 * k, (0.5 * 2.0 * (0.005 * k) ** 2, 0.0))
    assert velocity[0] == pytest.approx(2.0 * (0.005 * 99 - 0.025), abs=1e-9)


def test_a_gap_or_a_stamp_that_goes_back_starts_the_fit_anew():
    for stamp in (10.0, -10.0, 0.2, 0.2 + 1e-9):
        fit = VelocityFit()
        found = [fit.add(0.01 * k, (0.0, 0.0)) for k in range(21)]
        assert found[-1] == (0.0, 0.0)
        assert fit.add(stamp, (5.0, 5.0)) is None


def test_stamps_that_are_all_but_equal_give_no_velocity():
    fit = VelocityFit()
    assert [fit.add(k * 1e-200, (float(k), 0.0)) for k in range(9)] == [None] * 9


POSES = [{"t": 0.01 * k, "robot": 0, "x": 0.002 * k, "y": -1.0, "heading": 0.25} for k in range(20_000)]


@pytest.mark.parametrize("suffix", [".jsonl", ".csv"])
def test_a_recording_is_replayed_in_its_own_time(path, tmp_path, suffix, monkeypatch):
    file = tmp_path / f"poses{suffix}"
    if suffix == ".csv":
        rows = [",".join(POSES[0]), *(",".join(map(str, pose.values())) for pose in POSES)]
    else:
        rows = list(map(json.dumps, POSES))
    file.write_text("\n".join(rows) + "\n")
    flags = ["--fleet", str(path), "--replay", str(file)]
    signals, places = SimpleNamespace(reason=""), set()
    monkeypatch.setattr(command, "StopSignals", lambda: contextlib.nullcontext(signals))
    player = threading.Thread(target=command.main, args=(flags,))
    player.start()
    seen = watch(path, lambda own: places.add(own.position_m) or len(places) > 10)
    signals.reason = "enough"
    player.join(HANG_S)
    assert not player.is_alive()
    for own in seen:
        assert own.position_m[1] == -1.0
        assert own.velocity_m_s == pytest.approx((0.2, 0.0), abs=1e-9)
        assert own.heading_rad == 0.25


class Told:
    """A host that keeps what it is to tell."""

    def __init__(self):
        self.values = []

    def publish(self, kind, robot_id, stamp_s, values):
        assert (kind, robot_id) == (Kind.POSE, 0)
        self.values.append(values)


def test_poses_in_space_are_told_with_their_height():
    told, fit = Told(), MotionFit()
    for k in range(9):
        sample = Sample(t=0.01 * k, robot=0, x=0.1, y=0.2, z=0.005 * k, heading=0.25)
        _publish(sample, fit, told, sample.t)
    assert told.values[-1] == pytest.approx((0.1, 0.2, 0.04, 0.0, 0.0, 0.5, 0.25, 0.0), abs=1e-9)
    _publish(Sample(t=1, robot=0, x=1, y=2, z=3, vx=4, vy=5, vz=6), MotionFit(), told, 1.0)
    assert told.values[-1] == (1, 2, 3, 4, 5, 6, 0.0, 0.0)


class Motive:
    """A server of one moving rigid body among others, unicast to whoever connected."""

    def __init__(self, version=(4, 1), group=None, port=0):
        self.version, self.group = version, group
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        self.port = self.socket.getsockname()[1]
        self.alive, self.kept_alive = True, 0
        self.thread = threading.Thread(target=self.serve)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.alive = False
        self.thread.join()
        self.socket.close()

    def serve(self):
        client = None
        while self.alive:
            if select.select((self.socket,), (), (), 0.004)[0]:
                content, sender = self.socket.recvfrom(1000)
                self.kept_alive += content[0] == 10
                if content[0] == 0:
                    client = self.group or sender
                    self.socket.sendto(b"x", sender)
                    self.socket.sendto(struct.pack("<HH", 1, 5) + b"Motiv", sender)
                    self.socket.sendto(server_info(self.version, *self.group or ()), sender)
            elif client:
                stamp_s = 5000.0 + time.monotonic()
                turn = (0.0, math.sin(0.2), 0.0, math.cos(0.2))
                bodies = [
                    rigid_body(3, (7.0, 7.0, 7.0)),
                    rigid_body(7, (0.5, 0.1, -2.0), turn),
                    rigid_body(8, (8.0, 8.0, 8.0), tracked=False),
                ]
                self.socket.sendto(b"x", client)
                self.socket.sendto(frame(bodies, stamp_s, self.version), client)


@contextlib.contextmanager
def published(path, place, motive):
    """A feed from this Motive, published to the robot."""
    ended = threading.Event()
    with (
        StreamHost(endpoint(f"{place[0]}:{place[1]}"), robots(path), [0], [], KEY) as host,
        NatNetFeed("127.0.0.1", {7: 0}, "y", motive.port) as feed,
    ):
        server = threading.Thread(target=feed.publish, args=(host, lambda: "end" * ended.is_set()))
        server.start()
        try:
            yield feed
        finally:
            ended.set()
            server.join()


@pytest.mark.parametrize("version", [(4, 0), (4, 1), (4, 2)])
def test_rigid_bodies_reach_the_robot_that_carries_them(path, place, version):
    with Motive(version) as motive, published(path, place, motive) as feed:
        seen = watch(path, bool)
        until(lambda: motive.kept_alive)
    assert seen[-1].position_m == pytest.approx((0.5, 2.0))
    assert seen[-1].velocity_m_s == pytest.approx((0.0, 0.0), abs=1e-9)
    assert seen[-1].heading_rad == pytest.approx(0.4)
    assert time.monotonic() - 10.0 < seen[-1].stamp_s < time.monotonic()  # in our clock, not in Motive's
    assert feed.refused >= 1


def test_a_group_is_joined_where_the_server_is_reached(path, place):
    """On loopback here, whatever the machine's way to everywhere else is."""
    with Motive(group=("239.255.42.99", free_port()[1])) as motive, published(path, place, motive):
        assert watch(path, bool)


def test_a_network_that_is_gone_for_a_while_is_waited_for(path, place, monkeypatch):
    with Motive() as motive, published(path, place, motive) as feed:
        assert watch(path, bool)
        gone = Gone(feed._command._socket)
        monkeypatch.setattr(feed._command, "_socket", gone)
        assert gone.failed.wait(HANG_S)
        gone.there = True
        assert watch(path, bool)


class Gone:
    """A socket whose route has vanished, until it is there again."""

    def __init__(self, whole):
        self.whole, self.there, self.failed = whole, False, threading.Event()

    def fileno(self):
        return self.whole.fileno()

    def sendto(self, *arguments):
        return self._whole().sendto(*arguments)

    def recvmsg_into(self, *arguments):
        return self._whole().recvmsg_into(*arguments)

    def _whole(self):
        if not self.there:
            self.failed.set()
            raise OSError(errno.ENETUNREACH, "Network is unreachable")
        return self.whole

    def close(self):
        self.whole.close()


def test_a_server_that_started_anew_is_asked_again(path, place, monkeypatch):
    monkeypatch.setattr(feeds, "SILENT_S", 0.1)
    monkeypatch.setattr(feeds, "KEEP_ALIVE_S", 0.05)
    with contextlib.ExitStack() as stack:
        with Motive(port=free_port()[1]) as motive:
            stack.enter_context(published(path, place, motive))
            assert watch(path, bool)
        with Motive(port=motive.port):
            assert watch(path, bool)


def robots(path):
    return {member.id: endpoint(member.address) for member in mission(path).fleet.robots}


def test_an_interruption_is_not_kept_waiting_by_a_motive_that_does_not_answer(path, monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(feeds, "connect_packet", interrupted)
    assert command.main(["--fleet", str(path), "--natnet", "127.0.0.1"]) == 130
    assert capsys.readouterr().err == "edge-pose: interrupted\n"


def test_an_old_motive_is_refused():
    with (
        Motive((3, 1)) as motive,
        pytest.raises(ConfigError, match=r"^--natnet 127\.0\.0\.1: NatNet 3\.1: only"),
    ):
        NatNetFeed("127.0.0.1", {}, "y", motive.port)


@pytest.mark.parametrize(
    "line, expected",
    [
        ('{"t": 0, "robot": 0}', "line 1: a line has either `x` and `y`, or `ranges`"),
        ('{"t": 0, "robot": 0, "x": 1, "y": 2, "ranges": []}', "line 1: a line has either"),
        ('{"t": 0, "robot": 0, "x": 1, "y": 2, "vx": 1}', "line 1: `vx` and `vy` go together"),
        ('{"t": 0, "robot": 0, "z": 1, "ranges": [1]}', "line 1: `z` needs `x` and `y`"),
        ('{"t": 0, "robot": 0, "x": 1, "y": 2, "vx": 0, "vy": 0, "vz": 0}', "line 1: `vz` goes with"),
        ('{"t": 0, "robot": 0, "x": 1, "y": 2, "z": 3, "vx": 0, "vy": 0}', "line 1: `vz` goes with"),
        ('{"t": 0, "robot": 0, "x": 1, "y": 2, "z": 1e7}', "line 1: `z` must lie in"),
        ('{"t": 0, "robot": 0, "x": 1e999, "y": 2}', "line 1: "),
        ('{"t": 0, "robot": 0, "x": 1, "y": -2e6}', "line 1: `y` must lie in [-1e+06, 1e+06], got -2e+06"),
        (
            '{"t": 0, "robot": 0, "x": 1, "y": 2, "vx": 0, "vy": 2e3}',
            "line 1: `vy` must lie in [-1000, 1000], got 2000",
        ),
        (
            '{"t": 1, "robot": 0, "ranges": [1]}\n{"t": 0, "robot": 0, "ranges": [1]}',
            "line 2: t goes back to 0",
        ),
        (
            f'{{"t": 0, "robot": 0, "ranges": {[0] * 1025}}}',
            "line 1: `ranges` has 1025 numbers, at most 1024",
        ),
        ('{"t": ' + "[" * 100_000, "line 1: "),
        ("", "is empty"),
        ("t, robot", "line 1: "),
    ],
)
def test_recordings_that_do_not_hold_together(tmp_path, line, expected):
    file = tmp_path / "poses.jsonl"
    file.write_text(line)
    with pytest.raises(ConfigError) as caught:
        read_recording(file)
    assert str(caught.value).startswith(f"{file}: {expected}")
    assert "\n" not in str(caught.value)


def test_a_recording_of_ranges(tmp_path):
    file = tmp_path / "ranges.jsonl"
    file.write_text('{"t": 0.5, "robot": 3, "ranges": [0.1, 0.35]}\n')
    assert read_recording(file) == [Sample(t=0.5, robot=3, ranges=(0.1, 0.35))]


@pytest.mark.parametrize(
    "flags, expected",
    [
        ([], "one of the arguments --natnet --replay is required"),
        (["--natnet", "motive"], "argument --natnet: must be an IPv4 address, got 'motive'"),
        (
            ["--replay", "{file}", "--listen", "127.0.0.1:9"],
            "--listen must be one of the fleet's streams",
        ),
        (["--replay", "{file}"], "{file}: robot 1 does not get its poses from here"),
        (["--replay", "{file}.none"], "{file}.none: cannot be read (No such file or directory)"),
        (["--replay", "{file}", "--key-file", "{file}"], "key {file} is open to other users"),
    ],
)
def test_bad_input_is_one_line(path, tmp_path, capsys, flags, expected):
    file = tmp_path / "poses.jsonl"
    file.write_text('{"t": 0, "robot": 1, "x": 1, "y": 2}\n')
    file.chmod(0o644)
    assert command.main(["--fleet", str(path), *(flag.format(file=file) for flag in flags)]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith("edge-pose: " + expected.format(file=file))
    assert complaint.count("\n") == 1


def test_a_robot_of_the_plane_has_no_height(path, tmp_path, capsys):
    file = tmp_path / "poses.jsonl"
    file.write_text('{"t": 0, "robot": 0, "x": 1, "y": 2, "z": 3}\n')
    assert command.main(["--fleet", str(path), "--replay", str(file)]) == 2
    said = f"{file}: robot 0 moves in the plane: its poses have no z"
    assert said in capsys.readouterr().err


def test_an_object_among_robots_in_space_has_a_height(path, tmp_path, capsys):
    flat = path.read_text().replace("[0, ", "[0, 0, ").replace("[1, ", "[1, 0, ")
    place = re.search(r'pose = "(.*?)"', flat)[1]
    path.write_text(f'{flat}[[tracked]]\nname = "person"\npose = "{place}"\n')
    file = tmp_path / "poses.jsonl"
    file.write_text('{"t": 0, "object": "person", "x": 1, "y": 2}\n')
    assert command.main(["--fleet", str(path), "--replay", str(file)]) == 2
    said = f"{file}: object 'person' is among robots in space: its poses need z"
    assert said in capsys.readouterr().err
