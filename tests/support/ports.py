"""Ports of the loopback that nobody uses, and no other test is given: several run at once."""

import errno
import random
import socket
from collections import deque

PORTS = range(20_000, 32_000)
"""Below those that the system gives to sockets that ask for none."""
_claims = deque(maxlen=200)


def free_port(host="127.0.0.1"):
    """A host and a port of it that is free for UDP and for TCP."""
    while True:
        port = random.SystemRandom().choice(PORTS)
        if _claim(port) and _is_free(host, port):
            return host, port


def _claim(port):
    """Take a port for this process: by a name that the kernel gives only once."""
    claim = socket.socket(socket.AF_UNIX)
    try:
        claim.bind(f"\0a port for a test: {port}")
    except OSError:
        return False
    _claims.append(claim)
    return True


def _is_free(host, port):
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        for kind in (socket.SOCK_DGRAM, socket.SOCK_STREAM):
            with socket.socket(family, kind) as probe:
                probe.bind((host, port))
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return False
    return True
