"""NatNet frames against the published layout and another reader; whatever else arrives raises one error."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from natnet.data_frame import DataFrame
from natnet.packet_buffer import PacketBuffer
from natnet.version import Version
from natnet_packets import frame, packet, rigid_body, server_info

from edge_runtime.errors import ConfigError
from edge_runtime.tools.pose.natnet import (
    Body,
    NatNetError,
    Server,
    check_version,
    connect_packet,
    keep_alive_packet,
    read_frame,
    read_server,
)

VERSIONS = [(4, 0), (4, 1), (4, 2)]
singles = st.floats(-1e3, 1e3, width=32)
bodies = st.lists(
    st.tuples(st.integers(0, 2**31 - 1), st.tuples(*[singles] * 3), st.tuples(*[singles] * 4), st.booleans()),
    max_size=5,
)


@pytest.mark.parametrize("version", VERSIONS)
@settings(deadline=None)
@given(wanted=bodies, stamp_s=st.floats(0, 1e6), sets=st.integers(0, 3), unlabelled=st.integers(0, 4))
def test_rigid_bodies_and_the_stamp_are_found_among_everything_else(
    version, wanted, stamp_s, sets, unlabelled
):
    found = read_frame(
        frame([rigid_body(*body) for body in wanted], stamp_s, version, sets, unlabelled), version
    )
    assert found.stamp_s == stamp_s
    assert found.bodies == tuple(Body(*body) for body in wanted)


@pytest.mark.parametrize("version", VERSIONS)
def test_another_reader_reads_the_same(version):
    tracked = rigid_body(3, (1.5, 2.5, 3.5), (0.0, 0.6, 0.0, 0.8))
    content = frame([tracked, rigid_body(4, (0.0,) * 3, tracked=False)], 7.25, version)
    theirs = DataFrame.read_from_buffer(PacketBuffer(content[4:]), Version(*min(version, (4, 1))))
    ours = read_frame(content, version)
    assert ours.stamp_s == theirs.suffix.timestamp
    for mine, other in zip(ours.bodies, theirs.rigid_bodies, strict=True):
        assert (mine.id, mine.position_m) == (other.id_num, tuple(other.pos))
        assert mine.quaternion == tuple(other.rot)
        assert mine.tracked == other.tracking_valid


def test_the_server_tells_its_version_and_its_group():
    assert read_server(server_info((4, 0))) == Server((4, 0), None)
    assert read_server(server_info((4, 1), "239.255.42.99")) == Server((4, 1), ("239.255.42.99", 1511))
    assert read_server(packet(7, b"")) is None


@pytest.mark.parametrize(
    ("version", "update"), [((3, 1), "Motive"), ((4, 3), "cfpg-edge"), ((5, 0), "cfpg-edge")]
)
def test_versions_that_are_not_read(version, update):
    for read in VERSIONS:
        check_version(read)
    message = rf"NatNet {version[0]}\.{version[1]}: only 4\.0 to 4\.2 are read; update {update}$"
    with pytest.raises(ConfigError, match=message):
        check_version(version)


@pytest.mark.parametrize("stamp_s", [math.nan, math.inf, -1.0, 1e300])
def test_stamps_that_no_clock_has(stamp_s):
    with pytest.raises(NatNetError, match="its time stamp is"):
        read_frame(frame([], stamp_s), (4, 1))


def test_what_a_client_says():
    """sSender and sConnectionOptions of the SDK: a name, two versions, a flag, the bitstream wanted."""
    content = connect_packet()
    assert struct.unpack_from("<HH", content) == (0, 269)
    assert content[4:14] == b"edge-pose\0"
    assert content[4 + 265 :] == bytes([4, 1, 0, 0])
    assert keep_alive_packet() == struct.pack("<HH", 10, 0)


@pytest.mark.parametrize("version", VERSIONS)
def test_other_messages_are_no_frames(version):
    assert read_frame(server_info(), version) is None


@pytest.mark.parametrize("version", VERSIONS)
def test_a_cut_frame_is_one_error(version):
    whole = frame([rigid_body(1, (0.0,) * 3)], 1.0, version)
    for size in range(len(whole)):
        with pytest.raises(NatNetError):
            read_frame(whole[:size], version)


@settings(deadline=None)
@given(payload=st.binary(max_size=300), version=st.sampled_from(VERSIONS))
def test_junk_is_an_error_or_a_frame(payload, version):
    try:
        found = read_frame(packet(7, payload), version)
    except NatNetError:
        return
    assert math.isfinite(found.stamp_s)


def test_a_body_that_is_not_finite_is_not_tracked():
    (body,) = read_frame(frame([rigid_body(1, (math.nan, 0.0, 0.0))], 1.0), (4, 1)).bodies
    assert not body.tracked


@pytest.mark.parametrize("heading", [-2.0, 0.0, 0.5, 3.0])
def test_the_plane_and_the_heading(heading):
    """Turning about the axis that points up turns the heading by as much; with y up, left of x is -z."""
    half = heading / 2
    y_up = Body(1, (1.0, 9.0, -2.0), (0.0, math.sin(half), 0.0, math.cos(half)), True)
    z_up = Body(1, (1.0, 2.0, 9.0), (0.0, 0.0, math.sin(half), math.cos(half)), True)
    for body, up in ((y_up, "y"), (z_up, "z")):
        position, found = body.seen(up, 2)
        assert position == (1.0, 2.0)
        assert body.seen(up, 3) == ((1.0, 2.0, 9.0), found)
        assert found == pytest.approx(heading)
