"""Pose and range streams over real sockets: fresh ones only, from whom holds the key, in the team's frame."""

import hashlib
import math
import socket
import time
from contextlib import ExitStack

import msgspec
import pytest
from bundles import MANIFEST
from fleet_processes import mission, robot
from hypothesis import given, settings
from hypothesis import strategies as st
from ports import free_port
from waiting import until

from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.network import endpoint
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, RobotState
from edge_runtime.motion.models import LinearTable, Unicycle
from edge_runtime.network.datagrams import Datagram
from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.network.stream_wire import Kind, StreamFrame, decode_stream, encode_stream
from edge_runtime.team.frame_rotation import ActionAxes, action_axes, turned
from edge_runtime.team.membership import Alone, open_fleet
from edge_runtime.team.streams import Stream, Streams
from edge_runtime.tools.pose.stream_host import StreamHost

KEY = hashlib.sha256(b"a key for tests").digest()
POSE = (1.0, 2.0, 0.1, 0.2, 0.5, -0.25)
RAYS = MANIFEST.body.lidar_rays

numbers = st.floats(allow_nan=False, allow_infinity=False)
longs = st.integers(0, 2**64 - 1)
places, speeds = st.floats(-1e6, 1e6), st.floats(-1e3, 1e3)
values = st.one_of(st.tuples(*[places] * dims, *[speeds] * dims, places, places) for dims in (2, 3))


def bridge_state(heading_rad=0.0):
    return RobotState(0, time.monotonic(), (50.0, 50.0), (9.0, 9.0), heading_rad)


@pytest.fixture
def place():
    return free_port()


@pytest.fixture
def path(tmp_path, place):
    """A fleet of one robot that gets pose and ranges from one place."""
    (tmp_path / "team.key").write_bytes(KEY)
    (tmp_path / "team.key").chmod(0o600)
    file = tmp_path / "fleet.toml"
    source = f"{place[0]}:{place[1]}"
    file.write_text('[carrier]\nkey = "team.key"\n' + robot(0, f'pose = "{source}"\nranges = "{source}"'))
    return file


@pytest.fixture
def link(path):
    with open_fleet(mission(path), Alone()) as link:
        yield link


def host_for(path, place, key=KEY):
    robots = {member.id: endpoint(member.address) for member in load_fleet(path).robots}
    return StreamHost(place, robots, robots, robots, key)


def exchange(link, host, condition, pose=POSE, ranges=(0.3,) * RAYS):
    """Publish and tick until something holds; streams need a few packets to trust each other."""

    def tick():
        host.listen(0.005)
        now = time.monotonic()
        host.publish(Kind.POSE, 0, now, pose)
        host.publish(Kind.RANGES, 0, now, ranges)
        return condition(link.locate(bridge_state()))

    return until(tick)


def test_a_robot_goes_by_its_streams(path, place, link):
    assert link.locate(bridge_state()) is None  # nobody speaks yet
    with host_for(path, place) as host:

        def whole(own):
            view = own and link.team(own)
            return view if view and view.ranges_m and not view.fault else None

        view = exchange(link, host, whole)
    located = view.own
    assert (located.position_m, located.velocity_m_s, located.heading_rad) == ((1.0, 2.0), (0.1, 0.2), 0.5)
    assert view.ranges_m == (0.3,) * RAYS
    assert link.locate(None) is None  # the base says nothing: a pose alone does not drive it


def test_a_stale_stream_stops_the_robot_and_its_return_lets_it_go_on(path, place, link):
    with host_for(path, place) as host:
        exchange(link, host, lambda own: own and link.team(own).fault == "")
        time.sleep(0.12)
        own = link.locate(bridge_state())
        assert link.team(own).fault == "the pose stream is older than 0.1 s"
        assert time.monotonic() - own.stamp_s > 0.1
        exchange(link, host, lambda own: own and link.team(own).fault == "")


def test_a_stale_bridge_makes_a_fresh_pose_stale(path, place, link):
    with host_for(path, place) as host:
        exchange(link, host, bool)
        old = bridge_state()
        time.sleep(0.02)
        host.publish(Kind.POSE, 0, time.monotonic(), POSE)
        assert link.locate(old).stamp_s <= old.stamp_s


def test_a_host_that_starts_anew_is_heard_again(path, place, link):
    for _ in range(2):
        with host_for(path, place) as host:
            exchange(link, host, lambda own: own and link.team(own).fault == "")


def test_a_robot_that_starts_anew_hears_again(path, place):
    with host_for(path, place) as host:
        for _ in range(2):
            with open_fleet(mission(path), Alone()) as link:
                exchange(link, host, lambda own: own and link.team(own).fault == "")


def test_recorded_and_forged_frames_are_refused(path, place):
    """A recording of one run is played to the next one, by somebody who sends from anywhere."""
    place_of_robot = endpoint(load_fleet(path).robots[0].address)
    with ExitStack() as stack:
        link = stack.enter_context(open_fleet(mission(path), Alone()))
        host = stack.enter_context(host_for(path, place))
        recorded = []
        receive = link._carrier.receive
        link._carrier.receive = lambda: (recorded.append(d.content) or d for d in receive())
        exchange(link, host, lambda own: own and len(recorded) > 20)
    with (
        open_fleet(mission(path), Alone()) as link,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hostile,
    ):
        for packet in recorded:
            hostile.sendto(packet, place_of_robot)
            forged = bytearray(packet)
            forged[-1] ^= 1
            hostile.sendto(forged, place_of_robot)

        def all_refused():  # a tick takes only so many
            assert link.locate(bridge_state()) is None
            refused = link.report().refused
            return sum(refused.values()) >= 2 * len(recorded) and refused

        refused = until(all_refused)
        assert refused["unanswered"] == refused["foreign"] == len(recorded)
        with host_for(path, place) as host:
            exchange(link, host, bool)


def test_a_host_without_the_key_is_not_heard(path, place, link):
    with host_for(path, place, b"x" * 32) as host:
        for _ in range(30):
            host.listen(0.005)
            host.publish(Kind.POSE, 0, time.monotonic(), POSE)
            assert link.locate(bridge_state()) is None


def test_commands_are_turned_into_the_frame_of_the_odometry(path, place, link):
    """The base's heading has drifted by a quarter turn: what the team calls x, it calls y."""
    with host_for(path, place) as host:
        exchange(link, host, bool)
        link.locate(bridge_state(heading_rad=0.5 + math.pi / 2))
        command = link.for_base(Command(0, 1, 2.0, (1.0, 0.5), (0.3, 0.0)))
    assert command.velocity_m_s == pytest.approx((0.0, 0.3))
    assert command.action == pytest.approx((-0.5, 1.0))


@settings(deadline=None)
@given(
    action=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    velocity=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    others=st.lists(st.floats(-1, 1), max_size=2).map(tuple),
    angle=st.floats(-7, 7),
)
def test_turning_keeps_the_speed_and_every_limit(action, velocity, others, angle):
    low, high = (-1.0, -0.25, -1.0, -1.0), (0.5, 1.0, 1.0, 1.0)
    axes = ActionAxes(True, low[: 2 + len(others)], high[: 2 + len(others)])
    command = turned(Command(0, 1, 2.0, (*action, *others), (*velocity, 0.5)), angle, axes)
    assert math.hypot(*command.velocity_m_s[:2]) == pytest.approx(math.hypot(*velocity))
    assert command.velocity_m_s[2] == 0.5
    assert command.action[2:] == others
    for value, least, most in zip(command.action, low, high, strict=False):
        assert least * (1 + 1e-12) <= value <= most * (1 + 1e-12)
    command = msgspec.structs.replace(command, action=command.action[:2])
    expected = complex(*action) * complex(math.cos(angle), math.sin(angle))
    assert (complex(*command.action) * expected.conjugate()).imag == pytest.approx(0.0, abs=1e-9)


def test_what_a_unicycle_does_depends_on_no_axes_and_a_table_cannot_be_turned():
    manifest = msgspec.structs.replace(MANIFEST, motion=Unicycle(0.1))
    command = Command(0, 1, 2.0, (1.0, 0.5), (0.3, 0.0), 0.5)
    there = turned(command, math.pi / 2, action_axes(manifest))
    assert (there.action, there.yaw_rate_rad_s) == ((1.0, 0.5), 0.5)
    assert there.velocity_m_s == pytest.approx((0.0, 0.3))
    table = LinearTable(0.1, (0.9, 0.9), ((0.1,), (0.0,)), (0.1, 0.1), ((0.0,), (0.0,)))
    with pytest.raises(ConfigError, match=r"\(table\) holds along the team's axes"):
        action_axes(msgspec.structs.replace(MANIFEST, motion=table))


@settings(deadline=None)
@given(
    frame=st.builds(
        StreamFrame, st.just(Kind.POSE), st.integers(0, 65535), longs, longs, longs, longs, numbers, values
    )
)
def test_frames_survive_the_way(frame):
    assert decode_stream(encode_stream(frame, KEY), KEY) == frame


def refusal(packet):
    with pytest.raises(FrameError) as caught:
        decode_stream(packet, KEY)
    return caught.value.cause


def test_every_altered_bit_is_noticed():
    packet = encode_stream(StreamFrame(Kind.POSE, 1, 2, 3, 4, 5, 6.0, POSE), KEY)
    for bit in range(8 * len(packet)):
        altered = bytearray(packet)
        altered[bit // 8] ^= 1 << bit % 8
        assert refusal(bytes(altered)) is (Refusal.MALFORMED if bit < 32 else Refusal.FOREIGN)


@pytest.mark.parametrize(
    "kind, wrong, cause",
    [
        (Kind.POSE, POSE[:5], Refusal.MALFORMED),
        (Kind.POSE, (*POSE, 0.0), Refusal.MALFORMED),
        (Kind.POSE_REQUEST, POSE, Refusal.MALFORMED),
        (9, (), Refusal.MALFORMED),
        (Kind.RANGES, (math.inf,), Refusal.NOT_FINITE),
        (Kind.POSE, (math.nan, *POSE[1:]), Refusal.NOT_FINITE),
        (Kind.POSE, (1.1e6, *POSE[1:]), Refusal.MALFORMED),
        (Kind.POSE, (*POSE[:3], -1.1e3, *POSE[4:]), Refusal.MALFORMED),
        (Kind.POSE, (*POSE[:5], 1e300), Refusal.MALFORMED),
        (Kind.RANGES, (0.3, 1e7), Refusal.MALFORMED),
    ],
)
def test_what_holds_the_key_but_makes_no_sense_is_refused(kind, wrong, cause):
    assert refusal(encode_stream(StreamFrame(kind, 1, 2, 3, 4, 5, 6.0, wrong), KEY)) is cause


def test_ranges_of_another_sensor_are_refused():
    stream = Stream(-2, 0, Kind.RANGES_REQUEST, Kind.RANGES, (RAYS,), KEY, None)
    streams = Streams(0, None, stream, KEY)
    packet = encode_stream(StreamFrame(Kind.RANGES, 0, 2, 3, 4, 5, 6.0, (0.1,) * (RAYS - 1)), KEY)
    with pytest.raises(FrameError) as caught:
        streams.handle(Datagram(packet, None, 0.0))
    assert caught.value.cause is Refusal.MALFORMED


def test_a_place_that_is_taken_is_refused(path, place):
    with (
        host_for(path, place),
        pytest.raises(ConfigError, match=r"cannot listen on .* \(Address already"),
    ):
        host_for(path, place)
