"""Arrivals by the kernel's stamps: a late receiver sees how long a packet waited, whatever its clock says."""

import socket
import struct
import sys
import time

import pytest
from waiting import until

from edge_runtime.network.arrival_time import ArrivalClock, clocks_together
from edge_runtime.network.udp import UdpCarrier

STAMP_KIND = 35


class Socket:
    def setsockopt(self, *_):
        pass


class Clocks:
    """A monotonic clock, and a wall clock that somebody may set."""

    def __init__(self):
        self.now_s, self.wall_ahead_s = 100.0, 1.7e9
        self.arrivals = ArrivalClock(Socket(), lambda: self.now_s, lambda: self.now_s + self.wall_ahead_s)

    def stamp(self, arrival_s, kind=STAMP_KIND):
        seconds, rest = divmod(arrival_s + self.wall_ahead_s, 1.0)
        return [(socket.SOL_SOCKET, kind, struct.pack("@ll", int(seconds), int(1e9 * rest)))]

    def drain(self, *stamps, at_s, empties=True):
        self.now_s = at_s
        self.arrivals.begin()
        told = [self.arrivals.arrival_s(stamp) for stamp in stamps]
        if empties:
            self.arrivals.emptied()
        return told


def test_who_is_held_up_between_the_clocks_reads_them_again():
    monotonic, wall = iter([1.0, 1.001, 1.5, 1.50001]), iter([101.001, 101.5])
    assert clocks_together(lambda: next(monotonic), lambda: next(wall)) == (1.5, 101.5)


def test_a_stamp_tells_the_arrival_in_monotonic_time():
    clocks = Clocks()
    clocks.drain(at_s=101.0)
    assert clocks.drain(clocks.stamp(101.3), at_s=101.5) == [pytest.approx(101.3, abs=1e-6)]


def test_what_waited_before_the_first_drain_counts_as_arriving_now():
    clocks = Clocks()
    assert clocks.drain(clocks.stamp(50.0), at_s=101.0) == [101.0]


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0, 0.01, -0.01])
def test_a_clock_that_is_set_makes_no_message_younger_or_older(jump_s):
    clocks = Clocks()
    clocks.drain(at_s=101.0)
    before = clocks.stamp(101.3)
    clocks.wall_ahead_s += jump_s
    after = clocks.stamp(101.4)
    assert clocks.drain(before, after, at_s=101.5, empties=False) == [101.5, 101.5]
    assert clocks.drain(before, at_s=101.6) == [101.6]  # the queue was not empty in between
    assert clocks.drain(clocks.stamp(101.7), at_s=101.8) == [pytest.approx(101.7, abs=1e-6)]


def test_a_clock_that_is_slewed_stays_trusted():
    clocks = Clocks()
    clocks.drain(at_s=101.0)
    for step in range(1, 100):
        clocks.wall_ahead_s += 500e-6 * 0.02
        at_s = 101.0 + 0.02 * step
        assert clocks.drain(clocks.stamp(at_s - 0.01), at_s=at_s) == [pytest.approx(at_s - 0.01, abs=2e-5)]


def test_without_a_stamp_the_drain_is_the_arrival():
    clocks = Clocks()
    clocks.drain(at_s=101.0)
    assert clocks.drain([], clocks.stamp(101.2, kind=29), at_s=101.5) == [101.5, 101.5]


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's stamps are Linux's")
def test_the_kernel_stamps_what_waits_in_the_queue():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        place = probe.getsockname()
    carrier = UdpCarrier(place, {1: place})
    try:
        assert list(carrier.receive()) == []

        def stamped():
            earliest = time.monotonic()
            carrier.send(1, b"x")
            latest = time.monotonic()
            time.sleep(0.05)
            (datagram,) = until(lambda: list(carrier.receive()))
            return earliest - 1e-3 <= datagram.arrival_s <= latest + 1e-3

        until(stamped)  # Linux turns stamping on in the background when the first socket asks for it
    finally:
        carrier.close()
