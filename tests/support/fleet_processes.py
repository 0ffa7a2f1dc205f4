"""Teams of processes on the loopback."""

import json
import queue
import signal
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

from bundles import MANIFEST
from paths import SUPPORT
from ports import free_port
from waiting import HANG_S

from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.messages import RobotState
from edge_runtime.network.order_wire import Stop, encode_order
from edge_runtime.network.seal import Magic
from edge_runtime.network.team_wire import FRAME_BYTES, Frame, encode
from edge_runtime.policy.bundle import Bundle

UNREACHABLE = 2**40
"""A sequence that no robot of these tests reaches."""


def mission(path, robot_id=0):
    fleet = load_fleet(path)
    return Mission(robot_id, fleet, Bundle(MANIFEST, None, Path()), fleet.objective_set, 50.0)


def robot(robot_id, extra=""):
    host, port = free_port()
    place = f"start_m = [0, {robot_id}]\ngoal_m = [1, {robot_id}]"
    return f'[[robots]]\nid = {robot_id}\n{place}\naddress = "{host}:{port}"\n{extra}\n'


class Process:
    """A robot of the team in a process of its own; read all the time, for a full pipe would hold it up."""

    def __init__(self, path, robot_id, loss, stack):
        program = SUPPORT / "fleet_process.py"
        command = [sys.executable, str(program), str(path), str(robot_id), str(loss)]
        self.process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        self._lines = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        stack.callback(self._kill)

    def _read(self):
        for line in self.process.stdout:
            self._lines.put(line)
        self._lines.put("")

    def _kill(self):
        self.process.kill()
        self._reader.join()

    def tick(self):
        """The first tick that was not taken yet."""
        return json.loads(self._lines.get(timeout=HANG_S))

    def rest(self):
        """The ticks not taken yet, and the report, of a process that ends by itself."""
        *ticks, report = map(json.loads, iter(partial(self._lines.get, timeout=HANG_S), ""))
        assert self.process.wait(HANG_S) == 0
        return ticks, report

    def end(self):
        """End it; the ticks not taken yet, and the report."""
        self.process.send_signal(signal.SIGTERM)
        return self.rest()


def hostile(draw):
    """A frame by somebody who knows everything but the key."""
    state = RobotState(draw.choice([1, 2]), draw.uniform(0, 1e6), (9.0, 9.0), (0.0, 0.0))
    sequence = UNREACHABLE + draw.randrange(2**32)
    frame = Frame(
        0, draw.getrandbits(64), sequence, draw.getrandbits(64), draw.getrandbits(64), state, (1.0, 1.0)
    )
    packet = bytearray(encode(frame, draw.randbytes(32)))
    kind = draw.randrange(6)
    if kind == 0:
        return draw.randbytes(draw.randrange(2 * FRAME_BYTES))
    if kind == 1:
        packet[-32:] = bytes(32)
    elif kind == 2:
        packet = packet[: draw.randrange(FRAME_BYTES)]
    elif kind == 3:
        packet = encode_order(Stop(1, 2, 0, draw.getrandbits(64), 1e12), draw.randbytes(32))
    elif kind == 4:
        packet = Magic.ORDER + draw.randbytes(draw.randrange(2 * FRAME_BYTES))
    return bytes(packet)
