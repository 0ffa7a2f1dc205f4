"""The logger's end of the socket: all that was sent, in order, whatever becomes of who sent it."""

import os
import signal
import socket
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from waiting import until

import edge_runtime.recording.inbox as inbox_module
from edge_runtime.recording.inbox import Inbox


def pair():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    return ours, theirs


def all_of(inbox):
    """What is taken until the sender's end is closed."""
    taken = []
    while not inbox.over.wait(0.001):
        taken += inbox.drain()
    return [*taken, *inbox.drain()]


@pytest.fixture(autouse=True)
def _often(monkeypatch):
    monkeypatch.setattr(inbox_module, "LOOK_S", 0.001)


@settings(deadline=None, max_examples=30)
@given(packets=st.lists(st.binary(min_size=1, max_size=5000), max_size=30))
def test_every_packet_comes_once_and_in_order(packets):
    sender, connection = pair()
    with sender, connection:
        inbox = Inbox(connection)
        for packet in packets:
            sender.send(packet)
        sender.close()
        assert all_of(inbox) == packets


def test_what_a_killed_process_sent_is_there():
    """Though it left our report unread, which the system tells as a reset."""
    sender, connection = pair()
    code = (
        "import os, signal, socket, sys; ours = socket.socket(fileno=int(sys.argv[1]))\n"
        "for number in range(100): ours.send(b'%d' % number)\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    with connection:
        connection.send(b"a report")
        command = [sys.executable, "-c", code, str(sender.fileno())]
        process = subprocess.Popen(command, pass_fds=(sender.fileno(),))
        sender.close()
        assert process.wait() == -signal.SIGKILL
        assert all_of(Inbox(connection)) == [b"%d" % number for number in range(100)]


def test_what_waits_for_the_disk_is_bounded_and_the_sender_is_told(monkeypatch):
    monkeypatch.setattr(inbox_module, "MOST_BYTES", 100_000)
    sender, connection = pair()
    packets = [os.urandom(1000) for _ in range(3000)]
    with sender, connection:
        inbox, sent = Inbox(connection), []

        def send_on():
            """Send until the socket is full, and stays full."""
            before = len(sent)
            try:
                while len(sent) < len(packets):
                    sender.send(packets[len(sent)])
                    sent.append(packets[len(sent)])
            except BlockingIOError:
                return inbox._collected >= 100_000 and len(sent) == before
            raise AssertionError("three megabytes fit")

        until(send_on)
        assert inbox._collected < 102_000
        sender.close()
        assert all_of(inbox) == sent
