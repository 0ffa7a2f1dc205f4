"""Threads put in, one takes out: nothing is lost, all is in order, and too much is said."""

import select
import threading

import pytest

from edge_runtime.errors import BridgeError
from firmware_bridge.ros.inbox import MOST, Inbox


@pytest.fixture
def inbox():
    inbox = Inbox()
    yield inbox
    inbox.close()


def test_it_is_readable_while_something_waits(inbox):
    assert not select.select([inbox], [], [], 0.0)[0]
    inbox.put(1)
    inbox.put(2)
    assert select.select([inbox], [], [], 0.0)[0]
    assert inbox.take() == [1, 2]
    assert not select.select([inbox], [], [], 0.0)[0]
    assert inbox.take() == []


def test_what_other_threads_put_in_arrives_in_their_order(inbox):
    threads = [
        threading.Thread(target=lambda first=first: [inbox.put((first, n)) for n in range(60)])
        for first in range(4)
    ]
    for thread in threads:
        thread.start()
    taken = []
    while len(taken) < 240:
        select.select([inbox], [], [])
        taken += inbox.take()
    for thread in threads:
        thread.join()
    for first in range(4):
        assert [n for source, n in taken if source == first] == list(range(60))


def test_as_many_as_may_wait_are_taken(inbox):
    for number in range(MOST):
        inbox.put(number)
    assert inbox.take() == list(range(MOST))


def test_a_flood_is_bounded_and_told(inbox):
    for number in range(100 * MOST):
        inbox.put(number)
    with pytest.raises(BridgeError, match=f"over {MOST} messages"):
        inbox.take()
    inbox.put(1)
    assert inbox.take() == [1]


def test_after_it_closed_putting_in_is_harmless():
    inbox = Inbox()
    inbox.close()
    inbox.put(1)
