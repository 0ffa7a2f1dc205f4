import hashlib
import os
import threading

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mavlink_peers import local_position, vehicle_frame
from pymavlink.dialects.v20 import common

import firmware_bridge.mavlink.signing as mavlink_signing
from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.mavlink.signing import (
    RESERVE_TICKS,
    SIGNATURE_BYTES,
    SignatureCheck,
    Signing,
    Timestamps,
    clock_ticks,
)

KEY = bytes(range(32))


class Wall:
    def __init__(self, tick):
        self.tick = tick

    def __call__(self):
        return self.tick


def write_key(path, content, mode=0o600):
    path.write_bytes(content)
    path.chmod(mode)
    return path


@pytest.fixture
def wall():
    return Wall(40_000_000_000_000)


@pytest.fixture
def timestamps(tmp_path, wall):
    return Timestamps(tmp_path / "timestamp", wall)


@pytest.fixture
def signing(timestamps):
    return Signing(KEY, timestamps)


def signed(tick, key=KEY, **where):
    return vehicle_frame(local_position(), signing=(key, tick), **where)


def renew_and_wait(timestamps):
    timestamps.renew()
    for thread in threading.enumerate():
        if thread.name == "signing-timestamp":
            thread.join()


class TestTimestamps:
    def test_ticks_follow_the_wall_clock_and_never_repeat(self, timestamps, wall):
        first = timestamps.next()
        assert (first, timestamps.next()) == (wall.tick + 1, wall.tick + 2)
        wall.tick += 1000
        assert timestamps.next() == wall.tick

    @given(jumps=st.lists(st.integers(-(10**12), 10**9), max_size=8), crash=st.booleans())
    @settings(max_examples=30, deadline=None)
    def test_no_tick_repeats_over_restarts_whatever_the_clock_does(self, tmp_path_factory, jumps, crash):
        path = tmp_path_factory.mktemp("ticks") / "timestamp"
        wall, used = Wall(40_000_000_000_000), []
        for jump in jumps:
            timestamps = Timestamps(path, wall)
            used += [timestamps.next(), timestamps.next()]
            wall.tick += jump
            used.append(timestamps.next())
            if not crash:
                timestamps.close()
        assert used == sorted(set(used))

    def test_a_clean_end_does_not_run_ahead_of_the_clock(self, tmp_path, timestamps, wall):
        last = timestamps.next()
        timestamps.close()
        assert Timestamps(tmp_path / "timestamp", wall).next() == last + 2

    def test_what_is_promised_is_on_disk_before_it_is_used(self, tmp_path, timestamps, wall):
        for jump in (0, RESERVE_TICKS, RESERVE_TICKS - 1, 5 * RESERVE_TICKS):
            wall.tick += jump
            assert timestamps.next() < int((tmp_path / "timestamp").read_text())

    def test_promises_are_synced_before_they_replace_the_old_ones(self, tmp_path, wall, monkeypatch):
        calls = []
        monkeypatch.setattr(os, "fsync", lambda file: calls.append(("fsync", os.fstat(file).st_size > 0)))
        replace = mavlink_signing.Path.replace
        monkeypatch.setattr(
            mavlink_signing.Path, "replace", lambda self, to: (calls.append("replace"), replace(self, to))[1]
        )
        Timestamps(tmp_path / "timestamp", wall)
        assert calls == [("fsync", True), "replace", ("fsync", True)]

    def test_renewal_happens_in_the_background_once_half_is_used(self, tmp_path, timestamps, wall):
        path = tmp_path / "timestamp"
        before = path.read_text()
        timestamps.next()
        renew_and_wait(timestamps)
        assert path.read_text() == before
        wall.tick += RESERVE_TICKS // 2
        timestamps.next()
        renew_and_wait(timestamps)
        assert int(path.read_text()) == timestamps.last + RESERVE_TICKS

    def test_a_full_disk_is_reported_by_the_frame_that_needs_it(self, tmp_path, timestamps, wall):
        (tmp_path / "timestamp.new").mkdir()
        wall.tick += RESERVE_TICKS // 2
        timestamps.next()
        timestamps._renew()
        wall.tick += RESERVE_TICKS
        with pytest.raises(BridgeError, match="make its folder writable"):
            timestamps.next()

    def test_a_damaged_file_is_refused(self, tmp_path, wall):
        (tmp_path / "timestamp").write_text("yesterday")
        with pytest.raises(ConfigError, match="restore it or delete it"):
            Timestamps(tmp_path / "timestamp", wall)

    def test_a_pipe_in_its_place_holds_nobody_up(self, tmp_path, wall):
        os.mkfifo(tmp_path / "timestamp")
        with pytest.raises(ConfigError, match="not a regular file; restore it or delete it"):
            Timestamps(tmp_path / "timestamp", wall)

    def test_the_last_ticks_of_all_are_not_used(self, tmp_path):
        last = 2**48 - 1 - RESERVE_TICKS
        assert Timestamps(tmp_path / "timestamp", Wall(last)).last == last
        with pytest.raises(BridgeError, match="no successors"):
            Timestamps(tmp_path / "another", Wall(last + 1))

    def test_the_folder_is_closed_again(self, tmp_path, wall):
        before = sum(1 for _ in mavlink_signing.Path("/proc/self/fd").iterdir())
        Timestamps(tmp_path / "timestamp", wall)
        assert sum(1 for _ in mavlink_signing.Path("/proc/self/fd").iterdir()) == before

    def test_one_promise_lasts_five_minutes(self):
        assert RESERVE_TICKS == 300 * 100_000

    def test_the_wall_clock_counts_from_2015(self, monkeypatch):
        monkeypatch.setattr(mavlink_signing.time, "time", lambda: 1_420_071_400.5)
        assert clock_ticks() == 100_050_000


class TestVerify:
    def test_a_frame_that_pymavlink_signed_is_accepted_once(self, signing, wall):
        frame = signed(wall.tick + 5)
        assert signing.verify(frame) is SignatureCheck.ACCEPTED
        assert signing.verify(frame) is SignatureCheck.REPLAYED

    def test_an_unsigned_frame_is_refused(self, signing):
        assert signing.verify(vehicle_frame(local_position())) is SignatureCheck.UNSIGNED

    def test_another_key_is_refused(self, signing, wall):
        assert signing.verify(signed(wall.tick + 5, key=KEY[::-1])) is SignatureCheck.ALTERED

    @given(data=st.data())
    @settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    def test_no_altered_bit_is_accepted(self, timestamps, data):
        frame = bytearray(signed(timestamps.last + 5))
        bit = data.draw(st.integers(0, 8 * len(frame) - 1))
        frame[bit // 8] ^= 1 << bit % 8
        assert Signing(KEY, timestamps).verify(bytes(frame)) is not SignatureCheck.ACCEPTED

    def test_older_frames_of_the_same_stream_are_refused(self, signing, wall):
        assert signing.verify(signed(wall.tick + 100)) is SignatureCheck.ACCEPTED
        assert signing.verify(signed(wall.tick + 99, sequence=1)) is SignatureCheck.REPLAYED
        assert signing.verify(signed(wall.tick + 99, component=2)) is SignatureCheck.ACCEPTED
        assert signing.verify(signed(wall.tick + 99, system=2)) is SignatureCheck.ACCEPTED

    def test_each_link_has_its_own_order(self, signing, wall):
        other = bytearray(signed(wall.tick + 99))
        other[-SIGNATURE_BYTES] = 1
        other[-6:] = hashlib.sha256(KEY + other[:-6]).digest()[:6]
        assert signing.verify(signed(wall.tick + 100)) is SignatureCheck.ACCEPTED
        assert signing.verify(bytes(other)) is SignatureCheck.ACCEPTED
        assert signing.verify(bytes(other)) is SignatureCheck.REPLAYED

    def test_a_forged_timestamp_does_not_lock_the_true_sender_out(self, signing, wall):
        assert signing.verify(signed(2**47, key=KEY[::-1])) is SignatureCheck.ALTERED
        assert signing.verify(signed(wall.tick + 5)) is SignatureCheck.ACCEPTED

    def test_what_was_recorded_before_a_restart_is_refused(self, tmp_path, wall):
        path = tmp_path / "timestamp"
        before = Signing(KEY, Timestamps(path, wall))
        recorded = signed(wall.tick + 5)
        assert before.verify(recorded) is SignatureCheck.ACCEPTED
        after = Signing(KEY, Timestamps(path, wall))
        assert after.verify(recorded) is SignatureCheck.REPLAYED

    def test_our_own_next_frame_is_newer_than_all_accepted_ones(self, signing, wall):
        signing.verify(signed(wall.tick + 10**6))
        assert signing.timestamps.next() > wall.tick + 10**6

    def test_a_peer_whose_clock_is_behind_catches_up_with_our_first_frame(self, signing, wall):
        """pymavlink takes our timestamp over, as the guide demands; from then on it is believed."""
        peer = common.MAVLink(None, srcSystem=1, srcComponent=1)
        peer.signing.secret_key, peer.signing.sign_outgoing = KEY, True
        peer.signing.timestamp = wall.tick - 10**9
        assert signing.verify(bytes(local_position().pack(peer))) is SignatureCheck.REPLAYED
        peer.decode(bytearray(signed(signing.timestamps.next(), system=255)))
        peer.signing.timestamp += 1
        assert signing.verify(bytes(local_position().pack(peer))) is SignatureCheck.ACCEPTED
